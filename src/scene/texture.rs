//! Pictures on surfaces: PNG and JPEG files, bilinear, repeated in both directions.

use super::text;
use crate::error::{Error, Result};
use crate::math::Rgb;
use glam::{Vec2, Vec4};
use std::io::{Cursor, Read};
use std::path::Path;
use std::sync::LazyLock;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Most texels across and down.
const MAX_SIZE: u32 = 16_384;
/// Largest accepted file, bytes.
const MAX_FILE: u64 = 1 << 30;

/// A picture of 8 bits per channel. `u` runs right and `v` up over [0, 1], and on periodically.
#[derive(Clone, PartialEq, Eq, Hash)]
pub struct Texture {
    width: u32,
    height: u32,
    /// Red, green, blue (sRGB) and opacity (linear), rows from the top.
    texels: Vec<[u8; 4]>,
    has_opacity: bool,
}

impl std::fmt::Debug for Texture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Texture({}x{})", self.width, self.height)
    }
}

/// Linear values of sRGB codes (IEC 61966-2-1).
static SRGB: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|code| {
        let x = code as f32 / 255.0;
        if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
    })
});

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
    /// If it is neither.
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

    /// From `width` times `height` texels: red, green, blue (sRGB) and opacity, rows from the top.
    ///
    /// # Panics
    /// If their number is another, or there is none.
    pub fn new(width: u32, height: u32, texels: Vec<[u8; 4]>) -> Self {
        assert!(!texels.is_empty() && texels.len() == width as usize * height as usize);
        let has_opacity = texels.iter().any(|texel| texel[3] != 255);
        Self { width, height, texels, has_opacity }
    }

    /// Texels across and down.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// All texels.
    pub(super) fn texels(&self) -> &[[u8; 4]] {
        &self.texels
    }

    /// Mean of the linear color.
    pub(super) fn mean_color(&self) -> Rgb {
        let [r, g, b, _] = self.mean(|code| SRGB[usize::from(code)].into());
        Rgb::new(r, g, b)
    }

    /// Mean of each channel as it is stored, in [0, 1].
    pub(super) fn mean_stored(&self) -> [f32; 4] {
        self.mean(|code| f64::from(code) / 255.0)
    }

    fn mean(&self, value: impl Fn(u8) -> f64) -> [f32; 4] {
        let mut sums = [0.0; 4];
        for texel in &self.texels {
            sums.iter_mut().zip(texel).for_each(|(sum, code)| *sum += value(*code));
        }
        sums.map(|sum| (sum / self.texels.len() as f64) as f32)
    }

    /// Linear color at `uv`.
    pub fn color(&self, uv: Vec2) -> Rgb {
        let linear = |[r, g, b, _]: [u8; 4]| {
            let table = &*SRGB;
            Vec4::new(table[r as usize], table[g as usize], table[b as usize], 0.0)
        };
        self.bilinear(uv, linear).truncate()
    }

    /// Opacity at `uv`, in [0, 1]: the alpha channel if the picture has one, else its brightness as
    /// it is stored.
    pub fn opacity(&self, uv: Vec2) -> f32 {
        let value = |[r, g, b, a]: [u8; 4]| {
            let sum = u32::from(r) + u32::from(g) + u32::from(b);
            Vec4::splat(if self.has_opacity { f32::from(a) } else { sum as f32 / 3.0 } / 255.0)
        };
        self.bilinear(uv, value).x
    }

    /// The mean of the four texels around `uv`, by their distance.
    fn bilinear(&self, uv: Vec2, value: impl Fn([u8; 4]) -> Vec4) -> Vec4 {
        // Texel centers lie at halves; `rem_euclid` may round up to 1.
        let along = |x: f32, size: u32| {
            let place = x.rem_euclid(1.0).min(1.0) * size as f32 - 0.5;
            let low = place.floor();
            let index = |i: f32| (i as i64).rem_euclid(i64::from(size)) as usize;
            (index(low), index(low + 1.0), place - low)
        };
        let (left, right, x) = along(uv.x, self.width);
        let (top, bottom, y) = along(1.0 - uv.y, self.height);
        let texel =
            |column: usize, row: usize| value(self.texels[row * self.width as usize + column]);
        let above = texel(left, top).lerp(texel(right, top), x);
        let below = texel(left, bottom).lerp(texel(right, bottom), x);
        above.lerp(below, y)
    }
}

/// What decoders say: the problem alone, in words.
type Decoded<T> = std::result::Result<T, String>;

/// Refuses pictures without texels and those that memory might not hold.
fn check_size(width: u32, height: u32) -> Decoded<()> {
    if (1..=MAX_SIZE).contains(&width) && (1..=MAX_SIZE).contains(&height) {
        return Ok(());
    }
    Err(format!("it has {width}x{height} texels; at most {MAX_SIZE} across and down are taken"))
}

fn png(bytes: Vec<u8>) -> Decoded<Texture> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(|e| e.to_string())?;
    let (width, height) = (reader.info().width, reader.info().height);
    check_size(width, height)?;
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
        .set_max_width(MAX_SIZE as usize)
        .set_max_height(MAX_SIZE as usize)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(bytes), options);
    let data = decoder.decode().map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions().ok_or("it has no size")?;
    let (width, height) = (width as u32, height as u32);
    check_size(width, height)?;
    let texels: Vec<_> = data.chunks_exact(3).map(|c| [c[0], c[1], c[2], 255]).collect();
    if texels.len() != width as usize * height as usize {
        return Err("it is cut off".to_owned());
    }
    Ok(Texture::new(width, height, texels))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Black, white above red, green.
    fn picture() -> Texture {
        let texels = [[0, 0, 0, 255], [255, 255, 255, 255], [255, 0, 0, 255], [0, 255, 0, 255]];
        Texture::new(2, 2, texels.to_vec())
    }

    #[test]
    fn texel_centers_have_their_color_and_v_points_up() {
        let at = |u, v| picture().color(Vec2::new(u, v));
        assert_eq!(at(0.25, 0.75), Rgb::ZERO);
        assert_eq!(at(0.75, 0.75), Rgb::ONE);
        assert_eq!(at(0.25, 0.25), Rgb::X);
        assert_eq!(at(0.75, 0.25), Rgb::Y);
        assert_eq!(at(0.5, 0.75), Rgb::splat(0.5), "halfway in linear light");
        assert_eq!(at(0.5, 0.5), Rgb::new(0.5, 0.5, 0.25));
    }

    #[test]
    fn pictures_repeat() {
        for (u, v) in [(0.3, 0.9), (0.0, 0.0), (0.99, 0.5)] {
            let once = picture().color(Vec2::new(u, v));
            for shift in [-3.0, 1.0, 7.0] {
                let again = picture().color(Vec2::new(u + shift, v - shift));
                assert!((once - again).length() < 1e-4, "{u} {v} {shift}");
            }
        }
        // Rounding leads nowhere.
        for uv in [Vec2::splat(-1e-20), Vec2::splat(1e15), Vec2::splat(-1e15), Vec2::splat(1.0)] {
            assert!(picture().color(uv).is_finite());
        }
    }

    #[test]
    fn colors_are_decoded_and_opacity_is_not() {
        let gray = Texture::new(1, 1, vec![[188, 188, 188, 255]]);
        assert!((gray.color(Vec2::ZERO).x - 0.503).abs() < 1e-3);
        assert!((gray.opacity(Vec2::ZERO) - 188.0 / 255.0).abs() < 1e-6);
        let clear = Texture::new(1, 1, vec![[188, 188, 188, 51]]);
        assert!((clear.opacity(Vec2::ZERO) - 0.2).abs() < 1e-6);
    }
}
