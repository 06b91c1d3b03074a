//! Options for the format of an image and its preview.

use super::settings_args::word;
use bdpm::image_io::{ExrCompression, ExrFormat, ToneCurve, ToneMapping};
use std::convert::Infallible;
use std::path::{Path, PathBuf};

/// The name of an EXR image that the user gives. A PNG name is that of its preview.
pub fn image_name(name: &str) -> Result<PathBuf, Infallible> {
    let path = PathBuf::from(name);
    let is_png = path.extension().is_some_and(|own| own.eq_ignore_ascii_case("png"));
    Ok(if is_png { path.with_extension("exr") } else { path })
}

/// Tone mapping of an 8-bit picture.
#[derive(Clone, clap::Args)]
pub struct ToneArgs {
    /// Map the colors of the PNG preview by this curve
    #[arg(long, value_name = "CURVE", default_value = "srgb")]
    #[arg(value_parser = word::<ToneCurve>(TONE_CURVE))]
    tonemap: ToneCurve,
    /// Brighten the PNG preview by this many stops, beyond the automatic exposure
    #[arg(long, value_name = "STOPS", default_value = "0", value_parser = stops)]
    #[arg(allow_negative_numbers = true)]
    exposure: f32,
}

impl ToneArgs {
    /// Curve and exposure.
    pub fn mapping(&self) -> ToneMapping {
        ToneMapping { curve: self.tonemap, stops: self.exposure }
    }
}

/// Format of an image and its preview.
#[derive(Clone, clap::Args)]
pub struct ImageFileArgs {
    #[command(flatten)]
    tone: ToneArgs,
    /// Compress the EXR image by this lossless method
    #[arg(long, value_name = "METHOD", default_value = "zip")]
    #[arg(value_parser = word::<ExrCompression>(EXR_COMPRESSION))]
    exr_compression: ExrCompression,
    /// Write colors of the EXR image as 16-bit floats, and other layers as 32-bit floats
    #[arg(long)]
    half: bool,
    /// Add luminance in cd/m2 as a layer, and write it in false colors to a second PNG
    #[arg(long)]
    photometric: bool,
}

const TONE_CURVE: &[(&str, &str)] = &[
    ("srgb", "Exact sRGB colors below 0.7, brighter ones roll off toward white"),
    ("agx", "AgX: wide range, bright colors approach white"),
    ("filmic", "Hable's filmic curve: soft shadows and highlights"),
];

const EXR_COMPRESSION: &[(&str, &str)] = &[
    ("none", "No compression"),
    ("rle", "Run lengths"),
    ("zips", "zlib of single lines"),
    ("zip", "zlib of 16 lines"),
    ("piz", "Wavelets, for noisy images"),
];

impl ImageFileArgs {
    /// Tone mapping of the preview.
    pub fn tone_mapping(&self) -> ToneMapping {
        self.tone.mapping()
    }

    /// The file of the luminance in false colors beside the image, if one is written.
    pub fn false_color(&self, exr: &Path) -> Option<PathBuf> {
        self.photometric.then(|| exr.with_extension("luminance.png"))
    }

    /// Format of the EXR file of a whole image.
    pub fn exr_format(&self) -> ExrFormat {
        ExrFormat { compression: self.exr_compression, half: self.half, ..ExrFormat::default() }
    }
}

/// Reads a number of stops.
fn stops(text: &str) -> Result<f32, &'static str> {
    let stops = text.parse::<f32>().ok().filter(|stops| stops.is_finite());
    stops.ok_or("give a number of stops, such as 1 or -0.5")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_those_of_the_library() {
        for (word, _) in TONE_CURVE {
            let value: ToneCurve = serde_json::from_str(&format!("\"{word}\"")).unwrap();
            assert_eq!(serde_json::to_value(value).unwrap(), *word);
        }
        for (word, _) in EXR_COMPRESSION {
            let value: ExrCompression = serde_json::from_str(&format!("\"{word}\"")).unwrap();
            assert_eq!(serde_json::to_value(value).unwrap(), *word);
        }
    }

    #[test]
    fn stops_are_finite_numbers() {
        assert_eq!(stops("-0.5"), Ok(-0.5));
        for bad in ["", "bright", "inf", "NaN"] {
            assert!(stops(bad).is_err(), "{bad}");
        }
    }
}
