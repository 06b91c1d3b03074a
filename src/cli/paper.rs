//! `bdpm reproduce`.

use super::interrupts::catch_interrupts;
use super::progress::{Progress, ProgressFormat};
use super::scene_input::{LoadedScene, SessionArgs};
use super::{human_time, json, say};
use bdpm::adaptive::stopping::{Forecast, Stop};
use bdpm::base::error::{Error, Result};
use bdpm::job::{Status, Totals};
use bdpm::noise::file::check_memory;
use bdpm::noise::region;
use bdpm::paper::findings::Verdict;
use bdpm::paper::folder::{Folder, Identity};
use bdpm::paper::part::{Part, Purpose};
use bdpm::paper::published::{CAMERA_PATHS, LIGHT_PATHS};
use bdpm::paper::report;
use bdpm::paper::results::Results;
use bdpm::paper::run::{Bench, Run};
use bdpm::settings::{Kernel, PartialSettings, Settings};
use bdpm::timing::setup::Setup;
use serde::Serialize;
use std::fmt::Write;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::Duration;

/// The paper's red box.
const REGION: &str = "side-walls";

/// What `--quick` takes.
const QUICK: (Duration, [u32; 2]) = (Duration::from_secs(60), [64; 2]);

/// What is taken without it.
const FULL: (Duration, [u32; 2]) = (Duration::from_secs(20 * 60), [128; 2]);

#[derive(clap::Args)]
#[command(
    mut_arg("scene", |arg| arg.required(false).default_value("scenes/cornell-box").help(
        "Scene with a region side-walls: where the paper leaves values open, its file sets them"
    )),
    mut_arg("resolution", |arg| arg.help(
        "Image size in pixels [default: 128x128, with --quick 64x64]"
    )),
    mut_arg("time", |arg| arg.hide(true)),
    mut_arg("light_paths", |arg| arg.hide(true)),
    mut_arg("camera_paths", |arg| arg.hide(true)),
)]
pub struct Args {
    #[command(flatten)]
    session: SessionArgs,
    /// Folder for report.html and its data; an experiment that was begun there is continued
    #[arg(long, short, value_name = "DIR")]
    output: PathBuf,
    /// Rendering time for all parts, such as 20m or 2h [default: 20m, with --quick 60s]
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    time_budget: Option<Duration>,
    /// A first look within two minutes: fewer pixels, larger errors
    #[arg(long)]
    quick: bool,
}

/// The result.
#[derive(Serialize)]
struct Report<'a> {
    complete: bool,
    report: Option<String>,
    #[serde(flatten)]
    results: Option<&'a Results>,
}

pub fn run(args: &Args) -> Result<String> {
    let scene = &args.session.scene;
    if scene.wishes.light_paths.is_some()
        || scene.wishes.camera_paths.is_some()
        || args.session.time.is_some()
    {
        return Err(Error::new(
            "reproduce takes the numbers of paths from the paper",
            "leave out --light-paths, --camera-paths and --time; --time-budget is for all of them",
        ));
    }
    let (time, resolution) = if args.quick { QUICK } else { FULL };
    let time = args.time_budget.unwrap_or(time);
    let mut prepared = LoadedScene::with_default_resolution(&args.session, Some(resolution))?;
    as_published(&mut prepared.origin.settings, &scene.wishes);
    let identity = identity(&prepared, time)?;
    let folder = Folder::new(&args.output)?;
    let experiment = folder.open(identity)?;

    let bench =
        Bench { scene: &prepared.scene, accel: &prepared.accel, threads: &prepared.threads };
    let mut run = Run::new(bench, folder.clone(), experiment);
    if let Some(budget) = args.time_budget
        && run.experiment().done.is_empty()
        && !args.session.quiet
    {
        warn_of_haste(&run, budget)?;
    }
    if !measure(&mut run, time, args.session.quiet)? {
        return Ok(match (scene.json, args.session.quiet) {
            (true, _) => json(&Report { complete: false, report: None, results: None }),
            (false, true) => String::new(),
            (false, false) => "stopped; the same command goes on\n".into(),
        });
    }
    let results = Results::new(&folder, run.experiment().clone())?;
    results.write_data(&folder)?;
    let html = report::write(&results, &folder)?.to_string_lossy().into_owned();
    Ok(match (scene.json, args.session.quiet) {
        (true, _) => json(&Report { complete: true, report: Some(html), results: Some(&results) }),
        (false, true) => String::new(),
        (false, false) => text(&results, &html),
    })
}

/// The paper merges over discs of one radius, unless somebody wants to see what else would come out.
fn as_published(settings: &mut Settings, wishes: &PartialSettings) {
    settings.kernel = wishes.kernel.unwrap_or(Kernel::Disc);
    if wishes.caustic_radius.is_none() {
        settings.caustic_radius = settings.radius;
    }
}

/// All that the experiment depends on.
fn identity(prepared: &LoadedScene, time: Duration) -> Result<Identity> {
    let LoadedScene { scene, origin, threads, accel, .. } = prepared;
    let settings = Settings {
        light_paths: LIGHT_PATHS,
        camera_paths: CAMERA_PATHS[0],
        ..origin.settings.clone()
    };
    check_memory(settings.width, settings.height)?;
    Ok(Identity {
        setup: Setup::new(origin, threads.current_num_threads()),
        accel: accel.describe().name,
        settings,
        region: region::find(Some(REGION), &scene.regions)?,
        time_budget: time.as_secs_f64(),
    })
}

/// Every part has a least number of iterations, for its standard errors.
fn warn_of_haste(run: &Run, budget: Duration) -> Result<()> {
    let least = run.least_time()?;
    if least > budget.as_secs_f64() {
        say(&format!(
            "warning: the least iterations of all parts take about {}, longer than --time-budget {}\n\
             help: lower --resolution, or give more time; at the least the errors are large",
            human_time(least),
            humantime::format_duration(budget)
        ));
    }
    Ok(())
}

/// Measures what is left; returns whether all is complete.
fn measure(run: &mut Run, time: Duration, quiet: bool) -> Result<bool> {
    let format = if quiet { ProgressFormat::Nothing } else { ProgressFormat::Text };
    let stop = Stop::time(time);
    let mut progress = Progress::new(format);
    progress.start();
    let interrupted = catch_interrupts(progress.clone())?;
    let (done, all) = (run.experiment().done.len(), Part::all().len());
    let Identity { setup, .. } = &run.experiment().identity;
    progress.note(&match done {
        0 => format!("measuring {all} parts: {setup}"),
        _ if done == all => "all parts are complete".into(),
        _ => format!("{done} of {all} parts are complete: {setup}"),
    });
    let mut totals = Totals::default();
    let mut iterations = 0;
    let mut last = None;
    let complete = run.run(|glimpse| {
        if last != Some(glimpse.part) {
            let [number, parts] = glimpse.number;
            progress.note(&format!("part {} of {parts}: {}", number + 1, describe(&glimpse.part)));
            (last, iterations) = (Some(glimpse.part), 0);
        }
        iterations += 1;
        totals.add(glimpse.report);
        // Only the time that is left is forecast.
        let forecast = Some(Forecast { rms: f64::NAN, left: 1.0, seconds: glimpse.left });
        let status = Status { iterations, convergence: None, forecast };
        progress.show(&stop, &totals, &status, Duration::from_secs_f64(glimpse.seconds));
        match interrupted.load(Ordering::Relaxed) {
            false => ControlFlow::Continue(()),
            true => ControlFlow::Break(()),
        }
    });
    progress.finish();
    complete
}

fn describe(part: &Part) -> String {
    let what = match part.purpose {
        Purpose::Pairs => "noise of every pixel from all pairs",
        Purpose::Halves => "the same by the paper's halves",
        Purpose::Cell => "noise of the region and times",
    };
    format!("{what}, N_F = {}, N_B = {}", part.light_paths, part.camera_paths)
}

/// What is the same, in a few lines.
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
