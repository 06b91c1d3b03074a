//! The one error type: a problem, its location in a file, and advice.

use crate::names::visible;
use std::fmt::{self, Write};
use std::path::{Path, PathBuf};

/// Shorthand for results of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// A problem that the user can act on. Shown as
///
/// ```text
/// scenes/a.toml:7: unknown key `albdo`
///   7 | albdo = 0.5
/// help: use one of `albedo`, `emission`
/// ```
#[derive(Debug, thiserror::Error)]
pub struct Error {
    problem: String,
    advice: String,
    location: Option<Box<Location>>,
    source: Option<Box<dyn std::error::Error + Send + Sync>>,
    /// Further independent problems.
    others: Vec<Error>,
    is_interrupt: bool,
}

/// The file, and the line in it, that a problem is about.
#[derive(Debug)]
struct Location {
    path: PathBuf,
    /// One-based line number and the line's text.
    line: Option<(usize, String)>,
}

impl Error {
    /// A problem in one sentence without a full stop, and what to do about it.
    pub fn new(problem: impl Into<String>, advice: impl Into<String>) -> Self {
        let (problem, advice) = (problem.into(), advice.into());
        Self {
            problem,
            advice,
            location: None,
            source: None,
            others: Vec::new(),
            is_interrupt: false,
        }
    }

    /// Several independent problems, shown one after the other.
    ///
    /// # Errors
    /// If `problems` is not empty.
    pub fn all(problems: impl IntoIterator<Item = Self>) -> Result<()> {
        let mut problems = problems.into_iter();
        match problems.next() {
            Some(first) => Err(Self { others: problems.collect(), ..first }),
            None => Ok(()),
        }
    }

    /// A failed operation on a file: `action` completes "cannot ...".
    pub fn io(action: &str, path: &Path, source: std::io::Error) -> Self {
        let advice = match source.kind() {
            std::io::ErrorKind::NotFound => "check the path",
            std::io::ErrorKind::PermissionDenied => "check the permissions",
            std::io::ErrorKind::StorageFull | std::io::ErrorKind::QuotaExceeded => {
                "free some disk space"
            }
            std::io::ErrorKind::FileTooLarge => "allow larger files: ulimit -f",
            _ => "check the file and its folder",
        };
        Self {
            problem: format!("cannot {action}: {source}"),
            source: Some(Box::new(source)),
            ..Self::new("", advice).at(path)
        }
    }

    /// The user interrupted the program before there was a result.
    pub fn interrupted() -> Self {
        let advice = "let the first iteration end, or ask for fewer paths";
        let problem = "interrupted before the first iteration was done: there is no image";
        Self::new(problem, advice).by_interrupt()
    }

    /// Marks the error as the result of an interrupt by the user.
    #[must_use]
    pub fn by_interrupt(self) -> Self {
        Self { is_interrupt: true, ..self }
    }

    /// Returns true if the user interrupted the program.
    pub fn is_interrupt(&self) -> bool {
        self.is_interrupt
    }

    /// The problem, without file and line.
    pub fn problem(&self) -> &str {
        &self.problem
    }

    /// The advice: how to solve the problem.
    pub fn advice(&self) -> &str {
        &self.advice
    }

    /// The file that the error names.
    pub fn path(&self) -> Option<&Path> {
        self.location.as_ref().map(|location| &*location.path)
    }

    /// The one-based line in [`Self::path`] that the error names.
    pub fn line_number(&self) -> Option<usize> {
        Some(self.location.as_ref()?.line.as_ref()?.0)
    }

    /// Returns true if the error names a file.
    pub fn has_location(&self) -> bool {
        self.location.is_some()
    }

    /// Replaces this error, and further independent ones, by the error that `replacement` returns
    /// for it, if there is one.
    #[must_use]
    pub fn replaced(mut self, replacement: &impl Fn(&Self) -> Option<Self>) -> Self {
        let others = std::mem::take(&mut self.others).into_iter();
        let others = others.map(|other| other.replaced(replacement)).collect();
        let is_interrupt = self.is_interrupt;
        Self { others, is_interrupt, ..replacement(&self).unwrap_or(self) }
    }

    /// Names the file.
    #[must_use]
    pub fn at(mut self, path: impl Into<PathBuf>) -> Self {
        self.location = Some(Box::new(Location { path: path.into(), line: None }));
        self
    }

    /// Names the one-based line and shows its text, unless it is empty; needs [`Self::at`] first.
    #[must_use]
    pub fn line(mut self, number: usize, text: impl Into<String>) -> Self {
        if let Some(location) = &mut self.location {
            location.line = Some((number, text.into()));
        }
        self
    }

    /// Names the line that holds the byte `offset` of `text`; needs [`Self::at`] first.
    #[must_use]
    pub fn at_offset(self, text: &str, offset: usize) -> Self {
        let mut offset = offset.min(text.len());
        while !text.is_char_boundary(offset) {
            offset -= 1;
        }
        let number = text[..offset].matches('\n').count();
        let line = text.lines().nth(number).unwrap_or_default();
        self.line(number + 1, line.trim_end())
    }
}

/// Writes text from a file, whose names also get into paths and advice.
fn write_visible(f: &mut fmt::Formatter<'_>, text: &str) -> fmt::Result {
    text.chars().try_for_each(|c| f.write_char(visible(c)))
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(location) = &self.location {
            write_visible(f, &location.path.display().to_string())?;
            if let Some((number, _)) = location.line {
                write!(f, ":{number}")?;
            }
            write!(f, ": ")?;
        }
        write_visible(f, &self.problem)?;
        if let Some((number, text)) =
            self.location.as_ref().and_then(|location| location.line.as_ref())
            && !text.is_empty()
        {
            // A minified file may be one long line: show its beginning only.
            let shown: String = text.chars().take(120).map(visible).collect();
            write!(f, "\n  {number} | {shown}")?;
        }
        f.write_str("\nhelp: ")?;
        write_visible(f, &self.advice)?;
        self.others.iter().try_for_each(|other| write!(f, "\nerror: {other}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn display_names_file_line_text_and_advice() {
        let text = "a = 1\nalbdo = 0.5\r\nb = 2\n";
        let error = Error::new("unknown key `albdo`", "use `albedo`").at("x.toml");
        assert_eq!((error.path(), error.line_number()), (Some(Path::new("x.toml")), None));
        let error = error.at_offset(text, 8);
        assert_eq!(error.line_number(), Some(2));
        let shown = error.to_string();
        assert_eq!(shown, "x.toml:2: unknown key `albdo`\n  2 | albdo = 0.5\nhelp: use `albedo`");
    }

    #[test]
    fn several_problems_are_shown_one_after_the_other() {
        Error::all([]).unwrap();
        let all = ["a", "b"].map(|file| Error::new("full", "free space").at(file));
        let shown = Error::all(all).unwrap_err().to_string();
        assert_eq!(shown, "a: full\nhelp: free space\nerror: b: full\nhelp: free space");
    }

    #[test]
    fn the_shown_line_is_short_and_harmless() {
        let text = format!("\x1b[2J{}", "x".repeat(1000));
        let shown = Error::new("p", "a").at("f").line(1, text).to_string();
        assert!(shown.len() < 160 && !shown.contains('\x1b'), "{shown}");
        let hostile = "a\x1b[2J\u{202e}b";
        let shown = Error::new(hostile, hostile).at(hostile).line(1, hostile).to_string();
        assert_eq!(shown.matches("a\u{fffd}[2J\u{fffd}b").count(), 4, "{shown}");
    }

    #[test]
    fn offsets_past_the_end_or_inside_a_character_are_harmless() {
        for offset in 0..20 {
            let shown = Error::new("p", "a").at("f").at_offset("é\né", offset).to_string();
            assert!(shown.starts_with("f:"), "{shown}");
        }
    }
}
