//! Format of an EXR file: compression, precision, and place in a larger image.

use super::Layer;
use exr::prelude::{Compression, FlatSamples, f16};
use serde::{Deserialize, Serialize};

/// Format of an EXR file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ExrFormat {
    /// Compression of the pixels.
    pub compression: ExrCompression,
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

impl ExrFormat {
    /// The values of a channel of `layer` in the precision of the file.
    pub(super) fn samples(&self, layer: &Layer, values: &[f32]) -> FlatSamples {
        let is_color = layer.channels.iter().map(|(name, _)| &name[..]).eq(["R", "G", "B"]);
        match self.half && is_color {
            true => FlatSamples::F16(values.iter().map(|&value| half(value)).collect()),
            false => FlatSamples::F32(values.to_vec()),
        }
    }
}

/// The nearest 16-bit float. Finite values stay finite: the largest is 65504.
fn half(value: f32) -> f16 {
    if value.is_finite() {
        f16::from_f32(value.clamp(f16::MIN.to_f32(), f16::MAX.to_f32()))
    } else {
        f16::from_f32(value)
    }
}
