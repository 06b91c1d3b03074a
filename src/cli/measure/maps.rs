//! Maps of grids of meters: false colors, isolines and an EXR image of all numbers.

use super::digits::digits;
use bdpm::Measurement;
use bdpm::base::atomic::write_atomically;
use bdpm::base::error::{Error, Result};
use bdpm::image_io::{Image, Layer, Value, write_exr};
use bdpm::measurement::{Reading, SetReadings, quantity};
use bdpm::output::false_color::{ColorScale, FalseColorMap, ValueGrid};
use bdpm::output::isolines::isolines_svg;
use std::path::Path;

/// Width of a cell in the drawing of isolines.
const CELL: f64 = 20.0;

/// Writes `NAME.png`, `NAME.svg` and `NAME.exr` for each grid to a folder, which is created.
pub fn write(folder: &Path, measurement: &Measurement) -> Result<()> {
    std::fs::create_dir_all(folder).map_err(|error| Error::io("create", folder, error))?;
    for set in measurement.sets.iter().filter(|set| set.readings.len() > 1) {
        let path = folder.join(file_stem(&set.name));
        let values: Vec<f64> = set.readings.iter().map(|reading| reading.value).collect();
        let grid = ValueGrid::new(set.grid[0], set.grid[1], &values);
        let scale = ColorScale::linear(grid);
        let captions = captions(set);
        let map = FalseColorMap { grid, scale, unit: set.unit(), captions: &captions };
        map.write_png(&path.with_extension("png"))?;
        let svg = isolines_svg(grid, &scale.ticks(), set.unit(), CELL);
        write_atomically(&path.with_extension("svg"), |file| file.write_all(svg.as_bytes()))?;
        write_exr(&path.with_extension("exr"), &image(set))?;
    }
    Ok(())
}

fn captions(set: &SetReadings) -> Vec<String> {
    let places = digits(&set.mean);
    let [low, high] = set.range();
    let (unit, mean) = (set.unit(), &set.mean);
    vec![
        format!("{} of {}", quantity(set.kind), set.name),
        format!("mean {:.places$} {unit} +- {:.places$} (95 %)", mean.value, mean.expanded),
        format!("{low:.0} to {high:.0} {unit}, uniformity {:.3}", set.uniformity()),
    ]
}

/// Layers of the values and of their uncertainties, in the unit of the values.
fn image(set: &SetReadings) -> Image {
    let layer = |name: &str, number: fn(&Reading) -> f64| Layer {
        name: name.into(),
        channels: vec![("Y".into(), set.readings.iter().map(|own| number(own) as f32).collect())],
    };
    let layers = vec![
        layer("", |own| own.value),
        layer("expanded", |own| own.expanded),
        layer("noise", |own| own.noise),
        layer("bias", |own| own.bias),
        layer("direct", |own| own.direct),
    ];
    let metadata = [("unit".to_owned(), Value::Text(set.unit().into()))];
    Image { width: set.grid[0], height: set.grid[1], layers, metadata: metadata.into() }
}

/// The name of a set as a file name: letters, digits and hyphens.
fn file_stem(name: &str) -> String {
    let kept = |c: char| if c.is_alphanumeric() { c } else { '-' };
    let stem: String = name.to_lowercase().chars().map(kept).collect();
    if stem.is_empty() { "meters".into() } else { stem }
}
