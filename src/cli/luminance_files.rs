//! Luminance in cd/m^2: a layer of an image, and a picture in false colors.

use bdpm::base::error::Result;
use bdpm::base::math::{Rgb, luminance};
use bdpm::base::photometry::LUMENS_PER_WATT;
use bdpm::image_io::{self, Layer, Metadata, Value};
use bdpm::light::false_color::{ColorScale, FalseColorMap, ValueGrid};
use std::path::Path;

/// States the unit of [`luminance_layer`].
pub fn record_efficacy(metadata: &mut Metadata) {
    let efficacy = Value::Number(f64::from(LUMENS_PER_WATT));
    metadata.insert("luminance unit".into(), Value::Text("cd/m2".into()));
    metadata.insert("luminance in lumens per watt".into(), efficacy);
}

/// The luminance of pixels, cd/m^2.
pub fn luminance_layer(pixels: &[Rgb]) -> Layer {
    let values = pixels.iter().map(|pixel| LUMENS_PER_WATT * luminance(*pixel)).collect();
    Layer { name: "luminance".into(), channels: vec![("Y".into(), values)] }
}

/// Writes the luminance of pixels in false colors with a legend, cd/m^2, on a logarithmic scale.
pub fn write_luminance(path: &Path, (width, height): (u32, u32), pixels: &[Rgb]) -> Result<()> {
    let values: Vec<f64> =
        pixels.iter().map(|pixel| f64::from(LUMENS_PER_WATT * luminance(*pixel))).collect();
    let grid = ValueGrid::new(width, height, &values);
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let captions = [format!("Luminance, mean {} cd/m²", image_io::number(mean))];
    let scale = ColorScale::logarithmic(grid);
    FalseColorMap { grid, scale, unit: "cd/m²", captions: &captions, cell: None }.write_png(path)
}
