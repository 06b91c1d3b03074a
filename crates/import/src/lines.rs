//! The lines of an OBJ or MTL file, and errors that name file and line.

use super::text::decoded;
use bdpm_core::base::error::{Error, Result};
use std::borrow::Cow;
use std::path::Path;

/// Longest accepted line, bytes: a face of 100,000 corners fits.
const MAX_LINE: usize = 1 << 20;

/// Goes through text in memory, line by line.
pub struct Lines<'a> {
    path: &'a Path,
    rest: &'a [u8],
    line: Cow<'a, [u8]>,
    /// One-based number of the current line, and of the next one in the file.
    number: usize,
    next: usize,
}

impl<'a> Lines<'a> {
    /// Starts before the first line of a file.
    pub fn new(path: &'a Path, text: &'a [u8]) -> Self {
        Self { path, rest: text, line: Cow::default(), number: 0, next: 1 }
    }

    /// Goes on to the next line; `false` at the end. A backslash at a line's end continues it,
    /// unless it is a comment.
    pub fn advance(&mut self) -> Result<bool> {
        if self.rest.is_empty() {
            return Ok(false);
        }
        self.number = self.next;
        let line = self.take(&[])?.trim_ascii();
        if line.starts_with(b"#") || !is_continued(line) {
            self.line = Cow::Borrowed(line);
            return Ok(true);
        }
        let mut joined = Vec::new();
        let mut part = line;
        while is_continued(part) {
            let part_end = part.trim_ascii_end().len() - 1;
            joined.extend_from_slice(&part[..part_end]);
            joined.push(b' ');
            part = self.take(&joined)?;
        }
        joined.extend_from_slice(part);
        self.line = Cow::Owned(joined.trim_ascii().to_vec());
        Ok(true)
    }

    /// The next line of the file with its end, which belongs to a line that begins with `joined`.
    fn take(&mut self, joined: &[u8]) -> Result<&'a [u8]> {
        let window = &self.rest[..self.rest.len().min(MAX_LINE + 1)];
        let end = match memchr::memchr2(b'\n', 0, window) {
            Some(at) if window[at] == 0 => {
                let problem = "there is a zero byte, so this is not a text file";
                let advice = "give a text file in the OBJ or MTL format";
                return Err(self.unreadable(joined, self.next, problem, advice));
            }
            Some(at) => at + 1,
            None => window.len(),
        };
        if joined.len() + end > MAX_LINE {
            let problem = format!("the line is longer than {MAX_LINE} bytes");
            let advice = "split it, with a backslash before each line end";
            return Err(self.unreadable(joined, self.number, &problem, advice));
        }
        let (line, rest) = self.rest.split_at(end);
        self.rest = rest;
        self.next += 1;
        Ok(line)
    }

    /// The current line without white space around it.
    pub fn bytes(&self) -> &[u8] {
        &self.line
    }

    /// Decodes it as text. Comments and names in another encoding are no reason to refuse a file.
    pub fn text(&self) -> Cow<'_, str> {
        decoded(&self.line)
    }

    /// One-based number of the current line.
    pub fn number(&self) -> usize {
        self.number
    }

    /// The file and the number of the current line, for a message.
    pub fn place(&self) -> String {
        format!("{}:{}", self.path.display(), self.number)
    }

    /// A problem in the current line.
    pub fn error(&self, problem: impl Into<String>, advice: impl Into<String>) -> Error {
        Error::new(problem, advice).at(self.path).line(self.number, self.text())
    }

    fn unreadable(&self, joined: &[u8], number: usize, problem: &str, advice: &str) -> Error {
        let shown: Vec<u8> = joined.iter().chain(self.rest).take(200).copied().collect();
        let shown = shown.split(|byte| *byte == b'\n').next().unwrap_or_default();
        let text = String::from_utf8_lossy(shown).trim_end().to_owned();
        Error::new(problem, advice).at(self.path).line(number, text)
    }
}

/// Whether a line of the file ends in a backslash.
fn is_continued(line: &[u8]) -> bool {
    line.trim_ascii_end().ends_with(b"\\")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &[u8]) -> Result<Vec<(usize, String)>> {
        let mut lines = Lines::new(Path::new("a"), text);
        let mut all = Vec::new();
        while lines.advance()? {
            all.push((lines.number(), lines.text().into_owned()));
        }
        Ok(all)
    }

    #[test]
    fn lines_are_joined_trimmed_and_numbered() {
        let read = lines(b"a 1\r\n\r\nb \\\r\n 2\\\n3\n# c \\\nd").unwrap();
        let expected = [(1, "a 1"), (2, ""), (3, "b   2 3"), (6, "# c \\"), (7, "d")]
            .map(|(n, t)| (n, t.to_owned()));
        assert_eq!(read, expected);
        assert_eq!(lines(b"").unwrap(), []);
        assert_eq!(lines(b"a\\").unwrap(), [(1, "a".to_owned())]);
    }

    #[test]
    fn endless_lines_and_zero_bytes_are_refused() {
        let long = vec![b'x'; 2 * MAX_LINE];
        let error = lines(&long).unwrap_err().to_string();
        assert!(error.contains(":1: the line is longer than") && error.len() < 500, "{error}");
        let continued = b"x\\\n".repeat(MAX_LINE);
        assert!(lines(&continued).unwrap_err().to_string().contains(":1: the line is longer"));
        let error = lines(b"v 1 2 3\nELF\0\0").unwrap_err().to_string();
        assert!(error.contains(":2: there is a zero byte"), "{error}");
        let longest = vec![b'x'; MAX_LINE];
        assert_eq!(lines(&longest).unwrap()[0].1.len(), MAX_LINE);
    }
}
