//! `bdpm render SCENE`: what is to be done.

use super::analyze::check_counts;
use super::denoising::Denoising;
use super::layers::{LayerName, Layers};
use super::loaded_scene::{Continuation, LoadedScene, SessionArgs};
use super::mpi_leader::{MpiLeader, RenderSetup};
use super::mpi_worker::follow;
use super::page::Page;
use super::render_files::Outputs;
use super::render_inputs::{
    Counting, check_goal, check_grain, check_kept, fitting, fixed_counts, read_plan,
};
use super::render_task::Task;
use super::say;
use super::shard::Part;
use super::view::Place;
use bdpm::adaptive::autopilot::Autopilot;
use bdpm::adaptive::optimize::Objective;
use bdpm::adaptive::stopping::{Goal, Target};
use bdpm::adaptive::technique;
use bdpm::adaptive::technique::{End, FreeParameters, Selection};
use bdpm::adaptive::{Fixed, Replay};
use bdpm::base::error::{Error, Result};
use bdpm::film::aov::AovSelection;
use bdpm::mpi;
use bdpm::mpi::Ranks;
use bdpm::noise::file::check_memory;
use bdpm::noise::film::BatchGrain;
use bdpm::output::checkpoint::Checkpoint;
use bdpm::render::RenderConfig;
use bdpm::render::Renderer;
use bdpm::settings::Settings;
use bdpm::settings::provenance::Reuse;
use bdpm::timing::Timings;
use std::path::PathBuf;
use std::time::Instant;

/// The relative error to stop at where nothing else says when.
const DEFAULT_ERROR: f64 = 0.01;

/// Which error is to be small.
#[derive(Clone, Copy, Debug, PartialEq, clap::ValueEnum)]
enum Aim {
    /// Relative to each pixel's luminance: dark parts count as much as bright ones
    Relative,
    /// Pooled over all pixels, by luminance
    Pooled,
}

#[derive(clap::Args)]
pub struct Args {
    #[command(flatten)]
    pub session: SessionArgs,
    /// Image to write; the PNG preview beside it has the same name, or ends in .preview.png where that
    /// is another picture
    #[arg(long, short, value_name = "OUT.exr")]
    pub output: PathBuf,
    /// Iterations in all, those of a resumed image included; the counts are then not chosen
    /// automatically
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    iterations: Option<u64>,
    /// Stop at this error, noise and merge bias together: RMS relative to each pixel's luminance
    /// [default: 1%, without --time, --iterations and --target-rms]
    #[arg(long, value_name = "X%", value_parser = share, allow_negative_numbers = true)]
    target_error: Option<f64>,
    /// Stop at this noise: pooled RMS as luminance, or as a share of the mean luminance
    #[arg(long, value_name = "X|X%", allow_negative_numbers = true)]
    target_rms: Option<Target>,
    /// Which error the automatic choice makes small
    #[arg(long, default_value = "relative")]
    objective: Aim,
    /// Take counts, settings and iterations from this image; one that chose its own counts is
    /// rendered again bit for bit
    #[arg(long, value_name = "IMAGE.exr", conflicts_with_all = ["light_paths", "camera_paths"])]
    plan: Option<PathBuf>,
    /// Choose counts by these times instead of measuring them on the way: a file that `calibrate`
    /// wrote, or Criterion's folder after `cargo bench --bench tau`
    #[arg(long, value_name = "TIMES", conflicts_with = "plan")]
    timings: Option<PathBuf>,
    /// Denoise the image with Intel Open Image Denoise, and find the error of what comes out: --target-error and --time
    /// are then about the denoised image, a layer of the file and its preview
    #[arg(long)]
    pub denoise: bool,
    /// What the file has beside the image [default: all]
    #[arg(long, value_name = "LAYER", value_delimiter = ',')]
    pub layers: Vec<LayerName>,
    /// Write the noise coefficients that were measured on the way to this file, for predict
    #[arg(long, value_name = "NOISE.exr")]
    pub noise: Option<PathBuf>,
    /// Write a page to this file that tells of the render in any browser, renewed while it runs
    #[arg(long, value_name = "FILE.html")]
    pub report: Option<PathBuf>,
    /// Show the image while it renders: in tev, which listens there [default: 127.0.0.1:14158], or as a
    /// small picture in the terminal
    #[arg(long, value_name = "HOST:PORT|terminal", num_args = 0..=1, require_equals = true)]
    #[arg(default_missing_value = "127.0.0.1:14158")]
    pub view: Option<Place>,
    /// Write a checkpoint to this file every minute, on Ctrl-C and at the end
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,
    /// Continue the image of this checkpoint, with its settings
    #[arg(long, value_name = "FILE", conflicts_with = "plan")]
    pub resume: Option<PathBuf>,
    /// Render only part I of N of the --iterations, or of those of the --plan, for `bdpm merge`
    #[arg(long, value_name = "I/N", conflicts_with_all = ["target_error", "target_rms", "timings"])]
    part: Option<Part>,
}

/// Renders by all processes that were begun together.
pub fn run(mut args: Args) -> Result<String> {
    let ranks = mpi::join()?;
    let result = if ranks.is_first() {
        lead(&args, &*ranks)
    } else {
        args.session.quiet = true;
        follow(&args, &*ranks).map(|()| String::new())
    };
    if let Err(error) = &result
        && ranks.count() > 1
    {
        say(&format!("error: {error}"));
        ranks.abort();
    }
    result
}

fn lead(args: &Args, ranks: &dyn Ranks) -> Result<String> {
    let crew = MpiLeader::new(ranks);
    let mut outputs = Outputs::new(args)?;
    let resumed = args.resume.as_deref().map(Checkpoint::load).transpose()?;
    let planned = args.plan.as_deref().map(|path| read_plan(path, args)).transpose()?;
    let kept_plan = resumed.as_ref().and_then(|checkpoint| checkpoint.plan.as_ref());
    let counting = match (&resumed, planned.as_ref().map(|(plan, _)| plan).or(kept_plan)) {
        (_, Some(plan)) => Counting::Replay(plan.clone()),
        (Some(checkpoint), _) if checkpoint.autopilot.is_some() => Counting::Automatic,
        (Some(_), _) => Counting::Fixed,
        (None, None) if args.counts_are_open() => Counting::Automatic,
        (None, None) => Counting::Fixed,
    };
    let begun = |origin, file, reuse| Continuation { origin, file, reuse };
    let resumes = resumed.as_ref().map(|checkpoint| &checkpoint.origin).zip(args.resume.as_deref());
    let plans = planned.as_ref().map(|(_, origin)| origin).zip(args.plan.as_deref());
    let begun = resumes
        .map(|(origin, file)| begun(origin, file, Reuse::Resume))
        .or(plans.map(|(origin, file)| begun(origin, file, Reuse::Plan)));
    let times = args.timings.as_deref().map(Timings::load).transpose()?;
    let told =
        begun.map(|Continuation { origin, file, reuse }| (origin.clone(), file.to_owned(), reuse));
    crew.as_ref().map_or(Ok(()), |crew| crew.begin(told))?;
    let mut prepared = LoadedScene::new(&args.session, begun)?;
    crew.as_ref().map_or(Ok(()), |crew| crew.check_workers(&prepared))?;
    if outputs.spare_inputs(args)? && !args.session.quiet {
        let (preview, other) = (outputs.png.display(), outputs.exr.with_extension("png"));
        say(&format!("note: the preview is {preview}: {} is another picture", other.display()));
    }
    let start = Instant::now();
    let mut goal = args.goal(&counting);
    let begun_whole = resumed.as_ref().and_then(|checkpoint| checkpoint.whole);
    if args.part.is_some() && matches!(counting, Counting::Automatic) {
        let problem = "parts cannot choose their numbers of paths: all must take the same";
        let advice = "give --iterations, or --plan with an image that chose them";
        return Err(Error::new(problem, advice));
    }
    let share = args.part.map(|part| part.share(goal, begun_whole)).transpose()?;
    goal.iterations = share.as_ref().map_or(goal.iterations, |share| Some(share.own.count()));
    let denoising = args.denoise.then(|| args.load_denoiser(&prepared)).transpose()?;
    if let (Some(time), Some(denoising)) = (&mut goal.time, &denoising) {
        *time = time.saturating_sub(denoising.reserve());
    }
    // Borrows no more than it needs: the origin is still to change.
    let (scene, accel) = (&prepared.scene, &prepared.accel);
    let settings = prepared.origin.settings.clone();
    let new = prepared.threads.install(|| Renderer::new(scene, accel, settings));
    let mut config = RenderConfig { ranks: ranks.count(), ..RenderConfig::default() };
    let mut renderer = new?.configure(config)?;
    let mut page = args.report.clone().map(Page::new);
    let chosen = match counting {
        Counting::Automatic if resumed.is_none() => {
            page.as_mut().map_or(Ok(()), |page| page.announce(&prepared))?;
            Some(args.choose(&prepared, &renderer, &goal)?)
        }
        _ => None,
    };
    if let Some(chosen) = &chosen {
        let wishes = &args.session.scene.wishes;
        let settings = chosen.apply(&prepared.origin.settings);
        prepared.origin.settings = Settings {
            mis_light_paths: wishes.mis_light_paths.unwrap_or(settings.mis_light_paths),
            mis_c1: wishes.mis_c1.unwrap_or(settings.mis_c1),
            mis_c2: wishes.mis_c2.unwrap_or(settings.mis_c2),
            ..settings
        };
        goal.bias2 = chosen.best().bias.powi(2);
        let settings = prepared.origin.settings.clone();
        renderer = prepared.threads.install(|| renderer.with_settings(settings))?;
    }
    if let (Some(time), Some(counts)) = (args.session.time, fixed_counts(&counting, &prepared)) {
        prepared.check_time(time, 1, &counts, args.session.quiet)?;
    }
    if args.noise.is_some() {
        let settings = &prepared.origin.settings;
        if !matches!(counting, Counting::Automatic) {
            check_counts(settings)?;
        }
        check_memory(settings.width, settings.height)?;
        config.grain = BatchGrain::Pixel;
    }
    config.aovs = args.kept();
    renderer = renderer.configure(config)?;
    if let Some(share) = &share {
        renderer.assign(share.own.clone());
        if !args.session.quiet {
            say(&share.to_string());
        }
    }
    let mut state = None;
    if let Some(mut checkpoint) = resumed {
        check_goal(goal, &checkpoint.blocks)?;
        check_grain(args, &checkpoint.blocks)?;
        share.as_ref().map_or(Ok(()), |share| share.check_holds(&checkpoint.blocks))?;
        state = checkpoint.autopilot;
        goal.bias2 = state.map_or(0.0, |state| state.bias2());
        renderer.resume(checkpoint.take_partial())?;
        check_kept(args, renderer.config().aovs)?;
    }
    if let Some(crew) = &crew {
        let settings = prepared.origin.settings.clone();
        let (grain, kept) = (config.grain, renderer.config().aovs);
        crew.set_up(RenderSetup { settings, grain, kept })?;
    }
    let automatic = matches!(counting, Counting::Automatic);
    let prepared = &prepared;
    let whole = share.map(|share| share.whole);
    let task = Task {
        args,
        prepared,
        goal,
        outputs,
        page,
        crew,
        whole,
        automatic,
        chosen,
        denoising,
        start,
    };
    match counting {
        Counting::Fixed => task.render(renderer, Fixed),
        Counting::Replay(plan) => task.render(renderer, Replay::new(plan)),
        Counting::Automatic => {
            let pilot = match (&task.chosen, state) {
                (Some(chosen), _) => Autopilot::new(goal, chosen.best().times),
                (None, state) => Autopilot::resume(goal, state.expect("it was automatic")),
            };
            // Coefficients are written for one pair of counts.
            let pilot = if args.noise.is_some() { pilot.uniform() } else { pilot };
            let pilot = match times.zip(args.timings.as_deref()) {
                Some((times, path)) => pilot.with_times(fitting(&times, path, prepared)?),
                None => pilot,
            };
            task.render(renderer, pilot)
        }
    }
}

impl Args {
    /// What is to be kept beside the image.
    pub fn kept(&self) -> AovSelection {
        let kept = Layers::new(&self.layers).kept();
        AovSelection { folds: self.denoise, features: kept.features || self.denoise, ..kept }
    }

    fn load_denoiser(&self, prepared: &LoadedScene) -> Result<Denoising> {
        let Settings { width, height, .. } = prepared.origin.settings;
        let threads = prepared.threads.current_num_threads();
        Denoising::new(threads, (width, height), self.session.time)
    }

    /// Whether nothing on the command line says how many paths to take.
    fn counts_are_open(&self) -> bool {
        let scene = &self.session.scene;
        scene.wishes.light_paths.is_none()
            && scene.wishes.camera_paths.is_none()
            && self.iterations.is_none()
    }

    /// Tries techniques, as far as the command line leaves them open; the scene file's are where it begins.
    fn choose(
        &self,
        prepared: &LoadedScene,
        renderer: &Renderer,
        goal: &Goal,
    ) -> Result<Selection> {
        let wishes = &self.session.scene.wishes;
        // Known times are those of the settings that they were measured with.
        let any = self.timings.is_none();
        let (radius, caustic_radius) =
            (any && wishes.radius.is_none(), any && wishes.caustic_radius.is_none());
        let open = FreeParameters {
            strategy: any && wishes.strategy.is_none() && wishes.merge_vertex.is_none(),
            direct: any && wishes.direct.is_none(),
            kernel: any && wishes.kernel.is_none(),
            radius,
            caustic_radius,
            guide: any && wishes.guide.is_none(),
            // Who says at which radii gets the image of these. A denoiser takes it as it was merged, part by part.
            bias: (radius || caustic_radius) && wishes.bias.is_none() && !self.denoise,
        };
        let end = match (goal.time, goal.error, goal.target) {
            (Some(time), _, _) => End::Time(time.as_secs_f64()),
            (None, Some(error), _) => End::Error(error),
            (None, None, Some(Target::Share(share))) => End::Error(share),
            (None, None, _) => End::Error(DEFAULT_ERROR),
        };
        if !self.session.quiet {
            let what = if open.any() { "strategies and radii" } else { "light and camera paths" };
            say(&format!("trying {what} on a sample of the image"));
        }
        prepared.threads.install(|| technique::choose(renderer, open, end))
    }

    fn goal(&self, counting: &Counting) -> Goal {
        let planned = match counting {
            Counting::Replay(plan) => plan.iterations(),
            _ => None,
        };
        let iterations = self.iterations.or(planned);
        let (time, target, mut error) = (self.session.time, self.target_rms, self.target_error);
        if iterations.is_none() && time.is_none() && target.is_none() && self.part.is_none() {
            error = error.or(Some(DEFAULT_ERROR));
        }
        let objective = match self.objective {
            Aim::Relative => Objective::Relative,
            Aim::Pooled => Objective::Pooled,
        };
        Goal { iterations, time, target, error, objective, bias2: 0.0 }
    }
}

/// Reads a share such as 2%.
fn share(text: &str) -> Result<f64> {
    match text.parse::<Target>() {
        Ok(Target::Share(share)) => Ok(share),
        _ => Err(Error::new(format!("`{text}` is no share"), "give a positive share such as 2%")),
    }
}
