//! PNG and JPEG files as textures.

use super::text;
use crate::base::error::{Error, Result};
use crate::base::memory::{GIB, available_memory};
use crate::scene::Texture;
use std::io::{Cursor, Read};
use std::path::Path;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Most texels across and down.
const MAX_SIZE: usize = 16_384;
/// Largest accepted file, bytes.
const MAX_FILE: u64 = 1 << 30;
/// Bytes of memory that a texel takes while it is read: as decoded, and twice as kept.
const TEXEL: f64 = 16.0;

impl Texture {
    /// Reads a PNG or JPEG file, whichever its content is.
    ///
    /// # Errors
    /// If it cannot be read, or is neither.
    pub(super) fn load(path: &Path) -> Result<Self> {
        let mut bytes = Vec::new();
        text::open(path)?
            .take(MAX_FILE)
            .read_to_end(&mut bytes)
            .map_err(|e| Error::io("read the texture", path, e))?;
        Self::decode(bytes).map_err(|error| error.at(path))
    }

    /// From the content of a PNG or JPEG file, whichever it is.
    ///
    /// # Errors
    /// If it is neither, or broken.
    pub(super) fn decode(bytes: Vec<u8>) -> Result<Self> {
        let read = match bytes.as_slice() {
            [0x89, b'P', b'N', b'G', ..] => png(bytes),
            [0xff, 0xd8, ..] => jpeg(bytes),
            _ => Err("it is neither a PNG nor a JPEG file".to_owned()),
        };
        read.map_err(|problem| {
            let problem = format!("the texture cannot be read: {problem}");
            Error::new(problem, "save it again as PNG or JPEG of 8 bits per channel")
        })
    }
}

/// What decoders say: the problem alone, in words.
type Decoded<T> = std::result::Result<T, String>;

/// Refuses pictures without texels and those that memory might not hold, before they are decoded.
fn check_size(width: usize, height: usize, available: Option<f64>) -> Decoded<()> {
    let size = format!("it has {width}x{height} texels");
    if !((1..=MAX_SIZE).contains(&width) && (1..=MAX_SIZE).contains(&height)) {
        return Err(format!("{size}; at most {MAX_SIZE} across and down are taken"));
    }
    let needed = TEXEL * width as f64 * height as f64;
    match available {
        Some(available) if needed > available => Err(format!(
            "{size}, which take about {:.1} GiB of memory, but {:.1} GiB are available; scale it \
             down",
            needed / GIB,
            available / GIB
        )),
        _ => Ok(()),
    }
}

fn png(bytes: Vec<u8>) -> Decoded<Texture> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(|e| e.to_string())?;
    let (width, height) = (reader.info().width, reader.info().height);
    check_size(width as usize, height as usize, available_memory())?;
    let size = reader.output_buffer_size().ok_or("it is too large")?;
    let mut data = vec![0; size];
    let frame = reader.next_frame(&mut data).map_err(|e| e.to_string())?;
    let data = &data[..frame.buffer_size()];
    let texels = match frame.color_type {
        png::ColorType::Grayscale => data.iter().map(|&v| [v, v, v, 255]).collect(),
        png::ColorType::GrayscaleAlpha => {
            data.chunks_exact(2).map(|c| [c[0], c[0], c[0], c[1]]).collect()
        }
        png::ColorType::Rgb => data.chunks_exact(3).map(|c| [c[0], c[1], c[2], 255]).collect(),
        png::ColorType::Rgba => data.chunks_exact(4).map(|c| [c[0], c[1], c[2], c[3]]).collect(),
        png::ColorType::Indexed => return Err("its palette cannot be read".to_owned()),
    };
    Ok(Texture::new(width, height, texels))
}

fn jpeg(bytes: Vec<u8>) -> Decoded<Texture> {
    let options = DecoderOptions::default()
        .set_max_width(MAX_SIZE)
        .set_max_height(MAX_SIZE)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    decoder.decode_headers().map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions().ok_or("it has no size")?;
    check_size(width, height, available_memory())?;
    let data = decoder.decode().map_err(|e| e.to_string())?;
    let texels: Vec<_> = data.chunks_exact(3).map(|c| [c[0], c[1], c[2], 255]).collect();
    if texels.len() != width * height {
        return Err("it is cut off".to_owned());
    }
    Ok(Texture::new(width as u32, height as u32, texels))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_that_memory_cannot_hold_are_refused() {
        check_size(16_384, 16_384, None).unwrap();
        check_size(16_384, 16_384, Some(4.1 * GIB)).unwrap();
        let shown = check_size(16_384, 16_384, Some(3.9 * GIB)).unwrap_err();
        assert!(shown.contains("take about 4.0 GiB of memory, but 3.9 GiB are"), "{shown}");
        for (width, height) in [(0, 1), (1, 0), (16_385, 1), (1, usize::MAX)] {
            assert!(check_size(width, height, None).unwrap_err().contains("at most 16384"));
        }
    }
}
