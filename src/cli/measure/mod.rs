//! `bdpm measure SCENE`: illuminance and luminance with their uncertainty.

mod csv;
mod digits;
mod maps;
mod page;
mod report;
mod text;

use super::interrupts::catch_interrupts;
use super::progress::Progress;
use super::render::share;
use super::scene_input::{SceneInput, SessionArgs};
use super::settings_args::with_chosen_default;
use super::{human_time, json, say};
use bdpm::MeasureJob;
use bdpm::base::error::{Error, Result};
use bdpm::import::read_meters;
use bdpm::measurement::MeasureProgress;
use report::MeasureReport;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Duration;

/// Time between two lines about the progress.
const LINE_EVERY: Duration = Duration::from_secs(10);

#[derive(clap::Args)]
#[command(mut_args(with_chosen_default))]
pub struct Args {
    #[command(flatten)]
    session: SessionArgs,
    /// Measure the meters of this .csv or .toml file instead of those of the scene
    #[arg(long, value_name = "FILE")]
    meters: Option<PathBuf>,
    /// Stop at this relative uncertainty of every meter (95 %) [default: 2%]
    #[arg(long, value_name = "X%", value_parser = share, allow_negative_numbers = true)]
    target_error: Option<f64>,
    /// Apply the target to the mean over each grid instead of to every meter
    #[arg(long)]
    mean: bool,
    /// Measure the part of each light, material that emits, and the environment
    #[arg(long)]
    by_light: bool,
    /// Write one row per meter to this file
    #[arg(long, value_name = "FILE.csv")]
    csv: Option<PathBuf>,
    /// Write a false-color PNG, isolines and an EXR of each grid to this folder
    #[arg(long, value_name = "FOLDER")]
    maps: Option<PathBuf>,
    /// Write a page with tables and maps to this file
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
}

pub fn run(args: &Args) -> Result<String> {
    let session = &args.session;
    let input = SceneInput::load(session)?;
    let interrupted = catch_interrupts(Progress::new(session.progress_format()))?;
    let mut job = MeasureJob::new(&input.loaded)
        .settings((&session.scene.settings).into())
        .target(args.target_error)
        .time(session.time)
        .means_only(args.mean)
        .by_light(args.by_light)
        .backend(session.scene.accel.unwrap_or_default())
        .threads(input.threads.clone())
        .interrupted_by(interrupted);
    if let Some(path) = &args.meters {
        job = job.meters(read_meters(path)?);
    }
    if session.scene.settings.resolution.is_some() {
        let problem = "a measurement has no resolution";
        return Err(Error::new(problem, "remove --resolution; grids have `columns` and `rows`"));
    }
    let mut last_line = Duration::ZERO;
    let measurement = job.run(|progress| {
        if !session.quiet && progress.elapsed >= last_line + LINE_EVERY {
            last_line = progress.elapsed;
            say(&progress_line(&progress));
        }
        ControlFlow::Continue(())
    })?;
    if let Some(path) = &args.csv {
        csv::write(path, &measurement)?;
    }
    if let Some(folder) = &args.maps {
        maps::write(folder, &measurement)?;
    }
    if let Some(path) = &args.report {
        page::write(path, &input.loaded.scene.name, &measurement)?;
    }
    let report = MeasureReport::new(&input.loaded.scene.name, args.target_error, &measurement);
    Ok(if session.scene.json { json(&report) } else { text::text(&measurement) })
}

fn progress_line(progress: &MeasureProgress) -> String {
    format!(
        "{}: {}, {} iterations, largest uncertainty {:.2} %",
        human_time(progress.elapsed.as_secs_f64()),
        progress.group,
        progress.iterations,
        100.0 * progress.worst
    )
}
