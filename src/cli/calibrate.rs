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
use bdpm::paper::table_2::beside_table_2;
use bdpm::render::Renderer;
use bdpm::settings::Settings;
use bdpm::timing::fit::fit;
use bdpm::timing::grid;
use bdpm::timing::grid::Size;
use bdpm::timing::sample::Recorder;
use bdpm::timing::setup::Setup;
use bdpm::timing::{Timings, report};
use serde::Serialize;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Time of measuring unless --time is given.
const DEFAULT_TIME: Duration = Duration::from_secs(45);

/// Rounds at least, so that every time has an error.
const LEAST_ROUNDS: u64 = 2;

/// Iterations of a size in a round, after one more that is not counted: it meets cold memory.
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
    /// JSON file to write
    #[arg(long, short, value_name = "TIMES.json")]
    output: PathBuf,
}

/// The result.
#[derive(Serialize)]
struct Report {
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
    if scene.wishes.light_paths.is_some() || scene.wishes.camera_paths.is_some() {
        return Err(Error::new(
            "calibrate chooses the numbers of paths itself",
            "leave out --light-paths and --camera-paths; its result is for all of them",
        ));
    }
    let files = [Output::new("--output", &args.output, Some("json"))];
    outputs::check(&files)?;
    let prepared = LoadedScene::new(&args.session)?;
    outputs::spare_inputs(&files)?;
    let setup = Setup::new(&prepared.origin, prepared.threads.current_num_threads());
    let (recorder, rounds, time) = measure(&prepared, &setup, args)?;
    let timings = Timings::new(fit(&recorder.samples(), setup.pixels())?, setup);
    timings.save(&args.output)?;

    let output = args.output.to_string_lossy().into_owned();
    Ok(match (scene.json, quiet) {
        (true, _) => json(&Report { output, rounds, seconds: time.as_secs_f64(), timings }),
        (false, true) => String::new(),
        (false, false) => {
            format!(
                "{}\n{}\n{output}: {rounds} rounds\n",
                report::text(&timings),
                beside_table_2(&timings.model)
            )
        }
    })
}

/// Iterates at one size after the other, round by round: a machine that slows down or has other
/// work does so for all of them.
fn measure(
    prepared: &LoadedScene,
    setup: &Setup,
    args: &Args,
) -> Result<(Recorder, u64, Duration)> {
    let time = args.session.time.unwrap_or(DEFAULT_TIME);
    let stop = Stop::time(time);
    let mut progress = Progress::new(args.session.progress_format());
    progress.start();
    let interrupted = catch_interrupts(progress.clone())?;
    let sizes = grid::sizes(prepared.origin.settings.pixels());
    progress.note(&format!("measuring the times of {} sizes: {setup}", sizes.len()));

    let mut recorder = Recorder::new(setup.threads);
    let mut totals = Totals::default();
    let start = Instant::now();
    let mut rounds = 0;
    // A round that would end past the time by more than half of its own is not begun.
    let half = |rounds: u64| start.elapsed().as_secs_f64() / (2 * rounds.max(1)) as f64;
    while rounds < LEAST_ROUNDS || start.elapsed().as_secs_f64() + half(rounds) < time.as_secs_f64()
    {
        for &size in &sizes {
            // One renderer at a time: images at a high resolution are large.
            let mut renderer = renderer(prepared, size)?;
            for iteration in 0..=ITERATIONS {
                let report = prepared.threads.install(|| renderer.iterate(Measure::Off));
                totals.add(&report);
                let status = Status { iterations: totals.iterations, ..Status::default() };
                progress.show(&stop, &totals, &status, start.elapsed());
                if interrupted.load(Ordering::Relaxed) {
                    progress.finish();
                    return Err(Error::new(
                        "interrupted: nothing was written",
                        "let it end; --time makes it shorter",
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

fn renderer(prepared: &LoadedScene, size: Size) -> Result<Renderer> {
    let Size { light_paths, camera_paths } = size;
    let settings = Settings { light_paths, camera_paths, ..prepared.origin.settings.clone() };
    Renderer::new(&prepared.scene, &prepared.accel, settings)
}
