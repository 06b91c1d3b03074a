//! PNG files: tone-mapped previews and plots.

use super::ToneMapping;
use bdpm_base::atomic::write_atomically;
use bdpm_base::math::Rgb;
use rayon::prelude::*;
use std::fs::File;
use std::io::{Read, Write};
use std::path::Path;

/// The text chunk that marks files of this program.
const SOFTWARE: [&str; 2] = ["Software", "bdpm"];

/// Bytes at the beginning of a file that contain that text.
const BEGINNING: u64 = 1 << 10;

/// Writes a tone-mapped 8-bit sRGB picture with [`auto_exposure`](super::auto_exposure); returns
/// the exposure.
///
/// # Errors
/// If the file cannot be written; names it.
///
/// # Panics
/// If the number of pixels is not `width * height`.
pub fn write_png(path: &Path, width: u32, height: u32, pixels: &[Rgb]) -> bdpm_base::Result<f32> {
    write_png_as(path, (width, height), pixels, ToneMapping::default())
}

/// Writes an 8-bit sRGB picture with this tone mapping; returns the exposure.
///
/// # Errors
/// As [`write_png`].
///
/// # Panics
/// As [`write_png`].
pub fn write_png_as(
    path: &Path,
    (width, height): (u32, u32),
    pixels: &[Rgb],
    mapping: ToneMapping,
) -> bdpm_base::Result<f32> {
    let exposure = mapping.exposure(pixels);
    write_png_exposed(path, (width, height), pixels, mapping, exposure)?;
    Ok(exposure)
}

/// Writes as [`write_png_as`], but with this factor from radiance to display values.
///
/// # Errors
/// As [`write_png`].
///
/// # Panics
/// As [`write_png`].
pub fn write_png_exposed(
    path: &Path,
    (width, height): (u32, u32),
    pixels: &[Rgb],
    mapping: ToneMapping,
    exposure: f32,
) -> bdpm_base::Result<()> {
    assert_eq!(pixels.len(), width as usize * height as usize);
    let mapped: Vec<[u8; 3]> =
        pixels.par_iter().map(|pixel| mapping.apply(*pixel, exposure)).collect();
    let bytes = mapped.into_flattened();
    write_png_bytes(path, width, height, &bytes)
}

/// Writes 8-bit sRGB pixels as they are, row by row.
///
/// # Errors
/// If the file cannot be written; names it.
///
/// # Panics
/// If there are not three bytes per pixel.
pub fn write_png_bytes(
    path: &Path,
    width: u32,
    height: u32,
    bytes: &[u8],
) -> bdpm_base::Result<()> {
    assert_eq!(bytes.len(), 3 * width as usize * height as usize);
    write_atomically(path, |to| {
        encode(to, width, height, bytes).map_err(|e| match e {
            png::EncodingError::IoError(e) => e,
            e => e.into(),
        })
    })
}

/// Returns true if `path` is a PNG file that this program has written.
pub fn is_ours(path: &Path) -> bool {
    if !path.is_file() {
        return false; // opening a pipe would wait for its writer
    }
    let mut bytes = Vec::new();
    let read = File::open(path).and_then(|file| file.take(BEGINNING).read_to_end(&mut bytes));
    let [key, value] = SOFTWARE;
    let text = [b"tEXt", key.as_bytes(), b"\0", value.as_bytes()].concat();
    read.is_ok() && bytes.starts_with(b"\x89PNG") && memchr::memmem::find(&bytes, &text).is_some()
}

/// The bytes of a PNG file of 8-bit sRGB pixels, row by row.
///
/// # Panics
/// If there are not three bytes per pixel.
pub fn encode_png(width: u32, height: u32, bytes: &[u8]) -> Vec<u8> {
    assert_eq!(bytes.len(), 3 * width as usize * height as usize);
    let mut file = Vec::new();
    encode(&mut file, width, height, bytes).expect("memory takes everything");
    file
}

fn encode(to: impl Write, width: u32, height: u32, bytes: &[u8]) -> Result<(), png::EncodingError> {
    let mut encoder = png::Encoder::new(to, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    let [key, value] = SOFTWARE;
    encoder.add_text_chunk(key.into(), value.into())?;
    let mut writer = encoder.write_header()?;
    writer.write_image_data(bytes)?;
    writer.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tone_map;
    use std::io::BufReader;

    #[test]
    fn written_pixels_are_read_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let pixels: Vec<Rgb> =
            (0..35).map(|i| Rgb::new(i as f32, 0.5 * i as f32, 1.0) * 0.05).collect();
        let exposure = write_png(&path, 7, 5, &pixels).unwrap();
        let file = BufReader::new(File::open(&path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        assert_eq!((info.width, info.height), (7, 5));
        let expected: Vec<u8> = pixels.iter().flat_map(|&p| tone_map(p, exposure)).collect();
        assert_eq!(bytes, expected);
    }

    #[test]
    fn is_ours_accepts_only_files_of_this_program() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        write_png(&at("ours.png"), 2, 1, &[Rgb::ONE; 2]).unwrap();
        assert!(is_ours(&at("ours.png")));
        let file = File::create(at("other.png")).unwrap();
        let mut writer = png::Encoder::new(file, 1, 1).write_header().unwrap();
        writer.write_image_data(&[7]).unwrap();
        writer.finish().unwrap();
        std::fs::write(at("text.png"), "tEXtSoftware\0bdpm").unwrap();
        for name in ["other.png", "text.png", "none.png"] {
            assert!(!is_ours(&at(name)), "{name}");
        }
    }
}
