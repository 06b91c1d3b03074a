//! Image files: EXR with layers and metadata, and a tone-mapped PNG for viewing.
//!
//! Here live the formats of image files, tone curves, white balance, and pictures with numbers.
//! Nothing here knows how an image is made.
//!
//! Every file is written under a temporary name in its folder and renamed when it is complete. Half
//! an image is never visible, and a failure leaves the old file unchanged.

#[cfg(feature = "pictures")]
mod canvas;
mod exr_blocks;
mod exr_file;
mod exr_format;
mod exr_header;
mod exr_summary;
mod exr_windows;
mod png_file;
mod primaries;
mod scale;
mod tone;
mod tone_curves;
mod white_balance;

#[cfg(feature = "pictures")]
pub use canvas::Canvas;
pub use exr_file::{read_exr, read_exr_display, write_exr, write_exr_as, write_exr_rows};
pub use exr_format::{DisplayWindow, ExrCompression, ExrFormat, half_bits, half_value};
pub use exr_summary::{ExrChannel, ExrSummary, read_exr_summary};
pub use png_file::{
    encode_png, is_ours, write_png, write_png_as, write_png_bytes, write_png_exposed,
};
pub use primaries::{Primaries, converted};
pub use scale::{digits, number, quantile, tick_step};
pub use tone::{ToneCurve, ToneMapping, auto_exposure, tone_map};
pub use white_balance::{Adaptation, WhiteBalance};

use bdpm_base::math::Rgb;
use std::collections::BTreeMap;
use std::ops::Range;

/// Facts about an image, by name. Written to EXR as `bdpm.NAME`.
pub type Metadata = BTreeMap<String, Value>;

/// A fact about an image.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// Any text without NUL characters.
    Text(String),
    /// Any number; integers are exact up to 2^53.
    Number(f64),
}

/// Name of the layer with the image before `bdpm denoise` replaced it.
pub const NOISY: &str = "noisy";

/// Named channels of an image file, one `f32` per pixel and channel.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// Channel `Y` of layer `rms` is `rms.Y` in the file. The image itself has the empty name.
    pub name: String,
    /// Names, such as `R`, and values row by row from the top left.
    pub channels: Vec<(String, Vec<f32>)>,
}

impl Layer {
    /// The channels `R`, `G` and `B`.
    pub fn rgb(name: impl Into<String>, pixels: &[Rgb]) -> Self {
        let channel = |i: usize| pixels.iter().map(|pixel| pixel[i]).collect();
        let channels = ["R", "G", "B"].iter().enumerate();
        let channels = channels.map(|(i, &name)| (name.to_owned(), channel(i))).collect();
        Self { name: name.into(), channels }
    }

    /// Some rows of the layer of an image of this width.
    pub fn rows(&self, rows: Range<u32>, width: u32) -> Self {
        let values = (rows.start * width) as usize..(rows.end * width) as usize;
        let channels = self.channels.iter();
        let channels = channels.map(|(name, all)| (name.clone(), all[values.clone()].to_vec()));
        Self { name: self.name.clone(), channels: channels.collect() }
    }

    /// The values of a channel.
    pub fn channel(&self, name: &str) -> Option<&[f32]> {
        self.channels.iter().find(|(n, _)| n == name).map(|(_, values)| &values[..])
    }

    /// Its `R`, `G` and `B` as colors, if it has all three.
    pub fn to_rgb(&self) -> Option<Vec<Rgb>> {
        let [r, g, b] = ["R", "G", "B"].map(|name| self.channel(name));
        let (r, g, b) = (r?, g?, b?);
        Some(r.iter().zip(g).zip(b).map(|((&r, &g), &b)| Rgb::new(r, g, b)).collect())
    }
}

/// Content of an EXR file: linear Rec. 709 radiance, W/(m^2 sr), and other layers.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// The image itself and its other layers.
    pub layers: Vec<Layer>,
    /// Facts about the image.
    pub metadata: Metadata,
}

impl Image {
    /// The layer of this name; the image itself has the empty one.
    pub fn layer(&self, name: &str) -> Option<&Layer> {
        self.layers.iter().find(|layer| layer.name == name)
    }

    /// The image before denoising: the layer [`NOISY`] if `bdpm denoise` wrote the file, else the
    /// image itself.
    pub fn raw(&self) -> Option<&Layer> {
        self.layer(NOISY).or_else(|| self.layer(""))
    }
}
