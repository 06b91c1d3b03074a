//! `bdpm calibrate SCENE`.

use super::interrupts::catch_interrupts;
use super::outputs::{self, Output};
use super::progress::Progress;
use super::scene_input::{LoadedScene, SessionArgs};
use super::time_residuals::{largest_residual, warning};
use super::{json, say};
use bdpm::adaptive::stopping::Stop;
use bdpm::base::error::{Error, Result};
use bdpm::job::{Status, Totals};
use bdpm::timing::Timings;
use bdpm::timing::calibrate::{Calibration, calibrate};
use bdpm::timing::measure::sizes;
use bdpm::timing::setup::MeasurementSetup;
use serde::Serialize;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// Measuring time unless --time is given.
const DEFAULT_TIME: Duration = Duration::from_secs(45);

#[derive(clap::Args)]
#[command(
    mut_arg("time", |arg| arg.help(
        "Measure for this long, such as 30 (seconds) or 2m; at least two rounds [default: 45s]"
    )),
    mut_arg("light_paths", |arg| arg.hide(true)),
    mut_arg("camera_paths", |arg| arg.hide(true)),
)]
pub struct Args {
    #[command(flatten)]
    session: SessionArgs,
    /// Write the times to this JSON file
    #[arg(long, short, value_name = "TIMES.json")]
    output: PathBuf,
}

/// The measured times, as JSON.
#[derive(Serialize)]
struct CalibrateReport {
    output: String,
    /// Rounds over all sizes.
    rounds: u64,
    /// Wall-clock time of measuring, seconds.
    seconds: f64,
    /// Largest difference between measured and fitted time over the time of the iteration.
    largest_residual: Option<f64>,
    #[serde(flatten)]
    timings: Timings,
}

pub fn run(args: &Args) -> Result<String> {
    let SessionArgs { scene, quiet, .. } = &args.session;
    if scene.settings.light_paths.is_some() || scene.settings.camera_paths.is_some() {
        return Err(Error::new(
            "calibrate chooses the numbers of paths itself",
            "leave out --light-paths and --camera-paths; its result is for all of them",
        ));
    }
    let files = [Output::new("--output", &args.output, Some("json"))];
    outputs::check(&files)?;
    let loaded = LoadedScene::new(&args.session)?;
    outputs::spare_inputs(&files)?;
    let Calibration { timings, rounds, time } = measure(&loaded, args)?;
    timings.save(&args.output)?;
    let largest_residual = largest_residual(&timings);
    if !quiet {
        warning(largest_residual).iter().for_each(|warning| say(warning));
    }

    let output = args.output.to_string_lossy().into_owned();
    Ok(match (scene.json, quiet) {
        (true, _) => {
            let seconds = time.as_secs_f64();
            json(&CalibrateReport { output, rounds, seconds, largest_residual, timings })
        }
        (false, true) => String::new(),
        (false, false) => {
            let parts = [
                timings.text(),
                #[cfg(feature = "paper")]
                bdpm::paper::tables::beside_table_2(&timings.model),
                format!("{output}: {rounds} rounds\n"),
            ];
            parts.join("\n")
        }
    })
}

/// Measures with progress on stderr. An interruption is an error.
fn measure(loaded: &LoadedScene, args: &Args) -> Result<Calibration> {
    let time = args.session.time.unwrap_or(DEFAULT_TIME);
    let stop = Stop::time(time);
    let mut progress = Progress::new(args.session.progress_format());
    progress.start();
    let interrupted = catch_interrupts(progress.clone())?;
    let LoadedScene { threads, scene, accel, provenance } = loaded;
    let sizes = sizes(provenance.settings.pixels());
    let setup = MeasurementSetup::new(provenance, threads.current_num_threads());
    progress.note(&format!("measuring the times of {} sizes: {setup}", sizes.len()));
    let mut totals = Totals::default();
    let calibration = calibrate((scene, accel), provenance, threads, time, |report, elapsed| {
        totals.add(report);
        let status = Status { iterations: totals.iterations, ..Status::default() };
        progress.show(&stop, &totals, &status, elapsed);
        match interrupted.load(Ordering::Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    })?;
    progress.finish();
    calibration.ok_or_else(|| {
        Error::new("interrupted: nothing was written", "let it finish, or shorten it with --time")
    })
}
