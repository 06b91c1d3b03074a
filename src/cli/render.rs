//! `bdpm render SCENE`: arguments -> [`RenderJob`] -> files and a report.

use super::dry_run;
use super::image_file_args::{ImageFileArgs, image_name};
use super::interrupts::catch_interrupts;
use super::layers::layer_parser;
use super::light_groups::{self, LightGroups};
use super::progress::Progress;
use super::render_files::{ENLARGED, Outputs, WRITE_ENLARGED_PIXEL, WRITE_PIXEL};
use super::render_observer::RenderObserver;
use super::scene_input::{SceneInput, SessionArgs};
use super::settings_args::{OBJECTIVE, with_chosen_default, with_conflicts, word};
use super::verbose;
use super::view::ViewTarget;
use super::{Output, say};
use bdpm::adaptive::optimize::Objective;
use bdpm::adaptive::plan::Plan;
use bdpm::adaptive::stopping::Target;
use bdpm::base::duration::positive_time;
use bdpm::base::error::{Error, Result};
use bdpm::film::aov::AovSelection;
use bdpm::image_io::{self, Value};
use bdpm::job::Shard;
use bdpm::mpi;
use bdpm::mpi::Ranks;
use bdpm::output::checkpoint::Checkpoint;
use bdpm::output::layers::{LayerName, LayerSelection};
use bdpm::settings::combinations::{self, JobOptions, Request};
use bdpm::settings::provenance::Provenance;
use bdpm::settings::{PartialSettings, Settings};
use bdpm::timing::Timings;
use bdpm::{RenderJob, Stop};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

#[derive(Clone, clap::Args)]
#[command(mut_args(with_chosen_default), mut_args(with_conflicts))]
pub struct Args {
    #[command(flatten)]
    pub session: SessionArgs,
    /// Render only W x H pixels from column X and row Y of the full resolution
    #[arg(long, visible_alias = "region", value_name = "X,Y,W,H", value_parser = parse_crop)]
    #[arg(allow_hyphen_values = true)]
    crop: Option<[u32; 4]>,
    /// Write the image here, and a PNG preview beside it [default: SCENE.exr]
    #[arg(long, short, value_name = "OUT.exr", value_parser = image_name)]
    pub output: Option<PathBuf>,
    #[command(flatten)]
    pub files: ImageFileArgs,
    /// Show settings with their origin, candidates of the pilot, and times
    #[arg(long, short, conflicts_with = "quiet")]
    pub verbose: bool,
    /// Check everything and show what would be done, but render nothing
    #[arg(long)]
    dry_run: bool,
    /// Stop after N iterations, including resumed ones; then nothing is chosen
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    iterations: Option<u64>,
    /// Stop at this relative error [default: 1%, none with another limit]
    #[arg(long, value_name = "X%", value_parser = share, allow_negative_numbers = true)]
    target_error: Option<f64>,
    /// Stop at this pooled RMS noise: a luminance, or a share of the mean luminance
    #[arg(long, value_name = "X|X%", allow_negative_numbers = true)]
    target_rms: Option<Target>,
    /// Minimize this aggregate of the variances of all pixels
    #[arg(long, default_value = "relative", value_parser = word::<Objective>(OBJECTIVE))]
    objective: Objective,
    /// Render with the path counts, settings and iterations of this image
    #[arg(long, value_name = "IMAGE.exr")]
    pub plan: Option<PathBuf>,
    /// Choose path counts by these times of `calibrate` or `cargo bench --bench tau`
    #[arg(long, value_name = "TIMES")]
    timings: Option<PathBuf>,
    /// Check the image by path tracing for this share of the time [default: 5%]
    #[arg(long, value_name = "X%", value_parser = audit_share)]
    audit: Option<f64>,
    /// Denoise the image and estimate its error [default: if a time is given and noise shows];
    /// --target-error then applies to it
    #[arg(long)]
    pub denoise: bool,
    /// Leave the noise in the image
    #[arg(long, conflicts_with = "denoise")]
    no_denoise: bool,
    /// Add these layers to the image file [default: all; none if the time is too short for all
    /// pixels]
    #[arg(long, value_name = "LAYER", value_delimiter = ',', value_parser = layer_parser())]
    pub layers: Vec<LayerName>,
    /// Write the noise coefficients to this file, for `predict`
    #[arg(long, value_name = "NOISE.exr")]
    pub noise: Option<PathBuf>,
    /// Write a page about the render to this file, updated while it runs
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
    /// Show the image in tev or in the terminal [default: 127.0.0.1:14158]
    #[arg(long, value_name = "HOST:PORT|terminal", num_args = 0..=1, require_equals = true)]
    #[arg(default_missing_value = "127.0.0.1:14158")]
    pub view: Option<ViewTarget>,
    /// Write a checkpoint to this file every minute, on Ctrl-C and at the end
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,
    /// Write the checkpoint at this interval, such as 10s or 5m [default: 1m]
    #[arg(long, value_name = "TIME", value_parser = positive_time, requires = "checkpoint")]
    pub checkpoint_every: Option<Duration>,
    /// Continue the image of this checkpoint, with its settings
    #[arg(long, value_name = "FILE")]
    pub resume: Option<PathBuf>,
    /// Render part I of N of the iterations to --checkpoint, for `merge`
    #[arg(long, value_name = "I/N")]
    part: Option<Shard>,
    /// Render each group of light sources in turn, for `mix` [default: a group for each name]
    #[arg(long, value_name = "NAME=LIGHT+LIGHT,...", num_args = 0..=1, require_equals = true)]
    #[arg(default_missing_value = "", value_parser = light_groups::parse)]
    pub light_groups: Option<LightGroups>,
}

/// Start of an image.
enum ImageStart {
    New,
    Plan(Plan, Box<Provenance>),
    Checkpoint(Box<Checkpoint<'static>>),
}

/// Renders on all processes that were started together.
pub fn run(mut args: Args) -> Result<Output> {
    let ranks = mpi::join()?;
    let result = if ranks.is_first() {
        match &args.light_groups {
            Some(groups) => light_groups::render(&args, groups, &*ranks),
            None => render(&args, &*ranks),
        }
    } else if args.dry_run {
        Ok(Output::default())
    } else {
        args.session.quiet = true;
        follow(&args, &*ranks).map(|()| Output::default())
    };
    if let Err(error) = &result
        && ranks.count() > 1
    {
        say(&format!("error: {error}"));
        ranks.abort();
    }
    result
}

fn render(args: &Args, ranks: &dyn Ranks) -> Result<Output> {
    // Check the files before any work is done.
    let started = Instant::now();
    args.check_part()?;
    let mut outputs = Outputs::new(args)?;
    let start = args.image_start()?;
    let times = args.timings.as_deref().map(Timings::load).transpose()?;
    let input = &SceneInput::load(&args.session)?;
    outputs.spare_inputs(args)?;
    let rendering = Rendering { args, input, outputs, start, times, started };
    render_loaded(rendering, ranks).map(|(output, _)| output)
}

/// A loaded scene, and how its image is made.
pub struct Rendering<'a> {
    args: &'a Args,
    input: &'a SceneInput,
    outputs: Outputs,
    start: ImageStart,
    times: Option<Timings>,
    /// Start of the time that was given.
    started: Instant,
}

impl<'a> Rendering<'a> {
    /// A new image of a scene that was loaded before the time begins.
    pub fn new(args: &'a Args, input: &'a SceneInput) -> Result<Self> {
        let (outputs, started) = (Outputs::new(args)?, Instant::now());
        Ok(Self { args, input, outputs, start: ImageStart::New, times: None, started })
    }
}

/// Renders and writes an image. Returns also whether it was interrupted.
pub fn render_loaded(own: Rendering, ranks: &dyn Ranks) -> Result<(Output, bool)> {
    let Rendering { args, input, outputs, start, times, started } = own;
    let job = args.job(input, start, times).started(started).reserve_per_pixel(WRITE_PIXEL);
    let asks_for_more =
        !args.layers.is_empty() || outputs.checkpoint.is_some() || outputs.false_color.is_some();
    let job = job.fewer_pixels((!asks_for_more).then_some(WRITE_ENLARGED_PIXEL));
    if args.dry_run {
        let outline = job.outline_on(ranks)?;
        if let Some(warning) = outline.warning.as_deref().filter(|_| !args.session.quiet) {
            say(&format!("warning: {warning}"));
        }
        if args.verbose {
            verbose::before_render(args, input, &outline).iter().for_each(|line| say(line));
        }
        let text = dry_run::report(&outline, input, &outputs, args.session.scene.json);
        return Ok((text.into(), false));
    }
    let progress = Progress::new(args.session.progress_format());
    let interrupt = catch_interrupts(progress.clone())?;
    let job = job.interrupted_by(Arc::clone(&interrupt));
    let mut observer = RenderObserver::new(args, input, outputs, progress);
    let result = job.run_on(ranks, |event| observer.observe(event))?;
    Ok((observer.finish(result)?, interrupt.load(Ordering::Relaxed)))
}

/// Renders as rank 1 or a later one.
fn follow(args: &Args, ranks: &dyn Ranks) -> Result<()> {
    let interrupt = catch_interrupts(Progress::new(args.session.progress_format()))?;
    let input = match SceneInput::load(&args.session) {
        Ok(input) => input,
        Err(error) => return bdpm::job::report_failure(ranks, error),
    };
    input.job(&args.session).settings(args.settings()).interrupted_by(interrupt).follow(ranks)
}

impl Args {
    /// The image file: that of the command line, or the name of the scene in the current folder.
    pub fn output(&self) -> PathBuf {
        self.output.clone().unwrap_or_else(|| default_output(&self.session.scene.scene, "exr"))
    }

    /// Settings of the command line.
    pub fn settings(&self) -> PartialSettings {
        PartialSettings { crop: self.crop, ..(&self.session.scene.settings).into() }
    }

    /// Refuses to render a part that could not be merged.
    fn check_part(&self) -> Result<()> {
        let loses_part = self.part.is_some() && self.checkpoint.is_none();
        let plain = PartialSettings::default();
        let settings = Settings::resolve(&plain, &plain, 1.0)?;
        let job = JobOptions { loses_part, ..JobOptions::default() };
        combinations::check(&Request { job, ..Request::of(&settings) })
    }

    /// The shard from the command line.
    pub fn shard_name(&self) -> String {
        self.part.map_or(String::new(), |shard| shard.to_string())
    }

    fn image_start(&self) -> Result<ImageStart> {
        Ok(match (&self.resume, &self.plan) {
            (Some(path), _) => ImageStart::Checkpoint(Box::new(Checkpoint::load(path)?)),
            (None, Some(path)) => {
                let (plan, provenance) = self.read_plan(path)?;
                ImageStart::Plan(plan, Box::new(provenance))
            }
            (None, None) => ImageStart::New,
        })
    }

    /// Reads a plan and the provenance of its image. A plan without a number of iterations fixes
    /// neither seed nor version.
    fn read_plan(&self, path: &Path) -> Result<(Plan, Provenance)> {
        let image = image_io::read_exr(path)?;
        if let Some(Value::Text(size)) = image.metadata.get(ENLARGED) {
            return Err(Error::new(
                format!("the image was enlarged from {size} pixels, and has no plan"),
                "render it with more time, or with `--layers all`",
            )
            .at(path));
        }
        let plan = Plan::read_from(&image).map_err(|e| e.at(path))?;
        let mut provenance = Provenance::from_metadata(&image.metadata).map_err(|e| e.at(path))?;
        let Settings { width, height, .. } = provenance.settings;
        if (image.width, image.height) != (width, height) {
            let size = format!("{}x{}", image.width, image.height);
            return Err(Error::new(
                format!("the image has {size} pixels, but its settings have {width}x{height}"),
                "give the unchanged file that bdpm wrote",
            )
            .at(path));
        }
        if plan.iterations().is_none() {
            provenance.version = env!("CARGO_PKG_VERSION").into();
            provenance.settings.seed =
                self.session.scene.settings.seed.unwrap_or(provenance.settings.seed);
        }
        Ok((plan, provenance))
    }

    fn job(&self, input: &SceneInput, start: ImageStart, times: Option<Timings>) -> RenderJob {
        let path = |path: &Option<PathBuf>| path.clone().unwrap_or_default();
        let job = input
            .job(&self.session)
            .settings(self.settings())
            .stop(self.stop())
            .aovs(self.aovs(matches!(start, ImageStart::Checkpoint(_))))
            .pixel_noise(self.noise.is_some())
            .shard(self.part);
        let job = match (self.denoise, self.no_denoise) {
            (false, false) => job.denoise_if_noisy(),
            (denoise, _) => job.denoise(denoise),
        };
        let job = match self.audit {
            Some(share) => job.audit(share),
            None => job,
        };
        let job = match times {
            Some(times) => job.times(times, &path(&self.timings)),
            None => job,
        };
        match start {
            ImageStart::New => job,
            ImageStart::Plan(plan, provenance) => job.plan(plan, *provenance, &path(&self.plan)),
            ImageStart::Checkpoint(checkpoint) => job.resume(*checkpoint, &path(&self.resume)),
        }
    }

    /// Layers to accumulate. A resumed image has those of its checkpoint, unless --layers names
    /// others.
    fn aovs(&self, is_resumed: bool) -> AovSelection {
        if is_resumed && self.layers.is_empty() {
            return AovSelection::default();
        }
        LayerSelection::new(&self.layers).aovs()
    }

    fn stop(&self) -> Stop {
        Stop {
            iterations: self.iterations,
            time: self.session.time,
            target: self.target_rms,
            error: self.target_error,
            objective: self.objective,
            ..Stop::default()
        }
    }
}

/// `NAME.EXTENSION` in the current folder for a scene file `NAME.toml` or a folder `NAME`.
pub(super) fn default_output(scene: &Path, extension: &str) -> PathBuf {
    // Paths such as `.` get the name of their folder
    let path = scene.canonicalize().unwrap_or_else(|_| scene.to_owned());
    let name = if path.is_dir() { path.file_name() } else { path.file_stem() };
    let mut name = name.unwrap_or_else(|| OsStr::new("image")).to_owned();
    name.push(".");
    name.push(extension);
    name.into()
}

/// Reads a window such as 40,30,200,100.
fn parse_crop(text: &str) -> std::result::Result<[u32; 4], &'static str> {
    let numbers = text.split(',').map(|number| number.trim().parse().ok());
    let numbers: Option<Vec<u32>> = numbers.collect();
    let window = numbers.and_then(|numbers| <[u32; 4]>::try_from(numbers).ok());
    let window = window.filter(|&[_, _, width, height]| width > 0 && height > 0);
    window.ok_or("give the left column, the top row, a width and a height, such as 40,30,200,100")
}

/// Reads a share of at most a half, such as 5%, or 0.
fn audit_share(text: &str) -> Result<f64> {
    match text.trim() {
        "0" | "0%" => Ok(0.0),
        text => share(text).ok().filter(|share| *share <= 0.5).ok_or_else(|| {
            let advice = "give a share of at most 50%, such as 5%, or 0 for no audit";
            Error::new(format!("`{text}` is not a share for the audit"), advice)
        }),
    }
}

/// Reads a share such as 2%.
pub(super) fn share(text: &str) -> Result<f64> {
    match text.parse::<Target>() {
        Ok(Target::Share(share)) => Ok(share),
        _ => {
            Err(Error::new(format!("`{text}` is not a share"), "give a positive share such as 2%"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crop_is_four_whole_numbers_with_pixels() {
        assert_eq!(parse_crop("1, 2,30,40"), Ok([1, 2, 30, 40]));
        for bad in
            ["", "1,2,3", "1,2,3,4,5", "1,2,0,4", "1,2,3,0", "-1,2,3,4", "1,2,3,x", "1,2,3.5,4"]
        {
            assert!(parse_crop(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn default_output_has_the_name_of_the_scene() {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("my.room");
        std::fs::create_dir(&scene).unwrap();
        assert_eq!(default_output(&scene, "exr"), Path::new("my.room.exr"));
        assert_eq!(default_output(&scene.join("."), "ies"), Path::new("my.room.ies"));
        assert_eq!(default_output(Path::new("none/my.room.glb"), "exr"), Path::new("my.room.exr"));
    }
}
