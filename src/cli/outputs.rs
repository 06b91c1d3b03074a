//! Files that a command writes: that they can be written is found out before any work is done, and one
//! that fails at the end keeps none of the others from being written.

use super::say;
use bdpm::base::atomic::check_writable;
use bdpm::base::error::{Error, Result};
use bdpm::base::file_id::FileId;
use bdpm::base::input::check_not_read;
use std::path::{Path, PathBuf};

/// A file to be written.
#[derive(Clone, Copy)]
pub struct Output<'a> {
    /// What it is, for messages: the option that names it.
    pub what: &'a str,
    pub path: &'a Path,
    /// That its name must have.
    pub extension: Option<&'a str>,
}

impl<'a> Output<'a> {
    pub fn new(what: &'a str, path: &'a Path, extension: Option<&'a str>) -> Self {
        Self { what, path, extension }
    }
}

/// Refuses files that cannot be written, and two that are one.
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

/// Refuses to replace what was read. All that is read must have been by now.
pub fn spare_inputs(outputs: &[Output]) -> Result<()> {
    outputs.iter().try_for_each(|output| check_not_read(output.path, output.what))
}

/// Files that were written, and those that could not be.
#[derive(Default)]
pub struct Attempts {
    written: Vec<PathBuf>,
    failures: Vec<Error>,
}

impl Attempts {
    /// Writes a file if that is possible; returns what `write` does.
    pub fn add<T>(&mut self, path: &Path, write: impl FnOnce() -> Result<T>) -> Option<T> {
        match write() {
            Ok(told) => {
                self.written.push(path.to_owned());
                Some(told)
            }
            Err(error) => {
                self.failures.push(error);
                None
            }
        }
    }

    /// All failures.
    pub fn failures(self) -> Result<()> {
        Error::all(self.failures)
    }

    /// The same; says what there is nevertheless.
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
    fn one_file_by_two_names_is_refused() {
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
    fn a_failure_keeps_nothing_else_from_being_written() {
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
