//! Pictures of Radiance (`.hdr`): shared exponents, runs of both kinds, all orientations, RGB and
//! XYZ. The format is that of Radiance's manual (`color.c`, `colrops.c`, `resolu.c`).

use super::text::{check_memory, decoded, read_bytes};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::base::memory::available_memory;
use bdpm_core::image_io::{Primaries, converted};
use glam::DMat3;
use std::path::Path;

/// Maximum length of a header, bytes.
const MAX_HEADER: usize = 1 << 16;

/// Maximum number of pixels across and down.
const MAX_SIZE: usize = 1 << 16;

/// Bytes of memory per pixel while a picture is read: its color, twice if columns are turned.
const PIXEL_BYTES: f64 = 24.0;

/// Lengths of scanlines that may have runs for each channel.
const LENGTHS_OF_RUNS: std::ops::RangeInclusive<usize> = 8..=0x7fff;

/// A pixel: three mantissas and their exponent.
type Code = [u8; 4];

/// Width, height and radiances of a picture, row by row from the top left.
///
/// # Errors
/// If the file cannot be read, or is no such picture; names it.
pub fn read(path: &Path) -> Result<(u32, u32, Vec<Rgb>)> {
    let bytes = read_bytes(path, u64::MAX)?;
    decode(&bytes).map_err(|problem| {
        let problem = format!("cannot read it as an HDR image: {problem}");
        Error::new(problem, "give an .hdr file of Radiance, or convert it to .exr").at(path)
    })
}

fn decode(bytes: &[u8]) -> std::result::Result<(u32, u32, Vec<Rgb>), String> {
    let (header, rest) = Header::read(bytes)?;
    let (line, data) = split_line(rest).ok_or("it is cut off before its size")?;
    let layout = Layout::of(&decoded(line))?;
    let [count, length] = layout.scanlines;
    check_memory(PIXEL_BYTES * count as f64 * length as f64, available_memory())
        .map_err(|problem| format!("its {count} scanlines of {length} pixels take {problem}"))?;
    let (mut scanline, mut data) = (Vec::with_capacity(length), data);
    // Grows with the file, whose size may be wrong.
    let mut pixels: Vec<Rgb> = Vec::new();
    for number in 1..=count {
        scanline.clear();
        data = scanline_from(data, length, &mut scanline)
            .map_err(|problem| format!("scanline {number} of {count} {problem}"))?;
        pixels.extend(scanline.iter().map(|code| header.color(*code)));
    }
    let [width, height] = layout.size();
    Ok((width as u32, height as u32, layout.upright(pixels)))
}

/// The line that `bytes` begin with, without its end, and what follows.
fn split_line(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let end = memchr::memchr(b'\n', &bytes[..bytes.len().min(MAX_HEADER)])?;
    let line = &bytes[..end];
    Some((line.strip_suffix(b"\r").unwrap_or(line), &bytes[end + 1..]))
}

/// How codes become radiances.
struct Header {
    /// Factor of the colors: the inverse of what programs have multiplied them with.
    factor: Rgb,
    /// Map of the colors to Rec. 709.
    map: Option<DMat3>,
}

impl Header {
    /// Reads the lines up to the empty one. `EXPOSURE` and `COLORCORR` are factors that a program
    /// has multiplied with, as the manual of Radiance says. Those that are not positive numbers
    /// have no effect.
    fn read(bytes: &[u8]) -> std::result::Result<(Self, &[u8]), String> {
        if !bytes.starts_with(b"#?") {
            return Err("it does not begin with `#?`".into());
        }
        let (mut own, mut rest) = (Self { factor: Rgb::ONE, map: None }, bytes);
        let mut is_xyz = false;
        loop {
            let (line, after) = split_line(rest).ok_or("its header has no end")?;
            rest = after;
            if line.is_empty() {
                break;
            }
            let line = decoded(line);
            let Some((key, value)) = line.split_once('=') else { continue };
            match (key.trim(), value.trim()) {
                ("FORMAT", "32-bit_rle_rgbe") => is_xyz = false,
                ("FORMAT", "32-bit_rle_xyze") => is_xyz = true,
                ("FORMAT", other) => return Err(format!("the format `{other}` is unknown")),
                (key, value) => own.set(key, value),
            }
        }
        if is_xyz {
            own.map = Some(Primaries::xyz_to_rec_709());
        }
        Ok((own, rest))
    }

    fn set(&mut self, key: &str, value: &str) {
        let numbers = value.split_whitespace().map(|word| word.parse::<f64>());
        let Ok(numbers) = numbers.collect::<std::result::Result<Vec<f64>, _>>() else { return };
        let is_factor = numbers.iter().all(|number| (1e-30..1e30).contains(number));
        match (key, &numbers[..]) {
            ("EXPOSURE", [exposure]) if is_factor => self.factor /= *exposure as f32,
            ("COLORCORR", [r, g, b]) if is_factor => {
                self.factor /= Rgb::new(*r as f32, *g as f32, *b as f32);
            }
            ("PRIMARIES", &[a, b, c, d, e, f, g, h]) => {
                self.map = Primaries { xy: [[a, b], [c, d], [e, f], [g, h]] }.to_rec_709();
            }
            _ => {}
        }
    }

    fn color(&self, [r, g, b, exponent]: Code) -> Rgb {
        if exponent == 0 {
            return Rgb::ZERO;
        }
        // Within the range of normal numbers, also where the mantissas are small.
        let scale = (f64::from(exponent) - 136.0).exp2();
        let color = [r, g, b].map(|code| (f64::from(code) * scale) as f32);
        let color = self.factor * Rgb::from_array(color);
        self.map.map_or(color, |map| converted(map, color))
    }
}

/// Order of the pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Layout {
    /// Number of scanlines, and their length.
    scanlines: [usize; 2],
    /// Whether scanlines are columns.
    are_columns: bool,
    /// Whether the first pixel is at the right, and whether it is at the bottom.
    from_end: [bool; 2],
}

impl Layout {
    /// Reads a line such as `-Y 16 +X 32`: y points up and x to the right, and the first axis is
    /// that of the scanlines' order.
    fn of(line: &str) -> std::result::Result<Self, String> {
        let wrong = || {
            let shown: String = line.chars().take(40).collect();
            format!("`{shown}` is not a size such as `-Y 16 +X 32`")
        };
        let words: Vec<&str> = line.split_whitespace().collect();
        let [first, count, second, length] = words[..] else { return Err(wrong()) };
        let size = |word: &str| word.parse().ok().filter(|size| (1..=MAX_SIZE).contains(size));
        let (Some(count), Some(length)) = (size(count), size(length)) else {
            return Err(format!("{}; at most {MAX_SIZE} pixels are read", wrong()));
        };
        let (are_columns, x, y) = match (first, second) {
            ("-Y" | "+Y", "-X" | "+X") => (false, second, first),
            ("-X" | "+X", "-Y" | "+Y") => (true, first, second),
            _ => return Err(wrong()),
        };
        let from_end = [x.starts_with('-'), y.starts_with('+')];
        Ok(Self { scanlines: [count, length], are_columns, from_end })
    }

    /// Width and height, pixels.
    fn size(&self) -> [usize; 2] {
        let [count, length] = self.scanlines;
        if self.are_columns { [count, length] } else { [length, count] }
    }

    /// Pixels row by row from the top left.
    fn upright(&self, pixels: Vec<Rgb>) -> Vec<Rgb> {
        if !self.are_columns && self.from_end == [false; 2] {
            return pixels;
        }
        let [width, height] = self.size();
        let [from_right, from_bottom] = self.from_end;
        let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
        let pixel = |(x, y): (usize, usize)| {
            let x = if from_right { width - 1 - x } else { x };
            let y = if from_bottom { height - 1 - y } else { y };
            let index = if self.are_columns { x * height + y } else { y * width + x };
            pixels[index]
        };
        places.map(pixel).collect()
    }
}

const CUT_OFF: &str = "is cut off";

/// Reads a scanline of `length` pixels, and returns the bytes behind it.
fn scanline_from<'a>(
    data: &'a [u8],
    length: usize,
    scanline: &mut Vec<Code>,
) -> std::result::Result<&'a [u8], &'static str> {
    if LENGTHS_OF_RUNS.contains(&length)
        && let [2, 2, high @ 0..=127, low, rest @ ..] = data
    {
        if usize::from(*high) << 8 | usize::from(*low) != length {
            return Err("has another length");
        }
        return channels_from(rest, length, scanline);
    }
    pixels_from(data, length, scanline)
}

/// Reads runs of each channel, one channel after the other.
fn channels_from<'a>(
    mut data: &'a [u8],
    length: usize,
    scanline: &mut Vec<Code>,
) -> std::result::Result<&'a [u8], &'static str> {
    scanline.resize(length, [0; 4]);
    for channel in 0..4 {
        let mut at = 0;
        while at < length {
            let [count, rest @ ..] = data else { return Err(CUT_OFF) };
            let is_run = *count > 128;
            let count = usize::from(if is_run { count - 128 } else { *count });
            if count == 0 || count > length - at {
                return Err("has a run of a wrong length");
            }
            let stored = if is_run { 1 } else { count };
            let (values, rest) = rest.split_at_checked(stored).ok_or(CUT_OFF)?;
            let targets = scanline[at..at + count].iter_mut();
            let values = values.iter().cycle();
            targets.zip(values).for_each(|(code, value)| code[channel] = *value);
            (at, data) = (at + count, rest);
        }
    }
    Ok(data)
}

/// Reads pixels, and the older runs: three mantissas of 1 repeat the last pixel as often as their
/// exponent says. Several of these in a row are the digits of one number, the lowest first.
fn pixels_from<'a>(
    mut data: &'a [u8],
    length: usize,
    scanline: &mut Vec<Code>,
) -> std::result::Result<&'a [u8], &'static str> {
    let mut shift = 0;
    while scanline.len() < length {
        let Some((code, rest)) = data.split_first_chunk::<4>() else { return Err(CUT_OFF) };
        data = rest;
        if let [1, 1, 1, digit] = *code {
            let last = *scanline.last().ok_or("begins with a run")?;
            let count = u64::from(digit) << shift;
            if count > (length - scanline.len()) as u64 {
                return Err("has a run of a wrong length");
            }
            scanline.resize(scanline.len() + count as usize, last);
            shift = (shift + 8).min(32);
        } else {
            scanline.push(*code);
            shift = 0;
        }
    }
    Ok(data)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn older_runs_are_numbers_of_several_digits() {
        let read = |data: &[u8], length| {
            let mut scanline = Vec::new();
            let rest = scanline_from(data, length, &mut scanline).map(<[u8]>::len);
            rest.map(|rest| (scanline, rest))
        };
        let (scanline, rest) =
            read(&[9, 8, 7, 6, 1, 1, 1, 2, 1, 1, 1, 1, 5, 5, 5, 5, 0], 260).unwrap();
        let expected = [vec![[9, 8, 7, 6]; 259], vec![[5; 4]]].concat();
        assert_eq!((scanline, rest), (expected, 1));
        for (data, length, problem) in [
            (&[1, 1, 1, 4][..], 4, "begins with a run"),
            (&[9, 9, 9, 9, 1, 1, 1, 4], 4, "has a run of a wrong length"),
            (&[9, 9, 9], 1, "is cut off"),
            (&[2, 2, 0, 9, 0, 0], 8, "has another length"),
            (&[2, 2, 0, 8, 137, 0], 8, "has a run of a wrong length"),
            (&[2, 2, 0, 8, 0], 8, "has a run of a wrong length"),
            (&[2, 2, 0, 8, 136], 8, "is cut off"),
        ] {
            assert_eq!(read(data, length), Err(problem), "{data:?}");
        }
    }

    #[test]
    fn all_orientations_show_the_same_picture() {
        // Two columns and three rows: 10 times the row from the top, and the column from the left.
        let row = |row: f32| [10.0 * row, 10.0 * row + 1.0];
        let expected: Vec<Rgb> =
            [0.0, 1.0, 2.0].map(row).as_flattened().iter().copied().map(Rgb::splat).collect();
        for (line, order) in [
            ("-Y 3 +X 2", [0, 1, 10, 11, 20, 21]),
            ("-Y 3 -X 2", [1, 0, 11, 10, 21, 20]),
            ("+Y 3 +X 2", [20, 21, 10, 11, 0, 1]),
            ("+Y 3 -X 2", [21, 20, 11, 10, 1, 0]),
            ("+X 2 -Y 3", [0, 10, 20, 1, 11, 21]),
            ("-X 2 -Y 3", [1, 11, 21, 0, 10, 20]),
            ("+X 2 +Y 3", [20, 10, 0, 21, 11, 1]),
            ("-X 2 +Y 3", [21, 11, 1, 20, 10, 0]),
        ] {
            let layout = Layout::of(line).unwrap();
            assert_eq!(layout.size(), [2, 3], "{line}");
            let pixels = order.map(|number| Rgb::splat(number as f32)).to_vec();
            assert_eq!(layout.upright(pixels), expected, "{line}");
        }
        for line in ["-Y 3 +Y 2", "3 2", "-Y 0 +X 2", "-Y 70000 +X 2", "-Y x +X 2", ""] {
            assert!(Layout::of(line).is_err(), "{line}");
        }
    }
}
