//! Content of files compressed by gzip, which a small file could make endless.

use flate2::bufread::MultiGzDecoder;
use std::io::{self, BufRead, Read};

/// The first bytes of a compressed file.
pub const MAGIC: [u8; 2] = [0x1f, 0x8b];

/// A compressed file may always have as many bytes of content.
const MIN_CONTENT: u64 = 1 << 28;

/// Maximum bytes of content per byte of a compressed file. Meshes of equal numbers reach about 30.
pub const MAX_RATIO: u64 = 100;

/// Decodes a file of so many bytes.
pub fn decoder<R: BufRead>(compressed: R, length: u64) -> impl Read {
    let left = MIN_CONTENT.max(length.saturating_mul(MAX_RATIO));
    Bounded { decoder: MultiGzDecoder::new(compressed), left }
}

struct Bounded<R> {
    decoder: R,
    left: u64,
}

impl<R: Read> Read for Bounded<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.decoder.read(buffer)?;
        self.left = self.left.checked_sub(count as u64).ok_or_else(|| {
            io::Error::other(format!("it holds over {MAX_RATIO} times the bytes of the file"))
        })?;
        Ok(count)
    }
}
