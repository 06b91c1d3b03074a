//! The words of a file: commands, and primitives with their arguments.

use bdpm_core::base::error::{Error, Result};
use std::path::Path;

/// Numbers and words of a primitive, at most.
const MAX_ARGUMENTS: usize = 10_000_000;

/// What a file consists of.
pub enum Item {
    /// The offset of a line that begins with `!`, and the line without it.
    Command(usize, String),
    /// A material, a pattern or a surface.
    Primitive(Primitive),
}

/// A primitive: `modifier kind name`, then words and numbers.
#[derive(Clone, Debug, Default)]
pub struct Primitive {
    /// Name of what modifies it, or `void`.
    pub modifier: String,
    pub kind: String,
    pub name: String,
    pub words: Vec<String>,
    pub numbers: Vec<f64>,
    /// Place in the file, bytes.
    pub offset: usize,
}

impl Primitive {
    /// An error about this primitive, without a place.
    pub fn error(&self, problem: &str, advice: &str) -> Error {
        Error::new(format!("{} `{}` {problem}", self.kind, self.name), advice)
    }

    /// The numbers, of which there must be so many.
    ///
    /// # Errors
    /// If there are more or fewer.
    pub fn exactly<const N: usize>(&self) -> Result<[f64; N]> {
        self.numbers[..].try_into().map_err(|_| {
            let problem = format!("has {} numbers", self.numbers.len());
            self.error(&problem, &format!("give {N}"))
        })
    }

    /// The numbers, of which there must be at least so many.
    ///
    /// # Errors
    /// If there are fewer.
    pub fn at_least<const N: usize>(&self) -> Result<[f64; N]> {
        let first = self.numbers.get(..N).and_then(|own| own.try_into().ok());
        first.ok_or_else(|| {
            let problem = format!("has {} numbers", self.numbers.len());
            self.error(&problem, &format!("give at least {N}"))
        })
    }
}

/// The words of a text.
pub struct Tokens<'a> {
    path: &'a Path,
    text: &'a str,
    at: usize,
}

impl<'a> Tokens<'a> {
    /// The words of the text of a file.
    pub fn new(path: &'a Path, text: &'a str) -> Self {
        Self { path, text, at: 0 }
    }

    /// An error about the word before.
    fn error(&self, word: &str, error: Error) -> Error {
        error.at(self.path).at_offset(self.text, self.at - word.len())
    }

    /// The next command or primitive; `None` at the end.
    ///
    /// # Errors
    /// With the line of what is malformed.
    pub fn item(&mut self) -> Result<Option<Item>> {
        self.skip();
        let offset = self.at;
        if self.text[self.at..].starts_with('!') {
            return Ok(Some(Item::Command(offset, self.line())));
        }
        let Some(modifier) = self.word() else { return Ok(None) };
        let modifier = modifier.to_owned();
        let kind = self.needed("the type of a primitive")?.to_owned();
        let name = self.needed("the name of a primitive")?.to_owned();
        let mut own = Primitive { modifier, kind, name, offset, ..Primitive::default() };
        if own.kind == "alias" {
            own.words.push(self.needed("the name that an alias stands for")?.to_owned());
            return Ok(Some(Item::Primitive(own)));
        }
        let words = self.count()?;
        for _ in 0..words {
            own.words.push(self.needed("a word of a primitive")?.to_owned());
        }
        let integers = self.count()?;
        for _ in 0..integers {
            self.number()?;
        }
        let numbers = self.count()?;
        for _ in 0..numbers {
            let number = self.number()?;
            own.numbers.push(number);
        }
        Ok(Some(Item::Primitive(own)))
    }

    /// Skips white space and comments.
    fn skip(&mut self) {
        loop {
            let rest = &self.text[self.at..];
            let space = rest.len() - rest.trim_start().len();
            self.at += space;
            if !self.text[self.at..].starts_with('#') {
                return;
            }
            let rest = &self.text[self.at..];
            self.at += rest.find('\n').unwrap_or(rest.len());
        }
    }

    /// The rest of a line after `!`, with the lines that a backslash at its end joins.
    fn line(&mut self) -> String {
        let mut all = String::new();
        self.at += 1;
        loop {
            let rest = &self.text[self.at..];
            let end = rest.find('\n').unwrap_or(rest.len());
            let line = rest[..end].trim_end();
            self.at = (self.at + end + 1).min(self.text.len());
            match line.strip_suffix('\\') {
                Some(line) if self.at < self.text.len() => {
                    all += line;
                    all.push(' ');
                }
                _ => return all + line,
            }
        }
    }

    /// The next word. One in quotes may have white space, and ends with its line at the latest.
    fn word(&mut self) -> Option<&'a str> {
        self.skip();
        let rest = &self.text[self.at..];
        if let Some(quote) = rest.chars().next().filter(|first| matches!(first, '\'' | '"')) {
            let inside = &rest[1..];
            let end = inside.find([quote, '\n']).unwrap_or(inside.len());
            self.at += 1 + end + usize::from(inside[end..].starts_with(quote));
            return Some(&inside[..end]);
        }
        let end = rest.find(char::is_whitespace).unwrap_or(rest.len());
        self.at += end;
        (end > 0).then(|| &rest[..end])
    }

    fn needed(&mut self, what: &str) -> Result<&'a str> {
        let offset = self.at;
        self.word().ok_or_else(|| {
            let problem = format!("the file ends before {what}");
            Error::new(problem, "complete or remove the last primitive")
                .at(self.path)
                .at_offset(self.text, offset)
        })
    }

    fn count(&mut self) -> Result<usize> {
        let word = self.needed("a number of arguments")?;
        let count = word.parse().ok().filter(|count| *count <= MAX_ARGUMENTS);
        count.ok_or_else(|| {
            let problem = format!("`{word}` is not a number of arguments");
            let advice = "give the number of words, 0, and the number of numbers, each before them";
            self.error(word, Error::new(problem, advice))
        })
    }

    fn number(&mut self) -> Result<f64> {
        let word = self.needed("a number of a primitive")?;
        let number = word.parse().ok().filter(|number: &f64| number.is_finite());
        number.ok_or_else(|| {
            let problem = format!("`{word}` is not a number");
            self.error(word, Error::new(problem, "give as many numbers as the count says"))
        })
    }
}
