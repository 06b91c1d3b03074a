//! `bdpm render SCENE`.

use super::analyze::{check_counts, noise_file};
use super::progress::{Goal, Progress};
use super::session::{Prepared, RunReport, Session, SessionArgs, StoppedBy, metadata};
use super::{human_time, json};
use bdpm::checkpoint::{Checkpoint, Origin};
use bdpm::error::{Error, Result};
use bdpm::film::Film;
use bdpm::noise::Measure;
use bdpm::noise::file::check_memory;
use bdpm::noise::film::{BatchGrain, NoiseFilm};
use bdpm::noise::image::NoiseImage;
use bdpm::output::{self, Image, Layer};
use bdpm::render::Renderer;
use bdpm::settings::Settings;
use serde::Serialize;
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Iterations when neither --iterations nor --time is given: enough to judge a scene by.
const DEFAULT_ITERATIONS: u64 = 64;

/// Time between checkpoints.
const CHECKPOINT_EVERY: Duration = Duration::from_secs(60);

/// When the image is first written while rendering goes on.
const FIRST_WRITE: Duration = Duration::from_secs(10);

/// Rendering time per time of writing, at least: writing takes at most 2 % of the time.
const WRITE_SHARE: u32 = 50;

/// Time to write a pixel, assumed until it is known.
const WRITE_PIXEL: Duration = Duration::from_nanos(200);

#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    session: SessionArgs,
    /// Image to write; the PNG preview beside it has the same name
    #[arg(long, short, value_name = "OUT.exr")]
    output: PathBuf,
    /// Iterations in all, those of a resumed image included [default: 64]
    #[arg(long, value_name = "N", conflicts_with = "time",
          value_parser = clap::value_parser!(u64).range(1..))]
    iterations: Option<u64>,
    /// Write the noise coefficients that were measured on the way to this file, for predict
    #[arg(long, value_name = "NOISE.exr")]
    noise: Option<PathBuf>,
    /// Write a checkpoint to this file every minute, on Ctrl-C and at the end
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,
    /// Continue the image of this checkpoint, with its settings
    #[arg(long, value_name = "FILE")]
    resume: Option<PathBuf>,
}

#[derive(Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    run: RunReport<'a>,
    /// Pooled RMS of the image, W/(m^2 sr), and the same over the mean luminance.
    rms: Option<f64>,
    relative_rms: Option<f64>,
    exr: String,
    png: String,
    noise: Option<String>,
    checkpoint: Option<String>,
}

pub fn run(args: &Args) -> Result<String> {
    let outputs = Outputs::new(args)?;
    let resumed = args.resume.as_deref().map(Checkpoint::load).transpose()?;
    let goal = args.session.goal(args.iterations, DEFAULT_ITERATIONS);
    let begun = resumed.as_ref().map(|checkpoint| &checkpoint.origin);
    let prepared = Prepared::new(&args.session, begun.zip(args.resume.as_deref()))?;
    let mut renderer = prepared.renderer()?;
    if args.noise.is_some() {
        let settings = &prepared.origin.settings;
        check_counts(settings)?;
        check_memory(settings.width, settings.height)?;
        renderer = renderer.with_batches(BatchGrain::Pixel);
    }
    if let Some(checkpoint) = resumed {
        check_goal(goal, &checkpoint.film)?;
        let Checkpoint { film, noise, .. } = checkpoint;
        check_grain(args, noise.as_deref())?;
        renderer.resume(film.into_owned(), noise.map(Cow::into_owned))?;
    }

    let mut writer = Writer { origin: &prepared.origin, outputs, time: Duration::ZERO };
    let mut session = Session::new(&prepared, (goal, 1), args.session.quiet, "rendering")?;
    let mut schedule = Schedule::new(prepared.origin.settings.pixels());
    let stopped_by = session.iterate(
        &mut renderer,
        |renderer| renderer.scheduled(),
        |session, renderer| schedule.write_when_due(&mut writer, renderer, session),
    );
    let film = renderer.film();
    session.progress.finish();
    // The checkpoint first: with it, a full disk costs no work.
    writer.save_checkpoint(&renderer)?;
    writer.save_image(film)?;
    if let Some(path) = &args.noise {
        save_noise(path, &prepared, &renderer, &session.progress)?;
    }

    let name = |path: &Path| path.to_string_lossy().into_owned();
    let report = Report {
        run: session.report(film, stopped_by, writer.time),
        rms: film.pooled_rms(),
        relative_rms: film.pooled_rms().map(|rms| rms / film.mean_luminance()),
        exr: name(&writer.outputs.exr),
        png: name(&writer.outputs.png),
        noise: args.noise.as_deref().map(name),
        checkpoint: writer.outputs.checkpoint.as_deref().map(name),
    };
    Ok(match (args.session.scene.json, args.session.quiet) {
        (true, _) => json(&report),
        (false, true) => String::new(),
        (false, false) => text(&report),
    })
}

fn text(report: &Report) -> String {
    let stopped = if report.run.stopped_by == StoppedBy::Interrupt { ", interrupted" } else { "" };
    let rms = match (report.rms, report.relative_rms) {
        (Some(rms), Some(share)) => format!(", RMS {rms:.4} ({:.2} %)", 100.0 * share),
        _ => String::new(),
    };
    format!(
        "{} and {}: {} iterations in {}, {:.1} Mray/s, mean luminance {:.4}{rms}{stopped}\n",
        report.exr,
        report.png,
        report.run.iterations,
        human_time(report.run.seconds.render),
        report.run.rays_per_second / 1e6,
        report.run.mean_luminance
    )
}

/// Refuses to go on to fewer iterations than there are.
fn check_goal(goal: Goal, film: &Film) -> Result<()> {
    match goal {
        Goal::Iterations(wanted) if wanted < film.iterations => Err(Error::new(
            format!("the checkpoint holds {} iterations, more than {wanted}", film.iterations),
            format!("give --iterations {} or more, or --time", film.iterations),
        )),
        _ => Ok(()),
    }
}

/// Refuses to write coefficients by pixel of which a checkpoint has only sums by tile.
fn check_grain(args: &Args, noise: Option<&NoiseFilm>) -> Result<()> {
    let Some(path) = &args.noise else { return Ok(()) };
    match noise.map(NoiseFilm::grain) {
        Some(BatchGrain::Tile) => Err(Error::new(
            "the checkpoint was begun without --noise and lacks the batches of single pixels",
            "resume without --noise, or begin anew with it",
        )
        .at(path)),
        _ => Ok(()),
    }
}

/// Writes what the measuring iterations found.
fn save_noise(
    path: &Path,
    prepared: &Prepared,
    renderer: &Renderer,
    progress: &Progress,
) -> Result<()> {
    let measured = renderer.noise().filter(|noise| noise.iterations >= 2);
    let Some(measured) = measured else {
        progress.note("warning: too few iterations to tell the noise; --noise wrote nothing");
        return Ok(());
    };
    let Settings { light_paths, camera_paths, .. } = *renderer.settings();
    let noise = NoiseImage::new(renderer.film(), measured, (light_paths, camera_paths));
    noise_file(prepared, renderer.film(), noise, Measure::Pairs).write(path)
}

/// Files to write.
struct Outputs {
    exr: PathBuf,
    png: PathBuf,
    checkpoint: Option<PathBuf>,
}

impl Outputs {
    /// Finds problems with the files before any work is done.
    fn new(args: &Args) -> Result<Self> {
        let exr = args.output.clone();
        let png = exr.with_extension("png");
        output::check_writable(&exr, Some("exr"))?;
        output::check_writable(&png, Some("png"))?;
        if let Some(noise) = &args.noise {
            output::check_writable(noise, Some("exr"))?;
            if *noise == exr {
                return Err(Error::new(
                    "the coefficients and the image have the same name",
                    "give --noise another one",
                )
                .at(noise));
            }
        }
        if let Some(checkpoint) = &args.checkpoint {
            output::check_writable(checkpoint, None)?;
            if *checkpoint == exr || *checkpoint == png {
                return Err(Error::new(
                    "the checkpoint and the image have the same name",
                    "give --checkpoint another one",
                )
                .at(checkpoint));
            }
        }
        Ok(Self { exr, png, checkpoint: args.checkpoint.clone() })
    }
}

/// When files are written while rendering goes on.
struct Schedule {
    next_image: Duration,
    next_checkpoint: Duration,
}

impl Schedule {
    fn new(pixels: usize) -> Self {
        let next_image = FIRST_WRITE.max(WRITE_PIXEL * pixels as u32 * WRITE_SHARE);
        Self { next_image, next_checkpoint: CHECKPOINT_EVERY }
    }

    /// A failure here may be gone at the end: only the last write must succeed.
    fn write_when_due(&mut self, writer: &mut Writer, renderer: &Renderer, session: &Session) {
        if session.elapsed() >= self.next_checkpoint {
            warn_of_failure(&session.progress, writer.save_checkpoint(renderer));
            self.next_checkpoint = session.elapsed() + CHECKPOINT_EVERY;
        }
        if session.elapsed() >= self.next_image {
            let before = Instant::now();
            warn_of_failure(&session.progress, writer.save_image(renderer.film()));
            let pause = (before.elapsed() * WRITE_SHARE).max(session.elapsed() / 2);
            self.next_image = session.elapsed() + pause;
        }
    }
}

fn warn_of_failure(progress: &Progress, result: Result<()>) {
    if let Err(error) = result {
        progress.note(&format!("warning: {error}"));
    }
}

/// Writes the files and keeps the time that takes.
struct Writer<'a> {
    origin: &'a Origin,
    outputs: Outputs,
    time: Duration,
}

impl Writer<'_> {
    fn save_checkpoint(&mut self, renderer: &Renderer) -> Result<()> {
        let Some(path) = &self.outputs.checkpoint else { return Ok(()) };
        let start = Instant::now();
        let checkpoint = Checkpoint {
            origin: self.origin.clone(),
            film: Cow::Borrowed(renderer.film()),
            noise: renderer.noise().map(Cow::Borrowed),
        };
        let saved = checkpoint.save(path);
        self.time += start.elapsed();
        saved
    }

    fn save_image(&mut self, film: &Film) -> Result<()> {
        let start = Instant::now();
        let (width, height) = film.resolution();
        let pixels = film.mean();
        let mut layers = vec![Layer::rgb("", &pixels)];
        if let Some(rms) = film.rms() {
            layers.push(Layer { name: "rms".into(), channels: vec![("Y".into(), rms)] });
        }
        let image =
            Image { width, height, layers, metadata: metadata(self.origin, film.iterations) };
        let saved = output::write_exr(&self.outputs.exr, &image).and_then(|()| {
            output::write_png(&self.outputs.png, width, height, &pixels).map(|_exposure| ())
        });
        self.time += start.elapsed();
        saved
    }
}
