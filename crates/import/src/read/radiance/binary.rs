//! Binary files of Radiance: octrees (`.oct`) and meshes (`.rtm`), with the scene in both.
//!
//! A header in text, a number that states the width of indices, the cube, an octree of indices, and
//! primitives whose modifiers are numbers of earlier ones. Integers are big-endian. The octree is
//! skipped: rays have an acceleration structure of their own here.

use super::tokens::Primitive;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::input::{decoded, read_bytes};
use std::path::Path;

/// Largest accepted file, bytes.
const MAX_FILE: u64 = 4 << 30;

/// What the first number of a file exceeds by the width of indices, bytes.
const OCTREE_MAGIC: i64 = 4 * 8 + 251;
const MESH_MAGIC: i64 = 8 + 311;

/// Widest indices, bytes.
const MAX_INDEX: i64 = 8;

/// The kind of a binary file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    Octree,
    Mesh,
}

/// A file that is being read.
pub struct Binary {
    bytes: Vec<u8>,
    at: usize,
    /// Width of indices, bytes.
    index: usize,
    /// Corner of the cube and its size.
    pub cube: [f64; 4],
}

impl Binary {
    /// Opens a file, and reads it up to the cube.
    ///
    /// # Errors
    /// Names the file if it cannot be read, or is no such file.
    pub fn open(path: &Path, format: Format) -> Result<Self> {
        let bytes = read_bytes(path, MAX_FILE + 1)?;
        if bytes.len() as u64 > MAX_FILE {
            let problem = format!("the file is larger than {} GiB", MAX_FILE >> 30);
            return Err(Error::new(problem, "split it").at(path));
        }
        let mut own = Self { bytes, at: 0, index: 4, cube: [0.0; 4] };
        own.start(format).map_err(|error| error.at(path))?;
        Ok(own)
    }

    fn start(&mut self, format: Format) -> Result<()> {
        let (name, magic, program) = match format {
            Format::Octree => ("Radiance_octree", OCTREE_MAGIC, "oconv"),
            Format::Mesh => ("Radiance_tmesh", MESH_MAGIC, "obj2mesh"),
        };
        let foreign = |problem: String| {
            Error::new(problem, format!("give a file that {program} of Radiance writes"))
        };
        // The header ends with an empty line.
        let end = self.bytes.windows(2).position(|pair| pair == b"\n\n");
        let end = end.filter(|_| self.bytes.starts_with(b"#?"));
        let end = end.ok_or_else(|| foreign("the file has no header of Radiance".into()))?;
        let header = decoded(&self.bytes[..end]);
        let mut lines = header.lines();
        if !lines.any(|line| line.strip_prefix("FORMAT=").is_some_and(|own| own.trim() == name)) {
            return Err(foreign(format!("the format of the file is not {name}")));
        }
        self.at = end + 2;
        let index = self.integer(2)? - magic;
        if !(1..=MAX_INDEX).contains(&index) {
            return Err(foreign("the version of the file is not known".into()));
        }
        self.index = index as usize;
        for axis in 0..4 {
            let text = self.string()?;
            let number = text.trim().parse().ok().filter(|number: &f64| number.is_finite());
            self.cube[axis] = number.ok_or_else(|| damaged("the cube"))?;
        }
        Ok(())
    }

    /// The next bytes.
    ///
    /// # Errors
    /// If the file ends before.
    pub fn take(&mut self, count: usize) -> Result<&[u8]> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.bytes.len());
        let end = end.ok_or_else(|| Error::new("the file ends too early", "write it again"))?;
        let taken = &self.bytes[self.at..end];
        self.at = end;
        Ok(taken)
    }

    /// An integer of so many bytes, at most 8, with a sign.
    ///
    /// # Errors
    /// If the file ends before.
    pub fn integer(&mut self, width: usize) -> Result<i64> {
        let bytes = self.take(width)?;
        let start = if bytes.first().is_some_and(|byte| *byte >= 0x80) { -1 } else { 0 };
        Ok(bytes.iter().fold(start, |all: i64, byte| (all << 8) | i64::from(*byte)))
    }

    /// A number of something, in two bytes.
    ///
    /// # Errors
    /// If it is negative or above `most`.
    pub fn count(&mut self, what: &str, most: usize) -> Result<usize> {
        let count = self.integer(2)?;
        usize::try_from(count).ok().filter(|count| *count <= most).ok_or_else(|| damaged(what))
    }

    /// A floating-point number: a fraction of 31 bits and an exponent.
    ///
    /// # Errors
    /// If the file ends before.
    pub fn number(&mut self) -> Result<f64> {
        let (fraction, exponent) = (self.integer(4)?, self.integer(1)?);
        if fraction == 0 {
            return Ok(0.0);
        }
        // The middle of the interval that the fraction stands for.
        let fraction = fraction as f64 + if fraction < 0 { -0.5 } else { 0.5 };
        Ok(fraction / f64::from(i32::MAX) * f64::from(exponent as i32).exp2())
    }

    /// A text that ends with a zero byte.
    ///
    /// # Errors
    /// If the file ends before.
    pub fn string(&mut self) -> Result<String> {
        let rest = &self.bytes[self.at..];
        let length = memchr::memchr(0, rest).ok_or_else(|| damaged("a text"))?;
        let text = decoded(&rest[..length]).into_owned();
        self.at += length + 1;
        Ok(text)
    }

    /// An index of a primitive.
    ///
    /// # Errors
    /// If the file ends before.
    pub fn index(&mut self) -> Result<i64> {
        self.integer(self.index)
    }

    /// Skips the octree.
    ///
    /// # Errors
    /// If it is damaged.
    pub fn skip_tree(&mut self) -> Result<()> {
        // Nodes that are still to come; a loop, because a damaged tree may be deep.
        let mut nodes = 1u64;
        while nodes > 0 {
            nodes -= 1;
            match self.take(1)?[0] {
                0 => {}
                1 => {
                    let count = usize::try_from(self.index()?).ok();
                    let bytes = count.and_then(|count| count.checked_mul(self.index));
                    self.take(bytes.ok_or_else(|| damaged("the octree"))?)?;
                }
                2 => nodes += 8,
                _ => return Err(damaged("the octree")),
            }
        }
        Ok(())
    }

    /// The primitives. Modifiers have their names again.
    ///
    /// # Errors
    /// If they are damaged.
    pub fn primitives(&mut self) -> Result<Vec<Primitive>> {
        let mut kinds = Vec::new();
        loop {
            let kind = self.string()?;
            if kind.is_empty() {
                break;
            }
            kinds.push(kind);
        }
        let mut all: Vec<Primitive> = Vec::new();
        loop {
            let kind = self.integer(1)?;
            if kind == -1 {
                return Ok(all);
            }
            let kind = usize::try_from(kind).ok().and_then(|kind| kinds.get(kind));
            let kind = kind.ok_or_else(|| damaged("the type of a primitive"))?.clone();
            let modifier = match self.index()? {
                -1 => "void".to_owned(),
                index => {
                    let own = usize::try_from(index).ok().and_then(|index| all.get(index));
                    own.ok_or_else(|| damaged("a modifier"))?.name.clone()
                }
            };
            let mut own =
                Primitive { modifier, kind, name: self.string()?, ..Primitive::default() };
            for _ in 0..self.count("the words of a primitive", usize::MAX)? {
                own.words.push(self.string()?);
            }
            for _ in 0..self.count("the numbers of a primitive", usize::MAX)? {
                own.numbers.push(self.number()?);
            }
            if own.kind == "alias" && own.words.is_empty() {
                own.words.push(own.modifier.clone());
            }
            all.push(own);
        }
    }
}

/// An error about a file whose content contradicts its format.
pub fn damaged(what: &str) -> Error {
    Error::new(format!("{what} in the file is damaged"), "write the file again")
}
