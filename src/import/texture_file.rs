//! Picture files as textures: PNG, JPEG, WebP, TIFF, BMP and TGA.

use super::text;
use crate::base::error::{Error, Result};
use crate::base::memory::{GIB, available_memory};
use crate::scene::Texture;
use image::{ImageFormat, ImageReader, Limits};
use std::io::{Cursor, Read};
use std::path::Path;

/// Most texels across and down.
const MAX_SIZE: u32 = 16_384;
/// Largest accepted file, bytes.
const MAX_FILE: u64 = 1 << 30;
/// Bytes of memory that a texel takes while it is read: as decoded, and twice as kept.
const TEXEL: f64 = 16.0;
/// Most memory for decoding one, bytes: as much as the largest takes with 8 bits per channel.
const MAX_MEMORY: u64 = 1 << 30;

impl Texture {
    /// Reads a picture file of whatever kind its content is. TGA files, which do not tell, are known by their
    /// name.
    ///
    /// # Errors
    /// If it cannot be read, or is of no known kind.
    pub(super) fn load(path: &Path) -> Result<Self> {
        let mut bytes = Vec::new();
        text::open(path)?
            .take(MAX_FILE)
            .read_to_end(&mut bytes)
            .map_err(|e| Error::io("read the texture", path, e))?;
        let extension = path.extension().and_then(|extension| extension.to_str());
        let is_tga = extension.is_some_and(|extension| extension.eq_ignore_ascii_case("tga"));
        let unsaid = is_tga.then_some(ImageFormat::Tga);
        Self::decode_as(&bytes, unsaid).map_err(|error| error.at(path))
    }

    /// From the content of a picture file, whichever kind that is.
    ///
    /// # Errors
    /// If it is of no known kind, or broken.
    pub(super) fn decode(bytes: &[u8]) -> Result<Self> {
        Self::decode_as(bytes, None)
    }

    /// The same; `unsaid` is the kind of what does not tell its own.
    fn decode_as(bytes: &[u8], unsaid: Option<ImageFormat>) -> Result<Self> {
        decoded(bytes, unsaid).map_err(|problem| {
            let problem = format!("the texture cannot be read: {problem}");
            Error::new(problem, "save it again as PNG or JPEG of 8 bits per channel")
        })
    }
}

/// What decoders say: the problem alone, in words.
type Decoded<T> = std::result::Result<T, String>;

/// Refuses pictures without texels and those that memory might not hold, before they are decoded.
fn check_size(width: u32, height: u32, available: Option<f64>) -> Decoded<()> {
    let size = format!("it has {width}x{height} texels");
    if !((1..=MAX_SIZE).contains(&width) && (1..=MAX_SIZE).contains(&height)) {
        return Err(format!("{size}; at most {MAX_SIZE} across and down are taken"));
    }
    let needed = TEXEL * f64::from(width) * f64::from(height);
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

/// The texture, or the problem alone in words.
fn decoded(bytes: &[u8], unsaid: Option<ImageFormat>) -> Decoded<Texture> {
    let known = image::guess_format(bytes).ok().filter(ImageFormat::reading_enabled);
    let format = known.or(unsaid).ok_or("it is no PNG, JPEG, WebP, TIFF, BMP or TGA file")?;
    let reader = || ImageReader::with_format(Cursor::new(bytes), format);
    let (width, height) = reader().into_dimensions().map_err(|e| e.to_string())?;
    check_size(width, height, available_memory())?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_MEMORY);
    let mut reader = reader();
    reader.limits(limits);
    let picture = reader.decode().map_err(|e| e.to_string())?.into_rgba8();
    let (width, height) = picture.dimensions();
    let texels = picture.pixels().map(|pixel| pixel.0).collect();
    Ok(Texture::new(width, height, texels))
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
        for (width, height) in [(0, 1), (1, 0), (16_385, 1), (1, u32::MAX)] {
            assert!(check_size(width, height, None).unwrap_err().contains("at most 16384"));
        }
    }
}
