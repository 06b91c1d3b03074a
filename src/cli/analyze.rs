//! `bdpm analyze SCENE`.

use super::analyze_text::text;
use super::json;
use super::loaded_scene::{LoadedScene, SessionArgs};
use super::outputs::{self, Attempts, Output};
use super::render_report::describe_counts;
use super::session::{RunReport, Session};
use bdpm::adaptive::Measuring;
use bdpm::adaptive::stopping::{Goal, StoppedBy};
use bdpm::base::error::{Error, Result};
use bdpm::film::radiance::Film;
use bdpm::image_io::Value;
use bdpm::noise::Measure;
use bdpm::noise::file::{NoiseFile, PHOTONS_PER_LIGHT_PATH, check_memory};
use bdpm::noise::image::NoiseImage;
use bdpm::noise::picture::{TermsPicture, write_rms, write_terms};
use bdpm::noise::region;
use bdpm::noise::summary::NoiseSummary;
use bdpm::render::RenderConfig;
use bdpm::scene::Region;
use bdpm::settings::Settings;
use bdpm::settings::provenance::Provenance;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Iterations when neither --iterations nor --time is given. Standard errors come from 16 batches;
/// with 16 iterations in each, sums over regions are near enough to normal.
const DEFAULT_ITERATIONS: u64 = 256;

/// Of one iteration there is no sample variance.
const LEAST_ITERATIONS: u64 = 2;

#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    session: SessionArgs,
    /// EXR file to write; NAME.terms.png and NAME.rms.png come beside it
    #[arg(long, short, value_name = "NOISE.exr")]
    output: PathBuf,
    /// Iterations, at least 2; standard errors take 32 [default: 256, without --time]
    #[arg(long, value_name = "N")]
    iterations: Option<u64>,
    /// How coefficients are estimated: from all pairs, or from halves of the paths as published
    #[arg(long, default_value = "pairs")]
    estimator: Measure,
    /// The part of the image that the table is about: a name in the scene file, or a rectangle in
    /// fractions of the image, the origin at the top left [default: the whole image]
    #[arg(long, value_name = "NAME|X0,Y0,X1,Y1", allow_hyphen_values = true)]
    region: Option<String>,
}

/// The result.
#[derive(Serialize)]
pub struct Report<'a> {
    #[serde(flatten)]
    pub run: RunReport<'a>,
    pub light_paths: u32,
    pub camera_paths: u32,
    pub estimator: Measure,
    pub region: String,
    pub noise: NoiseSummary,
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
    let prepared = LoadedScene::new(&args.session, None)?;
    outputs::spare_inputs(&files)?;
    let settings = &prepared.origin.settings;
    check_counts(settings)?;
    let region = region::find(args.region.as_deref(), &prepared.scene.regions)?;
    check_memory(settings.width, settings.height)?;
    let mut renderer = prepared.renderer()?.configure(RenderConfig::with_pixel_batches())?;

    let time = args.session.time;
    if let Some(time) = time {
        let counts = &renderer.block().counts;
        prepared.check_time(time, LEAST_ITERATIONS, counts, args.session.quiet)?;
    }
    let default = time.is_none().then_some(DEFAULT_ITERATIONS);
    let goal = Goal { iterations: args.iterations.or(default), time, ..Goal::default() };
    let counts = describe_counts(renderer.block());
    let mut session = Session::new(
        &prepared,
        (goal, LEAST_ITERATIONS),
        args.session.manner(),
        ("measuring", &counts),
    )?;
    let mut measuring = Measuring(args.estimator);
    let stopped_by = session.iterate(&mut renderer, &mut measuring, None, |_, _, _| Ok(None))?;
    let film = renderer.film();
    session.progress.finish();
    if film.iterations < LEAST_ITERATIONS {
        return Err(too_few(film.iterations));
    }
    if film.iterations < 32 && stopped_by != StoppedBy::Iterations {
        session.progress.note("note: standard errors take at least 32 iterations");
    }

    let noise = renderer.block().noise_image()?;
    let pixels = region::pixels(&region, &noise)?;
    let start = Instant::now();
    let mut file =
        noise_file((&prepared.origin, &prepared.scene.regions), film, noise, args.estimator);
    let light_paths = session.totals.iterations as f64 * f64::from(settings.light_paths);
    let photons = session.totals.photons as f64 / light_paths;
    file.facts.insert(PHOTONS_PER_LIGHT_PATH.into(), Value::Number(photons));
    let mut attempts = Attempts::default();
    attempts.add(exr, || file.write(exr));
    let terms_picture = attempts.add(&terms_png, || write_terms(&terms_png, &file.noise));
    attempts.add(&rms_png, || write_rms(&rms_png, &file.noise));
    attempts.finish()?;
    let terms_picture = terms_picture.expect("nothing failed");
    let write_time = start.elapsed();

    let name = |path: &Path| path.to_string_lossy().into_owned();
    let report = Report {
        run: session.report((film.iterations, film.mean_luminance()), stopped_by, write_time),
        light_paths: settings.light_paths,
        camera_paths: settings.camera_paths,
        estimator: args.estimator,
        region: region.name,
        noise: NoiseSummary::new(&file.noise, &pixels),
        terms_picture,
        exr: name(exr),
        terms_png: name(&terms_png),
        rms_png: name(&rms_png),
    };
    Ok(match (args.session.scene.json, args.session.quiet) {
        (true, _) => json(&report),
        (false, true) => String::new(),
        (false, false) => text(&report),
    })
}

/// What was measured, with all that it takes to measure it again.
pub fn noise_file(
    (origin, regions): (&Provenance, &[Region]),
    film: &Film,
    noise: NoiseImage,
    estimator: Measure,
) -> NoiseFile {
    let mut facts = origin.to_metadata();
    facts.insert("iterations".into(), Value::Number(film.iterations as f64));
    let estimator = serde_json::to_value(estimator).expect("a plain name");
    let estimator = estimator.as_str().unwrap_or_default().to_owned();
    facts.insert("estimator".into(), Value::Text(estimator));
    let regions = regions.to_vec();
    NoiseFile { noise, pixels: film.mean(), regions, facts }
}

fn too_few(iterations: u64) -> Error {
    Error::new(
        format!("{iterations} measured iterations have no sample variance"),
        "measure at least 2 iterations; standard errors take 32, good ones 256",
    )
}

/// Coefficients are about pairs of paths of the same kind.
pub fn check_counts(settings: &Settings) -> Result<()> {
    for (count, what, option) in [
        (settings.light_paths, "light path", "--light-paths"),
        (settings.camera_paths, "camera path per pixel", "--camera-paths"),
    ] {
        if count < 2 {
            return Err(Error::new(
                format!("the noise cannot be measured with {count} {what}"),
                format!("give {option} 2 or more; the result predicts the noise at 1 as well"),
            ));
        }
    }
    Ok(())
}
