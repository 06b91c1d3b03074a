//! The folder that is written, which must not hurt what is there.

use crate::base::atomic::write_atomically;
use crate::base::error::{Error, Result};
use crate::base::input::check_not_read;
use crate::import::text::list;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

pub(super) struct Folder<'a> {
    root: &'a Path,
    replace: bool,
    /// Names within, with `/`.
    planned: Vec<String>,
}

impl<'a> Folder<'a> {
    pub fn new(root: &'a Path, replace: bool) -> Self {
        Self { root, replace, planned: Vec::new() }
    }

    /// A file that is going to be written.
    pub fn plan(&mut self, name: &str) {
        self.planned.push(name.to_owned());
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// Makes the folders; returns the number of files.
    ///
    /// # Errors
    /// If one is there, unless it is to be replaced; in any case if it was read.
    pub fn begin(&self) -> Result<usize> {
        let there = |name: &&String| self.path(name).symlink_metadata().is_ok();
        let there: Vec<&str> = self.planned.iter().filter(there).map(String::as_str).collect();
        if !(there.is_empty() || self.replace) {
            let problem = format!("the folder already holds {}", list(there));
            return Err(Error::new(
                problem,
                "name another folder, or give --force to replace them",
            )
            .at(self.root));
        }
        let paths = self.planned.iter().map(|name| self.path(name));
        paths.clone().try_for_each(|path| check_not_read(&path, "the copy"))?;
        for path in paths {
            let folder = path.parent().unwrap_or(self.root);
            std::fs::create_dir_all(folder).map_err(|e| Error::io("make the folder", folder, e))?;
        }
        Ok(self.planned.len())
    }

    /// Writes a part, quickly rather than all or nothing: there may be thousands, and the scene file,
    /// which comes last, makes them count.
    pub fn write_part(
        &self,
        name: &str,
        write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<()> {
        let path = self.path(name);
        let all = || {
            // What others link to stays as it is.
            let _ = std::fs::remove_file(&path);
            let mut file = BufWriter::with_capacity(1 << 18, File::create_new(&path)?);
            write(&mut file)?;
            file.flush()
        };
        all().map_err(|e| Error::io("write", &path, e))
    }

    /// Writes a file that appears complete or not at all.
    pub fn write(
        &self,
        name: &str,
        write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<()> {
        write_atomically(&self.path(name), |to| write(to))
    }
}
