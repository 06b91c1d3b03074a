//! `bdpm render SCENE`.

use super::analyze::{check_counts, noise_file};
use super::darkness;
use super::denoising::Denoising;
use super::layers::{LayerName, Layers};
use super::outputs::Attempts;
use super::page::{Moment, Page};
use super::render_files::{Outputs, Schedule, Writer};
use super::render_inputs::{
    Counting, check_goal, check_grain, check_kept, fitting, fixed_counts, read_plan,
};
use super::render_report::{Report, Shares, block_reports, describe_counts, text};
use super::session::{Begun, Prepared, Session, SessionArgs};
use super::view::{Place, View};
use super::{json, say};
use bdpm::base::error::{Error, Result};
use bdpm::files::checkpoint::Checkpoint;
use bdpm::image::layers::Kept;
use bdpm::noise::Measure;
use bdpm::noise::file::check_memory;
use bdpm::noise::film::BatchGrain;
use bdpm::optimize::Objective;
use bdpm::render::Renderer;
use bdpm::render::bias::MergeBias;
use bdpm::render::block::{Block, Combined};
use bdpm::settings::Settings;
use bdpm::settings::origin::Reuse;
use bdpm::steer::autopilot::Autopilot;
use bdpm::steer::goal::{Goal, StoppedBy, Target, importance};
use bdpm::steer::technique;
use bdpm::steer::technique::{Chosen, End, Open};
use bdpm::steer::{Fixed, Replay, Steer};
use bdpm::timing::Timings;
use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

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
    view: Option<Place>,
    /// Write a checkpoint to this file every minute, on Ctrl-C and at the end
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,
    /// Continue the image of this checkpoint, with its settings
    #[arg(long, value_name = "FILE", conflicts_with = "plan")]
    pub resume: Option<PathBuf>,
}

pub fn run(args: &Args) -> Result<String> {
    let mut outputs = Outputs::new(args)?;
    let resumed = args.resume.as_deref().map(Checkpoint::load).transpose()?;
    let planned = args.plan.as_deref().map(|path| read_plan(path, args)).transpose()?;
    let counting = match (&resumed, planned.as_ref()) {
        (_, Some((plan, _))) => Counting::Replay(plan.clone()),
        (Some(checkpoint), _) if checkpoint.autopilot.is_some() => Counting::Automatic,
        (Some(_), _) => Counting::Fixed,
        (None, None) if args.counts_are_open() => Counting::Automatic,
        (None, None) => Counting::Fixed,
    };
    let begun = |origin, file, reuse| Begun { origin, file, reuse };
    let resumes = resumed.as_ref().map(|checkpoint| &checkpoint.origin).zip(args.resume.as_deref());
    let plans = planned.as_ref().map(|(_, origin)| origin).zip(args.plan.as_deref());
    let begun = resumes
        .map(|(origin, file)| begun(origin, file, Reuse::Resume))
        .or(plans.map(|(origin, file)| begun(origin, file, Reuse::Plan)));
    let times = args.timings.as_deref().map(Timings::load).transpose()?;
    let mut prepared = Prepared::new(&args.session, begun)?;
    if outputs.spare_inputs(args)? && !args.session.quiet {
        let (preview, other) = (outputs.png.display(), outputs.exr.with_extension("png"));
        say(&format!("note: the preview is {preview}: {} is another picture", other.display()));
    }
    let start = Instant::now();
    let mut goal = args.goal(&counting);
    let denoising = args.denoise.then(|| args.load_denoiser(&prepared)).transpose()?;
    if let (Some(time), Some(denoising)) = (&mut goal.time, &denoising) {
        *time = time.saturating_sub(denoising.reserve());
    }
    // Borrows no more than it needs: the origin is still to change.
    let (scene, accel) = (&prepared.scene, &*prepared.accel);
    let settings = prepared.origin.settings.clone();
    let mut renderer = prepared.threads.install(|| Renderer::new(scene, accel, settings))?;
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
        renderer = prepared.threads.install(|| renderer.like(settings))?;
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
        renderer = renderer.with_batches(BatchGrain::Pixel);
    }
    renderer = renderer.keeping(args.kept())?;
    let mut state = None;
    if let Some(checkpoint) = resumed {
        check_goal(goal, &checkpoint.blocks)?;
        check_grain(args, &checkpoint.blocks)?;
        let features = checkpoint.features.map(Cow::into_owned);
        state = checkpoint.autopilot;
        goal.bias2 = state.map_or(0.0, |state| state.bias2());
        renderer.resume_with(checkpoint.blocks.into_owned(), features)?;
        check_kept(args, renderer.kept())?;
    }
    let automatic = matches!(counting, Counting::Automatic);
    let prepared = &prepared;
    let task = Task { args, prepared, goal, outputs, page, automatic, chosen, denoising, start };
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
    pub fn kept(&self) -> Kept {
        let kept = Layers::new(&self.layers).kept();
        Kept { parts: self.denoise, features: kept.features || self.denoise, ..kept }
    }

    fn load_denoiser(&self, prepared: &Prepared) -> Result<Denoising> {
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
    fn choose(&self, prepared: &Prepared, renderer: &Renderer, goal: &Goal) -> Result<Chosen> {
        let wishes = &self.session.scene.wishes;
        // Known times are those of the settings that they were measured with.
        let any = self.timings.is_none();
        let open = Open {
            strategy: any && wishes.strategy.is_none() && wishes.merge_vertex.is_none(),
            direct: any && wishes.direct.is_none(),
            kernel: any && wishes.kernel.is_none(),
            radius: any && wishes.radius.is_none(),
            caustic_radius: any && wishes.caustic_radius.is_none(),
            guide: any && wishes.guide.is_none(),
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
        if iterations.is_none() && time.is_none() && target.is_none() {
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

/// A render that is ready to begin.
struct Task<'a> {
    args: &'a Args,
    prepared: &'a Prepared,
    goal: Goal,
    outputs: Outputs,
    page: Option<Page>,
    /// Whether counts are chosen on the way.
    automatic: bool,
    /// The technique, where that was chosen.
    chosen: Option<Chosen>,
    denoising: Option<Denoising>,
    /// When rendering began: with the choice of the technique.
    start: Instant,
}

impl Task<'_> {
    /// Renders to the goal, writes the files and tells of it.
    fn render(self, mut renderer: Renderer, mut steer: impl Steer) -> Result<String> {
        let Self { args, prepared, goal, outputs, mut page, automatic, chosen, denoising, start } =
            self;
        page.as_mut().map_or(Ok(()), |page| page.announce(prepared))?;
        let layers = Layers::new(&args.layers);
        let origin = &prepared.origin;
        let mut writer = Writer { origin, outputs, page, layers, time: Duration::ZERO };
        let earlier = steer.state(0.0).map_or(0.0, |state| state.elapsed());
        let announced = if automatic {
            "numbers of paths chosen automatically".to_owned()
        } else {
            describe_counts(renderer.block())
        };
        let quiet = args.session.quiet;
        let session = Session::new(prepared, (goal, 1), quiet, ("rendering", &announced))?;
        let mut session = session.begun_at(start);
        let name = |path: &Path| path.to_string_lossy().into_owned();
        let place = args.view.as_ref();
        let mut view = place.map(|place| View::new(place, &name(&args.output), &session.progress));
        session.denoising = denoising;
        let mut schedule = Schedule::new(prepared.origin.settings.pixels());
        let stopped_by =
            session.iterate(&mut renderer, &mut steer, |session, renderer, steer| {
                let image = || combined(renderer, steer, goal.objective);
                if session.denoises_enough(renderer, image)? {
                    return Ok(Some(StoppedBy::Target));
                }
                let save = |writer: &mut Writer, session: &Session, attempts: &mut Attempts| {
                    writer.save_checkpoint(renderer, steer, session.elapsed(), attempts);
                };
                schedule.write_when_due(&mut writer, session, save, |writer, session, attempts| {
                    let image = image();
                    match session.preview(renderer, &image) {
                        Ok(denoised) => {
                            writer.save_image(renderer, &image, denoised.as_ref(), attempts);
                        }
                        Err(error) => session.progress.note(&format!("warning: {error}")),
                    }
                });
                if writer.page_is_due(session) {
                    let image = combined(renderer, steer, goal.objective);
                    let (promise, chosen) = (steer.promise(), chosen.as_ref());
                    let denoised = session.denoised();
                    let report = None;
                    let moment = Moment {
                        session,
                        image: &image,
                        denoised,
                        earlier,
                        promise,
                        chosen,
                        report,
                    };
                    writer.renew_page(&moment);
                }
                let elapsed = session.elapsed();
                if let Some(view) = &mut view
                    && view.is_due(elapsed)
                {
                    view.show(
                        &combined(renderer, steer, goal.objective),
                        session.denoised(),
                        elapsed,
                    );
                }
                Ok(None)
            })?;
        let half_way = session.half_way();
        // What was asked for first, and all of it whatever fails.
        let image = combined(&renderer, &steer, goal.objective);
        session.progress.finish();
        let mut attempts = Attempts::default();
        let denoised = session.denoise(&renderer, &image);
        let latest = session.denoising.as_ref().and_then(|denoising| denoising.latest.as_ref());
        writer.save_image(&renderer, &image, latest, &mut attempts);
        if denoised.is_err() {
            attempts.add(&writer.outputs.exr, || denoised);
        }
        darkness::warn(&image, &session.progress);
        if let Some(path) = &args.noise {
            match best_measured(&renderer) {
                Some(block) => _ = attempts.add(path, || save_noise(path, prepared, block)),
                None => session
                    .progress
                    .note("warning: too few iterations to tell the noise; --noise wrote nothing"),
            }
        }
        writer.save_checkpoint(&renderer, &steer, session.elapsed(), &mut attempts);

        let (variance, luminance) = (image.pooled_variance(), image.mean_luminance());
        let rms = variance.map(|(variance, _)| variance.sqrt());
        let error = variance.map(|(variance, error)| 0.5 * error / variance.sqrt());
        let report = Report {
            run: session.report((image.iterations(), luminance), stopped_by, writer.time),
            automatic,
            blocks: block_reports(&image, renderer.blocks()),
            rms,
            rms_error: error.filter(|error| error.is_finite()),
            relative_rms: rms.map(|rms| rms / luminance).filter(|share| share.is_finite()),
            promise: steer.promise().copied(),
            error: automatic.then(|| Shares::new(&renderer, &image, &goal)).flatten(),
            denoised: session.denoising.as_ref().map(|denoising| denoising.report(&goal)),
            technique: chosen,
            half_way,
            merge_bias: MergeBias::new(renderer.blocks(), &image),
            exr: name(&writer.outputs.exr),
            png: name(&writer.outputs.png),
            noise: args.noise.as_deref().map(name),
            report: args.report.as_deref().map(name),
            checkpoint: writer.outputs.checkpoint.as_deref().map(name),
        };
        if let Some(page) = &mut writer.page {
            session.look_again(&renderer, &steer);
            let (chosen, promise) = (report.technique.as_ref(), report.promise.as_ref());
            let (session, image, denoised, report) =
                (&session, &image, session.denoised(), Some(&report));
            let moment = Moment { session, image, denoised, earlier, promise, chosen, report };
            let path = page.path.clone();
            attempts.add(&path, || page.write(&moment));
        }
        if let Some(view) = view {
            view.finish(&image, session.denoised(), session.elapsed());
        }
        attempts.finish()?;
        Ok(match (args.session.scene.json, quiet) {
            (true, _) => json(&report),
            (false, true) => String::new(),
            (false, false) => text(&report),
        })
    }
}

/// The image of all blocks.
fn combined<'a>(renderer: &'a Renderer, steer: &impl Steer, objective: Objective) -> Combined<'a> {
    let importance = importance(renderer.blocks(), objective);
    Combined::new(renderer.blocks(), steer.weights(renderer.blocks(), &importance))
}

/// The block with the most measuring iterations, if they tell its noise.
fn best_measured<'a>(renderer: &'a Renderer) -> Option<&'a Block> {
    let measured = |block: &Block| block.noise.as_ref().map_or(0, |noise| noise.iterations);
    let best = renderer.blocks().iter().max_by_key(|block| measured(block));
    best.filter(|block| measured(block) >= 2)
}

/// Writes what its measuring iterations found.
fn save_noise(path: &Path, prepared: &Prepared, block: &Block) -> Result<()> {
    let noise = block.noise_image()?;
    noise_file(prepared, &block.film, noise, Measure::Pairs).write(path)
}
