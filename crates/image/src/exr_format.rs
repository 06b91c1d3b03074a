//! Format of an EXR file: compression, precision, and place in a larger image.

use super::Layer;
use exr::prelude::{Compression, f16};
use serde::{Deserialize, Serialize};

/// Format of an EXR file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExrFormat {
    /// Compression of the pixels.
    pub compression: ExrCompression,
    /// Compress [`ExrCompression::Zip`] less, in a fraction of the time.
    pub fast: bool,
    /// Write layers of colors (channels `R`, `G` and `B`) as 16-bit floats. Others keep 32 bits.
    pub half: bool,
    /// Place of the pixels in a larger image; `None` if they are the whole image.
    pub window: Option<DisplayWindow>,
}

/// Place of an image in a larger one, as the data window in the display window of an EXR file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DisplayWindow {
    /// Column and row of the top left pixel.
    pub origin: [u32; 2],
    /// Width and height of the larger image, pixels.
    pub size: [u32; 2],
}

/// Lossless compression of an EXR file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ExrCompression {
    /// No compression.
    None,
    /// Run lengths.
    Rle,
    /// zlib of single lines.
    Zips,
    /// zlib of 16 lines.
    #[default]
    Zip,
    /// Wavelets and Huffman codes of 32 lines.
    Piz,
}

impl ExrCompression {
    /// The method of the crate `exr`.
    pub(super) fn method(self) -> Compression {
        match self {
            Self::None => Compression::Uncompressed,
            Self::Rle => Compression::RLE,
            Self::Zips => Compression::ZIP1,
            Self::Zip => Compression::ZIP16,
            Self::Piz => Compression::PIZ,
        }
    }
}

/// Maximum number of pixels of an image whose files are compressed well by default.
const MAX_SLOW_PIXELS: usize = 1 << 20;

impl ExrFormat {
    /// The format for an image of this many pixels: files of more than a million pixels are
    /// compressed fast.
    #[must_use]
    pub fn for_pixels(self, pixels: usize) -> Self {
        Self { fast: self.fast || pixels > MAX_SLOW_PIXELS, ..self }
    }

    /// Whether the channels of `layer` are written as 16-bit floats.
    pub(super) fn is_half(&self, layer: &Layer) -> bool {
        self.half && layer.channels.iter().map(|(name, _)| &name[..]).eq(["R", "G", "B"])
    }
}

/// Bits of the nearest 16-bit float. Finite values stay finite: the largest is 65504.
pub fn half_bits(value: f32) -> u16 {
    half(value).to_bits()
}

/// Value of the 16-bit float with these bits.
pub fn half_value(bits: u16) -> f32 {
    f16::from_bits(bits).to_f32()
}

/// The nearest 16-bit float. Finite values stay finite: the largest is 65504.
pub(super) fn half(value: f32) -> f16 {
    if value.is_finite() {
        f16::from_f32(value.clamp(f16::MIN.to_f32(), f16::MAX.to_f32()))
    } else {
        f16::from_f32(value)
    }
}
