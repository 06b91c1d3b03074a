//! Images in the portable float map format, which pbrt reads as well.

use crate::text::read_bytes;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use std::path::Path;

/// Largest accepted width and height, pixels.
const MAX_SIZE: usize = 65_536;

/// Reads width, height and pixels, row by row from the top.
///
/// # Errors
/// If the file cannot be read, or is malformed.
pub(super) fn read(path: &Path) -> Result<(u32, u32, Vec<Rgb>)> {
    let bytes = read_bytes(path, u64::MAX)?;
    decode(&bytes).ok_or_else(|| {
        let problem = "cannot read it as a portable float map";
        Error::new(problem, "give a complete .pfm file, or convert it to EXR").at(path)
    })
}

fn decode(bytes: &[u8]) -> Option<(u32, u32, Vec<Rgb>)> {
    let mut rest = bytes;
    // One white space character follows each word.
    let mut word = || {
        let end = rest.iter().take(64).position(u8::is_ascii_whitespace)?;
        let word = std::str::from_utf8(&rest[..end]).ok()?;
        rest = &rest[end + 1..];
        Some(word)
    };
    let channels = match word()? {
        "PF" => 3,
        "Pf" => 1,
        _ => return None,
    };
    let mut size = || word()?.parse().ok().filter(|size| (1..=MAX_SIZE).contains(size));
    let (width, height) = (size()?, size()?);
    let scale: f32 = word()?.parse().ok()?;
    // The sign of the scale tells the order of bytes.
    let number = |bytes: &[u8; 4]| {
        if scale < 0.0 { f32::from_le_bytes(*bytes) } else { f32::from_be_bytes(*bytes) }
    };
    let (numbers, _) = rest.as_chunks::<4>();
    let row = width * channels;
    let numbers = numbers.get(..row.checked_mul(height)?)?;
    // Rows are from the bottom.
    let pixels = numbers.chunks_exact(row).rev().flat_map(|row| {
        row.chunks_exact(channels).map(|pixel| match pixel {
            [r, g, b] => Rgb::new(number(r), number(g), number(b)),
            _ => Rgb::splat(number(&pixel[0])),
        })
    });
    Some((width as u32, height as u32, pixels.collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_from_the_bottom_and_bytes_in_either_order() {
        for (scale, bytes) in
            [("-1.0", f32::to_le_bytes as fn(f32) -> [u8; 4]), ("1", f32::to_be_bytes)]
        {
            let mut file = format!("PF\n1 2\n{scale}\n").into_bytes();
            (1..=6).for_each(|i| file.extend(bytes(i as f32)));
            let expected = vec![Rgb::new(4.0, 5.0, 6.0), Rgb::new(1.0, 2.0, 3.0)];
            assert_eq!(decode(&file), Some((1, 2, expected)));
            file.pop();
            assert_eq!(decode(&file), None);
        }
        let mut gray = b"Pf 2 1 -1\n".to_vec();
        [0.5_f32, 2.0].iter().for_each(|value| gray.extend(value.to_le_bytes()));
        assert_eq!(decode(&gray), Some((2, 1, vec![Rgb::splat(0.5), Rgb::splat(2.0)])));
        for bad in [&b"P6 1 1 1\n"[..], b"PF 0 1 1\n", b"PF 1 1", b""] {
            assert_eq!(decode(bad), None);
        }
    }
}
