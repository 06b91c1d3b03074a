//! `bdpm compare A B`.

use bdpm::base::error::{Error, Result};
use bdpm::base::math::Rgb;
use bdpm::film::compare::{Comparison, compare};
use bdpm::image_io::read_exr;
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct Args {
    /// Compare this EXR image
    a: PathBuf,
    /// Use this EXR image of the same size as the reference
    b: PathBuf,
    /// Print the result as one JSON object on stdout
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct CompareReport {
    a: String,
    b: String,
    #[serde(flatten)]
    comparison: Comparison,
}

pub fn run(args: &Args) -> Result<String> {
    let (a, a_size) = read(&args.a)?;
    let (b, b_size) = read(&args.b)?;
    let comparison = compare((&a, a_size), (&b, b_size))?;
    if args.json {
        let name = |path: &Path| path.to_string_lossy().into_owned();
        return Ok(super::json(&CompareReport { a: name(&args.a), b: name(&args.b), comparison }));
    }
    Ok(text(&comparison))
}

fn read(path: &Path) -> Result<(Vec<Rgb>, (u32, u32))> {
    let image = read_exr(path)?;
    let rgb = image.layer("").and_then(|layer| layer.to_rgb()).ok_or_else(|| {
        Error::new("the image has no channels R, G and B", "give an RGB image").at(path)
    })?;
    Ok((rgb, (image.width, image.height)))
}

fn text(c: &Comparison) -> String {
    let or_black = |value: Option<f64>| {
        value.map_or("undefined, the reference is black".into(), |value| format!("{value:.6}"))
    };
    let [x, y] = c.max_pixel;
    let mut text = String::new();
    let mut row = |name: &str, value: String| {
        writeln!(text, "{name:<19} {value}").expect("strings take everything");
    };
    row("size", format!("{}x{} pixels", c.width, c.height));
    row("mean ratio", or_black(c.mean_ratio));
    row("RMSE", format!("{:.6e}", c.rmse));
    row("relative MSE", or_black(c.relative_mse));
    row(
        "maximum difference",
        match c.max_difference {
            0.0 => "0, the images are equal".into(),
            max => format!("{max:.6e} at pixel ({x}, {y})"),
        },
    );
    if c.non_finite_a + c.non_finite_b > 0 {
        row("non-finite pixels", format!("{} and {}, left out", c.non_finite_a, c.non_finite_b));
    }
    text
}
