//! Automatic counts: those of the settings at first, which a choice of technique found, then the optimum, chosen
//! again at a few moments from all that is known by then.

use super::stopping::{Convergence, Stop, importance, luminances};

use crate::adaptive::optimize::{CountLimits, MAX_CAMERA_PATHS, NEAR_OPTIMUM, Objective, Problem};
use crate::base::error::Result;
use crate::film::counts::{CameraCounts, Counts};
use crate::film::radiance::{box_filter, luminance_weights};
use crate::noise::schedule::{MEASURE_EVERY, MeasureSchedule};
use crate::noise::{Coefficients, Measure};
use crate::render::Renderer;
use crate::render::block;
use crate::render::block::{Block, CombinedImage};
use crate::settings::policy::*;
use crate::timing::TimeModel;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Chooses the counts of a renderer while it renders.
#[derive(Debug)]
pub struct Autopilot {
    goal: Stop,
    /// Whether counts may differ from pixel to pixel.
    per_pixel: bool,
    /// Times that are known beforehand.
    times: Option<TimeModel>,
    /// Rendering time before this run.
    earlier: f64,
    state: AutopilotState,
}

/// What an interrupted run needs to go on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AutopilotState {
    /// Rendering time when it was saved, seconds.
    elapsed: f64,
    /// Rendering time when the block under way began.
    block_began: f64,
    /// Rendering time when counts are chosen next, seconds; `None` before the first choice.
    next_choice: Option<f64>,
    /// What is known of the choice that the promise is about.
    expected: Expected,
    /// Times on a sample of the image, from a choice of technique before: in proportion to those of the image.
    sampled: TimeModel,
    /// Squared relative bias of the image, as far as it is known.
    bias2: f64,
    /// What was promised, once a few iterations at the second choice were rendered.
    promise: Option<Promise>,
}

/// Costs, time times variance of an iteration, by model and formula.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Expected {
    /// Time of an iteration at the chosen counts, seconds.
    tau: f64,
    /// Cost of as many light paths as pixels and one camera path per pixel.
    one_each: f64,
    /// Cost of the best counts that are equal in all pixels.
    uniform: f64,
}

/// What was expected after the first iterations at the second choice of counts: these are new
/// samples, so that a choice which followed the noise of its data does not look better than it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Promise {
    /// Pooled RMS at the end, W/(m^2 sr).
    pub rms: f64,
    /// Relative error at the end, noise and bias, if that is what counts.
    pub error: Option<f64>,
    /// Rendering time to the end, from the very first iteration, seconds.
    pub seconds: f64,
    /// Rendering time when this was said.
    pub said_after: f64,
    /// Time that as many light paths as pixels and one camera path per pixel would take for the same
    /// noise, over that of the chosen counts.
    pub gain_over_one_each: f64,
    /// The same for the best counts that are equal in all pixels.
    pub gain_over_uniform: f64,
}

/// Counts, and what they should lead to.
struct Choice {
    counts: Counts,
    expected: Expected,
    /// Whether that is worth a new block.
    saves: bool,
}

impl AutopilotState {
    /// Before the first iteration.
    pub fn new(sampled: TimeModel, bias2: f64) -> Self {
        Self {
            elapsed: 0.0,
            block_began: 0.0,
            next_choice: None,
            expected: Expected::default(),
            sampled,
            bias2,
            promise: None,
        }
    }

    /// Rendering time when it was saved, seconds, from the very first iteration.
    pub fn elapsed(&self) -> f64 {
        self.elapsed
    }

    /// Squared relative bias of the image, as far as a choice of technique found it.
    pub fn bias2(&self) -> f64 {
        self.bias2
    }
}

impl Autopilot {
    /// Begins with the counts of a renderer's settings; `sampled` are times in proportion to those of its image, of
    /// a sample of the pixels.
    pub fn new(goal: Stop, sampled: TimeModel) -> Self {
        Self::resume(goal, AutopilotState::new(sampled, goal.bias2))
    }

    /// Goes on from `state`, which knows the bias.
    pub fn resume(goal: Stop, state: AutopilotState) -> Self {
        let goal = Stop { bias2: state.bias2, ..goal };
        Self { goal, per_pixel: true, times: None, earlier: state.elapsed, state }
    }

    /// Takes the same counts in all pixels.
    #[must_use]
    pub fn uniform(self) -> Self {
        Self { per_pixel: false, ..self }
    }

    /// Chooses by times that are known beforehand, instead of by those of the iterations.
    #[must_use]
    pub fn with_times(self, times: TimeModel) -> Self {
        Self { times: Some(times), ..self }
    }

    /// Expectations from the first iterations at the chosen counts, once these tell the noise well or a part of the
    /// time is over.
    /// theory.md (89).
    fn promised(&self, renderer: &Renderer, elapsed: f64) -> Option<Promise> {
        let standing = self.standing(renderer);
        let goal = standing.with_measured_bias(&self.goal);
        let (variance, tau) = (standing.per_iteration?, self.iteration_time(renderer, elapsed)?);
        let forecast = standing.forecast(&goal, variance, tau, elapsed)?;
        let (pooled, error) = renderer.film().pooled_variance()?;
        let is_late = elapsed > PROMISE_SHARE * (elapsed + forecast.seconds);
        if error > PROMISE_ERROR * pooled && !is_late {
            return None;
        }
        let Expected { tau, one_each, uniform } = self.state.expected;
        let gain = |other: f64| if variance > 0.0 { other / (variance * tau) } else { 1.0 };
        let said_after = self.earlier + elapsed;
        Some(Promise {
            rms: forecast.rms,
            error: standing.error(&goal, forecast.left),
            seconds: said_after + forecast.seconds,
            said_after,
            gain_over_one_each: gain(one_each),
            gain_over_uniform: gain(uniform),
        })
    }

    fn standing(&self, renderer: &Renderer) -> Convergence {
        let importance = importance(renderer.blocks(), self.goal.objective);
        let weights = block::weights(renderer.blocks(), &importance);
        Convergence::new(renderer.blocks(), weights, &importance)
    }

    /// The best counts by all that has been measured.
    fn choose(&self, renderer: &Renderer, elapsed: f64) -> Result<Choice> {
        let standing = self.standing(renderer);
        let blocks = renderer.blocks();
        let settings = renderer.settings();
        let times =
            self.times.map(|times| times.scaled(f64::from(renderer.config().ranks).recip()));
        let model = times.unwrap_or_else(|| scaled(&self.state.sampled, blocks));
        let measured = block::coefficients(blocks).expect("the first iteration measures");
        let smoothed = smoothed(blocks, &measured, settings.width, settings.height);
        let (luminance, scale) = self.luminance(blocks, (settings.width, settings.height));
        let problem = |iteration_time| {
            let bounds = CountLimits {
                light_paths: 2..=renderer.most_light_paths(),
                camera_paths: 1..=MAX_CAMERA_PATHS,
                iteration_time,
            };
            Problem::new(&smoothed, &luminance, self.goal.objective, model, &bounds)
        };
        // Enough iterations must fit in the rest, whose length depends on the counts where a
        // target ends it: a few rounds settle that.
        let mut longest = f64::INFINITY;
        let least = problem(longest).least_sensible_time();
        for _ in 0..4 {
            let best = problem(longest).uniform();
            let (variance, tau) = (best.variance * scale, best.iteration_time);
            let rest = standing.forecast(&self.goal, variance, tau, elapsed);
            let share =
                // theory.md (86), (90)
                rest.map_or(f64::INFINITY, |rest| {
                    rest.seconds / least_iterations_after_choice(renderer.config().ranks)
                });
            longest = share.max(least);
        }
        let problem = problem(longest);
        let uniform = problem.shortest_uniform(NEAR_OPTIMUM);
        let mut counts = Counts::uniform(uniform.light_paths, uniform.camera_paths);
        let mut cost = uniform.cost;
        if self.per_pixel {
            let best = problem.shortest_per_pixel(NEAR_OPTIMUM);
            if best.cost < uniform.cost * (1.0 - WORTHWHILE_PER_PIXEL) {
                let camera_paths = CameraCounts::PerPixel(best.camera_paths);
                counts = Counts { light_paths: best.light_paths, camera_paths };
                cost = best.cost;
            }
        }
        let tau = |counts: &Counts| {
            model.iteration(f64::from(counts.light_paths), counts.camera_paths.mean())
        };
        let one_each = scale * problem.evaluate_uniform(settings.pixels() as u32, 1).cost;
        // The samples of the block tell what its counts cost.
        // theory.md (88)
        let present_tau = tau(&renderer.block().counts);
        let present = standing.per_iteration.unwrap_or(0.0) * present_tau;
        let saves = scale * cost < present * (1.0 - WORTHWHILE);
        let tau = if saves { tau(&counts) } else { present_tau };
        let expected = Expected { tau, one_each, uniform: scale * uniform.cost };
        Ok(Choice { saves, counts, expected })
    }

    /// Luminance of each pixel to allot camera paths by, and the mean of the weights that follow from it.
    fn luminance(&self, blocks: &[Block], (width, height): (u32, u32)) -> (Vec<f64>, f64) {
        let image = CombinedImage::new(blocks, vec![1.0; blocks.len()]);
        let own: Vec<_> = luminances(&image).into_iter().map(|l| [l]).collect();
        let luminance: Vec<f64> =
            box_filter(&own, width, height).into_iter().map(|[l]| l).collect();
        let scale = match self.goal.objective {
            Objective::Relative => {
                luminance_weights(&luminance).iter().sum::<f64>() / luminance.len() as f64
            }
            _ => 1.0,
        };
        (luminance, scale)
    }
}

impl Autopilot {
    /// Prepares the next iteration, after `elapsed` seconds of this run, and returns what to measure in it.
    ///
    /// # Errors
    /// If other counts are chosen and do not fit in the memory.
    pub fn prepare(&mut self, renderer: &mut Renderer, elapsed: f64) -> Result<Measure> {
        let (now, entered) = (self.earlier + elapsed, Instant::now());
        if renderer.iterations() == 0 {
            self.state.block_began = now;
        } else if self.is_choice_due(renderer, now) {
            let is_first = self.state.next_choice.is_none();
            self.state.next_choice = Some(2.0 * now);
            if is_first || renderer.blocks().len() < MOST_BLOCKS {
                let choice = self.choose(renderer, elapsed)?;
                if is_first {
                    self.state.expected = choice.expected;
                }
                if choice.saves {
                    self.state.block_began = now + entered.elapsed().as_secs_f64();
                    renderer.begin_block(choice.counts)?;
                }
            }
        }
        // The first iteration of a block is measured, so that its start-up is not in the times.
        let measures = renderer.film().iterations.is_multiple_of(self.schedule().every);
        Ok(if measures { Measure::Pairs } else { Measure::Off })
    }

    /// Whether counts are to be chosen before the next iteration. On the way, makes the promise once enough is known.
    ///
    /// The pilot saw a sample of the pixels only, so that the first choice, from iterations of the whole image, comes
    /// before any promise.
    fn is_choice_due(&mut self, renderer: &Renderer, now: f64) -> bool {
        if renderer.film().iterations < FIRST_ITERATIONS {
            return false;
        }
        let Some(next_choice) = self.state.next_choice else { return true };
        if self.state.promise.is_none() && is_time_to_look(renderer) {
            self.state.promise = self.promised(renderer, now - self.earlier);
        }
        now >= next_choice
    }

    /// Which iterations are measured before the next decision.
    pub fn schedule(&self) -> MeasureSchedule {
        let is_first = self.state.next_choice.is_none();
        let every = if is_first { MEASURE_FIRST_EVERY } else { MEASURE_EVERY };
        MeasureSchedule { pilot: 0, every, estimator: Measure::Pairs }
    }

    /// Seconds per iteration from now on, with production and measured iterations in the shares that they have in the
    /// long run; `None` before the block has enough iterations.
    pub fn iteration_time(&self, renderer: &Renderer, elapsed: f64) -> Option<f64> {
        let Block { film, clock, .. } = renderer.block();
        let measured = film.iterations.saturating_sub(clock.iterations);
        let known = film.iterations >= MEASURE_EVERY;
        let since = self.earlier + elapsed - self.state.block_began;
        let production = clock.times.wall.as_secs_f64();
        let share = 1.0 / MEASURE_EVERY as f64;
        let per_production = production / clock.iterations as f64;
        let per_measured = (since - production).max(0.0) / measured as f64;
        // theory.md (93)
        known.then_some((1.0 - share) * per_production + share * per_measured)
    }

    /// AutopilotState for a checkpoint, after `elapsed` seconds of this run.
    pub fn state(&self, elapsed: f64) -> AutopilotState {
        AutopilotState { elapsed: self.earlier + elapsed, ..self.state }
    }

    /// The promise, once enough is known to make one.
    pub fn promise(&self) -> Option<&Promise> {
        self.state.promise.as_ref()
    }
}

/// After so many iterations of a block, twice as many, and so on: a look takes a pass over the image.
fn is_time_to_look(renderer: &Renderer) -> bool {
    let iterations = renderer.film().iterations;
    iterations.is_multiple_of(FIRST_ITERATIONS) && (iterations / FIRST_ITERATIONS).is_power_of_two()
}

/// Times in proportion to `sampled` that explain those of the production iterations of all blocks.
fn scaled(sampled: &TimeModel, blocks: &[Block]) -> TimeModel {
    let (mut found, mut expected) = (0.0, 0.0);
    for Block { counts, clock, .. } in blocks {
        let each = sampled.iteration(f64::from(counts.light_paths), counts.camera_paths.mean());
        found += clock.times.wall.as_secs_f64();
        expected += clock.iterations as f64 * each;
    }
    let scale = if found > 0.0 && expected > 0.0 { found / expected } else { 1.0 };
    sampled.scaled(scale)
}

/// Coefficients to allot camera paths by, at least 0: those of the neighborhood of 5 by 5 pixels as
/// long as little is known about the pixel itself, then more and more its own.
fn smoothed(
    blocks: &[Block],
    measured: &[Coefficients],
    width: u32,
    height: u32,
) -> Vec<Coefficients> {
    let values: Vec<_> = measured.iter().map(|c| [c.a, c.b, c.f]).collect();
    let pooled = box_filter(&values, width, height);
    let freedom = block::degrees_of_freedom(blocks);
    let mixed = |((&own, [a, b, f]), freedom): ((&Coefficients, [f64; 3]), f64)| {
        // theory.md (87)
        let share = freedom / (freedom + PRIOR_FREEDOM);
        (own * share + Coefficients { a, b, f } * (1.0 - share)).clamped()
    };
    measured.iter().zip(pooled).zip(freedom).map(mixed).collect()
}
