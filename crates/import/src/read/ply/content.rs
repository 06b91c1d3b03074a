//! The bytes of a PLY file: its header in the dialect of the crate `ply-rs-bw`, then the numbers of
//! its elements.
//!
//! Programs write numbers such as `2.` and `.5`, byte order marks, empty lines and the line ends of
//! old Macs, which the crate refuses. So it parses only the header here.

use crate::growth::Growth;
use crate::gzip;
use crate::text;
use bdpm_core::base::error::{Error, Result};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{DefaultElement, Encoding, Header, ScalarType};
use std::io::{self, BufRead, BufReader, ErrorKind, Read};
use std::path::Path;

/// Advice for a malformed file.
const EXPORT_AGAIN: &str = "export the mesh again";

/// Maximum length of a header, bytes.
const MAX_HEADER: usize = 1 << 20;

/// Reads the numbers of a PLY file one after another.
pub(super) struct Content<'a> {
    path: &'a Path,
    input: BufReader<Box<dyn Read>>,
    /// The current line of a text, without its end.
    line: Vec<u8>,
    /// One-based number of the current line.
    number: usize,
    /// Number of bytes of the line that are read.
    position: usize,
    /// Whether a line feed after a carriage return belongs to the end of the line.
    is_crlf: Option<bool>,
    encoding: Encoding,
    growth: Growth,
}

impl<'a> Content<'a> {
    /// Opens a file, which may be compressed by gzip, and reads its header.
    pub fn open(path: &'a Path) -> Result<(Self, Header)> {
        let mut file = BufReader::new(text::open(path)?);
        let length = file.get_ref().metadata().map_or(0, |metadata| metadata.len());
        let start = file.fill_buf().map_err(|e| Error::io("read the file", path, e))?;
        let input: Box<dyn Read> = if start.starts_with(&gzip::MAGIC) {
            Box::new(gzip::decoder(file, length))
        } else {
            Box::new(file)
        };
        let mut content = Self {
            path,
            input: BufReader::with_capacity(1 << 16, input),
            line: Vec::new(),
            number: 0,
            position: 0,
            is_crlf: None,
            encoding: Encoding::Ascii,
            growth: Growth::default(),
        };
        let header = content.header()?;
        content.encoding = header.encoding;
        Ok((content, header))
    }

    /// A problem of the file.
    pub fn broken(&self, problem: &str) -> Error {
        let problem = problem.split_whitespace().collect::<Vec<_>>().join(" ");
        let problem: String = problem.chars().take(300).collect();
        Error::new(format!("cannot read it as a PLY file: {problem}"), EXPORT_AGAIN).at(self.path)
    }

    /// A problem in the current line, if the file is a text.
    pub fn wrong(&self, problem: &str) -> Error {
        let error = self.broken(problem);
        match self.encoding {
            Encoding::Ascii => error.line(self.number, text::decoded(&self.line)),
            _ => error,
        }
    }

    /// Counts bytes that are about to be stored.
    pub fn store(&mut self, bytes: usize) -> Result<()> {
        self.growth.add(bytes as u64).map_err(|problem| {
            let problem = format!("reading the file takes {problem}");
            Error::new(problem, "simplify the mesh").at(self.path)
        })
    }

    /// Reads the header, line by line, and gives it to the parser in its own dialect.
    fn header(&mut self) -> Result<Header> {
        let mut header = Vec::new();
        // Lines in which each line of the header is.
        let mut numbers = Vec::new();
        while numbers.is_empty() || header.last_chunk() != Some(b"\nend_header\n") {
            if !self.next_line()? {
                return Err(self.broken("the file ends within its header"));
            }
            let mut line = self.line.trim_ascii();
            if numbers.is_empty() {
                line = line.strip_prefix(b"\xef\xbb\xbf").unwrap_or(line);
            }
            if line.is_empty() {
                continue;
            }
            if header.len() + line.len() > MAX_HEADER {
                return Err(self.broken(&format!("its header has over {MAX_HEADER} bytes")));
            }
            header.extend_from_slice(text::decoded(line).as_bytes());
            header.push(b'\n');
            numbers.push(self.number);
        }
        let parsed = Parser::<DefaultElement>::new().read_header(&mut Reader::new(&header[..]));
        parsed.map_err(|error| {
            let place = error.line().and_then(|line| line.checked_sub(1));
            let broken = self.broken(&error.to_string());
            let Some((index, number)) = place.and_then(|i| Some((i, *numbers.get(i)?))) else {
                return broken;
            };
            let line = header.split(|byte| *byte == b'\n').nth(index).unwrap_or_default();
            broken.line(number, text::decoded(line))
        })
    }

    /// Goes on to the next line; `false` at the end of the file.
    fn next_line(&mut self) -> Result<bool> {
        self.line.clear();
        self.position = 0;
        let mut is_any = false;
        loop {
            let buffer = self.input.fill_buf().map_err(|e| failed(self.path, &e))?;
            if buffer.is_empty() {
                self.number += usize::from(is_any);
                return Ok(is_any);
            }
            is_any = true;
            let end = memchr::memchr2(b'\n', b'\r', buffer);
            let is_return = end.is_some_and(|end| buffer[end] == b'\r');
            let count = end.unwrap_or(buffer.len());
            self.line.extend_from_slice(&buffer[..count]);
            self.input.consume(count + usize::from(end.is_some()));
            if end.is_none() {
                self.store(count)?;
                if self.encoding == Encoding::Ascii
                    && self.number == 0
                    && self.line.len() > MAX_HEADER
                {
                    return Err(self.broken("the first line is not `ply`"));
                }
                continue;
            }
            self.number += 1;
            if is_return && self.is_crlf != Some(false) {
                let buffer = self.input.fill_buf().map_err(|e| failed(self.path, &e))?;
                let is_feed = buffer.first() == Some(&b'\n');
                // The first line decides, because binary numbers may begin with a line feed.
                self.is_crlf = Some(is_feed);
                self.input.consume(usize::from(is_feed));
            }
            return Ok(true);
        }
    }

    /// Goes on to the next item of an element, which is a line of a text.
    pub fn next_item(&mut self, element: &str, index: usize) -> Result<()> {
        if self.encoding != Encoding::Ascii {
            return Ok(());
        }
        loop {
            if !self.next_line()? {
                return Err(self.ends(element, index));
            }
            if !self.line.trim_ascii().is_empty() {
                return Ok(());
            }
        }
    }

    /// The error for a file that is too short.
    pub fn ends(&self, element: &str, index: usize) -> Error {
        self.broken(&format!("the file ends before item {index} of the element `{element}`"))
    }

    /// The next number; `None` at the end of a binary file.
    pub fn number(&mut self, kind: &ScalarType) -> Result<Option<f64>> {
        let is_big = match self.encoding {
            Encoding::Ascii => return self.word().map(Some),
            Encoding::BinaryBigEndian => true,
            Encoding::BinaryLittleEndian => false,
        };
        let mut bytes = [0; 8];
        let size = size(kind);
        match self.input.read_exact(&mut bytes[..size]) {
            Ok(()) => {}
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(None),
            Err(error) => return Err(failed(self.path, &error)),
        }
        if is_big {
            bytes[..size].reverse();
        }
        let [a, b, c, d, ..] = bytes;
        Ok(Some(match kind {
            ScalarType::Char => f64::from(a as i8),
            ScalarType::UChar => f64::from(a),
            ScalarType::Short => f64::from(i16::from_le_bytes([a, b])),
            ScalarType::UShort => f64::from(u16::from_le_bytes([a, b])),
            ScalarType::Int => f64::from(i32::from_le_bytes([a, b, c, d])),
            ScalarType::UInt => f64::from(u32::from_le_bytes([a, b, c, d])),
            ScalarType::Float => f64::from(f32::from_le_bytes([a, b, c, d])),
            ScalarType::Double => f64::from_le_bytes(bytes),
        }))
    }

    /// The next number of the current line.
    fn word(&mut self) -> Result<f64> {
        let rest = &self.line[self.position..];
        let begin = rest.iter().position(|byte| !byte.is_ascii_whitespace());
        let Some(begin) = begin else {
            return Err(self.wrong("the line has too few numbers"));
        };
        let word = &rest[begin..];
        let end = word.iter().position(u8::is_ascii_whitespace).unwrap_or(word.len());
        let word = &word[..end];
        let number = std::str::from_utf8(word).ok().and_then(|word| word.parse().ok());
        let number = number.ok_or_else(|| {
            self.wrong(&format!("`{}` is not a number", String::from_utf8_lossy(word)))
        })?;
        self.position += begin + end;
        Ok(number)
    }
}

/// Bytes of a number of a binary file.
fn size(kind: &ScalarType) -> usize {
    match kind {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

fn failed(path: &Path, error: &io::Error) -> Error {
    let problem = format!("cannot read it as a PLY file: {error}");
    Error::new(problem, EXPORT_AGAIN).at(path)
}
