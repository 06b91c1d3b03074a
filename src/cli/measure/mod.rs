//! `bdpm measure SCENE`: illuminance and luminance with their uncertainty.

mod csv;
mod digits;
mod dimming;
mod maps;
mod evidence;
mod page;
mod record;
mod report;
mod text;

use super::interrupts::catch_interrupts;
use super::outputs::{self, Attempts, Output};
use super::progress::{Progress, ProgressFormat};
use super::render::share;
use super::scene_input::{SceneInput, SessionArgs};
use super::settings_args::with_chosen_default;
use super::{Output as Outcome, human_time, json, print, say};
use bdpm::base::error::{Error, Result};
use bdpm::import::{EnvironmentSource, read_meters};
use bdpm::measurement::MeasureProgress;
use bdpm::scene::MeterSet;
use bdpm::{MeasureJob, Measurement};
use clap::Arg;
pub use csv::as_text;
pub use evidence::files_and_surfaces;
pub use record::Record;
use report::MeasureReport;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Time between two lines about the progress.
const LINE_EVERY: Duration = Duration::from_secs(10);

/// Time between two JSON objects about the progress.
const OBJECT_EVERY: Duration = Duration::from_millis(500);

/// Illuminance of the horizontal by the overcast sky of daylight factors, lx. They do not depend on
/// it.
const OUTDOORS: f64 = 10_000.0;

/// The overcast sky of daylight factors: that of Moon and Spencer, the type 16 of the CIE, above a
/// ground that reflects 20 %.
fn overcast_sky() -> Result<EnvironmentSource> {
    let keys = format!("model = 'cie', cie_type = 16, diffuse_lx = {OUTDOORS}, albedo = 0.2");
    EnvironmentSource::sky(&keys)
}

/// Options for images, which a measurement does not have.
const IMAGE_OPTIONS: [&str; 5] = ["resolution", "camera", "look_at", "fov", "camera_from"];

/// Hides the options for images in help texts.
fn without_image_options(option: Arg) -> Arg {
    let is_hidden = IMAGE_OPTIONS.contains(&option.get_id().as_str());
    if is_hidden { option.hide(true) } else { option }
}

#[derive(clap::Args)]
#[command(mut_args(with_chosen_default), mut_args(without_image_options))]
pub struct Args {
    #[command(flatten)]
    session: SessionArgs,
    /// Measure the meters of this .csv, .toml or .pts file instead of those of the scene
    #[arg(long, value_name = "FILE")]
    meters: Option<PathBuf>,
    /// Stop at this relative half-width of every 95 % interval [default: 2%]
    #[arg(long, value_name = "X%", value_parser = share, allow_negative_numbers = true)]
    target_error: Option<f64>,
    /// Apply the target to the mean over each grid instead of to every meter
    #[arg(long)]
    mean: bool,
    /// Measure the part of each light, material that emits, and the environment
    #[arg(long)]
    by_light: bool,
    /// Measure daylight factors in percent: the light of an overcast sky alone, over that outdoors
    #[arg(long, conflicts_with_all = ["environment", "sky", "by_light"])]
    daylight_factor: bool,
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

/// The scene and the meters.
fn load(args: &Args) -> Result<(SceneInput, Vec<MeterSet>)> {
    let overcast = args.daylight_factor.then(overcast_sky).transpose()?;
    let input = SceneInput::load_under(&args.session, overcast.as_ref())?;
    let sets = match &args.meters {
        Some(path) => read_meters(path, &input.loaded.scene)?,
        None => input.loaded.meters.clone(),
    };
    Ok((input, sets))
}

pub fn run(args: &Args) -> Result<Outcome> {
    let session = &args.session;
    if session.scene.settings.resolution.is_some() {
        let problem = "a measurement has no resolution";
        return Err(Error::new(problem, "remove --resolution; grids have `columns` and `rows`"));
    }
    // Check the files before any work is done.
    let mut files = Vec::new();
    for (what, path, extension) in [("--csv", &args.csv, "csv"), ("--report", &args.report, "html")]
    {
        files.extend(path.as_ref().map(|path| Output::new(what, path, Some(extension))));
    }
    outputs::check(&files)?;
    let (input, sets) = load(args)?;
    let map_files = map_files(args.maps.as_deref(), &sets)?;
    files.extend(map_files.iter().map(|path| Output::new("--maps", path, None)));
    outputs::check(&files)?;
    outputs::spare_inputs(&files)?;
    let interrupted = catch_interrupts(Progress::new(session.progress_format()))?;
    let mut last_shown = Duration::ZERO;
    let measurement = MeasureJob::new(&input.loaded)
        .meters(sets)
        .settings((&session.scene.settings).into())
        .target(args.target_error)
        .time(session.time)
        .means_only(args.mean)
        .by_light(args.by_light)
        .daylight_factor(args.daylight_factor.then_some(OUTDOORS))
        .backend(session.scene.accel.unwrap_or_default())
        .threads(input.threads.clone())
        .interrupted_by(interrupted)
        .run(|progress| {
            show(&progress, session.progress_format(), &mut last_shown);
            ControlFlow::Continue(())
        })?;
    let unknown = unknown(&measurement);
    if let Some(error) = unknown.as_ref().filter(|_| session.scene.strict) {
        return Err(Error::new(error.problem(), error.advice()));
    }
    if !session.quiet {
        measurement.warnings.iter().for_each(|warning| say(&format!("note: {warning}")));
    }
    let scene = &input.loaded.scene.name;
    let mut attempts = Attempts::default();
    if let Some(path) = &args.csv {
        attempts.add(path, || csv::write(path, &measurement));
    }
    if let Some(path) = &args.report {
        attempts.add(path, || page::write(path, &input.loaded.scene, &measurement));
    }
    if let Some(folder) = &args.maps {
        maps::write(folder, &measurement, &mut attempts);
    }
    let report = MeasureReport::new(scene, args.target_error, &measurement);
    let readings = if session.scene.json { json(&report) } else { text::text(&measurement) };
    if let Err(error) = attempts.finish() {
        // The readings are printed even if a file cannot be written.
        print(&readings)?;
        return Err(error);
    }
    let is_unknown = unknown.is_some();
    Ok(Outcome { text: readings, failure: unknown, is_unknown })
}

/// An error that names the sets with readings whose values or uncertainties are unknown, if there
/// are any.
fn unknown(measurement: &Measurement) -> Option<Error> {
    let sets = measurement.unknown();
    let of_set = |(name, count): &(&str, usize)| match count {
        1 => format!("`{name}`"),
        count => format!("{count} of `{name}`"),
    };
    let names: Vec<String> = sets.iter().map(of_set).collect();
    let advice = "too few paths were traced to say that no light arrives, or to state an uncertainty: check that light \
                  can reach the meters, or measure for a longer time";
    (!names.is_empty())
        .then(|| Error::new(format!("readings are unknown: {}", names.join(", ")), advice))
}

/// Files of `--maps` for these sets. Creates the folder.
fn map_files(folder: Option<&Path>, sets: &[MeterSet]) -> Result<Vec<PathBuf>> {
    let Some(folder) = folder else { return Ok(Vec::new()) };
    std::fs::create_dir_all(folder).map_err(|error| Error::io("create", folder, error))?;
    let paths = maps::paths(folder, sets.iter().map(|set| (&set.name[..], set.meters.len())));
    let files = paths
        .iter()
        .flat_map(|path| maps::EXTENSIONS.iter().map(|extension| path.with_extension(extension)));
    Ok(files.collect())
}

/// Shows the progress, if enough time has passed since `last`.
fn show(progress: &MeasureProgress, format: ProgressFormat, last: &mut Duration) {
    let pause = if format == ProgressFormat::Json { OBJECT_EVERY } else { LINE_EVERY };
    if format == ProgressFormat::Nothing || progress.elapsed < *last + pause {
        return;
    }
    *last = progress.elapsed;
    match format {
        ProgressFormat::Json => say(&progress_object(progress).to_string()),
        _ => say(&progress_line(progress)),
    }
}

/// Progress as a JSON object: the uncertainty as a share, the time in seconds.
fn progress_object(progress: &MeasureProgress) -> serde_json::Value {
    serde_json::json!({
        "lights": progress.group,
        "iterations": progress.iterations,
        "uncertainty": progress.worst,
        "seconds": progress.elapsed.as_secs_f64(),
    })
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
