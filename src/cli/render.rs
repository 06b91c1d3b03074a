//! `bdpm render SCENE`.

use super::progress::{Goal, Progress, Totals};
use super::{SceneArgs, human_time, json};
use bdpm::accel::backend::{self, Backend};
use bdpm::checkpoint::{Checkpoint, Origin};
use bdpm::error::{Error, Result};
use bdpm::film::Film;
use bdpm::output::{self, Image, Layer, Metadata, Value};
use bdpm::render::{IterationReport, Renderer};
use bdpm::scene::load::load;
use bdpm::settings::{Length, RenderDefaults, Settings};
use serde::Serialize;
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
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
    scene: SceneArgs,
    /// Image to write; the PNG preview beside it has the same name
    #[arg(long, short, value_name = "OUT.exr")]
    output: PathBuf,
    /// Iterations in all, those of a resumed image included [default: 64]
    #[arg(long, value_name = "N", conflicts_with = "time",
          value_parser = clap::value_parser!(u64).range(1..))]
    iterations: Option<u64>,
    /// Render for about this long, such as 30s, 2m or 1h; at least one iteration
    #[arg(long, value_name = "TIME", value_parser = humantime::parse_duration)]
    time: Option<Duration>,
    /// Number of threads; the image does not depend on it [default: all processors]
    #[arg(long, value_name = "T", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Write a checkpoint to this file every minute, on Ctrl-C and at the end
    #[arg(long, value_name = "FILE")]
    checkpoint: Option<PathBuf>,
    /// Continue the image of this checkpoint, with its settings
    #[arg(long, value_name = "FILE")]
    resume: Option<PathBuf>,
    /// Show nothing but errors
    #[arg(long, short)]
    quiet: bool,
}

/// Why rendering ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum StoppedBy {
    Iterations,
    Time,
    Interrupt,
}

#[derive(Serialize)]
struct Report<'a> {
    version: &'a str,
    scene: &'a str,
    fingerprint: String,
    backend: &'a str,
    threads: usize,
    settings: &'a Settings,
    /// Of the image, and of this run.
    iterations: u64,
    new_iterations: u64,
    stopped_by: StoppedBy,
    seconds: Seconds,
    /// Of this run.
    rays: u64,
    rays_per_second: f64,
    photons_per_iteration: f64,
    /// W/(m^2 sr).
    mean_luminance: f64,
    non_finite: u64,
    exr: String,
    png: String,
    checkpoint: Option<String>,
}

/// Wall-clock times. `light`, `camera` and `merge` are busy thread-seconds over threads.
#[derive(Default, Serialize)]
struct Seconds {
    load: f64,
    build: f64,
    light: f64,
    camera: f64,
    merge: f64,
    render: f64,
    write: f64,
}

pub fn run(args: &Args) -> Result<String> {
    let outputs = Outputs::new(args)?;
    let resumed = args.resume.as_deref().map(Checkpoint::load).transpose()?;
    let threads = rayon::ThreadPoolBuilder::new()
        .num_threads(args.threads.unwrap_or(0).into())
        .build()
        .map_err(|e| Error::new(format!("cannot start the threads: {e}"), "lower --threads"))?;
    let goal = match (args.time, args.iterations) {
        (Some(time), _) => Goal::Time(time),
        (None, iterations) => Goal::Iterations(iterations.unwrap_or(DEFAULT_ITERATIONS)),
    };

    let start = Instant::now();
    let loaded = threads.install(|| load(&args.scene.scene))?;
    let load_time = start.elapsed();
    if !args.quiet {
        loaded.notes.iter().for_each(|note| super::say(&format!("note: {note}")));
    }
    let scene = &loaded.scene;
    // A resumed image has its own settings; arguments that agree with them do no harm.
    let begun = resumed.as_ref().map(|checkpoint| &checkpoint.origin);
    let defaults = begun.map_or(loaded.defaults.clone(), |origin| wishes(&origin.settings));
    let settings = Settings::resolve(&args.scene.wishes(), &defaults, scene.size())?;
    let begun_backend =
        begun.and_then(|origin| Backend::ALL.into_iter().find(|b| b.name() == origin.backend));
    let backend = args.scene.accel.or(begun_backend).unwrap_or_default();
    let origin = Origin {
        version: env!("CARGO_PKG_VERSION").into(),
        scene: scene.name.clone(),
        fingerprint: scene.fingerprint(),
        backend: backend.name().into(),
        settings: settings.clone(),
    };
    if let (Some(begun), Some(file)) = (begun, &args.resume) {
        begun.check_agrees(&origin).map_err(|e| e.at(file))?;
    }
    let start = Instant::now();
    let accel = threads.install(|| backend::build(backend, scene))?;
    let build_time = start.elapsed();
    let mut renderer = Renderer::new(scene, &*accel, settings)?;
    if let Some(checkpoint) = resumed {
        check_goal(goal, &checkpoint.film)?;
        let Checkpoint { film, noise, .. } = checkpoint;
        renderer.resume(film.into_owned(), noise.map(Cow::into_owned))?;
    }

    let mut job = Job {
        origin,
        outputs,
        goal,
        progress: Progress::new(goal, args.quiet),
        totals: Totals::default(),
        start: Instant::now(),
        write_time: Duration::ZERO,
    };
    let presses = catch_interrupts(job.progress.clone())?;
    job.begin(&accel.describe().name, threads.current_num_threads());
    let stopped_by = job.iterate(&threads, &mut renderer, presses);
    let film = renderer.film();
    job.progress.finish();
    // The checkpoint first: with it, a full disk costs no work.
    job.save_checkpoint(film)?;
    job.save_image(film)?;

    let cores = threads.current_num_threads() as f64;
    let Job { origin, outputs, totals, write_time, .. } = &job;
    let busy = |time: Duration| time.as_secs_f64() / cores;
    let name = |path: &Path| path.to_string_lossy().into_owned();
    let report = Report {
        version: &origin.version,
        scene: &origin.scene,
        fingerprint: format!("{:016x}", origin.fingerprint),
        backend: &origin.backend,
        threads: threads.current_num_threads(),
        settings: &origin.settings,
        iterations: film.iterations,
        new_iterations: totals.iterations,
        stopped_by,
        seconds: Seconds {
            load: load_time.as_secs_f64(),
            build: build_time.as_secs_f64(),
            light: busy(totals.times.light),
            camera: busy(totals.times.camera),
            merge: busy(totals.times.merge),
            render: totals.times.wall.as_secs_f64(),
            write: write_time.as_secs_f64(),
        },
        rays: totals.rays,
        rays_per_second: totals.rays_per_second(),
        photons_per_iteration: totals.photons as f64 / totals.iterations.max(1) as f64,
        mean_luminance: film.mean_luminance(),
        non_finite: totals.non_finite,
        exr: name(&outputs.exr),
        png: name(&outputs.png),
        checkpoint: outputs.checkpoint.as_deref().map(name),
    };
    Ok(match (args.scene.json, args.quiet) {
        (true, _) => json(&report),
        (false, true) => String::new(),
        (false, false) => text(&report),
    })
}

fn text(report: &Report) -> String {
    let stopped = if report.stopped_by == StoppedBy::Interrupt { ", interrupted" } else { "" };
    format!(
        "{} and {}: {} iterations in {}, {:.1} Mray/s, mean luminance {:.4}{stopped}\n",
        report.exr,
        report.png,
        report.iterations,
        human_time(report.seconds.render),
        report.rays_per_second / 1e6,
        report.mean_luminance
    )
}

/// Settings as wishes that leave nothing open.
fn wishes(settings: &Settings) -> RenderDefaults {
    RenderDefaults {
        resolution: Some([settings.width, settings.height]),
        light_paths: Some(settings.light_paths),
        camera_paths: Some(settings.camera_paths),
        radius: Some(Length::Units(settings.radius)),
        merge_vertex: Some(settings.merge_vertex),
        direct: Some(settings.direct),
        light_roulette: Some(settings.light_roulette),
        camera_roulette: Some(settings.camera_roulette),
        seed: Some(settings.seed),
    }
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

/// Counts Ctrl-C (and requests to terminate); the second one ends the program at once.
fn catch_interrupts(progress: Progress) -> Result<&'static AtomicU32> {
    static PRESSES: AtomicU32 = AtomicU32::new(0);
    ctrlc::set_handler(move || {
        if PRESSES.fetch_add(1, Ordering::Relaxed) > 0 {
            // The customary status of a program that SIGINT ended.
            std::process::exit(130);
        }
        progress.note("finishing this iteration; press Ctrl-C again to abort");
    })
    .map_err(|e| Error::new(format!("cannot catch Ctrl-C: {e}"), "report this as a bug"))?;
    Ok(&PRESSES)
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

/// An image under way.
struct Job {
    origin: Origin,
    outputs: Outputs,
    goal: Goal,
    progress: Progress,
    totals: Totals,
    start: Instant,
    write_time: Duration,
}

impl Job {
    fn begin(&mut self, accel: &str, threads: usize) {
        let Settings { width, height, light_paths, camera_paths, .. } = self.origin.settings;
        self.progress.note(&format!(
            "rendering {}: {width}x{height} pixels, {light_paths} light paths, {camera_paths} \
             camera paths per pixel, {threads} threads, {accel}",
            self.origin.scene
        ));
        self.start = Instant::now();
    }

    /// Iterates up to the goal or an interrupt, writing now and then.
    fn iterate(
        &mut self,
        threads: &rayon::ThreadPool,
        renderer: &mut Renderer,
        presses: &AtomicU32,
    ) -> StoppedBy {
        let pixels = renderer.settings().pixels() as u32;
        let mut next_image = FIRST_WRITE.max(WRITE_PIXEL * pixels * WRITE_SHARE);
        let mut next_checkpoint = CHECKPOINT_EVERY;
        loop {
            if let Some(reason) = self.finished(renderer.film()) {
                return reason;
            }
            let report = threads.install(|| renderer.iterate(renderer.scheduled()));
            self.totals.add(&report);
            let film = renderer.film();
            self.warn_of_bad_pixels(&report, film.iterations - 1);
            self.progress.update(&self.totals, film.iterations, self.start.elapsed());
            if presses.load(Ordering::Relaxed) > 0 {
                return StoppedBy::Interrupt;
            }
            // A failure here may be gone at the end: only the last write must succeed.
            if self.start.elapsed() >= next_checkpoint {
                let saved = self.save_checkpoint(film);
                self.warn_of_failure(saved);
                next_checkpoint = self.start.elapsed() + CHECKPOINT_EVERY;
            }
            if self.start.elapsed() >= next_image {
                let before = Instant::now();
                let saved = self.save_image(film);
                self.warn_of_failure(saved);
                let pause = (before.elapsed() * WRITE_SHARE).max(self.start.elapsed() / 2);
                next_image = self.start.elapsed() + pause;
            }
        }
    }

    /// Why no further iteration is to be begun, if so.
    fn finished(&self, film: &Film) -> Option<StoppedBy> {
        match self.goal {
            Goal::Iterations(wanted) => {
                (film.iterations >= wanted).then_some(StoppedBy::Iterations)
            }
            Goal::Time(time) => {
                // One that would end past the goal by more than half of its time is not begun.
                let done = self.totals.iterations;
                let elapsed = self.start.elapsed().as_secs_f64();
                let half = 0.5 * elapsed / done.max(1) as f64;
                (done > 0 && elapsed + half > time.as_secs_f64()).then_some(StoppedBy::Time)
            }
        }
    }

    /// Tells of the first pixel value that was left out, with what it takes to replay it.
    fn warn_of_bad_pixels(&self, report: &IterationReport, iteration: u64) {
        if let Some((x, y)) = report.non_finite.first()
            && self.totals.non_finite == report.non_finite.len() as u64
        {
            self.progress.note(&format!(
                "warning: pixel ({x}, {y}) was not finite in iteration {iteration} with seed {} \
                 and was left out\nhelp: please report this with the scene; further ones are \
                 counted only",
                self.origin.settings.seed
            ));
        }
    }

    fn warn_of_failure(&self, result: Result<()>) {
        if let Err(error) = result {
            self.progress.note(&format!("warning: {error}"));
        }
    }

    fn save_checkpoint(&mut self, film: &Film) -> Result<()> {
        let Some(path) = &self.outputs.checkpoint else { return Ok(()) };
        let start = Instant::now();
        let checkpoint =
            Checkpoint { origin: self.origin.clone(), film: Cow::Borrowed(film), noise: None };
        let saved = checkpoint.save(path);
        self.write_time += start.elapsed();
        saved
    }

    fn save_image(&mut self, film: &Film) -> Result<()> {
        let start = Instant::now();
        let (width, height) = film.resolution();
        let pixels = film.mean();
        let layers = vec![Layer::rgb("", &pixels)];
        let image = Image { width, height, layers, metadata: self.metadata(film) };
        let saved = output::write_exr(&self.outputs.exr, &image).and_then(|()| {
            output::write_png(&self.outputs.png, width, height, &pixels).map(|_exposure| ())
        });
        self.write_time += start.elapsed();
        saved
    }

    /// All that it takes to render the image again.
    fn metadata(&self, film: &Film) -> Metadata {
        let Origin { version, scene, fingerprint, backend, settings } = &self.origin;
        let mut facts = Metadata::from([
            ("version".into(), Value::Text(version.clone())),
            ("scene".into(), Value::Text(scene.clone())),
            ("fingerprint".into(), Value::Text(format!("{fingerprint:016x}"))),
            ("backend".into(), Value::Text(backend.clone())),
            ("iterations".into(), Value::Number(film.iterations as f64)),
        ]);
        for (name, value) in settings.to_map() {
            let value = match value {
                serde_json::Value::String(text) => Value::Text(text),
                // Seeds may have more digits than a number keeps.
                serde_json::Value::Number(number) if name == "seed" => {
                    Value::Text(number.to_string())
                }
                other => Value::Number(other.as_f64().unwrap_or(f64::NAN)),
            };
            facts.insert(name, value);
        }
        facts
    }
}
