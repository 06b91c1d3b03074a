//! Words, numbers, quoted texts and brackets of a scene file, with their places.

use crate::growth::Growth;
use crate::{gzip, text};
use bdpm_core::base::error::{Error, Result};
use std::collections::HashMap;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Longest accepted word or quoted text, bytes.
const MAX_WORD: usize = 1 << 16;

/// The content of a file compressed by gzip.
fn decompressed(path: &Path, compressed: &[u8]) -> Result<Vec<u8>> {
    /// Bytes between two checks of the memory.
    const STEP: u64 = 1 << 20;
    let mut decoder = gzip::decoder(compressed, compressed.len() as u64);
    let (mut plain, mut growth) = (Vec::new(), Growth::default());
    loop {
        let read = decoder.by_ref().take(STEP).read_to_end(&mut plain).map_err(|e| {
            let problem = format!("cannot decompress it: {e}");
            Error::new(problem, "compress it again by gzip").at(path)
        })?;
        if read == 0 {
            text::unify_line_ends(&mut plain);
            return Ok(plain);
        }
        growth.add(read as u64).map_err(|problem| {
            let problem = format!("decompressing it takes {problem}");
            Error::new(problem, "split the scene").at(path)
        })?;
    }
}

/// A file of a scene.
pub(super) struct SourceFile {
    pub path: PathBuf,
    text: Vec<u8>,
}

/// Maximum bytes of files that are included again. Scenes place a shape several times by
/// `ObjectInstance`; nested includes would grow without bound.
const MAX_REPEATED: u64 = 1 << 28;

/// Maximum number of includes, far more than any scene has.
const MAX_INCLUDES: usize = 100_000;

/// Files of a scene, each read once however often it is included.
#[derive(Default)]
pub(super) struct SourceFiles {
    read: HashMap<PathBuf, Rc<SourceFile>>,
    /// Bytes of files that were included again.
    repeated: u64,
    includes: usize,
}

impl SourceFiles {
    /// The tokens of a file, which may be compressed by gzip.
    pub fn tokens(&mut self, path: &Path) -> Result<Tokens> {
        self.includes += 1;
        let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let file = match self.read.get(&full) {
            Some(file) => {
                self.repeated += file.text.len() as u64;
                file.clone()
            }
            None => {
                let read = Tokens::read(path)?.file;
                self.read.insert(full, read.clone());
                read
            }
        };
        if self.repeated > MAX_REPEATED || self.includes > MAX_INCLUDES {
            let (mib, count) = (self.repeated >> 20, self.includes);
            let problem = format!("{count} includes repeat {mib} MiB of files");
            return Err(Error::new(problem, "include each file once"));
        }
        Ok(Tokens { file, position: 0, ahead: None })
    }
}

/// A place in a file, for errors.
#[derive(Clone)]
pub(super) struct Location {
    file: Rc<SourceFile>,
    offset: usize,
}

impl Location {
    /// A problem at this place.
    pub fn error(&self, problem: impl Into<String>, advice: impl Into<String>) -> Error {
        let text = &self.file.text;
        let offset = self.offset.min(text.len());
        let start = memchr::memrchr(b'\n', &text[..offset]).map_or(0, |at| at + 1);
        let end = memchr::memchr(b'\n', &text[offset..]).map_or(text.len(), |at| offset + at);
        let shown = &text[start..end.min(start + 400)];
        let number = memchr::memchr_iter(b'\n', &text[..start]).count() + 1;
        let line = String::from_utf8_lossy(shown).trim_end().to_owned();
        Error::new(problem, advice).at(&self.file.path).line(number, line)
    }

    /// The error at this place, unless it names a file already.
    pub fn place(&self, error: Error) -> Error {
        match error.has_location() {
            true => error,
            false => self.error(error.problem(), error.advice()),
        }
    }
}

/// A lexical element.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Token {
    /// A word without quotes: a directive, `true` or `false`.
    Word(String),
    /// A text in quotes.
    Text(String),
    Number(f64),
    Open,
    Close,
}

/// Goes through the tokens of a file.
pub(super) struct Tokens {
    file: Rc<SourceFile>,
    position: usize,
    /// A token that was looked at, where it begins, and where the next one begins.
    ahead: Option<(Token, usize)>,
}

impl Tokens {
    fn read(path: &Path) -> Result<Self> {
        let text = text::read_lines(path)?;
        let text = if text.starts_with(&gzip::MAGIC) { decompressed(path, &text)? } else { text };
        Ok(Self::new(path, text))
    }

    fn new(path: &Path, text: Vec<u8>) -> Self {
        let file = Rc::new(SourceFile { path: path.to_owned(), text });
        Self { file, position: 0, ahead: None }
    }

    /// The place of an offset.
    pub fn location(&self, offset: usize) -> Location {
        Location { file: self.file.clone(), offset }
    }

    /// The next token and its offset, without going on.
    pub fn peek(&mut self) -> Result<Option<&(Token, usize)>> {
        if self.ahead.is_none() {
            self.ahead = self.scan()?;
        }
        Ok(self.ahead.as_ref())
    }

    /// The next token and its offset; `None` at the end of the file.
    pub fn next(&mut self) -> Result<Option<(Token, usize)>> {
        match self.ahead.take() {
            Some(ahead) => Ok(Some(ahead)),
            None => self.scan(),
        }
    }

    /// Goes past white space and comments.
    fn skip(&mut self) {
        let text = &self.file.text;
        while let Some(byte) = text.get(self.position) {
            match byte {
                b'#' => {
                    let rest = &text[self.position..];
                    self.position += memchr::memchr(b'\n', rest).unwrap_or(rest.len());
                }
                _ if byte.is_ascii_whitespace() => self.position += 1,
                _ => break,
            }
        }
    }

    fn scan(&mut self) -> Result<Option<(Token, usize)>> {
        self.skip();
        let (text, start) = (&self.file.text, self.position);
        let Some(first) = text.get(start) else { return Ok(None) };
        let token = match first {
            b'[' | b']' => {
                self.position += 1;
                if *first == b'[' { Token::Open } else { Token::Close }
            }
            b'"' => Token::Text(self.quoted()?),
            _ => {
                let ends = |byte: &u8| byte.is_ascii_whitespace() || b"[]\"#".contains(byte);
                let length = text[start..].iter().take(MAX_WORD).position(ends);
                let length = length.unwrap_or((text.len() - start).min(MAX_WORD));
                self.position += length;
                let word = String::from_utf8_lossy(&text[start..start + length]);
                if first.is_ascii_digit() || b"+-.".contains(first) {
                    let number = word.parse().ok().filter(|number: &f64| number.is_finite());
                    Token::Number(number.ok_or_else(|| {
                        let problem = format!("`{word}` is not a number");
                        self.location(start).error(problem, "correct it")
                    })?)
                } else {
                    Token::Word(word.into_owned())
                }
            }
        };
        Ok(Some((token, start)))
    }

    /// A text in quotes, which a backslash may be in front of.
    fn quoted(&mut self) -> Result<String> {
        let start = self.position;
        let mut bytes = Vec::new();
        let mut rest = self.file.text[start + 1..].iter().enumerate();
        while let Some((at, byte)) = rest.next() {
            match byte {
                b'"' => {
                    self.position = start + at + 2;
                    return Ok(text::decoded(&bytes).into_owned());
                }
                b'\n' => break,
                b'\\' => {
                    let escaped = rest.next().map_or(b'\\', |(_, byte)| *byte);
                    bytes.push(match escaped {
                        b'n' => b'\n',
                        b't' => b'\t',
                        other => other,
                    });
                }
                other => bytes.push(*other),
            }
            if bytes.len() > MAX_WORD {
                break;
            }
        }
        let problem = "the quoted text does not end on its line";
        Err(self.location(start).error(problem, "add the closing quote"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(text: &str) -> Result<Vec<Token>> {
        let mut tokens = Tokens::new(Path::new("a.pbrt"), text.into());
        let mut found = Vec::new();
        while let Some((token, _)) = tokens.next()? {
            found.push(token);
        }
        Ok(found)
    }

    #[test]
    fn tokens_are_words_numbers_texts_and_brackets() {
        let found = all("Shape \"a \\\"b\\\"\" [-1.5e2 .5]# c\n[\"x\"]true").unwrap();
        let text = |text: &str| Token::Text(text.into());
        let word = |word: &str| Token::Word(word.into());
        let (open, close) = (Token::Open, Token::Close);
        let expected = [
            word("Shape"),
            text("a \"b\""),
            open.clone(),
            Token::Number(-150.0),
            Token::Number(0.5),
            close.clone(),
            open,
            text("x"),
            close,
            word("true"),
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn bad_numbers_and_open_texts_name_their_line() {
        for (text, part) in [
            ("A\n1.2.3", ":2: `1.2.3` is not a number"),
            ("\n\n-inf", ":3: `-inf` is not a number"),
            ("\"abc\nd\"", ":1: the quoted text does not end"),
        ] {
            let shown = all(text).unwrap_err().to_string();
            assert!(shown.contains(part), "{shown}");
        }
    }
}
