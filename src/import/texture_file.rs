//! Picture files as textures: PNG, JPEG, WebP, TIFF, BMP and TGA.

use super::text;
use crate::base::error::{Error, Result};
use crate::scene::Texture;
use image::{ImageFormat, ImageReader, Limits};
use std::io::{Cursor, Read};
use std::path::Path;

/// Most texels across and down.
const MAX_SIZE: u32 = 16_384;
/// Largest accepted file, bytes.
const MAX_FILE: u64 = 1 << 30;
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

/// The texture, or the problem alone in words.
fn decoded(bytes: &[u8], unsaid: Option<ImageFormat>) -> std::result::Result<Texture, String> {
    let known = image::guess_format(bytes).ok().filter(ImageFormat::reading_enabled);
    let format = known.or(unsaid).ok_or("it is no PNG, JPEG, WebP, TIFF, BMP or TGA file")?;
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(MAX_SIZE), Some(MAX_SIZE));
    limits.max_alloc = Some(MAX_MEMORY);
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    reader.limits(limits);
    let picture = reader.decode().map_err(|e| e.to_string())?.into_rgba8();
    let (width, height) = picture.dimensions();
    if width == 0 || height == 0 {
        return Err("it has no texels".to_owned());
    }
    let texels = picture.pixels().map(|pixel| pixel.0).collect();
    Ok(Texture::new(width, height, texels))
}
