//! `bdpm calibrate SCENE`.

use super::interrupts::catch_interrupts;
use super::json;
use super::outputs::{self, Output};
use super::progress::Progress;
use super::scene_input::{LoadedScene, SessionArgs};
use bdpm::adaptive::stopping::Stop;
use bdpm::base::error::{Error, Result};
use bdpm::job::{Status, Totals};
use bdpm::noise::Measure;
use bdpm::paper::tables::beside_table_2;
use bdpm::render::Renderer;
use bdpm::settings::Settings;
use bdpm::timing::Timings;
use bdpm::timing::fit::fit;
use bdpm::timing::measure::{Recorder, SampleSize, sizes};
use bdpm::timing::setup::MeasurementSetup;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Measuring time unless --time is given.
const DEFAULT_TIME: Duration = Duration::from_secs(45);

/// Fewest rounds, so that every time has an error.
const MIN_ROUNDS: u64 = 2;

/// Iterations of a size in a round. One more goes before them and is not counted: its memory is not
/// in the caches yet.
const ITERATIONS: usize = 2;

#[derive(clap::Args)]
#[command(
    mut_arg("time", |arg| arg.help(
        "Measure for about this long, such as 30s or 2m; at least two rounds [default: 45s]"
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
    let setup = MeasurementSetup::new(&loaded.provenance, loaded.threads.current_num_threads());
    let (recorder, rounds, time) = measure(&loaded, &setup, args)?;
    let timings = Timings::new(fit(&recorder.samples(), setup.pixels())?, setup);
    timings.save(&args.output)?;

    let output = args.output.to_string_lossy().into_owned();
    Ok(match (scene.json, quiet) {
        (true, _) => {
            json(&CalibrateReport { output, rounds, seconds: time.as_secs_f64(), timings })
        }
        (false, true) => String::new(),
        (false, false) => {
            format!(
                "{}\n{}\n{output}: {rounds} rounds\n",
                timings.text(),
                beside_table_2(&timings.model)
            )
        }
    })
}

/// Iterates at one size after the other, round by round: a machine that slows down or has other work
/// affects all sizes alike.
fn measure(
    loaded: &LoadedScene,
    setup: &MeasurementSetup,
    args: &Args,
) -> Result<(Recorder, u64, Duration)> {
    let time = args.session.time.unwrap_or(DEFAULT_TIME);
    let stop = Stop::time(time);
    let mut progress = Progress::new(args.session.progress_format());
    progress.start();
    let interrupted = catch_interrupts(progress.clone())?;
    let sizes = sizes(loaded.provenance.settings.pixels());
    progress.note(&format!("measuring the times of {} sizes: {setup}", sizes.len()));

    let mut recorder = Recorder::new(setup.threads);
    let mut totals = Totals::default();
    let start = Instant::now();
    let mut rounds = 0;
    // Begin a round only if at least half of it fits in the time.
    let half = |rounds: u64| start.elapsed().as_secs_f64() / (2 * rounds.max(1)) as f64;
    while rounds < MIN_ROUNDS || start.elapsed().as_secs_f64() + half(rounds) < time.as_secs_f64() {
        for &size in &sizes {
            // One renderer at a time: images at a high resolution are large.
            let mut renderer = renderer(loaded, size)?;
            for iteration in 0..=ITERATIONS {
                let report = loaded.threads.install(|| renderer.iterate(Measure::Off));
                totals.add(&report);
                let status = Status { iterations: totals.iterations, ..Status::default() };
                progress.show(&stop, &totals, &status, start.elapsed());
                if interrupted.load(Ordering::Relaxed) {
                    progress.finish();
                    return Err(Error::new(
                        "interrupted: nothing was written",
                        "let it finish, or shorten it with --time",
                    ));
                }
                if iteration > 0 {
                    let (light, camera) = (size.light_paths.into(), size.camera_paths.into());
                    recorder.add(light, camera, &report.times);
                }
            }
        }
        rounds += 1;
    }
    progress.finish();
    Ok((recorder, rounds, start.elapsed()))
}

fn renderer(loaded: &LoadedScene, size: SampleSize) -> Result<Renderer> {
    let SampleSize { light_paths, camera_paths } = size;
    let settings = Settings { light_paths, camera_paths, ..loaded.provenance.settings.clone() };
    Renderer::new(&loaded.scene, &loaded.accel, settings)
}
