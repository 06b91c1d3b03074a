//! Automatic path counts: first those of the settings, from the choice of technique, then the
//! optimum. It is chosen again a few times from all measurements so far.

pub use super::count_choice::CountOptions;
use super::count_choice::{CountChoice, CountChooser, ExpectedCosts, fitted_times, is_large};
use super::error_interval::ErrorInterval;
use super::stopping::{Convergence, Stop, importance};
use crate::timing::TimeModel;
use bdpm_core::base::error::Error;
use bdpm_core::film::cells::CellGrid;
use bdpm_core::noise::Measure;
use bdpm_core::noise::film::BatchGrain;
use bdpm_core::noise::schedule::{MEASURE_EVERY, MeasureSchedule};
use bdpm_core::render::Renderer;
use bdpm_core::render::block::{self, Block};
use bdpm_core::render::max_blocks;
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

/// Time of a choice for each cell of statistics, with that of the estimates that a second block
/// adds, seconds: .5 s for 520,000 on two cores, with a margin.
const CHOICE_TIME: f64 = 1e-6;

/// Maximum share of a choice in the time that is left.
const MOST_CHOOSING: f64 = 0.2;

/// Share of the time after which counts are not chosen again, so that the promise has iterations to
/// rest on.
const LAST_CHOICE_SHARE: f64 = 0.25;

/// Share of the time after which the counts stay as they are, and the error at the end is promised.
const PROMISE_SHARE: f64 = 1.0 / 3.0;

/// Chooses the counts of a renderer while it renders.
#[derive(Debug)]
pub struct Autopilot {
    /// How counts are chosen.
    pub options: CountOptions,
    /// Rendering time before this run.
    earlier: f64,
    state: AutopilotState,
    /// Reason why the latest choice of counts failed, until it is reported. The counts in force
    /// were kept.
    pub failure: Option<Error>,
}

/// State that an interrupted run needs to resume.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AutopilotState {
    /// Rendering time when it was saved, seconds, from the first iteration of the image.
    pub elapsed: f64,
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
    /// Squared relative bias of the image, as the pilot estimated it.
    pub bias2: f64,
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

impl AutopilotState {
    /// State before the first iteration. `pilot_times` are proportional to the times of the image.
    /// `bias2` is the squared relative bias that the pilot expects.
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
}

impl Autopilot {
    /// Starts with the counts of the renderer's settings, or resumes.
    pub fn new(state: AutopilotState, options: CountOptions) -> Self {
        Self { options, earlier: state.elapsed, state, failure: None }
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

    /// The best counts from all measurements so far.
    fn choose(&self, renderer: &Renderer, stop: &Stop, elapsed: f64) -> CountChoice {
        let convergence = convergence(renderer, stop);
        let ranks = f64::from(renderer.config().ranks);
        let options = self.options;
        let times = options.times.map(|times| times.scaled(ranks.recip()));
        let times =
            times.unwrap_or_else(|| fitted_times(&self.state.pilot_times, renderer.blocks()));
        CountChooser { renderer, convergence, stop, elapsed, times, options }.choose()
    }

    /// Prepares the next iteration, after `elapsed` seconds of this run, and returns its
    /// measurement. If other counts are chosen and cannot be rendered, the counts in force are
    /// kept: see [`Self::failure`].
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
        let iterations = renderer.film().iterations + u64::from(is_last);
        let measures = iterations.is_multiple_of(self.schedule(renderer).every);
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
        let (elapsed, iterations) = (now - self.earlier, renderer.film().iterations);
        let is_after =
            |share: f64| stop.time.is_some_and(|time| elapsed > share * time.as_secs_f64());
        let is_late = is_after(FIRST_CHOICE_SHARE);
        let first = if is_late { FEWEST_FIRST_ITERATIONS } else { FIRST_ITERATIONS };
        if iterations < first {
            return false;
        }
        let Some(next_choice) = self.state.next_choice else {
            let cells = CellGrid::of(renderer.settings().resolution()).len() as f64;
            let left = |time: Duration| time.as_secs_f64() - elapsed;
            return stop.time.is_none_or(|time| CHOICE_TIME * cells < MOST_CHOOSING * left(time));
        };
        let is_due = is_after(PROMISE_SHARE) || is_doubled(iterations, first);
        if self.state.promise.is_none() && is_due {
            self.state.promise = self.make_promise(renderer, stop, elapsed);
        }
        now >= next_choice && !is_after(LAST_CHOICE_SHARE) && self.state.promise.is_none()
    }

    /// Keeps the times of the latest two marks.
    fn mark(&mut self, iterations: u64, seconds: f64) {
        let [_, latest] = self.state.marks;
        if is_doubled(iterations, MEASURE_EVERY) && latest.iterations != iterations {
            self.state.marks = [latest, Mark { iterations, seconds }];
        }
    }

    /// The iterations that are measured before the next decision. After the promise counts stay.
    /// Measurements then serve the merge bias, or a file of the noise of each pixel.
    pub fn schedule(&self, renderer: &Renderer) -> MeasureSchedule {
        let is_needed =
            renderer.settings().shares_light() || renderer.config().grain == BatchGrain::Pixel;
        let every = match self.state.next_choice {
            None => MEASURE_FIRST_EVERY,
            Some(_) if is_needed || self.state.promise.is_none() => MEASURE_EVERY,
            Some(_) => u64::MAX,
        };
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
        // Where pixels share no light, no iteration is measured after the promise.
        if known && clock.iterations > 0 && !renderer.settings().shares_light() {
            return Some(per_production);
        }
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

/// Returns true after `first` iterations of a block, twice as many, and so on, since each look at
/// the image takes a pass over it.
fn is_doubled(iterations: u64, first: u64) -> bool {
    iterations.is_multiple_of(first) && (iterations / first).is_power_of_two()
}
