//! Files that a command writes. They are checked before any work is done. If one of them fails at
//! the end, the others are written all the same.

use super::say;
use bdpm::base::atomic::check_writable;
use bdpm::base::error::{Error, Result};
use bdpm::base::file_id::FileId;
use bdpm::base::input::check_not_read;
use std::path::{Path, PathBuf};

/// A file to write.
#[derive(Clone, Copy)]
pub struct Output<'a> {
    /// Name for messages: the option that gives the path.
    pub what: &'a str,
    pub path: &'a Path,
    /// Required extension of the file name.
    pub extension: Option<&'a str>,
}

impl<'a> Output<'a> {
    pub fn new(what: &'a str, path: &'a Path, extension: Option<&'a str>) -> Self {
        Self { what, path, extension }
    }
}

/// Refuses files that cannot be written, and two paths to one file.
pub fn check(outputs: &[Output]) -> Result<()> {
    for (index, output) in outputs.iter().enumerate() {
        let Output { what, path, extension } = *output;
        check_writable(path, extension)?;
        let identity = FileId::of(path);
        let mut others = outputs[..index].iter();
        if let Some(other) = others.find(|other| FileId::of(other.path) == identity) {
            let problem = format!("{what} and {} are the same file", other.what);
            return Err(Error::new(problem, "give them different names").at(path));
        }
    }
    Ok(())
}

/// Refuses to replace a file that was read. Call it after all inputs were read.
pub fn spare_inputs(outputs: &[Output]) -> Result<()> {
    outputs.iter().try_for_each(|output| check_not_read(output.path, output.what))
}

/// Written files, and the errors of those that could not be written.
#[derive(Default)]
pub struct Attempts {
    written: Vec<PathBuf>,
    failures: Vec<Error>,
}

impl Attempts {
    /// Writes a file and keeps the error if that fails. Returns the value of `write`.
    pub fn add<T>(&mut self, path: &Path, write: impl FnOnce() -> Result<T>) -> Option<T> {
        match write() {
            Ok(value) => {
                self.written.push(path.to_owned());
                Some(value)
            }
            Err(error) => {
                self.failures.push(error);
                None
            }
        }
    }

    /// Returns all errors.
    pub fn failures(self) -> Result<()> {
        Error::all(self.failures)
    }

    /// Returns all errors. If there are any, first prints the files that were written.
    pub fn finish(self) -> Result<()> {
        if !(self.failures.is_empty() || self.written.is_empty()) {
            let names = self.written.iter().map(|path| path.display().to_string());
            say(&format!("written: {}", names.collect::<Vec<_>>().join(", ")));
        }
        self.failures()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_paths_to_one_file_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let (a, b, same) = (at("a.exr"), at("b.exr"), at("./a.exr"));
        let output = |what, path| Output { what, path, extension: Some("exr") };
        check(&[output("--output", &a), output("--noise", &b)]).unwrap();
        let both = check(&[output("--output", &a), output("--noise", &same)]);
        let shown = both.unwrap_err().to_string();
        assert!(shown.contains("a.exr: --noise and --output are the same file"), "{shown}");
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink("a.exr", &b).unwrap();
            assert!(check(&[output("--output", &a), output("--noise", &b)]).is_err());
        }
    }

    #[test]
    fn failed_write_does_not_stop_the_others() {
        let mut attempts = Attempts::default();
        let mut tried = 0;
        for file in ["a", "b", "c"] {
            attempts.add(Path::new(file), || {
                tried += 1;
                if file == "b" { Ok(()) } else { Err(Error::new("full", "free space").at(file)) }
            });
        }
        assert_eq!(tried, 3);
        let shown = attempts.finish().unwrap_err().to_string();
        assert!(shown.starts_with("a: full") && shown.contains("\nerror: c: full"), "{shown}");
        Attempts::default().finish().unwrap();
    }
}
