//! Writes equal images as equal files: sorts the attributes of an EXR header by name. The crate
//! `exr` keeps them in a hash table, whose order differs from run to run. Any order is valid.

use std::io::{self, Seek, SeekFrom, Write};

/// Bytes before the first attribute: the magic number and the version.
const BEGIN: usize = 8;

/// Writes a file of one part; its header is held back until it is complete.
pub(super) struct SortedHeader<W> {
    to: W,
    /// Bytes of the header until it is complete.
    header: Option<Vec<u8>>,
}

impl<W: Write> SortedHeader<W> {
    /// A writer of a file that begins at the position of `to`.
    pub fn new(to: W) -> Self {
        Self { to, header: Some(Vec::new()) }
    }
}

impl<W: Write> Write for SortedHeader<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Some(header) = &mut self.header else { return self.to.write(bytes) };
        header.extend_from_slice(bytes);
        if let Some((mut attributes, end)) = attributes(header) {
            attributes.sort_unstable();
            self.to.write_all(&header[..BEGIN])?;
            attributes.iter().try_for_each(|attribute| self.to.write_all(attribute))?;
            self.to.write_all(&header[end..])?;
            self.header = None;
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.to.flush()
    }
}

impl<W: Write + Seek> Seek for SortedHeader<W> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        if self.header.is_some() {
            return Err(io::Error::other("the header of an EXR file is written in one go"));
        }
        self.to.seek(to)
    }
}

/// Bytes of each attribute of a header (name, type, size and value, as in *OpenEXR File Layout*),
/// and where they end; `None` if the header is not complete.
fn attributes(header: &[u8]) -> Option<(Vec<&[u8]>, usize)> {
    let text_end = |from: usize| {
        let length = memchr::memchr(0, header.get(from..)?)?;
        Some(from + length + 1)
    };
    let mut found = Vec::new();
    let mut begin = BEGIN;
    while *header.get(begin)? != 0 {
        let value = text_end(text_end(begin)?)?;
        let size = header.get(value..value + 4)?.try_into().ok()?;
        let end = value + 4 + u32::from_le_bytes(size) as usize;
        found.push(header.get(begin..end)?);
        begin = end;
    }
    Some((found, begin))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn attribute(name: &str, value: &[u8]) -> Vec<u8> {
        let size = (value.len() as u32).to_le_bytes();
        [name.as_bytes(), b"\0string\0", &size, value].concat()
    }

    #[test]
    fn attributes_are_sorted_however_the_bytes_come() {
        let (a, b) = (attribute("a", b"\0b\0"), attribute("bc", b""));
        let whole = [b"8 bytes.", &b[..], &a, b"\0pixels"].concat();
        let sorted = [b"8 bytes.", &a[..], &b, b"\0pixels"].concat();
        for step in 1..=whole.len() {
            let mut to = SortedHeader::new(io::Cursor::new(Vec::new()));
            whole.chunks(step).for_each(|bytes| to.write_all(bytes).unwrap());
            to.seek(SeekFrom::Start(2)).unwrap();
            to.write_all(b"BYTES").unwrap();
            let mut expected = sorted.clone();
            expected[2..7].copy_from_slice(b"BYTES");
            assert_eq!(to.to.into_inner(), expected, "{step}");
        }
    }

    #[test]
    fn an_incomplete_header_cannot_be_left() {
        let mut to = SortedHeader::new(io::Cursor::new(Vec::new()));
        to.write_all(b"8 bytes.name").unwrap();
        assert!(to.seek(SeekFrom::Start(0)).is_err());
    }
}
