//! Automatic path counts: first those of the settings, from the choice of technique, then the
//! optimum. It is chosen again a few times from all measurements so far.

use super::denoised_noise::left_by_denoiser;
use super::error_interval::ErrorInterval;
use super::stopping::{Convergence, Stop, importance, luminances};
use crate::adaptive::optimize::{CountLimits, MAX_CAMERA_PATHS, NEAR_OPTIMUM, Objective, Problem};
use crate::timing::TimeModel;
use bdpm_core::base::error::Error;
use bdpm_core::film::cells::CellGrid;
use bdpm_core::film::counts::{CameraCounts, Counts};
use bdpm_core::film::radiance::{box_filter, luminance_weights};
use bdpm_core::noise::schedule::{MEASURE_EVERY, MeasureSchedule};
use bdpm_core::noise::{Coefficients, Measure};
use bdpm_core::render::Renderer;
use bdpm_core::render::block;
use bdpm_core::render::block::{Block, CombinedImage};
use bdpm_core::render::max_blocks;
use bdpm_core::settings::Settings;
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// Before the first choice of counts, every second iteration is measured. The times of the
/// iterations come from the others.
const MEASURE_FIRST_EVERY: u64 = 2;

/// Iterations at new counts before the next choice or promise. The sample variance of the pooled
/// noise is then known within a few percent.
pub const FIRST_ITERATIONS: u64 = 12;

/// Iterations before the first choice or promise if [`FIRST_ITERATIONS`] take too long: in large
/// images, whose millions of pixels replace iterations, and where the pilot was wrong about the
/// times.
const FEWEST_FIRST_ITERATIONS: u64 = 3;

/// Share of the time after which the first counts are chosen after [`FEWEST_FIRST_ITERATIONS`].
const FIRST_CHOICE_SHARE: f64 = 0.2;

/// If fewer iterations of a large image fit in the rest of the time, their counts are chosen such
/// that a whole number of them does: a single iteration is a notable part of the time.
const FEW_ITERATIONS: f64 = 16.0;

/// Minimum number of iterations that should fit in the time after a choice of counts: some of them
/// are measured, and counts may be chosen again among them.
pub const MIN_ITERATIONS_AFTER_CHOICE: f64 = 64.0;

/// Minimum number of iterations of each of several processes, so that none ends long before
/// another.
const MIN_ITERATIONS_OF_RANK: f64 = 8.0;

/// [`MIN_ITERATIONS_AFTER_CHOICE`] for `ranks` processes that share the iterations.
pub fn min_iterations_after_choice(ranks: u32) -> f64 {
    MIN_ITERATIONS_AFTER_CHOICE.max(MIN_ITERATIONS_OF_RANK * f64::from(ranks))
}

/// Share of the time after which counts are not chosen again, so that the promise has iterations to
/// rest on.
const LAST_CHOICE_SHARE: f64 = 0.25;

/// Share of the time after which the counts stay as they are, and the error at the end is promised.
const PROMISE_SHARE: f64 = 1.0 / 3.0;

/// Minimum share of the time that a new block must save. A smaller gain is lost to the block's own
/// weight.
const WORTHWHILE: f64 = 0.02;

/// Minimum share of the time that counts per pixel must save. They follow the noise of the data
/// that they are chosen from, so their predicted gain is too large.
const WORTHWHILE_PER_PIXEL: f64 = 0.05;

/// Degrees of freedom of the mean over a neighborhood, relative to those of a single pixel, whose
/// values have heavy tails. Middle of the range in which `examples/optimum_table.rs` shows no
/// difference beyond its noise.
const PRIOR_FREEDOM: f64 = 200.0;

/// Chooses the counts of a renderer while it renders.
#[derive(Debug)]
pub struct Autopilot {
    /// True if camera paths may differ between pixels.
    per_pixel: bool,
    /// The image is denoised: what counts is the noise that is left.
    denoises: bool,
    /// Known times, which replace the measured ones.
    times: Option<TimeModel>,
    /// Rendering time before this run.
    earlier: f64,
    state: AutopilotState,
    /// Reason why the latest choice of counts failed, until it is reported.
    failure: Option<Error>,
}

/// State that an interrupted run needs to resume.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AutopilotState {
    /// Rendering time when it was saved, seconds.
    elapsed: f64,
    /// Rendering time when the present block started.
    block_began: f64,
    /// Iterations of the present block and rendering time at its latest two marks.
    marks: [Mark; 2],
    /// Rendering time of the next choice of counts, seconds; `None` before the first choice.
    next_choice: Option<f64>,
    /// Costs at the first choice, for the promise.
    costs: ExpectedCosts,
    /// Times that the pilot measured on a sample of the pixels. They are proportional to those of
    /// the image.
    pilot_times: TimeModel,
    /// Latest estimate of the squared relative bias of the image.
    bias2: f64,
    /// The promise, once a few iterations after the first choice were rendered.
    promise: Option<Promise>,
}

/// A moment of a block whose iterations are [`MEASURE_EVERY`] times a power of two.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Mark {
    iterations: u64,
    /// Rendering time, seconds.
    seconds: f64,
}

/// Predicted costs: time times variance of an iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct ExpectedCosts {
    /// Time of an iteration at the chosen counts, seconds.
    tau: f64,
    /// Cost of one light path and one camera path per pixel.
    one_path_each: f64,
    /// Minimum cost of counts that are equal in every pixel.
    uniform: f64,
}

/// Forecast of the end, from the first iterations after the first choice of counts. They are new
/// samples, independent of those that the choice was made from, so the forecast is not biased by
/// the choice.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Promise {
    /// Pooled RMS at the end, W/(m^2 sr).
    pub rms: f64,
    /// Relative error at the end, noise and bias, if the objective is the relative error.
    pub error: Option<f64>,
    /// Range in which the true relative error at the end should lie, if it is known.
    pub interval: Option<ErrorInterval>,
    /// Rendering time from the first iteration of the image to the end, seconds.
    pub seconds: f64,
    /// Rendering time when the promise was made, seconds.
    pub said_after: f64,
    /// Time for the same noise with one light path and one camera path per pixel, relative to the
    /// chosen counts.
    pub gain_over_one_each: f64,
    /// Time for the same noise with the best counts that are equal in every pixel, relative to the
    /// chosen counts.
    pub gain_over_uniform: f64,
}

/// A choice of counts.
struct CountChoice {
    counts: Counts,
    costs: ExpectedCosts,
    /// True if the counts save enough time to start a new block.
    is_worthwhile: bool,
}

impl AutopilotState {
    /// State before the first iteration.
    pub fn new(pilot_times: TimeModel, bias2: f64) -> Self {
        Self {
            elapsed: 0.0,
            block_began: 0.0,
            marks: Default::default(),
            next_choice: None,
            costs: ExpectedCosts::default(),
            pilot_times,
            bias2,
            promise: None,
        }
    }

    /// Rendering time when the state was saved, seconds, from the first iteration of the image.
    pub fn elapsed(&self) -> f64 {
        self.elapsed
    }

    /// Squared relative bias of the image, as the pilot estimated it.
    pub fn bias2(&self) -> f64 {
        self.bias2
    }
}

impl Autopilot {
    /// Starts with the counts of the renderer's settings. `pilot_times` are proportional to the
    /// times of the image. `bias2` is the squared relative bias that the pilot expects.
    pub fn new(pilot_times: TimeModel, bias2: f64) -> Self {
        Self::resume(AutopilotState::new(pilot_times, bias2))
    }

    /// Resumes from `state`.
    pub fn resume(state: AutopilotState) -> Self {
        let earlier = state.elapsed;
        let denoises = false;
        Self { per_pixel: true, denoises, times: None, earlier, state, failure: None }
    }

    /// Starts again with the counts of other settings.
    #[must_use]
    pub fn restarted(&self, pilot_times: TimeModel, bias2: f64) -> Self {
        let Self { per_pixel, denoises, times, .. } = *self;
        Self { per_pixel, denoises, times, ..Self::new(pilot_times, bias2) }
    }

    /// Chooses equal counts for every pixel.
    #[must_use]
    pub fn uniform(self) -> Self {
        Self { per_pixel: false, ..self }
    }

    /// Chooses counts for an image that is denoised, if `denoises`.
    #[must_use]
    pub fn denoised(self, denoises: bool) -> Self {
        Self { denoises, ..self }
    }

    /// Chooses by known times instead of measured ones.
    #[must_use]
    pub fn with_times(self, times: TimeModel) -> Self {
        Self { times: Some(times), ..self }
    }

    /// Takes the reason why the latest choice of counts failed, if it did. The counts in force were
    /// kept.
    pub fn take_failure(&mut self) -> Option<Error> {
        self.failure.take()
    }

    /// A promise from all iterations so far; `None` before [`PROMISE_SHARE`] of the time. theory.md
    /// (89).
    fn make_promise(&self, renderer: &Renderer, stop: &Stop, elapsed: f64) -> Option<Promise> {
        let convergence = convergence(renderer, stop);
        let prior = stop;
        let stop = convergence.with_measured_bias(stop);
        let (variance, tau) = (convergence.per_iteration?, self.iteration_time(renderer, elapsed)?);
        let forecast = convergence.forecast(&stop, variance, tau, elapsed)?;
        let is_early = elapsed < PROMISE_SHARE * (elapsed + forecast.seconds);
        if is_early {
            return None;
        }
        let ExpectedCosts { tau, one_path_each, uniform } = self.state.costs;
        let gain = |other: f64| if variance > 0.0 { other / (variance * tau) } else { 1.0 };
        let said_after = self.earlier + elapsed;
        Some(Promise {
            rms: forecast.rms,
            error: convergence.error(&stop, forecast.left),
            interval: convergence.error_interval(prior, forecast.left),
            seconds: said_after + forecast.seconds,
            said_after,
            gain_over_one_each: gain(one_path_each),
            gain_over_uniform: gain(uniform),
        })
    }

    /// Coefficients of the noise that counts, from those of the image, and its share of the pooled
    /// variance at the present counts.
    fn noise_that_counts(
        &self,
        renderer: &Renderer,
        noise: Vec<Coefficients>,
        weights: &[f64],
    ) -> (Vec<Coefficients>, f64) {
        if !self.denoises {
            return (noise, 1.0);
        }
        let Settings { strategy, merge_vertex, .. } = *renderer.settings();
        let left: Vec<_> =
            noise.iter().map(|own| left_by_denoiser(strategy, merge_vertex, *own)).collect();
        let Counts { light_paths, camera_paths } = &renderer.block().counts;
        let variance = |cells: &[Coefficients]| {
            let weighted = cells.iter().zip(weights).map(|(own, weight)| *own * *weight);
            let sum: Coefficients = weighted.sum();
            sum.variance(f64::from(*light_paths), camera_paths.mean())
        };
        let share = variance(&left) / variance(&noise);
        (left, if share > 0.0 { share } else { 1.0 })
    }

    /// The best counts from all measurements so far.
    fn choose(&self, renderer: &Renderer, stop: &Stop, elapsed: f64) -> CountChoice {
        let convergence = convergence(renderer, stop);
        let blocks = renderer.blocks();
        let settings = renderer.settings();
        let times =
            self.times.map(|times| times.scaled(f64::from(renderer.config().ranks).recip()));
        let model = times.unwrap_or_else(|| fitted_times(&self.state.pilot_times, blocks));
        let measured = block::coefficients(blocks).expect("the first iteration measures");
        let grid = CellGrid::of(settings.resolution());
        let smoothed = smoothed(blocks, &measured, grid);
        let (luminance, scale) = luminance(stop.objective, blocks, grid);
        let weights = stop.objective.weights(&luminance);
        let (smoothed, left) = self.noise_that_counts(renderer, smoothed, &weights);
        let scale =
            scale / left * pooled_share(stop.objective, &smoothed, &renderer.block().counts, grid);
        let allowed = renderer.allowed_light_paths();
        let problem = |iteration_time| {
            let bounds = CountLimits {
                light_paths: allowed.bounds(),
                camera_paths: 1..=MAX_CAMERA_PATHS,
                iteration_time,
            };
            Problem::new(&smoothed, &luminance, stop.objective, model, &bounds)
                .of_squares(grid.pixels_per_cell())
        };
        // Enough iterations must fit in the remaining time. If a target ends the render, this time
        // depends on the counts. A few rounds of this loop suffice for convergence.
        let mut max_time = f64::INFINITY;
        let min_time = problem(max_time).least_sensible_time();
        for _ in 0..4 {
            let best = problem(max_time).uniform();
            let (variance, tau) = (best.variance * scale, best.iteration_time);
            let rest = convergence.forecast(stop, variance, tau, elapsed);
            let share =
                // theory.md (86), (90)
                rest.map_or(f64::INFINITY, |rest| {
                    rest.seconds / min_iterations_after_choice(renderer.config().ranks)
                });
            max_time = share.max(min_time);
        }
        let problem = problem(max_time);
        let uniform = problem.shortest_uniform(NEAR_OPTIMUM);
        let light_paths = allowed.nearest(uniform.light_paths);
        let mut counts = Counts::uniform(light_paths, uniform.camera_paths);
        let mut cost = uniform.cost;
        if self.per_pixel {
            let best = problem.shortest_per_pixel(NEAR_OPTIMUM);
            if best.cost < uniform.cost * (1.0 - WORTHWHILE_PER_PIXEL) {
                let camera_paths = CameraCounts::PerPixel(grid.expanded(&best.camera_paths));
                let light_paths = allowed.nearest(best.light_paths);
                counts = Counts { light_paths, camera_paths };
                cost = best.cost;
            }
        }
        let time = |counts: &Counts| {
            model.iteration(f64::from(counts.light_paths), counts.camera_paths.mean())
        };
        let one_path_each = scale * problem.evaluate_uniform(settings.pixels() as u32, 1).cost;
        // The cost of the present counts is measured from the samples of the block.
        // theory.md (88)
        let present_tau = time(&renderer.block().counts);
        let present = convergence.per_iteration.unwrap_or(0.0) * present_tau;
        let mut is_worthwhile = scale * cost < present * (1.0 - WORTHWHILE);
        let left = stop.time.map(|time| time.as_secs_f64() - elapsed);
        if let Some(left) = left.filter(|_| is_large(renderer) && settings.has_photons()) {
            let chosen =
                if is_worthwhile { counts.clone() } else { renderer.block().counts.clone() };
            if let Some(light_paths) = fitting_light_paths(&model, &chosen, left) {
                let light_paths = allowed.at_most(light_paths);
                (counts, is_worthwhile) = (Counts { light_paths, ..chosen }, true);
            }
        }
        let tau = if is_worthwhile { time(&counts) } else { present_tau };
        let costs = ExpectedCosts { tau, one_path_each, uniform: scale * uniform.cost };
        CountChoice { is_worthwhile, counts, costs }
    }

    /// Prepares the next iteration, after `elapsed` seconds of this run, and returns its
    /// measurement. If other counts are chosen and cannot be rendered, the counts in force are
    /// kept: see [`Self::take_failure`].
    pub fn prepare(&mut self, renderer: &mut Renderer, stop: &Stop, elapsed: f64) -> Measure {
        let (now, entered) = (self.earlier + elapsed, Instant::now());
        self.mark(renderer.film().iterations, now);
        if renderer.iterations() == 0 {
            self.state.block_began = now;
        } else if self.update_promise_and_check_choice(renderer, stop, now) {
            let is_first = self.state.next_choice.is_none();
            self.state.next_choice = Some(2.0 * now);
            if is_first || renderer.blocks().len() < max_blocks(renderer.settings()) {
                let choice = self.choose(renderer, stop, elapsed);
                if is_first {
                    self.state.costs = choice.costs;
                }
                if choice.is_worthwhile {
                    match renderer.begin_block(choice.counts) {
                        Ok(()) => {
                            self.state.block_began = now + entered.elapsed().as_secs_f64();
                            self.state.marks = Default::default();
                        }
                        Err(error) => self.failure = Some(error),
                    }
                }
            }
        }
        // The first iteration of a block is measured, so that its start-up is not part of the
        // times. The first block of a large image has measured the noise of millions of pixels, so
        // that its last one measures later.
        let is_last =
            is_large(renderer) && renderer.blocks().len() == max_blocks(renderer.settings());
        let skipped = if is_last { 1 } else { 0 };
        let measures = (renderer.film().iterations + skipped).is_multiple_of(self.schedule().every);
        if measures { Measure::Pairs } else { Measure::Off }
    }

    /// Makes the promise if it is due, and returns true if counts should be chosen before the next
    /// iteration.
    ///
    /// The pilot used only a sample of the pixels, so a promise is made only after the first
    /// choice, which uses the whole image.
    fn update_promise_and_check_choice(
        &mut self,
        renderer: &Renderer,
        stop: &Stop,
        now: f64,
    ) -> bool {
        let late = stop.time.map(|time| FIRST_CHOICE_SHARE * time.as_secs_f64());
        let is_late = late.is_some_and(|late| now - self.earlier > late);
        let first = if is_late { FEWEST_FIRST_ITERATIONS } else { FIRST_ITERATIONS };
        if renderer.film().iterations < first {
            return false;
        }
        let Some(next_choice) = self.state.next_choice else { return true };
        let share_of_time = |time: Duration| (now - self.earlier) / time.as_secs_f64();
        let is_third = stop.time.is_some_and(|time| share_of_time(time) >= PROMISE_SHARE);
        if self.state.promise.is_none() && (is_third || is_promise_check_due(renderer, first)) {
            self.state.promise = self.make_promise(renderer, stop, now - self.earlier);
        }
        let is_late = stop.time.is_some_and(|time| share_of_time(time) >= LAST_CHOICE_SHARE);
        now >= next_choice && !is_late && self.state.promise.is_none()
    }

    /// Keeps the times of the latest two marks.
    fn mark(&mut self, iterations: u64, seconds: f64) {
        let is_mark = iterations.is_multiple_of(MEASURE_EVERY)
            && (iterations / MEASURE_EVERY).is_power_of_two();
        let [_, latest] = self.state.marks;
        if is_mark && latest.iterations != iterations {
            self.state.marks = [latest, Mark { iterations, seconds }];
        }
    }

    /// The iterations that are measured before the next decision.
    pub fn schedule(&self) -> MeasureSchedule {
        let is_first = self.state.next_choice.is_none();
        let every = if is_first { MEASURE_FIRST_EVERY } else { MEASURE_EVERY };
        MeasureSchedule { pilot: 0, every, estimator: Measure::Pairs }
    }

    /// Seconds per iteration from now on, with the long-run shares of production and measured
    /// iterations; `None` before the block has enough iterations.
    pub fn iteration_time(&self, renderer: &Renderer, elapsed: f64) -> Option<f64> {
        let Block { film, clock, .. } = renderer.block();
        let measured = film.iterations.saturating_sub(clock.iterations);
        let known = film.iterations >= MEASURE_EVERY;
        let since = self.earlier + elapsed - self.state.block_began;
        let production = clock.times.wall.as_secs_f64();
        let share = 1.0 / MEASURE_EVERY as f64;
        let per_production = production / clock.iterations as f64;
        let per_measured = (since - production).max(0.0) / measured as f64;
        // The first iterations of a scene take longer while areas and memory are new: the latest
        // ones tell the time.
        let [mark, _] = self.state.marks;
        if mark.iterations > 0 {
            let seconds = self.earlier + elapsed - mark.seconds;
            return Some(seconds / (film.iterations - mark.iterations) as f64);
        }
        // theory.md (93)
        known.then_some((1.0 - share) * per_production + share * per_measured)
    }

    /// State for a checkpoint, after `elapsed` seconds of this run.
    pub fn state(&self, elapsed: f64) -> AutopilotState {
        AutopilotState { elapsed: self.earlier + elapsed, ..self.state }
    }

    /// The promise, once it was made.
    pub fn promise(&self) -> Option<&Promise> {
        self.state.promise.as_ref()
    }
}

fn convergence(renderer: &Renderer, stop: &Stop) -> Convergence {
    let importance = importance(renderer.blocks(), stop.objective);
    let weights = block::weights(renderer.blocks(), &importance);
    Convergence::new(renderer.blocks(), weights, &importance)
}

/// Luminance of each cell for the allocation of camera paths, and the mean of the weights that
/// follow from it.
fn luminance(objective: Objective, blocks: &[Block], grid: CellGrid) -> (Vec<f64>, f64) {
    let (width, height) = grid.size();
    let image = CombinedImage::new(blocks, vec![1.0; blocks.len()]);
    let unfiltered: Vec<_> = luminances(&image).into_iter().map(|l| [l]).collect();
    let luminance: Vec<f64> =
        box_filter(&unfiltered, width, height).into_iter().map(|[l]| l).collect();
    let scale = match objective {
        Objective::Relative => {
            luminance_weights(&luminance).iter().sum::<f64>() / luminance.len() as f64
        }
        _ => 1.0,
    };
    (luminance, scale)
}

/// Pooled variance over the objective at the present counts, as predicted. Costs are compared with
/// sampled variances, which are pooled, so both agree at these counts. 1 for objectives that are
/// means themselves.
fn pooled_share(
    objective: Objective,
    cells: &[Coefficients],
    counts: &Counts,
    grid: CellGrid,
) -> f64 {
    if matches!(objective, Objective::Pooled | Objective::Relative) {
        return 1.0;
    }
    let variances = || {
        let n_light = f64::from(counts.light_paths);
        let n_camera = move |cell| counts.camera_paths.at(grid.first_pixel(cell)).into();
        let cells = cells.iter().enumerate();
        cells.map(move |(cell, own)| own.variance(n_light, n_camera(cell)))
    };
    let share = Objective::Pooled.aggregate(variances()) / objective.aggregate(variances());
    if share.is_finite() && share > 0.0 { share } else { 1.0 }
}

/// Returns true after `first` iterations of a block, twice as many, and so on, since each check
/// takes a pass over the image.
fn is_promise_check_due(renderer: &Renderer, first: u64) -> bool {
    let iterations = renderer.film().iterations;
    iterations.is_multiple_of(first) && (iterations / first).is_power_of_two()
}

/// Whether the pixels of the image share statistics.
fn is_large(renderer: &Renderer) -> bool {
    !CellGrid::of(renderer.settings().resolution()).is_single_pixels()
}

/// Light paths with which a whole number of iterations takes `left` seconds; `None` if that number
/// is at least [`FEW_ITERATIONS`], or if it would take another number of camera paths. The number
/// of iterations is the nearest one. If that leaves too few light paths, it is the next smaller
/// one.
fn fitting_light_paths(times: &TimeModel, counts: &Counts, left: f64) -> Option<u32> {
    let n_light = f64::from(counts.light_paths);
    let [base, per_light_path] = times.in_light_paths(counts.camera_paths.mean());
    let number = left / (base + per_light_path * n_light);
    if number >= FEW_ITERATIONS {
        return None;
    }
    let fitting = |number: f64| (left / number.max(1.0) - base) / per_light_path;
    let [least, most] = FITTING_RATIOS.map(|ratio| ratio * n_light);
    let mut all = [number.round(), number.floor()].map(fitting).into_iter();
    all.find(|own| (least..most).contains(own)).map(|own| own as u32)
}

/// Range of the ratio between fitting and best light paths. More of them cost little where camera
/// paths take most of the time.
const FITTING_RATIOS: [f64; 2] = [0.5, 8.0];

/// Times proportional to `pilot_times` that match the times of the production iterations of all
/// blocks.
pub fn fitted_times(pilot_times: &TimeModel, blocks: &[Block]) -> TimeModel {
    let (mut measured, mut predicted) = (0.0, 0.0);
    for Block { counts, clock, .. } in blocks {
        let iteration =
            pilot_times.iteration(f64::from(counts.light_paths), counts.camera_paths.mean());
        measured += clock.times.wall.as_secs_f64();
        predicted += clock.iterations as f64 * iteration;
    }
    let scale = if measured > 0.0 && predicted > 0.0 { measured / predicted } else { 1.0 };
    pilot_times.scaled(scale)
}

/// Coefficients for the allocation of camera paths, at least 0. With few measurements, a cell has
/// those of its 5 by 5 neighborhood. With more, the weight of its own coefficients increases.
fn smoothed(blocks: &[Block], measured: &[Coefficients], grid: CellGrid) -> Vec<Coefficients> {
    let (width, height) = grid.size();
    let values: Vec<_> = measured.iter().map(|c| [c.a, c.b, c.f]).collect();
    let pooled = box_filter(&values, width, height);
    let freedom = block::degrees_of_freedom(blocks);
    let mixed = |((&pixel, [a, b, f]), freedom): ((&Coefficients, [f64; 3]), f64)| {
        // theory.md (87)
        let share = freedom / (freedom + PRIOR_FREEDOM);
        (pixel * share + Coefficients { a, b, f } * (1.0 - share)).clamped()
    };
    measured.iter().zip(pooled).zip(freedom).map(mixed).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_iterations_of_a_large_image_fill_the_time() {
        let times = TimeModel {
            fixed: 0.1,
            light_path: 1e-6,
            camera_path: 1e-6,
            look_up: 0.0,
            merge_pair: 1e-11,
            pixels: 1e6,
        };
        let counts = Counts::uniform(100_000, 1);
        let tau = |n: u32| times.iteration(n.into(), 1.0);
        assert!((tau(100_000) - 2.2).abs() < 1e-9);
        for (left, number) in [(10.0, 5.0), (11.0, 5.0), (12.0, 5.0), (12.2, 6.0), (2.0, 1.0)] {
            let light_paths = fitting_light_paths(&times, &counts, left).unwrap();
            assert!((number * tau(light_paths) / left - 1.0).abs() < 1e-4, "{left}: {light_paths}");
        }
        // Many iterations end near enough to the time, and one cannot be shortened to any time.
        assert_eq!(fitting_light_paths(&times, &counts, 40.0), None);
        assert_eq!(fitting_light_paths(&times, &counts, 1.2), None);
        // Where camera paths take most of the time, four iterations cannot be shortened, and three
        // are longer.
        let camera = TimeModel { merge_pair: 0.0, ..times };
        let light_paths = fitting_light_paths(&camera, &counts, 4.2).unwrap();
        assert!((3.0 * camera.iteration(light_paths.into(), 1.0) / 4.2 - 1.0).abs() < 1e-4);
    }
}
