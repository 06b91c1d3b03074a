//! `bdpm render SCENE`.

use super::analyze::{check_counts, noise_file};
use super::darkness;
use super::progress::Progress;
use super::render_files::{Outputs, Schedule, Writer};
use super::render_report::{Report, Shares, block_reports, describe_counts, text};
use super::session::{Prepared, Session, SessionArgs};
use super::{json, say};
use bdpm::base::error::{Error, Result};
use bdpm::files::checkpoint::Checkpoint;
use bdpm::noise::Measure;
use bdpm::noise::file::check_memory;
use bdpm::noise::film::BatchGrain;
use bdpm::optimize::Objective;
use bdpm::pictures;
use bdpm::render::Renderer;
use bdpm::render::bias::MergeBias;
use bdpm::render::block::{Block, Combined};
use bdpm::settings::Settings;
use bdpm::settings::origin::Origin;
use bdpm::steer::autopilot::Autopilot;
use bdpm::steer::goal::{Goal, Target};
use bdpm::steer::plan::Plan;
use bdpm::steer::technique;
use bdpm::steer::technique::{Chosen, End, Open};
use bdpm::steer::{Fixed, Replay, Steer};
use bdpm::timing::{TimeModel, Timings};
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
    /// Image to write; the PNG preview beside it has the same name
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
    /// Write the noise coefficients that were measured on the way to this file, for predict
    #[arg(long, value_name = "NOISE.exr")]
    pub noise: Option<PathBuf>,
    /// Write a checkpoint to this file every minute, on Ctrl-C and at the end
    #[arg(long, value_name = "FILE")]
    pub checkpoint: Option<PathBuf>,
    /// Continue the image of this checkpoint, with its settings
    #[arg(long, value_name = "FILE", conflicts_with = "plan")]
    resume: Option<PathBuf>,
}

/// Where the counts come from.
enum Counting {
    Fixed,
    Automatic,
    Replay(Plan),
}

pub fn run(args: &Args) -> Result<String> {
    let outputs = Outputs::new(args)?;
    let resumed = args.resume.as_deref().map(Checkpoint::load).transpose()?;
    let planned = args.plan.as_deref().map(|path| read_plan(path, args)).transpose()?;
    let counting = match (&resumed, planned.as_ref()) {
        (_, Some((plan, _))) => Counting::Replay(plan.clone()),
        (Some(checkpoint), _) if checkpoint.autopilot.is_some() => Counting::Automatic,
        (Some(_), _) => Counting::Fixed,
        (None, None) if args.counts_are_open() => Counting::Automatic,
        (None, None) => Counting::Fixed,
    };
    let begun = resumed
        .as_ref()
        .map(|checkpoint| &checkpoint.origin)
        .zip(args.resume.as_deref())
        .or(planned.as_ref().map(|(_, origin)| origin).zip(args.plan.as_deref()));
    let mut prepared = Prepared::new(&args.session, begun)?;
    let start = Instant::now();
    let mut goal = args.goal(&counting);
    let mut chosen = None;
    if matches!(counting, Counting::Automatic) && resumed.is_none() {
        chosen = args.choose(&prepared, &goal)?;
    }
    if let Some(chosen) = &chosen {
        let wishes = &args.session.scene.wishes;
        let settings = chosen.best().apply(&prepared.origin.settings);
        prepared.origin.settings = Settings {
            mis_light_paths: wishes.mis_light_paths.unwrap_or(settings.mis_light_paths),
            mis_c1: wishes.mis_c1.unwrap_or(settings.mis_c1),
            mis_c2: wishes.mis_c2.unwrap_or(settings.mis_c2),
            ..settings
        };
        goal.bias2 = chosen.best().bias.powi(2);
    }
    let mut renderer = prepared.renderer()?;
    if args.noise.is_some() {
        let settings = &prepared.origin.settings;
        if !matches!(counting, Counting::Automatic) {
            check_counts(settings)?;
        }
        check_memory(settings.width, settings.height)?;
        renderer = renderer.with_batches(BatchGrain::Pixel);
    }
    let mut state = None;
    if let Some(checkpoint) = resumed {
        check_goal(goal, &checkpoint.blocks)?;
        check_grain(args, &checkpoint.blocks)?;
        state = checkpoint.autopilot;
        goal.bias2 = state.map_or(0.0, |state| state.bias2());
        renderer.resume(checkpoint.blocks.into_owned())?;
    }
    let automatic = matches!(counting, Counting::Automatic);
    let task = Task { args, prepared: &prepared, goal, outputs, automatic, chosen, start };
    match counting {
        Counting::Fixed => task.render(renderer, Fixed),
        Counting::Replay(plan) => task.render(renderer, Replay::new(plan)),
        Counting::Automatic => {
            let threads = prepared.threads.current_num_threads();
            let pilot = Autopilot::new(goal, threads, state);
            let pilot = match &task.chosen {
                Some(chosen) => pilot.starting_at(chosen.best()),
                None => pilot,
            };
            // Coefficients are written for one pair of counts.
            let pilot = if args.noise.is_some() { pilot.uniform() } else { pilot };
            let pilot = match &args.timings {
                Some(path) => pilot.with_times(known_times(path, &prepared)?),
                None => pilot,
            };
            task.render(renderer, pilot)
        }
    }
}

impl Args {
    /// Whether nothing on the command line says how many paths to take.
    fn counts_are_open(&self) -> bool {
        let scene = &self.session.scene;
        scene.wishes.light_paths.is_none()
            && scene.wishes.camera_paths.is_none()
            && self.iterations.is_none()
    }

    /// Tries techniques, as far as the command line leaves them open; the scene file's are where it begins.
    fn choose(&self, prepared: &Prepared, goal: &Goal) -> Result<Option<Chosen>> {
        let wishes = &self.session.scene.wishes;
        let settings = &prepared.origin.settings;
        let open = Open {
            strategy: wishes.strategy.is_none() && wishes.merge_vertex.is_none(),
            direct: wishes.direct.is_none(),
            radius: wishes.radius.is_none(),
            caustic_radius: wishes.caustic_radius.is_none(),
        };
        let Open { strategy, direct, radius, caustic_radius } = open;
        // Known times are those of the settings that they were measured with.
        if self.timings.is_some() || !(strategy || direct || radius || caustic_radius) {
            return Ok(None);
        }
        let end = match (goal.time, goal.error, goal.target) {
            (Some(time), _, _) => End::Time(time.as_secs_f64()),
            (None, Some(error), _) => End::Error(error),
            (None, None, Some(Target::Share(share))) => End::Error(share),
            (None, None, _) => End::Error(DEFAULT_ERROR),
        };
        if !self.session.quiet {
            say("trying strategies and radii on a sample of the image");
        }
        let task = (open, end);
        let chosen = prepared
            .threads
            .install(|| technique::choose(&prepared.scene, &*prepared.accel, settings, task))?;
        Ok(Some(chosen))
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

/// Reads a plan with what it belongs to. Where its iterations are open, seed and version are as well.
fn read_plan(path: &Path, args: &Args) -> Result<(Plan, Origin)> {
    let image = pictures::read_exr(path)?;
    let plan = Plan::read_from(&image).map_err(|e| e.at(path))?;
    let mut origin = Origin::from_metadata(&image.metadata).map_err(|e| e.at(path))?;
    let Settings { width, height, .. } = origin.settings;
    if (image.width, image.height) != (width, height) {
        let size = format!("{}x{}", image.width, image.height);
        return Err(Error::new(
            format!("the image has {size} pixels, but says that it was made with {width}x{height}"),
            "give the file as bdpm wrote it",
        )
        .at(path));
    }
    if plan.iterations().is_none() {
        origin.version = env!("CARGO_PKG_VERSION").into();
        origin.settings.seed = args.session.scene.wishes.seed.unwrap_or(origin.settings.seed);
    } else if args.checkpoint.is_some() {
        return Err(Error::new(
            "an image is replayed in one go, without checkpoints",
            "leave --checkpoint out",
        )
        .at(path));
    }
    Ok((plan, origin))
}

/// Times that belong to this scene and these settings.
fn known_times(path: &Path, prepared: &Prepared) -> Result<TimeModel> {
    let timings = Timings::load(path)?;
    let Settings { width, height, .. } = prepared.origin.settings;
    let facts = prepared.origin.to_metadata();
    timings.check_fits(&facts, width, height).map_err(|e| e.at(path))?;
    Ok(timings.model)
}

/// A render that is ready to begin.
struct Task<'a> {
    args: &'a Args,
    prepared: &'a Prepared,
    goal: Goal,
    outputs: Outputs,
    /// Whether counts are chosen on the way.
    automatic: bool,
    /// The technique, where that was chosen.
    chosen: Option<Chosen>,
    /// When rendering began: with the choice of the technique.
    start: Instant,
}

impl Task<'_> {
    /// Renders to the goal, writes the files and tells of it.
    fn render(self, mut renderer: Renderer, mut steer: impl Steer) -> Result<String> {
        let Self { args, prepared, goal, outputs, automatic, chosen, start } = self;
        let mut writer = Writer { origin: &prepared.origin, outputs, time: Duration::ZERO };
        let announced = if automatic {
            "numbers of paths chosen automatically".to_owned()
        } else {
            describe_counts(renderer.block())
        };
        let quiet = args.session.quiet;
        let session = Session::new(prepared, (goal, 1), quiet, ("rendering", &announced))?;
        let mut session = session.begun_at(start);
        let mut schedule = Schedule::new(prepared.origin.settings.pixels());
        let stopped_by =
            session.iterate(&mut renderer, &mut steer, |session, renderer, steer| {
                let save = |writer: &mut Writer| {
                    writer.save_checkpoint(renderer, steer, session.elapsed())
                };
                schedule.write_when_due(&mut writer, session, save, |writer| {
                    writer.save_image(&combined(renderer, steer))
                });
            })?;
        session.progress.finish();
        let half_way = session.half_way();
        // The checkpoint first: with it, a full disk costs no work.
        writer.save_checkpoint(&renderer, &steer, session.elapsed())?;
        let image = combined(&renderer, &steer);
        writer.save_image(&image)?;
        darkness::warn(&image, &session.progress);
        if let Some(path) = &args.noise {
            save_noise(path, prepared, &renderer, &session.progress)?;
        }

        let name = |path: &Path| path.to_string_lossy().into_owned();
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
            technique: chosen,
            half_way,
            merge_bias: MergeBias::new(renderer.blocks(), &image),
            exr: name(&writer.outputs.exr),
            png: name(&writer.outputs.png),
            noise: args.noise.as_deref().map(name),
            checkpoint: writer.outputs.checkpoint.as_deref().map(name),
        };
        Ok(match (args.session.scene.json, quiet) {
            (true, _) => json(&report),
            (false, true) => String::new(),
            (false, false) => text(&report),
        })
    }
}

/// The image of all blocks.
fn combined<'a>(renderer: &'a Renderer, steer: &impl Steer) -> Combined<'a> {
    Combined::new(renderer.blocks(), steer.weights(renderer.blocks()))
}

/// Refuses to go on to fewer iterations than there are.
fn check_goal(goal: Goal, blocks: &[Block]) -> Result<()> {
    let done: u64 = blocks.iter().map(|block| block.film.iterations).sum();
    match goal.iterations {
        Some(wanted) if wanted < done => Err(Error::new(
            format!("the checkpoint holds {done} iterations, more than {wanted}"),
            format!("give --iterations {done} or more, or --time"),
        )),
        _ => Ok(()),
    }
}

/// Refuses to write coefficients by pixel of which a checkpoint has only sums by tile.
fn check_grain(args: &Args, blocks: &[Block]) -> Result<()> {
    let Some(path) = &args.noise else { return Ok(()) };
    let by_tile =
        |block: &Block| block.noise.as_ref().is_some_and(|noise| noise.grain() == BatchGrain::Tile);
    if blocks.iter().any(by_tile) {
        return Err(Error::new(
            "the checkpoint was begun without --noise and lacks the batches of single pixels",
            "resume without --noise, or begin anew with it",
        )
        .at(path));
    }
    Ok(())
}

/// Writes what the measuring iterations of the block with the most of them found.
fn save_noise(
    path: &Path,
    prepared: &Prepared,
    renderer: &Renderer,
    progress: &Progress,
) -> Result<()> {
    let measured =
        renderer.blocks().iter().filter_map(|block| Some((block, block.noise.as_ref()?)));
    let most = measured.max_by_key(|(_, noise)| noise.iterations);
    let Some((block, _)) = most.filter(|(_, noise)| noise.iterations >= 2) else {
        progress.note("warning: too few iterations to tell the noise; --noise wrote nothing");
        return Ok(());
    };
    let noise = block.noise_image()?;
    noise_file(prepared, &block.film, noise, Measure::Pairs).write(path)
}
