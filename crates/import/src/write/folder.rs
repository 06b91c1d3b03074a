//! The folder that is written. Existing files are protected.

use crate::text::list;
use bdpm_core::base::atomic::write_atomically;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::input::check_not_read;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

pub(super) struct ExportFolder<'a> {
    root: &'a Path,
    /// Whether existing files are replaced.
    replace: bool,
    /// Names in the folder, with `/`.
    planned: Vec<String>,
}

impl<'a> ExportFolder<'a> {
    pub fn new(root: &'a Path, replace: bool) -> Self {
        Self { root, replace, planned: Vec::new() }
    }

    /// Announces a file that will be written.
    pub fn plan(&mut self, name: &str) {
        self.planned.push(name.to_owned());
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.root.join(name)
    }

    /// Creates the folders, and returns the paths of the files.
    ///
    /// # Errors
    /// If a file exists and must not be replaced, or if this process has read it.
    pub fn begin(&self) -> Result<Vec<PathBuf>> {
        let exists = |name: &&String| self.path(name).symlink_metadata().is_ok();
        let existing: Vec<&str> = self.planned.iter().filter(exists).map(String::as_str).collect();
        if !(existing.is_empty() || self.replace) {
            let problem = format!("the folder already holds {}", list(existing));
            let advice = "name another folder, or allow its files to be replaced";
            return Err(Error::new(problem, advice).at(self.root));
        }
        let paths: Vec<PathBuf> = self.planned.iter().map(|name| self.path(name)).collect();
        paths.iter().try_for_each(|path| check_not_read(path, "the copy"))?;
        for path in &paths {
            let folder = path.parent().unwrap_or(self.root);
            std::fs::create_dir_all(folder).map_err(|e| Error::io("make the folder", folder, e))?;
        }
        Ok(paths)
    }

    /// Writes a part of the scene without the cost of atomic replacement. There may be thousands of
    /// parts, and only the scene file, which is written last, refers to them.
    pub fn write_part(
        &self,
        name: &str,
        write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<()> {
        let path = self.path(name);
        let all = || {
            // Removing the file keeps the content of hard links.
            let _ = std::fs::remove_file(&path);
            let mut file = BufWriter::with_capacity(1 << 18, File::create_new(&path)?);
            write(&mut file)?;
            file.flush()
        };
        all().map_err(|e| Error::io("write", &path, e))
    }

    /// Writes a file atomically.
    pub fn write(
        &self,
        name: &str,
        write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> Result<()> {
        write_atomically(&self.path(name), |to| write(to))
    }
}
