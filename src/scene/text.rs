//! Reading text files line by line: bounded memory, and errors that name file and line.

use crate::error::{Error, Result};
use std::fs::File;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::path::{Path, PathBuf};

/// Longest accepted line, bytes: a face of 100,000 corners fits.
const MAX_LINE: usize = 1 << 20;

/// Largest accepted scene file, bytes. Geometry belongs into OBJ files, which have no limit.
const MAX_SCENE_FILE: u64 = 16 << 20;

/// Opens a regular file. Folders are refused with a better word than the system's; devices and
/// pipes because they may never end.
pub(super) fn open(path: &Path) -> Result<File> {
    // Look before opening: opening a pipe waits for its writer.
    let metadata = std::fs::metadata(path).map_err(|e| Error::io("read the file", path, e))?;
    if metadata.is_dir() {
        return Err(Error::new("this is a folder, not a file", "name a file in it").at(path));
    }
    if !metadata.is_file() {
        return Err(Error::new(
            "this is neither a regular file nor a folder",
            "copy its content to a file",
        )
        .at(path));
    }
    File::open(path).map_err(|e| Error::io("open the file", path, e))
}

/// Reads a small text file as a whole, without its byte order mark.
pub(super) fn read(path: &Path) -> Result<String> {
    let mut bytes = Vec::new();
    open(path)?
        .take(MAX_SCENE_FILE + 1)
        .read_to_end(&mut bytes)
        .map_err(|e| Error::io("read the file", path, e))?;
    if bytes.len() as u64 > MAX_SCENE_FILE {
        return Err(Error::new(
            format!("the scene file is larger than {} MiB", MAX_SCENE_FILE >> 20),
            "keep geometry in OBJ files",
        )
        .at(path));
    }
    let text = String::from_utf8(bytes).map_err(|e| {
        let offset = e.utf8_error().valid_up_to();
        // Valid up to the offset, so the lossy text has the same length up to there.
        let text = String::from_utf8_lossy(e.as_bytes());
        Error::new("this is not UTF-8 text", "save the scene file as UTF-8")
            .at(path)
            .at_offset(&text, offset)
    })?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

/// The lines of an OBJ or MTL file, one buffer for all of them.
pub(super) struct Lines {
    path: PathBuf,
    reader: BufReader<File>,
    bytes: Vec<u8>,
    line: String,
    /// Physical lines read so far, and where the current one began.
    read: usize,
    start: usize,
}

impl Lines {
    /// Opens the file.
    pub(super) fn open(path: &Path) -> Result<Self> {
        Ok(Self {
            path: path.to_owned(),
            reader: BufReader::with_capacity(1 << 16, open(path)?),
            bytes: Vec::new(),
            line: String::new(),
            read: 0,
            start: 0,
        })
    }

    /// Goes on to the next line; `false` at the end. A backslash at a line's end continues it.
    pub(super) fn advance(&mut self) -> Result<bool> {
        self.bytes.clear();
        self.start = self.read + 1;
        let mut any = false;
        let mut comment = false;
        loop {
            let before = self.bytes.len();
            let room = (MAX_LINE + 2 - before) as u64;
            let got = self.reader.by_ref().take(room).read_until(b'\n', &mut self.bytes);
            match got {
                Ok(0) => break,
                Ok(_) => any = true,
                Err(e) if e.kind() == ErrorKind::Interrupted => continue,
                Err(e) => return Err(Error::io("read the file", &self.path, e)),
            }
            self.read += 1;
            if self.read == 1 && self.bytes.starts_with(b"\xef\xbb\xbf") {
                self.bytes.drain(..3);
            }
            // The new part alone: a million continued lines must not be searched a million times.
            if self.bytes[before.min(self.bytes.len())..].contains(&0) {
                return Err(self
                    .fault_at(self.read, "there is a zero byte, so this is not a text file")
                    .into_error("give a text file in the OBJ or MTL format"));
            }
            if self.bytes.len() > MAX_LINE {
                return Err(self
                    .fault_at(self.start, &format!("the line is longer than {MAX_LINE} bytes"))
                    .into_error("split it, with a backslash before each line end"));
            }
            let line = self.bytes.trim_ascii_end();
            if self.read == self.start {
                comment = self.bytes.trim_ascii_start().starts_with(b"#");
            }
            if comment || !line.ends_with(b"\\") {
                break;
            }
            let kept = line.len() - 1;
            self.bytes.truncate(kept);
            self.bytes.push(b' ');
        }
        self.line.clear();
        // Comments and names in another encoding are no reason to refuse a file.
        self.line.push_str(&String::from_utf8_lossy(self.bytes.trim_ascii()));
        Ok(any)
    }

    /// The current line without white space around it.
    pub(super) fn line(&self) -> &str {
        &self.line
    }

    /// One-based number of the current line.
    pub(super) fn number(&self) -> usize {
        self.start
    }

    /// A problem in the current line.
    pub(super) fn error(&self, problem: impl Into<String>, advice: impl Into<String>) -> Error {
        Error::new(problem, advice).at(&self.path).line(self.start, self.line.as_str())
    }

    fn fault_at(&self, number: usize, problem: &str) -> Fault<'_> {
        let shown = &self.bytes[..self.bytes.len().min(200)];
        let text = String::from_utf8_lossy(shown).trim_end().to_owned();
        Fault { path: &self.path, number, problem: problem.to_owned(), text }
    }
}

/// A line that could not even be read.
struct Fault<'a> {
    path: &'a Path,
    number: usize,
    problem: String,
    text: String,
}

impl Fault<'_> {
    fn into_error(self, advice: &str) -> Error {
        Error::new(self.problem, advice).at(self.path).line(self.number, self.text)
    }
}

/// The first word and what follows it, without white space around either.
pub(super) fn split_keyword(line: &str) -> (&str, &str) {
    let end = line.find(char::is_whitespace).unwrap_or(line.len());
    (&line[..end], line[end..].trim_start())
}

/// A few names for a message, in quotes.
pub(super) fn list<'a>(names: impl IntoIterator<Item = &'a str>) -> String {
    const SHOWN: usize = 12;
    let mut names = names.into_iter();
    let mut text = String::new();
    for name in names.by_ref().take(SHOWN) {
        let short: String = name.chars().take(60).collect();
        text.push_str(if text.is_empty() { "`" } else { ", `" });
        text.push_str(&short);
        text.push('`');
    }
    match names.count() {
        0 => text,
        more => format!("{text} and {more} more"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn lines(content: &[u8]) -> Result<Vec<(usize, String)>> {
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(content).unwrap();
        let mut lines = Lines::open(file.path())?;
        let mut all = Vec::new();
        while lines.advance()? {
            all.push((lines.number(), lines.line().to_owned()));
        }
        Ok(all)
    }

    #[test]
    fn lines_are_joined_trimmed_and_numbered() {
        let read = lines(b"\xef\xbb\xbfa 1\r\n\r\nb \\\r\n 2\\\n3\n# c \\\nd").unwrap();
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
        let longest = vec![b'x'; MAX_LINE - 1];
        assert_eq!(lines(&longest).unwrap()[0].1.len(), MAX_LINE - 1);
    }

    #[test]
    fn long_lists_are_cut() {
        assert_eq!(list(["a", "b"]), "`a`, `b`");
        assert!(list(["x"; 20]).ends_with("and 8 more"));
    }
}
