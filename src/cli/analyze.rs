//! `bdpm analyze SCENE`.

use super::analyze_text::text;
use super::interrupts::catch_interrupts;
use super::outputs::{self, Attempts, Output};
use super::progress::Progress;
use super::render_report::announce;
use super::reported;
use super::run_report::RunReport;
use super::scene_input::{SceneInput, SessionArgs};
use super::settings_args::{ESTIMATOR, word};
use bdpm::adaptive::optimize::Objective;
use bdpm::adaptive::stopping::{Stop, StoppedBy};
use bdpm::base::error::{Error, Result};
use bdpm::noise::picture::{TermsPicture, write_rms, write_terms};
use bdpm::noise::region;
use bdpm::noise::summary::NoiseSummary;
use bdpm::noise::{Coefficients, Measure};
use bdpm::{Event, RenderResult};
use serde::Serialize;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Iterations if neither --iterations nor --time is given. Standard errors come from 16 batches.
/// With 16 iterations per batch, sums over regions are approximately normal.
const DEFAULT_ITERATIONS: u64 = 256;

/// Minimum number of iterations for a sample variance.
const MIN_ITERATIONS: u64 = 2;

#[derive(clap::Args)]
#[command(mut_arg("time", |arg| arg.help(
    "Measure for about this time, such as 30 (seconds) or 2m [default: no limit]"
)))]
pub struct Args {
    #[command(flatten)]
    session: SessionArgs,
    /// Write the noise to this EXR file, NAME.terms.png and NAME.rms.png
    #[arg(long, short, value_name = "NOISE.exr")]
    output: PathBuf,
    /// Measure N iterations; standard errors need 32 [default: 256, without --time]
    #[arg(long, value_name = "N")]
    iterations: Option<u64>,
    /// Estimate coefficients from all pairs of paths, or from halves of the paths
    #[arg(long, default_value = "pairs", value_parser = word::<Measure>(ESTIMATOR))]
    estimator: Measure,
    /// Show statistics of this part of the image [default: the whole image]
    ///
    /// Give a region's name in the scene file, or a rectangle in fractions of the image with the
    /// origin at the top left.
    #[arg(long, value_name = "NAME|X0,Y0,X1,Y1", allow_hyphen_values = true)]
    region: Option<String>,
}

/// The noise of a region and the files that were written, as JSON.
#[derive(Serialize)]
pub struct AnalyzeReport<'a> {
    #[serde(flatten)]
    pub run: RunReport<'a>,
    pub light_paths: u32,
    pub camera_paths: u32,
    pub estimator: Measure,
    pub region: String,
    pub noise: NoiseSummary,
    /// Mean `a`, `b` and `f` over the region, squared luminance: what `--coefficients` takes.
    pub coefficients: Coefficients,
    pub terms_picture: TermsPicture,
    pub exr: String,
    pub terms_png: String,
    pub rms_png: String,
}

pub fn run(args: &Args) -> Result<String> {
    let exr = &args.output;
    let (terms_png, rms_png) = (exr.with_extension("terms.png"), exr.with_extension("rms.png"));
    let files = [
        Output::new("--output", exr, Some("exr")),
        Output::new("the picture of the terms", &terms_png, None),
        Output::new("the picture of the RMS", &rms_png, None),
    ];
    outputs::check(&files)?;
    if let Some(iterations @ ..2) = args.iterations {
        return Err(too_few(iterations));
    }
    let input = SceneInput::load(&args.session)?;
    outputs::spare_inputs(&files)?;
    let region = region::find(args.region.as_deref(), &input.loaded.scene.regions)?;

    let mut result = measure(args, &input)?;
    let failure = result.state.failure.take();
    let state = &result.state;
    let file = result.noise_file(args.estimator)?;
    let pixels = region::pixels(&region, &file.noise)?;
    let start = Instant::now();
    let settings = &state.provenance.settings;
    let mut attempts = Attempts::default();
    attempts.add(exr, || file.write(exr));
    let terms_picture = attempts.add(&terms_png, || write_terms(&terms_png, &file.noise));
    attempts.add(&rms_png, || write_rms(&rms_png, &file.noise));
    if let Some(failure) = failure {
        attempts.add(exr, || Err::<(), _>(failure));
    }
    attempts.finish()?;
    let terms_picture = terms_picture.expect("nothing failed");
    let write_time = start.elapsed();

    let name = |path: &Path| path.to_string_lossy().into_owned();
    let report = AnalyzeReport {
        run: RunReport::new(&input, &result, write_time),
        light_paths: settings.light_paths,
        camera_paths: settings.camera_paths,
        estimator: args.estimator,
        region: region.name,
        noise: NoiseSummary::new(&file.noise, &pixels),
        coefficients: file.noise.mean_coefficients(&pixels),
        terms_picture,
        exr: name(exr),
        terms_png: name(&terms_png),
        rms_png: name(&rms_png),
    };
    let SessionArgs { scene, quiet, .. } = &args.session;
    Ok(reported((scene.json, *quiet), &report, || text(&report)))
}

/// Renders the iterations, each of which is measured.
fn measure(args: &Args, input: &SceneInput) -> Result<RenderResult> {
    let time = args.session.time;
    let default = time.is_none().then_some(DEFAULT_ITERATIONS);
    let iterations = args.iterations.or(default);
    let stop = Stop { iterations, time, objective: Objective::Pooled, ..Stop::default() };
    let settings = &args.session.scene.settings;
    let mut progress = Progress::new(args.session.progress_format());
    let job = input
        .job(&args.session)
        .measure_always(args.estimator)
        .at_least(MIN_ITERATIONS)
        // The terms do not depend on the counts.
        .fewer_paths(settings.light_paths.is_none(), settings.camera_paths.is_none())
        .stop(stop)
        .interrupted_by(catch_interrupts(progress.clone())?);
    let result = job.run(|event| {
        match event {
            Event::Warning(warning) => progress.note(&format!("warning: {warning}")),
            Event::Started(state) => {
                announce(&progress, state, "measuring", "");
                progress.start();
            }
            Event::Iterated(state) => progress.update(state),
            Event::Choosing(..) | Event::Restarted(_) | Event::Denoised(..) => {}
        }
        ControlFlow::Continue(())
    })?;
    progress.finish();
    let iterations = result.state.renderer.film().iterations;
    if iterations < MIN_ITERATIONS {
        return Err(too_few(iterations));
    }
    if iterations < 32 && result.stopped_by != StoppedBy::Iterations {
        progress.note("note: standard errors need at least 32 iterations");
    }
    Ok(result)
}

fn too_few(iterations: u64) -> Error {
    Error::new(
        format!("the sample variance of {iterations} measured iterations is undefined"),
        "measure at least 2 iterations; standard errors need 32, accurate ones 256",
    )
}
