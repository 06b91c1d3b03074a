//! Maps of grids of meters: false colors, isolines and an EXR image of all numbers.

use super::digits::{digits, uncertainty};
use crate::cli::outputs::Attempts;
use bdpm::Measurement;
use bdpm::base::atomic::write_atomically;
use bdpm::base::names::{Names, for_file};
use bdpm::image_io::{Image, Layer, Value, write_exr};
use bdpm::light::false_color::{ColorScale, FalseColorMap, ValueGrid};
use bdpm::light::isolines::isolines_svg;
use bdpm::measurement::{Reading, SetReadings, quantity};
use std::path::{Path, PathBuf};

/// Width of a cell in the drawing of isolines.
const CELL: f64 = 20.0;

/// Extensions of the files of a grid.
pub const EXTENSIONS: [&str; 3] = ["png", "svg", "exr"];

/// Paths in a folder for the files of each grid among sets of these names and numbers of meters,
/// without extensions.
pub fn paths<'a>(folder: &Path, sets: impl Iterator<Item = (&'a str, usize)>) -> Vec<PathBuf> {
    let mut names = Names::default();
    let grids = sets.filter(|(_, meters)| *meters > 1);
    grids.map(|(name, _)| folder.join(names.unique(for_file(name, "meters")))).collect()
}

/// Writes a map in false colors, isolines and an EXR image for each grid.
pub fn write(folder: &Path, measurement: &Measurement, attempts: &mut Attempts) {
    let sets = || measurement.sets.iter();
    let paths = paths(folder, sets().map(|set| (&set.name[..], set.readings.len())));
    for (set, path) in sets().filter(|set| set.readings.len() > 1).zip(paths) {
        let values: Vec<f64> = set.readings.iter().map(|reading| reading.value).collect();
        let grid = ValueGrid::new(set.grid[0], set.grid[1], &values);
        let scale = ColorScale::linear(grid);
        let captions = captions(set);
        let map = FalseColorMap { grid, scale, unit: set.unit(), captions: &captions };
        let svg = isolines_svg(grid, &scale.ticks(), set.unit(), CELL);
        let [png, lines, exr] = EXTENSIONS.map(|extension| path.with_extension(extension));
        attempts.add(&png, || map.write_png(&png));
        attempts.add(&lines, || write_atomically(&lines, |file| file.write_all(svg.as_bytes())));
        attempts.add(&exr, || write_exr(&exr, &image(set)));
    }
}

fn captions(set: &SetReadings) -> Vec<String> {
    let places = digits(&set.mean);
    let [low, high] = set.extremes().map(|extreme| extreme.value);
    let (unit, mean, uniformity) = (set.unit(), &set.mean, set.uniformity());
    vec![
        format!("{} of {}", quantity(set.kind), set.name),
        format!(
            "mean {:.places$} {unit} +- {} (95 %)",
            mean.value,
            uncertainty(mean.expanded, places)
        ),
        format!(
            "{} to {} {unit}, uniformity {} +- {}",
            uncertainty(low, 0),
            uncertainty(high, 0),
            uncertainty(uniformity.value, 3),
            uncertainty(uniformity.expanded, 3)
        ),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_of_one_name_have_files_of_their_own() {
        let sets = [("Desk 1", 4), ("point", 1), ("desk-1", 9), ("/", 2)];
        let paths = paths(Path::new("a"), sets.into_iter());
        assert_eq!(paths, ["a/Desk-1", "a/desk-1-2", "a/meters"].map(PathBuf::from));
    }
}
