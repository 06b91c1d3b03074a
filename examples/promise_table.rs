//! Prints promised and reported errors of automatic renders over their measured errors as a table.
//!
//! ```sh
//! cargo run --release --example promise_table -- cornell-box 128 5s 20s 2%      # scene, pixels along a side, ends
//! ```
//!
//! Each end is one run of `bdpm render SCENE --time` or `--target-error`, which is expected beside
//! the examples, where Cargo builds it. The error is found against two long renders, as
//! `examples/references` says, which are kept in `target/measured`.

#[allow(dead_code)] // renders by the program itself
mod references;

use bdpm::film::radiance::luminance;
use bdpm::image_io::read_exr;
use references::{Reference, Result, with};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [scene, side, ends @ ..] = &arguments[..] else {
        let example = "cornell-box 128 5s 20s 2%";
        return Err(format!("give a scene, a number of pixels and ends, such as {example}").into());
    };
    with(scene, side.parse()?, |_, reference| {
        ends.iter().try_for_each(|end| tell((scene, side), end, reference))
    })
}

/// Renders until this end, and prints the line of it.
fn tell((scene, side): (&str, &str), end: &str, reference: &Reference) -> Result<()> {
    let target: Option<f64> = end.strip_suffix('%').map(str::parse).transpose()?;
    let goal = if target.is_some() { "--target-error" } else { "--time" };
    let image = std::env::temp_dir().join(format!("promise-{}-{scene}.exr", std::process::id()));
    let start = Instant::now();
    let run = Command::new(program()?)
        .args(["render", "--json", "--quiet", "--resolution", &format!("{side}x{side}")])
        .args([goal, end, "--output"])
        .arg(&image)
        .arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(scene))
        .output()?;
    let took = start.elapsed().as_secs_f64();
    if !run.status.success() {
        return Err(String::from_utf8_lossy(&run.stderr).into());
    }
    let report: Value = serde_json::from_slice(&run.stdout)?;
    let pixels = read_exr(&image)?.layer("").and_then(|layer| layer.to_rgb());
    std::fs::remove_file(&image)?;
    let pixels = pixels.ok_or("the image has no channels R, G and B")?;
    let pixels: Vec<f64> = pixels.iter().map(|pixel| luminance(pixel.as_dvec3())).collect();
    let found = reference.square(&pixels).max(0.0).sqrt();
    // A requested error is a promise, too.
    let promised = report["promise"]["error"].as_f64();
    let promised = target.map(|percent| percent / 100.0).or(promised);
    let over = |value: Option<f64>| value.map_or("-".into(), |v| format!("{:.2}", v / found));
    let [said, later] = ["seconds", "took"].map(|name| report["half_way"][name].as_f64());
    // A time that was asked for is kept as a whole; the way to a target is foretold half way.
    let time = match target {
        Some(_) => said.zip(later).map_or("-".into(), |(s, took)| format!("{:.2}", s / took)),
        None => format!("{:.2}", end.trim_end_matches('s').parse::<f64>()? / took),
    };
    println!(
        "| {scene} | {end} | {:.2} % | {} | {} | {time} |",
        100.0 * found,
        over(promised),
        over(report["error"]["total"].as_f64()),
    );
    Ok(())
}

/// The program `bdpm` that was built with this example.
fn program() -> Result<PathBuf> {
    let own = std::env::current_exe()?;
    let folder = own.parent().and_then(Path::parent).ok_or("examples are in a folder")?;
    Ok(folder.join("bdpm"))
}
