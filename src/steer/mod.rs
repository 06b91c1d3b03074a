//! Who decides before each iteration about counts and measuring.

pub mod autopilot;
pub mod goal;
pub mod pace;
pub mod plan;
pub mod technique;

use crate::base::error::Result;
use crate::noise::Measure;
use crate::render::Renderer;
use crate::render::block;
use crate::render::block::Block;
use crate::settings::policy::{FIXED_PILOT, MEASURE_EVERY};
use autopilot::{Promise, State};
use plan::Plan;

/// Decides about counts and measuring while an image is rendered.
pub trait Steer: Send + Sync {
    /// Prepares the next iteration, after `elapsed` seconds of this run, and tells whether to
    /// measure.
    ///
    /// # Errors
    /// If other counts are to be taken and do not fit in the memory.
    fn steer(&mut self, renderer: &mut Renderer, elapsed: f64) -> Result<Measure>;

    /// Weight of an iteration of each block, for pixels of such importance.
    fn weights(&self, blocks: &[Block], importance: &[f64]) -> Vec<f64> {
        block::weights(blocks, importance)
    }

    /// Seconds per iteration from now on, after `done` iterations in `elapsed` seconds of this run;
    /// `None` if that is not known yet.
    fn pace(&self, _renderer: &Renderer, done: u64, elapsed: f64) -> Option<f64> {
        (done > 0).then(|| elapsed / done as f64)
    }

    /// What a checkpoint must keep for this to go on later, after `elapsed` seconds of this run; `None` if
    /// the iterations tell all.
    fn state(&self, _elapsed: f64) -> Option<State> {
        None
    }

    /// What was promised, if anything.
    fn promise(&self) -> Option<&Promise> {
        None
    }
}

/// The same counts throughout: a pilot and a fixed share of the other iterations are measured, where the
/// counts allow it.
#[derive(Clone, Copy, Debug)]
pub struct Fixed;

impl Steer for Fixed {
    fn steer(&mut self, renderer: &mut Renderer, _: f64) -> Result<Measure> {
        let Block { counts, film, .. } = renderer.block();
        let measures =
            film.iterations < FIXED_PILOT || film.iterations.is_multiple_of(MEASURE_EVERY);
        Ok(if measures && counts.can_measure() { Measure::Pairs } else { Measure::Off })
    }
}

/// The same counts throughout, every iteration measured.
#[derive(Clone, Copy, Debug)]
pub struct Measuring(pub Measure);

impl Steer for Measuring {
    fn steer(&mut self, _: &mut Renderer, _: f64) -> Result<Measure> {
        Ok(self.0)
    }
}

/// A plan, step after step; the last one has no end.
#[derive(Clone, Debug)]
pub struct Replay {
    plan: Plan,
    /// Steps begun.
    begun: usize,
}

impl Replay {
    /// Begins with the first step.
    pub fn new(plan: Plan) -> Self {
        Self { plan, begun: 0 }
    }
}

impl Steer for Replay {
    fn steer(&mut self, renderer: &mut Renderer, elapsed: f64) -> Result<Measure> {
        let step = self.begun.checked_sub(1).map(|last| &self.plan.steps[last]);
        let rendered = step.map(|step| step.rendered.map_or(u64::MAX, |r| r.iterations));
        let over = rendered.is_none_or(|iterations| renderer.film().iterations >= iterations);
        if over && let Some(next) = self.plan.steps.get(self.begun) {
            renderer.begin_block(next.counts.clone())?;
            self.begun += 1;
        }
        Fixed.steer(renderer, elapsed)
    }

    fn weights(&self, blocks: &[Block], _: &[f64]) -> Vec<f64> {
        let mut weights = self.plan.weights();
        weights.truncate(blocks.len());
        weights
    }
}
