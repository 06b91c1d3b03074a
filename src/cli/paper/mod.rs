//! `bdpm reproduce`.

mod built_in_scene;

use super::interrupts::catch_interrupts;
use super::progress::{Progress, ProgressFormat};
use super::scene_input::{LoadedScene, SessionArgs};
use super::settings_args::SettingsArgs;
use super::{human_time, reported, say};
use bdpm::adaptive::stopping::{Forecast, Stop};
use bdpm::base::error::{Error, Result};
use bdpm::job::{Status, Totals};
use bdpm::noise::file::check_memory;
use bdpm::noise::region;
use bdpm::paper::findings::Verdict;
use bdpm::paper::folder::{Conditions, Folder};
use bdpm::paper::measurement::{Measurement, Purpose};
use bdpm::paper::published::{CAMERA_PATHS, LIGHT_PATHS};
use bdpm::paper::report;
use bdpm::paper::results::Results;
use bdpm::paper::run::{Run, SceneContext};
use bdpm::settings::{Kernel, Settings};
use bdpm::timing::setup::MeasurementSetup;
use built_in_scene::{BUILT_IN, BuiltInScene, is_built_in};
use serde::Serialize;
use std::fmt::Write;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// The paper's red box.
const REGION: &str = "side-walls";

/// Time and resolution with `--quick`.
const QUICK: (Duration, [u32; 2]) = (Duration::from_secs(60), [64; 2]);

/// Time and resolution without `--quick`.
const FULL: (Duration, [u32; 2]) = (Duration::from_secs(20 * 60), [128; 2]);

#[derive(clap::Args)]
#[command(
    mut_arg("scene", |arg| arg.required(false).default_value(BUILT_IN).help(
        "Measure this scene, which needs a region side-walls; it sets what the paper leaves open"
    )),
    mut_arg("resolution", |arg| arg.help(
        "Render this many pixels [default: 128x128, with --quick 64x64]"
    )),
    mut_arg("time", |arg| arg.help(
        "Render for this long, such as 300 (seconds) or 2h [default: 20m, with --quick 60s]"
    )),
    mut_arg("light_paths", |arg| arg.hide(true)),
    mut_arg("camera_paths", |arg| arg.hide(true)),
)]
pub struct Args {
    #[command(flatten)]
    session: SessionArgs,
    /// Write report.html and its data to this folder, or continue the experiment in it
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
    /// Finish within two minutes, with fewer pixels and larger errors
    #[arg(long)]
    quick: bool,
}

/// The report file and its numbers, as JSON.
#[derive(Serialize)]
struct ReproduceReport<'a> {
    complete: bool,
    report: Option<String>,
    #[serde(flatten)]
    results: Option<&'a Results>,
}

pub fn run(mut args: Args) -> Result<String> {
    let path = &mut args.session.scene.scene;
    if is_built_in(path) {
        let scene = BuiltInScene::new()?;
        *path = scene.path();
        return run_experiment(&args);
    }
    run_experiment(&args)
}

/// Runs or continues the experiment with a scene on disk.
fn run_experiment(args: &Args) -> Result<String> {
    let scene = &args.session.scene;
    if scene.settings.light_paths.is_some() || scene.settings.camera_paths.is_some() {
        return Err(Error::new(
            "reproduce takes the path counts from the paper",
            "leave out --light-paths and --camera-paths; --time is for all of them",
        ));
    }
    let (time, resolution) = if args.quick { QUICK } else { FULL };
    let time = args.session.time.unwrap_or(time);
    let mut loaded = LoadedScene::with_default_resolution(&args.session, Some(resolution))?;
    as_published(&mut loaded.provenance.settings, &scene.settings);
    let conditions = experiment_conditions(&loaded, time)?;
    let folder = Folder::new(&args.output)?;
    let experiment = folder.open(conditions)?;

    let context =
        SceneContext { scene: &loaded.scene, accel: &loaded.accel, threads: &loaded.threads };
    let mut run = Run::new(context, folder.clone(), experiment);
    if let Some(time) = args.session.time
        && run.experiment().done.is_empty()
        && !args.session.quiet
    {
        warn_of_short_time(&run, time)?;
    }
    if !measure(&mut run, time, args.session.quiet)? {
        let report = ReproduceReport { complete: false, report: None, results: None };
        let text = || "stopped; run the command again to continue\n".into();
        return Ok(reported((scene.json, args.session.quiet), &report, text));
    }
    let results = Results::new(&folder, run.experiment().clone())?;
    results.write_data(&folder)?;
    let html = report::write(&results, &folder)?.to_string_lossy().into_owned();
    let (shown, results) = (html.clone(), &results);
    let report = ReproduceReport { complete: true, report: Some(html), results: Some(results) };
    Ok(reported((scene.json, args.session.quiet), &report, || text(results, &shown)))
}

/// The paper merges over discs of one radius. Explicit options change that.
fn as_published(settings: &mut Settings, requested: &SettingsArgs) {
    settings.kernel = requested.kernel.unwrap_or(Kernel::Disc);
    if requested.caustic_radius.is_none() {
        settings.caustic_radius = settings.radius;
    }
}

/// Everything that the experiment depends on.
fn experiment_conditions(loaded: &LoadedScene, time: Duration) -> Result<Conditions> {
    let LoadedScene { scene, provenance, threads, accel, .. } = loaded;
    let settings = Settings {
        light_paths: LIGHT_PATHS,
        camera_paths: CAMERA_PATHS[0],
        ..provenance.settings.clone()
    };
    check_memory(settings.width, settings.height)?;
    Ok(Conditions {
        setup: MeasurementSetup::new(provenance, threads.current_num_threads()),
        accel: accel.describe().name,
        settings,
        region: region::find(Some(REGION), &scene.regions)?,
        time: time.as_secs_f64(),
    })
}

/// Warns if the minimum of iterations, which standard errors need, takes longer than the time.
fn warn_of_short_time(run: &Run, time: Duration) -> Result<()> {
    let least = run.least_time()?;
    if least > time.as_secs_f64() {
        say(&format!(
            "warning: the minimum of iterations takes about {}, longer than --time {}\n\
             help: lower --resolution, or give more time; with few iterations errors are large",
            human_time(least),
            humantime::format_duration(time)
        ));
    }
    Ok(())
}

/// Takes the remaining measurements; returns whether the experiment is complete.
fn measure(run: &mut Run, time: Duration, quiet: bool) -> Result<bool> {
    let format = if quiet { ProgressFormat::Nothing } else { ProgressFormat::Text };
    let stop = Stop::time(time);
    let mut progress = Progress::new(format);
    progress.start();
    let interrupted = catch_interrupts(progress.clone())?;
    let (done, all) = (run.experiment().done.len(), Measurement::all().len());
    let Conditions { setup, .. } = &run.experiment().conditions;
    progress.note(&match done {
        0 => format!("measuring {all} parts: {setup}"),
        _ if done == all => "all parts are complete".into(),
        _ => format!("{done} of {all} parts are complete: {setup}"),
    });
    let mut totals = Totals::default();
    let mut iterations = 0;
    let mut last = None;
    let complete = run.run(|status| {
        if last != Some(status.measurement) {
            progress.note(&format!(
                "part {} of {}: {}",
                status.index + 1,
                status.count,
                describe(&status.measurement)
            ));
            (last, iterations) = (Some(status.measurement), 0);
        }
        iterations += 1;
        totals.add(status.report);
        // Forecast the remaining time only.
        let forecast = Some(Forecast { rms: f64::NAN, left: 1.0, seconds: status.left });
        let shown = Status { iterations, convergence: None, forecast };
        progress.show(&stop, &totals, &shown, Duration::from_secs_f64(status.seconds));
        match interrupted.load(Ordering::Relaxed) {
            false => ControlFlow::Continue(()),
            true => ControlFlow::Break(()),
        }
    });
    progress.finish();
    complete
}

fn describe(measurement: &Measurement) -> String {
    let what = match measurement.purpose {
        Purpose::Pairs => "noise of every pixel from all pairs",
        Purpose::Halves => "noise of every pixel by the paper's halves",
        Purpose::Cell => "noise of the region and times",
    };
    format!("{what}, N_F = {}, N_B = {}", measurement.light_paths, measurement.camera_paths)
}

/// The findings, a line each.
fn text(results: &Results, html: &str) -> String {
    let mut text = String::new();
    for finding in &results.findings {
        let error = finding.here.error.unwrap_or(f64::NAN);
        writeln!(
            text,
            "{:<10} {:<64} {:>8.4} +- {:<7.4} printed {:.4}",
            finding.verdict.text(),
            finding.name,
            finding.here.value,
            error,
            finding.printed
        )
        .expect("strings take everything");
    }
    let count = |verdict| results.findings.iter().filter(|f| f.verdict == verdict).count();
    let time = human_time(results.seconds);
    writeln!(
        text,
        "\n{html}: {} the same as printed, {} as the paper's other numbers imply, {} different, {} \
         uncertain; {time} of rendering",
        count(Verdict::Same),
        count(Verdict::AsImplied),
        count(Verdict::Different),
        count(Verdict::Uncertain),
    )
    .expect("strings take everything");
    text
}
