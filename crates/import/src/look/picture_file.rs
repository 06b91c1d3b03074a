//! Picture files as textures: PNG, JPEG, WebP, TIFF, BMP and TGA.

use crate::srgb;
use crate::text::{check_memory, read_bytes};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::base::memory::available_memory;
use bdpm_core::scene::{Texture, Wrap};
use image::{DynamicImage, ImageFormat, ImageReader, Limits};
use std::io::Cursor;
use std::path::Path;

/// Maximum number of texels across and down.
const MAX_SIZE: u32 = 16_384;
/// Largest accepted file, bytes.
const MAX_FILE: u64 = 1 << 30;
/// Bytes of memory per texel while a picture is read: as decoded, and twice as stored.
const TEXEL: f64 = 16.0;
/// Maximum memory for decoding a picture, bytes: that of the largest one with 8 bits per channel.
const MAX_MEMORY: u64 = 1 << 30;

/// Reads a picture file of the format that its content has. TGA files, whose content has no
/// signature, are recognized by their name.
///
/// # Errors
/// If the file cannot be read, or its format is unknown.
pub fn load(path: &Path) -> Result<Texture> {
    let bytes = read_bytes(path, MAX_FILE)?;
    let extension = path.extension().and_then(|extension| extension.to_str());
    let is_tga = extension.is_some_and(|extension| extension.eq_ignore_ascii_case("tga"));
    let default = is_tga.then_some(ImageFormat::Tga);
    decoded(&bytes, default).map_err(|problem| unreadable(&problem).at(path))
}

/// Reads a picture of colors. Those of a PNG file with another gamma than that of sRGB become sRGB
/// codes. Numbers, such as normals, are what a file stores, whatever its gamma is.
///
/// # Errors
/// As [`load`].
pub fn load_colors(path: &Path) -> Result<Texture> {
    let texture = load(path)?;
    let bytes = read_bytes(path, MAX_FILE)?;
    let Some(gamma) = png_gamma(&bytes) else { return Ok(texture) };
    decoded_by(&bytes, gamma).map_err(|problem| unreadable(&problem).at(path))
}

/// Decodes the content of a picture file of any format that has a signature.
///
/// # Errors
/// If the format is unknown, or the content is malformed.
pub fn decode(bytes: &[u8]) -> Result<Texture> {
    decoded(bytes, None).map_err(|problem| unreadable(&problem))
}

/// A texture with each texel changed, and the same sampling.
pub fn map_texels(texture: &Texture, change: impl Fn([u8; 4]) -> [u8; 4]) -> Texture {
    let [width, height] = texture.size();
    let texels = texture.texels().iter().map(|texel| change(*texel)).collect();
    Texture::new(width, height, texels).sampled(texture.sampling())
}

fn unreadable(problem: &str) -> Error {
    let problem = format!("the texture cannot be read: {problem}");
    Error::new(problem, "save it again as PNG or JPEG of 8 bits per channel")
}

/// The exponent of the chunk `gAMA` of a PNG file: codes are linear values to this power. `None`
/// without one, with a color profile, which precedes it, and for that of sRGB.
fn png_gamma(bytes: &[u8]) -> Option<f64> {
    /// Exponent of sRGB, and the range in which programs round it.
    const SRGB: f64 = 1.0 / 2.2;
    const ROUNDING: f64 = 0.02;
    let reader = png::Decoder::new(Cursor::new(bytes)).read_info().ok()?;
    let info = reader.info();
    let has_profile = info.srgb.is_some() || info.icc_profile.is_some();
    let gamma = f64::from(info.gama_chunk?.into_value());
    let is_other = (0.05..=5.0).contains(&gamma) && (gamma - SRGB).abs() > ROUNDING;
    (!has_profile && is_other).then_some(gamma)
}

/// The sRGB codes of a PNG file whose codes are linear values to the power `gamma`, from all its
/// bits.
fn decoded_by(bytes: &[u8], gamma: f64) -> Decoded<Texture> {
    let picture = picture(bytes, ImageFormat::Png)?.into_rgba16();
    let (width, height) = picture.dimensions();
    let code = |value: u16| {
        let linear = (f64::from(value) / 65_535.0).powf(1.0 / gamma);
        (255.0 * srgb::encode(Rgb::splat(linear as f32))[0]).round() as u8
    };
    let codes: Vec<u8> = (0..=u16::MAX).map(code).collect();
    let texel = |&image::Rgba([r, g, b, a]): &image::Rgba<u16>| {
        let [r, g, b] = [r, g, b].map(|value| codes[usize::from(value)]);
        [r, g, b, (f64::from(a) / 257.0).round() as u8]
    };
    Ok(Texture::new(width, height, picture.pixels().map(texel).collect()))
}

/// The linear color of a texel, without its opacity.
pub fn linear_color([r, g, b, _]: [u8; 4]) -> Rgb {
    srgb::decode([r, g, b].map(|code| f64::from(code) / 255.0))
}

/// Names of the continuations of textures in scene files, in the order of [`Wrap`].
pub const WRAP_NAMES: &[&str] = &["repeat", "mirror", "clamp"];

/// The name of a continuation in scene files.
pub fn wrap_name(wrap: Wrap) -> &'static str {
    WRAP_NAMES[wrap as usize]
}

/// The continuation of this name.
pub fn wrap_named(name: &str) -> Option<Wrap> {
    [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp].into_iter().find(|wrap| wrap_name(*wrap) == name)
}

/// Results of decoders, whose error is the problem in words.
type Decoded<T> = std::result::Result<T, String>;

/// Refuses pictures without texels and those that memory might not hold, before they are decoded.
fn check_size(width: u32, height: u32, available: Option<f64>) -> Decoded<()> {
    let size = format!("it has {width}x{height} texels");
    if !((1..=MAX_SIZE).contains(&width) && (1..=MAX_SIZE).contains(&height)) {
        return Err(format!("{size}; at most {MAX_SIZE} across and down are supported"));
    }
    check_memory(TEXEL * f64::from(width) * f64::from(height), available)
        .map_err(|problem| format!("{size}, which take {problem}; scale it down"))
}

fn decoded(bytes: &[u8], default: Option<ImageFormat>) -> Decoded<Texture> {
    let known = image::guess_format(bytes).ok().filter(ImageFormat::reading_enabled);
    let format = known.or(default).ok_or("it is not a PNG, JPEG, WebP, TIFF, BMP or TGA file")?;
    let picture = picture(bytes, format)?.into_rgba8();
    let (width, height) = picture.dimensions();
    let texels = picture.pixels().map(|pixel| pixel.0).collect();
    Ok(Texture::new(width, height, texels))
}

/// The picture in a file of this format, as it is stored.
fn picture(bytes: &[u8], format: ImageFormat) -> Decoded<DynamicImage> {
    let reader = || ImageReader::with_format(Cursor::new(bytes), format);
    let (width, height) = reader().into_dimensions().map_err(|e| e.to_string())?;
    check_size(width, height, available_memory())?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(MAX_MEMORY);
    let mut reader = reader();
    reader.limits(limits);
    reader.decode().map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::base::memory::GIB;

    #[test]
    fn pictures_beyond_memory_or_maximum_size_are_refused() {
        check_size(16_384, 16_384, None).unwrap();
        check_size(16_384, 16_384, Some(4.1 * GIB)).unwrap();
        let shown = check_size(16_384, 16_384, Some(3.9 * GIB)).unwrap_err();
        assert!(shown.contains("take about 4.0 GiB of memory, but 3.9 GiB are"), "{shown}");
        for (width, height) in [(0, 1), (1, 0), (16_385, 1), (1, u32::MAX)] {
            assert!(check_size(width, height, None).unwrap_err().contains("at most 16384"));
        }
    }
}
