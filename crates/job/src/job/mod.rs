//! One call renders: [`RenderJob`].
//!
//! ```text
//! scene -> pilot (technique, radii, guide) -> iterations (counts chosen on the way) -> RenderResult
//! ```
//!
//! A job reads and writes no files; [`output`](crate::output) writes images from its
//! [`RenderResult`]. An observer sees the [`RenderState`] after every iteration.

mod asked;
mod audit;
mod audit_report;
mod builder;
mod denoise_mode;
mod denoising;
mod iterate;
mod root_run;
mod root_rank;
mod near_layers;
mod outline;
mod reduced_size;
mod restart;
mod result;
mod run_clock;
mod status;
mod shard;
mod state;
mod step;
mod time_check;
mod worker;

pub use audit::{Audit, DEFAULT_SHARE};
pub use audit_report::{AuditReport, AuditedRegion, Verdict};
pub(crate) use audit_report::{MIN_HITS, named_regions};
pub use denoising::{DENOISED_DECAY, DenoisedPromise, DenoisedReport, Denoising};
pub use outline::JobOutline;
pub use result::{RelativeError, RenderResult};
pub use run_clock::Spent;
pub use shard::Shard;
pub use state::{RenderState, best_measured};
pub use status::{Exchanged, NoiseAt, Status, TimeForecast, Totals};
pub use step::{PlantedFailure, Step};
pub use time_check::check_time;
pub use worker::report_failure;

use crate::mpi::{Ranks, SingleProcess};
use crate::output::checkpoint::{Checkpoint, ShardedImage};
use crate::output::denoise::ErrorSummary;
use audit::AuditPace;
use bdpm_auto::adaptive::autopilot::{Autopilot, AutopilotState, CountOptions};
use bdpm_auto::adaptive::count_policy::CountPolicy;
use bdpm_auto::adaptive::plan::Plan;
use bdpm_auto::adaptive::stopping::{Stop, Target};
use bdpm_auto::adaptive::technique::{End, FreeParameters, Selection};
use bdpm_auto::timing::{TimeModel, Timings};
use bdpm_core::accel::Intersect;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::film::aov::AovSelection;
use bdpm_core::film::counts::Counts;
use bdpm_core::noise::file::check_memory;
use bdpm_core::noise::film::BatchGrain;
use bdpm_core::noise::schedule::MeasureSchedule;
use bdpm_core::render::Renderer;
use bdpm_core::render::audit::AuditSums;
use bdpm_core::render::block::Block;
use bdpm_core::scene::backend;
use bdpm_core::scene::backend::Backend;
use bdpm_core::scene::{Media, Scene};
use bdpm_core::settings::provenance::{Provenance, Reuse};
use bdpm_core::settings::{Bias, PartialSettings, Settings};
use bdpm_core::transport::camera_paths::CameraPoints;
use denoise_mode::Denoise;
use rayon::ThreadPool;
use root_rank::RootRank;
use shard::ShardIterations;
use std::borrow::Cow;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// Relative error at which a job stops if no stop condition was given: 1 %.
const DEFAULT_ERROR: f64 = 0.01;

/// Shadow rays that learn the visibility of lights if a job chooses its settings, per second of the
/// job: they take about 2 % of its time. Eight times as many reduce the variance of a room behind
/// windows by a tenth.
const VISIBILITY_RAYS_PER_SECOND: f64 = 65_536.0;

/// Their maximum: more hardly reduce the noise.
const MOST_VISIBILITY_RAYS: u32 = 1 << 22;

/// Renders a scene until a [`Stop`] condition holds.
///
/// By default, short trials choose the technique, merge radii and guide with the least predicted
/// error (noise and merge bias), and the job chooses its path counts. Settings that
/// [`Self::settings`] fixes are not chosen.
///
/// ```no_run
/// use bdpm_auto::Stop;
/// use bdpm_job::RenderJob;
/// use std::time::Duration;
///
/// let scene = bdpm_load::load("scenes/cornell-box")?;
/// let result = RenderJob::new(&scene).stop(Stop::time(Duration::from_secs(60))).render()?;
/// println!("{:?}", result.error);
/// # Ok::<(), bdpm_core::Error>(())
/// ```
#[derive(Clone)]
pub struct RenderJob {
    scene: Arc<Scene>,
    scene_settings: PartialSettings,
    settings: PartialSettings,
    backend: Option<Backend>,
    accel: Option<(Backend, Arc<dyn Intersect>)>,
    threads: Option<Arc<ThreadPool>>,
    stop: Stop,
    start: Start,
    times: Option<(Timings, PathBuf)>,
    free: Option<FreeParameters>,
    reserve_per_pixel: Duration,
    started: Option<Instant>,
    min_iterations: u64,
    /// Reserve for each pixel of an enlarged picture, if the image may have fewer pixels.
    reserve_per_enlarged_pixel: Option<Duration>,
    fewer_paths: [bool; 2], // of light and camera, where the time is too short for those of the settings
    schedule: MeasureSchedule,
    pixel_noise: bool,
    aovs: AovSelection,
    denoise: Denoise,
    audit: Option<f64>,
    shard: Option<Shard>,
    interrupt: Arc<AtomicBool>,
    planted: Option<PlantedFailure>,
    /// Sums of the audit of the image that is resumed.
    audited: Option<AuditSums>,
}

/// Start of an image.
#[derive(Clone)]
enum Start {
    New,
    Plan { plan: Plan, made_by: Box<Provenance>, file: PathBuf },
    Checkpoint { checkpoint: Box<Checkpoint<'static>>, file: PathBuf },
}

/// Events that a job reports to its observer.
pub enum Event<'a> {
    /// A warning for the user. The job continues.
    Warning(String),
    /// The pilot starts to try techniques. The parameters are those that it may choose; the
    /// provenance holds the settings before the choice.
    Choosing(FreeParameters, &'a Provenance),
    /// The first iteration is about to start.
    Started(&'a RenderState),
    /// The image started again with another technique, since its audit refuted the first.
    Restarted(&'a RenderState),
    /// The error of the denoised image was estimated, after this rendering time.
    Denoised(&'a ErrorSummary, Duration),
    /// An iteration is done, or with several processes a round of iterations.
    Iterated(&'a mut RenderState),
}

/// Scene, settings and threads of a job that is about to render.
struct Prepared {
    scene: Arc<Scene>,
    accel: Arc<dyn Intersect>,
    threads: Arc<ThreadPool>,
    provenance: Provenance,
    build_time: Duration,
}

impl RenderJob {
    /// Renders without an observer.
    ///
    /// # Errors
    /// As [`Self::run`].
    pub fn render(self) -> Result<RenderResult> {
        self.run(|_| ControlFlow::Continue(()))
    }

    /// Renders, and reports events to `observer`, which may end the job.
    ///
    /// # Errors
    /// - if settings are invalid, or differ from those of the plan or checkpoint;
    /// - if the memory does not suffice;
    /// - if one iteration would take far longer than the time;
    /// - if the denoiser fails.
    pub fn run(self, observer: impl FnMut(Event) -> ControlFlow<()>) -> Result<RenderResult> {
        self.run_on(&SingleProcess, observer)
    }

    /// Renders as rank 0 of several processes, which leads the others. They
    /// [`follow`](Self::follow).
    ///
    /// # Errors
    /// As [`Self::run`], and if another process has another scene or version. The other processes
    /// then end, too.
    pub fn run_on(
        self,
        ranks: &dyn Ranks,
        mut observer: impl FnMut(Event) -> ControlFlow<()>,
    ) -> Result<RenderResult> {
        let mut root = RootRank::new(ranks);
        let result = self.run_root(ranks, &mut root, &mut observer);
        if result.is_err()
            && let Some(root) = &mut root
        {
            // The error of the render says why.
            let _ = root.dismiss();
        }
        result
    }

    /// Renders as a rank other than 0 of several processes, until rank 0 has no more work for it.
    ///
    /// # Errors
    /// As [`Self::run_on`].
    pub fn follow(mut self, ranks: &dyn Ranks) -> Result<()> {
        let prepared = self.prepare();
        worker::follow(ranks, prepared, &self.interrupt, self.planted)
    }

    /// Resolves settings, builds the acceleration structure, and checks both against the plan or
    /// checkpoint.
    fn prepare(&mut self) -> Result<Prepared> {
        let threads = match self.threads.take() {
            Some(threads) => threads,
            None => Arc::new(thread_pool(0)?),
        };
        let scene = Arc::clone(&self.scene);
        let earlier = match &self.start {
            Start::New => None,
            Start::Plan { made_by, file, .. } => Some((&**made_by, file, Reuse::Plan)),
            Start::Checkpoint { checkpoint, file } => {
                Some((&checkpoint.provenance, file, Reuse::Resume))
            }
        };
        // An image that is continued has its own settings. Settings that agree with them are
        // accepted.
        let defaults = match earlier {
            Some((made_by, ..)) => Cow::Owned((&made_by.settings).into()),
            None => Cow::Borrowed(&self.scene_settings),
        };
        let settings = Settings::resolve(&self.settings, &defaults, scene.size())?;
        let earlier_backend = earlier.and_then(|(made_by, ..)| Backend::named(&made_by.backend));
        let start = Instant::now();
        let (backend, accel) = match self.accel.take() {
            Some((backend, accel)) => (backend, accel),
            None => {
                let backend = self.backend.or(earlier_backend).unwrap_or_default();
                (backend, threads.install(|| backend::build(backend, &scene))?)
            }
        };
        let build_time = start.elapsed();
        let settings = threads.install(|| self.fitting(&scene, &accel, settings))?;
        let provenance = provenance(&scene, backend, settings);
        if let Some((made_by, file, reuse)) = earlier {
            made_by.check_agrees(&provenance, reuse).map_err(|e| e.at(file))?;
        }
        Ok(Prepared { scene, accel, threads, provenance, build_time })
    }

    /// Returns true if the path counts are chosen during the render.
    fn is_automatic(&self) -> bool {
        match &self.start {
            Start::Plan { .. } => false,
            Start::Checkpoint { checkpoint, .. } => {
                checkpoint.plan.is_none() && checkpoint.autopilot.is_some()
            }
            Start::New if self.free.is_some() => true,
            Start::New => {
                let Self { settings, stop, schedule, .. } = self;
                settings.light_paths.is_none()
                    && settings.camera_paths.is_none()
                    && stop.iterations.is_none()
                    && *schedule == MeasureSchedule::default()
            }
        }
    }

    /// The parameters that the pilot may choose.
    fn chosen_parameters(&self) -> FreeParameters {
        if let Some(free) = self.free {
            return free;
        }
        let fixed = &self.settings;
        // Known times hold only for the settings that they were measured with.
        let any = self.times.is_none();
        let in_media = any && self.scene.media().is_some_and(Media::any_scatters);
        let radius = any && fixed.radius.is_none();
        let caustic_radius = any && fixed.caustic_radius.is_none();
        FreeParameters {
            strategy: any && fixed.strategy.is_none() && fixed.merge_vertex.is_none(),
            direct: any && fixed.direct.is_none(),
            radius,
            caustic_radius,
            medium_query: in_media && fixed.medium_query.is_none(),
            medium_scale: in_media && fixed.medium_scale.is_none(),
            medium_share: in_media && fixed.medium_share.is_none(),
            guide: any && fixed.guide.is_none(),
            sobol_set: any && fixed.sobol_set.is_none(),
            splitting: any && fixed.splitting.is_none(),
            // At radii that the user chose, the image keeps its bias.
            bias: (radius || caustic_radius) && fixed.bias.is_none(),
        }
    }

    /// Shadow rays that learn the visibility of lights. Their number depends on options alone, so
    /// that images can be repeated. Among local lights the light tree chooses so well that learning
    /// does not pay; through windows it does.
    fn visibility_rays(&self, scene: &Scene, settings: &Settings, time: Option<Duration>) -> u32 {
        let is_fixed = self.settings.light_visibility.is_some() || self.times.is_some();
        if is_fixed || self.free.is_some_and(|free| !free.any()) {
            return settings.light_visibility;
        }
        if !scene.lights().has_environment() {
            return 0;
        }
        let most = f64::from(MOST_VISIBILITY_RAYS);
        time.map_or(most, |time| (VISIBILITY_RAYS_PER_SECOND * time.as_secs_f64()).min(most)) as u32
    }

    fn stop_with_default(&self) -> Stop {
        let mut stop = self.stop;
        stop.iterations = stop.iterations.or(self.planned().and_then(Plan::iterations));
        let is_open = stop.iterations.is_none() && stop.time.is_none() && stop.target.is_none();
        if is_open && self.shard.is_none() {
            stop.error = stop.error.or(Some(DEFAULT_ERROR));
        }
        stop
    }

    /// The iterations of the shard, if the job renders one.
    fn shard_iterations(&self, stop: &Stop) -> Result<Option<ShardIterations>> {
        let Some(shard) = self.shard else { return Ok(None) };
        shard.iterations(stop.iterations, self.begun_shards()).map(Some)
    }

    /// The division into parts of the image that is continued, if it is one of them.
    fn begun_shards(&self) -> Option<ShardedImage> {
        match &self.start {
            Start::Checkpoint { checkpoint, .. } => checkpoint.sharded,
            _ => None,
        }
    }

    /// The path counts of all iterations, if they are equal and the number of iterations is open.
    fn fixed_counts(&self, provenance: &Provenance) -> Option<Counts> {
        let Settings { light_paths, camera_paths, .. } = provenance.settings;
        match self.planned() {
            _ if self.is_automatic() => None,
            None => Some(Counts::uniform(light_paths, camera_paths)),
            Some(plan) if plan.iterations().is_none() => Some(plan.steps[0].counts.clone()),
            Some(_) => None,
        }
    }

    /// Layers to accumulate: the selected ones and those that the denoiser needs.
    fn kept_aovs(&self, settings: &Settings, audit: Option<AuditPace>) -> AovSelection {
        // Images whose bias is corrected have halves of their own. theory.md (44g)
        let halves = CameraPoints::are_used(settings)
            || audit.is_some() && settings.has_photons() && settings.bias == Bias::Keep;
        AovSelection {
            features: self.aovs.features || self.denoises(),
            folds: self.aovs.folds || self.denoises(),
            halves,
            ..self.aovs
        }
    }

    fn batch_grain(&self, settings: &Settings) -> Result<BatchGrain> {
        if !self.pixel_noise {
            return Ok(BatchGrain::Tile);
        }
        check_memory(settings.width, settings.height)?;
        Ok(BatchGrain::Pixel)
    }

    /// The policy for path counts. If the job resumes a checkpoint, hands its sums to the renderer.
    fn policy(
        &mut self,
        renderer: &mut Renderer,
        (stop, selection): (&mut Stop, Option<&Selection>),
        times: Option<TimeModel>,
        iterations: Option<&ShardIterations>,
    ) -> Result<CountPolicy> {
        let mut state = None;
        let plan = match std::mem::replace(&mut self.start, Start::New) {
            Start::New => None,
            Start::Plan { plan, .. } => Some(plan),
            Start::Checkpoint { checkpoint, file } => {
                self.check_resumed(&checkpoint, stop, iterations).map_err(|e| e.at(&file))?;
                let mut checkpoint = *checkpoint;
                self.audited = checkpoint.audit.take();
                state = checkpoint.autopilot;
                *stop = stop.with_pilot_bias2(state.map_or(0.0, |state| state.bias2));
                renderer.resume(checkpoint.take_partial())?;
                self.check_kept(renderer.config().aovs).map_err(|e| e.at(&file))?;
                checkpoint.plan
            }
        };
        let state = match (plan, selection, state) {
            (Some(plan), ..) => return Ok(CountPolicy::Plan(plan)),
            (None, Some(selection), _) => AutopilotState::new(selection.best().times, stop.bias2),
            (None, None, Some(state)) => state,
            (None, None, None) => return Ok(CountPolicy::Fixed(self.schedule)),
        };
        // Coefficients of single pixels belong to one pair of path counts.
        let (per_pixel, denoises) = (!self.pixel_noise, self.denoises());
        let options = CountOptions { per_pixel, denoises, times };
        Ok(CountPolicy::Automatic(Box::new(Autopilot::new(state, options))))
    }

    /// The model of known times, if they belong to this scene and these settings.
    fn time_model(&self, provenance: &Provenance) -> Result<Option<TimeModel>> {
        let Some((times, file)) = &self.times else { return Ok(None) };
        let Settings { width, height, .. } = provenance.settings;
        times.check_fits(&provenance.to_metadata(), width, height).map_err(|e| e.at(file))?;
        Ok(Some(times.model))
    }

    /// Refuses a checkpoint that lacks statistics of the job, or has too many iterations.
    fn check_resumed(
        &self,
        checkpoint: &Checkpoint,
        stop: &Stop,
        iterations: Option<&ShardIterations>,
    ) -> Result<()> {
        let blocks = &checkpoint.blocks[..];
        let done: u64 = blocks.iter().map(|block| block.film.iterations).sum();
        if let Some(wanted) = stop.iterations.filter(|wanted| *wanted < done) {
            return Err(Error::new(
                format!("the checkpoint holds {done} iterations, more than {wanted}"),
                format!("render at least {done} iterations, or set a time instead"),
            ));
        }
        let by_tile = |block: &Block| {
            block.statistics.noise.as_ref().is_some_and(|noise| noise.grain() == BatchGrain::Tile)
        };
        if self.pixel_noise && blocks.iter().any(by_tile) {
            return Err(Error::new(
                "the checkpoint lacks the noise of single pixels",
                "resume without a noise file, or start a new image",
            ));
        }
        iterations.map_or(Ok(()), |iterations| iterations.check_holds(blocks))
    }

    /// Refuses a checkpoint that lacks layers of the job.
    fn check_kept(&self, kept: AovSelection) -> Result<()> {
        let (missing, advice) = if self.denoises() && !kept.folds {
            ("the folds for the denoiser", "resume without denoising, or start a new image")
        } else if self.aovs.light && !kept.light || self.aovs.features && !kept.features {
            ("some of the layers", "resume without these layers, or start a new image")
        } else {
            return Ok(());
        };
        Err(Error::new(format!("the checkpoint lacks {missing}"), advice))
    }
}

/// Target of the pilot.
fn pilot_end(stop: &Stop) -> End {
    match (stop.time, stop.error, stop.target) {
        (Some(time), _, _) => End::Time(time.as_secs_f64()),
        (None, Some(error), _) => End::Error(error),
        (None, None, Some(Target::Share(share))) => End::Error(share),
        (None, None, _) => End::Error(DEFAULT_ERROR),
    }
}

/// Threads for a job: this many, or one per processor if the number is 0.
///
/// # Errors
/// If the system refuses to start them.
pub fn thread_pool(threads: usize) -> Result<ThreadPool> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| Error::new(format!("cannot start the threads: {e}"), "use fewer threads"))
}

/// Provenance of an image of the scene by this version of the program.
pub fn provenance(scene: &Scene, backend: Backend, settings: Settings) -> Provenance {
    Provenance {
        version: env!("CARGO_PKG_VERSION").into(),
        scene: scene.name.clone(),
        fingerprint: scene.fingerprint(),
        backend: backend.name().into(),
        settings,
    }
}
