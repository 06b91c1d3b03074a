//! Maps of grids of meters: false colors, isolines and an EXR image of all numbers.

use super::digits::{digits, uncertainty};
use crate::cli::outputs::Attempts;
use bdpm::Measurement;
use bdpm::base::atomic::write_atomically;
use bdpm::base::names::{Names, for_file};
use bdpm::image_io::{Image, Layer, Value, write_exr};
use bdpm::light::false_color::{ColorScale, FalseColorMap, ValueGrid};
use bdpm::light::isolines::isolines_svg;
use bdpm::measurement::{Reading, SetReadings};
use glam::DVec3;
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
        let cell = cell(set);
        let map = FalseColorMap { grid, scale, unit: set.unit(), captions: &captions, cell };
        let svg = isolines_svg(grid, &scale.ticks(), set.unit(), CELL);
        let [png, lines, exr] = EXTENSIONS.map(|extension| path.with_extension(extension));
        attempts.add(&png, || map.write_png(&png));
        attempts.add(&lines, || write_atomically(&lines, |file| file.write_all(svg.as_bytes())));
        attempts.add(&exr, || write_exr(&exr, &image(set)));
    }
}

/// Size of the cells of a plane across and down, meters; `None` if the meters are not the corners
/// of equal cells.
fn cell(set: &SetReadings) -> Option<[f64; 2]> {
    let [columns, rows] = set.grid.map(|own| own as usize);
    let at = |index: usize| set.places[index].position;
    let step = |index: usize| at(index) - at(0);
    let [across, down] = match (columns > 1, rows > 1) {
        (true, true) => [step(1), step(columns)],
        (true, false) => [step(1), DVec3::ZERO],
        (false, true) => [DVec3::ZERO, step(1)],
        (false, false) => return None,
    };
    let close = 1e-3 * across.length().max(down.length());
    let expected =
        |index: usize| at(0) + across * (index % columns) as f64 + down * (index / columns) as f64;
    let is_even = (0..set.places.len()).all(|index| at(index).distance(expected(index)) < close);
    // A single line of meters has cells as high as they are wide.
    let size = [across.length(), down.length()];
    let longest = size[0].max(size[1]);
    is_even.then(|| size.map(|own| if own > 0.0 { own } else { longest }))
}

fn captions(set: &SetReadings) -> Vec<String> {
    let places = digits(&set.mean);
    let [low, high] = set.extremes().map(|extreme| extreme.value);
    let (unit, mean, uniformity) = (set.unit(), &set.mean, set.uniformity());
    vec![
        format!("{} of {}", set.quantity(), set.name),
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
