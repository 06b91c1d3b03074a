//! State of a job during and after the render.

use super::audit::Audit;
use super::denoising::Denoising;
use super::run_clock::{RunClock, Spent, has_time};
use super::status::{Exchanged, NoiseAt, Status, TimeForecast, Totals};
use super::step::{PlantedFailure, Step, attempt};
use crate::output::checkpoint::{Checkpoint, ShardedImage};
use crate::output::denoise::{Denoised, ErrorSummary};
use bdpm_auto::adaptive::autopilot::Promise;
use bdpm_auto::adaptive::count_policy::CountPolicy;
use bdpm_auto::adaptive::error_interval::ErrorInterval;
use bdpm_auto::adaptive::stopping::{Convergence, Stop, StoppedBy, importance};
use bdpm_auto::adaptive::technique::{Alternatives, Selection};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::film::cells::CellGrid;
use bdpm_core::film::counts::Counts;
use bdpm_core::render::Renderer;
use bdpm_core::render::block::{Block, CombinedImage};
use bdpm_core::render::combined_image::DerivedStatistics;
use bdpm_core::render::narrow_beam::narrow_beam;
use bdpm_core::render::photon_only_light::CausticLight;
use bdpm_core::scene::{Camera, Region};
use bdpm_core::settings::Direct;
use bdpm_core::settings::provenance::Provenance;
use rayon::ThreadPool;
use std::borrow::Cow;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Ratio of the times of two values of the history.
const HISTORY_GROWTH: f64 = 1.02;

/// Maximum time between two estimates of the noise of the image, seconds.
const MAX_ESTIMATE_PAUSE: f64 = 0.5;

/// Time between two estimates relative to the elapsed time, up to the maximum.
const ESTIMATE_PAUSE_SHARE: f64 = 0.02;

/// Maximum share of these estimates in the time. Each is a pass over the image.
const ESTIMATE_COST: f64 = 0.02;

/// Iterations before their mean time tells that of the next.
const FEW_ITERATIONS: u64 = 8;

/// Factor on the time of an iteration that the pilot predicts: every second one is measured, and
/// the audit takes its share.
const TIME_MARGIN: f64 = 1.25;

/// Estimates of the noise that take as long as the result at the end.
const RESULT_ESTIMATES: f64 = 4.0;

/// The image of a job, its progress and its statistics, during and after the render.
pub struct RenderState {
    /// How the image is made: version, scene, backend and the chosen settings.
    pub provenance: Provenance,
    /// Name and version of the acceleration structure.
    pub accel_name: String,
    /// Time that building the acceleration structure took.
    pub build_time: Duration,
    /// The sums of the image.
    pub renderer: Renderer,
    /// The policy for path counts.
    pub policy: CountPolicy,
    /// Stop conditions, with the latest estimate of the merge bias.
    pub stop: Stop,
    /// True if path counts are chosen during the render.
    pub is_automatic: bool,
    /// The choice of the pilot, if it ran.
    pub selection: Option<Selection>,
    /// What may take its place if an audit refutes it.
    pub(super) alternatives: Option<Alternatives>,
    /// The audit of the image, if there is one.
    pub audit: Option<Audit>,
    /// Work of this run.
    pub totals: Totals,
    /// Progress of the image.
    pub status: Status,
    /// Noise of the image at times that grow by 2 %.
    pub history: Vec<NoiseAt>,
    /// The denoiser, if the image is denoised, and its latest result.
    pub denoising: Option<Denoising>,
    /// Exchange between several processes.
    pub exchanged: Exchanged,
    /// Rendering time of earlier runs, seconds.
    pub earlier: f64,
    /// Width and height that were asked for, if the time did not suffice for all of these pixels.
    /// The caller [enlarges](crate::output::enlarge) the image.
    pub full_size: Option<(u32, u32)>,
    /// Size of the whole image, if this job renders a shard.
    pub sharded: Option<ShardedImage>,
    /// The scene's named regions, for files.
    pub regions: Vec<Region>,
    /// What the latest image of the blocks has computed.
    pub(super) latest: Mutex<Latest>,
    pub(super) threads: Arc<ThreadPool>,
    pub(super) interrupt: Arc<AtomicBool>,
    pub(super) clock: RunClock,
    /// The first error after the first iteration, which left the image incomplete or not denoised.
    pub failure: Option<Error>,
    pub(super) planted: Option<PlantedFailure>,
    /// Whether a warning has said that the audit refuted the image.
    pub(super) has_warned_of_audit: bool,
}

/// Weights of the blocks and statistics of the image after this number of iterations.
#[derive(Default)]
pub(super) struct Latest {
    iterations: u64,
    weights: Vec<f64>,
    derived: DerivedStatistics,
}

/// Light paths, a fifth of which aims at what casts caustics, that would have found a caustic.
const ENOUGH_LIGHT_PATHS: u64 = 2000;

impl RenderState {
    /// Threads of this process.
    pub fn threads(&self) -> &ThreadPool {
        &self.threads
    }

    /// Time since the start of the job, including the pilot.
    pub fn elapsed(&self) -> Duration {
        self.clock.start.elapsed()
    }

    /// Times of what this run has done between and after its iterations.
    pub fn spent(&self) -> Spent {
        let paths = self.audit.as_ref().map_or(Duration::ZERO, Audit::time_of_paths);
        Spent { audit: self.clock.spent.audit + paths, ..self.clock.spent }
    }

    /// The camera of the image.
    pub fn camera(&self) -> &Camera {
        &self.renderer.scene_and_accel().0.camera
    }

    /// Light that the scene may have, that no camera path finds, and of which no photon was stored:
    /// too few light paths started to say that there is none. `None` without such light. The
    /// photons of an earlier run, and photons straight from lights, say nothing about it.
    pub fn unseen_light(&self) -> Option<CausticLight> {
        let settings = self.renderer.settings();
        let says_nothing = self.earlier > 0.0 || settings.direct != Direct::Connect;
        let is_found = says_nothing
            || self.totals.found_caustics
            || self.totals.light_paths >= ENOUGH_LIGHT_PATHS;
        if settings.has_photons() && is_found {
            return None;
        }
        CausticLight::of(self.renderer.scene_and_accel().0)
    }

    /// A light whose beam merges in media blur; `None` without one.
    pub fn narrow_beam(&self) -> Option<String> {
        narrow_beam(self.renderer.scene_and_accel().0, self.renderer.settings())
    }

    /// An interval of the error of the image, open above if the image may lack light, or blurs
    /// beams.
    pub(super) fn open_if_unknown(&self, interval: Option<ErrorInterval>) -> Option<ErrorInterval> {
        let is_open = self.unseen_light().is_some() || self.narrow_beam().is_some();
        let high = |own: &ErrorInterval| if is_open { f64::INFINITY } else { own.high };
        interval.map(|own| ErrorInterval { high: high(&own), ..own })
    }

    /// Interval for the error of the image so far; `None` while it is not known.
    pub fn error_interval(&self, convergence: &Convergence) -> Option<ErrorInterval> {
        self.open_if_unknown(convergence.error_interval(&self.stop, 1.0))
    }

    /// The image so far: all blocks with their weights.
    pub fn image(&self) -> CombinedImage<'_> {
        let blocks = self.renderer.blocks();
        let iterations = self.renderer.iterations();
        let mut latest = self.latest.lock().unwrap_or_else(PoisonError::into_inner);
        if latest.iterations != iterations || latest.weights.len() != blocks.len() {
            // A single block needs no importance of the pixels.
            let importance = match blocks {
                [_] => Vec::new(),
                _ => importance(blocks, self.stop.objective),
            };
            let weights = self.policy.weights(blocks, &importance);
            *latest = Latest { iterations, weights, derived: DerivedStatistics::default() };
        }
        CombinedImage::new(blocks, latest.weights.clone()).with_derived(latest.derived.clone())
    }

    /// Reserves this time for the caller's work at the end, such as writing files, instead of that
    /// of [`RenderJob::reserve_per_pixel`](super::RenderJob::reserve_per_pixel).
    pub fn reserve(&mut self, time: Duration) {
        if let Some(end) = self.stop.time {
            let end = self.clock.replace_reserve(end, time);
            self.stop.time = Some(end);
        }
    }

    /// The promised error or time, once there is one.
    pub fn promise(&self) -> Option<&Promise> {
        self.policy.promise()
    }

    /// The latest denoised image.
    pub fn denoised(&self) -> Option<&Denoised> {
        self.denoising.as_ref()?.latest.as_ref()
    }

    /// A denoised image without its error, for a preview; `None` if the image is not denoised.
    ///
    /// # Errors
    /// Those of the denoiser.
    pub fn denoised_preview(&mut self) -> Result<Option<Denoised>> {
        self.with_denoiser(|denoising, renderer, image| denoising.preview(renderer, image))
    }

    /// The state from which a later job can resume.
    pub fn checkpoint(&self) -> Checkpoint<'_> {
        Checkpoint {
            provenance: self.provenance.clone(),
            blocks: Cow::Borrowed(self.renderer.blocks()),
            shared: Cow::Borrowed(self.renderer.shared()),
            autopilot: self.policy.state(self.elapsed().as_secs_f64()),
            plan: self.policy.plan().cloned(),
            sharded: self.sharded,
            regions: self.regions.clone(),
            audit: self.audit.as_ref().map(|audit| audit.sums().clone()),
        }
    }

    /// [`best_measured`] of the image's blocks.
    pub fn best_measured(&self) -> Option<&Block> {
        best_measured(self.renderer.blocks())
    }

    /// The forecast of the time that was made at half of the time.
    pub fn half_way(&self) -> Option<TimeForecast> {
        let took = self.clock.start.elapsed().as_secs_f64();
        let half =
            self.clock.forecasts.iter().find(|forecast| forecast.said_after >= 0.5 * took)?;
        Some(TimeForecast { took, ..*half })
    }

    /// Estimates noise and bias of the image. This takes a pass over the image.
    pub fn estimate(&mut self) {
        let elapsed = self.elapsed().as_secs_f64();
        self.clock.last_estimate = elapsed;
        let entered = Instant::now();
        let (blocks, objective) = (self.renderer.blocks(), self.stop.objective);
        let convergence =
            self.threads.install(|| Convergence::of(self.image(), &importance(blocks, objective)));
        self.clock.estimate_time = entered.elapsed().as_secs_f64();
        self.clock.spent.estimates += entered.elapsed();
        if convergence.variance.is_none() && self.status.convergence.is_some() {
            return; // After the first iteration of a block, the previous estimate is the better one.
        }
        self.stop = convergence.with_measured_bias(&self.stop);
        let iteration_time =
            self.policy.iteration_time(&self.renderer, self.totals.iterations, elapsed);
        self.status.forecast =
            convergence.per_iteration.zip(iteration_time).and_then(|(variance, iteration_time)| {
                convergence.forecast(&self.stop, variance, iteration_time, elapsed)
            });
        self.record_history(&convergence, elapsed);
        self.status.convergence = Some(convergence);
    }

    /// Runs a step; a panic becomes an error.
    pub(super) fn attempt<T>(
        &mut self,
        step: Step,
        run: impl FnOnce(&mut Self) -> Result<T>,
    ) -> Result<T> {
        let (iterations, planted) = (self.renderer.iterations(), self.planted);
        attempt(step, iterations, planted, || run(self))
    }

    pub(super) fn interrupt(&self) {
        self.interrupt.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_interrupted(&self) -> bool {
        self.interrupt.load(Ordering::Relaxed)
    }

    /// Calls [`Self::estimate`] at intervals, so that it takes little of the time.
    pub(super) fn estimate_if_due(&mut self) -> Result<()> {
        self.status.iterations = self.renderer.iterations();
        let elapsed = self.elapsed().as_secs_f64();
        let pause = MAX_ESTIMATE_PAUSE.min(ESTIMATE_PAUSE_SHARE * elapsed);
        let is_large = !CellGrid::of(self.renderer.settings().resolution()).is_single_pixels();
        if is_large && self.status.iterations < 2 {
            return Ok(()); // Nothing is known of the noise.
        }
        if elapsed < self.clock.last_estimate + pause.max(self.clock.estimate_time / ESTIMATE_COST)
        {
            return Ok(());
        }
        self.attempt(Step::Estimate, |state| {
            state.estimate();
            Ok(())
        })
    }

    /// The reason to stop before the next iteration, if there is one.
    pub(super) fn finished(&self) -> Option<StoppedBy> {
        let Stop { iterations, time, .. } = self.stop;
        let done = self.totals.iterations;
        if iterations.is_some_and(|wanted| self.renderer.iterations() >= wanted) {
            return Some(StoppedBy::Iterations);
        }
        if done < self.clock.min_iterations {
            return None;
        }
        let convergence = self.status.convergence.as_ref();
        if convergence.is_some_and(|now| now.is_good_enough(&self.stop)) {
            return Some(StoppedBy::Target);
        }
        let mean = match done {
            // The first ones compute areas and measure, and later ones may do neither.
            1..FEW_ITERATIONS => self.next_iteration(done) / f64::from(self.exchanged.ranks),
            _ => self.clock.rendering_time() / done.max(1) as f64,
        };
        let (blocks, elapsed) = (self.renderer.blocks().len(), self.elapsed().as_secs_f64());
        // Iterations of earlier blocks may have taken another time.
        let clock = &self.renderer.block().clock;
        let iteration_time = match clock.iterations {
            iterations if blocks > 1 && iterations > 0 => {
                clock.times.wall.as_secs_f64() / iterations as f64
            }
            _ => mean,
        };
        let next = iteration_time * f64::from(self.exchanged.ranks);
        let result = RESULT_ESTIMATES * self.clock.estimate_time;
        let left = |time: Duration| time.as_secs_f64() - result - elapsed;
        let is_over = time.is_some_and(|time| !has_time(left(time), next, time.as_secs_f64()));
        is_over.then_some(StoppedBy::Time)
    }

    /// Time of the next of few iterations, seconds: the latest one. The first one has started up,
    /// and was measured: after it, what the pilot predicts, but at least half as much.
    fn next_iteration(&self, done: u64) -> f64 {
        let latest = self.clock.latest_iteration;
        let Counts { light_paths, camera_paths } = &self.renderer.block().counts;
        let predicted = self.selection.as_ref().map_or(f64::INFINITY, |selection| {
            let times = selection.best().times;
            TIME_MARGIN * times.iteration((*light_paths).into(), camera_paths.mean())
        });
        match done {
            1 => predicted.clamp(0.5 * latest, latest),
            _ => latest,
        }
    }

    /// Estimates the error of the denoised image if that is due. Returns the error, and true if it
    /// reaches the target. After an error the image will not be denoised.
    pub(super) fn denoised_error(&mut self) -> Result<Option<(ErrorSummary, bool)>> {
        let (elapsed, stop) = (self.elapsed(), self.stop);
        let iterations = self.renderer.iterations();
        let remaining = self.status.forecast.map(|forecast| forecast.seconds);
        let remaining = remaining.and_then(|seconds| Duration::try_from_secs_f64(seconds).ok());
        let is_due = |d: &Denoising| d.is_due(elapsed, iterations, &stop, remaining);
        if !self.denoising.as_ref().is_some_and(is_due) {
            return Ok(None);
        }
        let reserved = self.denoising.as_ref().map_or(Duration::ZERO, Denoising::reserve);
        let suffices = self.with_denoiser(|denoising, renderer, image| {
            denoising.denoise(renderer, image)?;
            Ok(denoising.check_target(elapsed, &stop))
        });
        if suffices.is_err() {
            self.denoising = None;
        }
        // If denoising was given up, its time is for samples.
        let kept = self.denoising.as_ref().map_or(Duration::ZERO, Denoising::reserve);
        if let Some(time) = &mut self.stop.time {
            *time += reserved.saturating_sub(kept);
        }
        let error = self.denoising.as_ref().and_then(|denoising| denoising.error().copied());
        Ok(error.zip(suffices?))
    }

    /// Denoises the final image, with its error. A raw image that reached the target is the result
    /// as it is.
    pub(super) fn denoise(&mut self) -> Result<()> {
        let convergence = self.status.convergence.as_ref();
        if self.stop.time.is_none()
            && convergence.is_some_and(|now| now.is_good_enough(&self.stop))
            && let Some(denoising) = &mut self.denoising
        {
            denoising.give_up();
        }
        self.with_denoiser(|denoising, renderer, image| denoising.denoise(renderer, image))?;
        Ok(())
    }

    fn with_denoiser<T: Send>(
        &mut self,
        run: impl FnOnce(&mut Denoising, &Renderer, &CombinedImage) -> Result<T> + Send,
    ) -> Result<Option<T>> {
        let Some(mut denoising) = self.denoising.take() else { return Ok(None) };
        let (threads, start) = (Arc::clone(&self.threads), Instant::now());
        let done = self.attempt(Step::Denoising, |state| {
            threads.install(|| run(&mut denoising, &state.renderer, &state.image()))
        });
        self.clock.spent.denoising += start.elapsed();
        self.denoising = Some(denoising);
        done.map(Some)
    }

    fn record_history(&mut self, convergence: &Convergence, elapsed: f64) {
        let last = self.history.last().map_or(0.0, |last| last.seconds);
        if let Some(noise2) = convergence.relative_variance(self.stop.objective)
            && elapsed > last * HISTORY_GROWTH
        {
            self.history.push(NoiseAt { seconds: elapsed, noise2 });
        }
        let last = self.clock.forecasts.last().map_or(0.0, |last| last.said_after);
        if let Some(forecast) = self.status.forecast
            && elapsed > last * HISTORY_GROWTH
        {
            let seconds = elapsed + forecast.seconds;
            self.clock.forecasts.push(TimeForecast { said_after: elapsed, seconds, took: 0.0 });
        }
    }
}

/// The block with the most measured iterations, if they suffice to estimate its noise.
pub fn best_measured(blocks: &[Block]) -> Option<&Block> {
    let measured =
        |block: &Block| block.statistics.noise.as_ref().map_or(0, |noise| noise.iterations);
    let best = blocks.iter().max_by_key(|block| measured(block));
    best.filter(|block| measured(block) >= 2)
}
