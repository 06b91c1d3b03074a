//! Images of the path tracer, made once from more paths than tests have time for, beside the scenes
//! that they are of. `cargo run --release --example reference_tables` makes them.

use super::images::{Pixels, inside};
use bdpm::Scene;
use serde::Deserialize;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// An image in luminance: by pixel, row by row.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Table {
    fingerprint: String,
    width: u32,
    height: u32,
    paths_per_pixel: u64,
    mean: Vec<f64>,
    /// Variance of the means. Pixels are independent: they share no path.
    variance: Vec<f64>,
}

impl Table {
    /// The committed one of this name, which must be of this scene at this resolution.
    ///
    /// # Panics
    /// If it is missing or of another image.
    pub fn of(name: &str, scene: &Arc<Scene>, resolution: [u32; 2]) -> Self {
        let path = path(name);
        let help = format!("make it by: {}", command(name));
        let text = std::fs::read_to_string(&path)
            .unwrap_or_else(|e| panic!("{}: {e}; {help}", path.display()));
        let table: Self =
            toml::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}; {help}", path.display()));
        let wanted = (fingerprint(scene), resolution);
        let found = (table.fingerprint.clone(), [table.width, table.height]);
        assert_eq!(found, wanted, "{} is of another image; {help}", path.display());
        let pixels = (table.width * table.height) as usize;
        assert_eq!([table.mean.len(), table.variance.len()], [pixels; 2], "{}", path.display());
        table
    }

    /// Its pixels, of a region those; all if there is none.
    pub fn pixels(&self, region: &[usize]) -> Pixels {
        let [mean, variance] = [&self.mean, &self.variance].map(|values| inside(region, values));
        let variance_of_sum = variance.iter().sum();
        Pixels { mean, variance, variance_of_sum }
    }

    /// Paths in each pixel that it was made of.
    pub fn paths_per_pixel(&self) -> u64 {
        self.paths_per_pixel
    }
}

/// Where the table of this name is.
pub fn path(name: &str) -> PathBuf {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/reference");
    data.join(name).with_extension("toml")
}

/// The text of a table, as the committed ones are.
pub fn text(
    name: &str,
    scene: &Arc<Scene>,
    [width, height]: [u32; 2],
    paths_per_pixel: u64,
    pixels: &Pixels,
) -> String {
    let command = command(name);
    let fingerprint = fingerprint(scene);
    let mut text = format!(
        "# Path-traced: luminance by pixel, row by row, and the variance of these means.\n\
         # {command}\n\
         fingerprint = \"{fingerprint}\"\nwidth = {width}\nheight = {height}\n\
         paths_per_pixel = {paths_per_pixel}\n"
    );
    for (key, values, digits) in [("mean", &pixels.mean, 6), ("variance", &pixels.variance, 2)] {
        let _ = writeln!(text, "{key} = [");
        for row in values.chunks(width as usize) {
            let row: Vec<_> = row.iter().map(|value| format!("{value:.digits$e}")).collect();
            let _ = writeln!(text, "    {},", row.join(", "));
        }
        text += "]\n";
    }
    text
}

/// Replaces the fingerprint of a committed table by that of the scene.
pub fn renew(name: &str, scene: &Arc<Scene>) -> std::io::Result<()> {
    let path = path(name);
    let text = std::fs::read_to_string(&path)?;
    let (before, rest) = text.split_once("fingerprint = ").expect("a fingerprint");
    let (_, after) = rest.split_once('\n').expect("a line");
    let fingerprint = fingerprint(scene);
    std::fs::write(&path, format!("{before}fingerprint = \"{fingerprint}\"\n{after}"))
}

fn command(name: &str) -> String {
    format!("cargo run --release --example reference_tables -- {name}")
}

fn fingerprint(scene: &Arc<Scene>) -> String {
    format!("{:016x}", scene.fingerprint())
}
