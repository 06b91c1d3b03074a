//! Who decides before each iteration about counts and measuring.

pub mod autopilot;
pub mod goal;
pub mod plan;

use crate::base::error::Result;
use crate::noise::Measure;
use crate::render::Renderer;
use crate::render::block;
use crate::render::block::Block;
use autopilot::Autopilot;
use plan::Plan;

/// Decides about counts and measuring while an image is rendered.
pub trait Steer: Send {
    /// Prepares the next iteration, after `elapsed` seconds of this run, and tells whether to
    /// measure.
    ///
    /// # Errors
    /// If other counts are to be taken and do not fit in the memory.
    fn steer(&mut self, renderer: &mut Renderer, elapsed: f64) -> Result<Measure>;

    /// Weight of an iteration of each block.
    fn weights(&self, blocks: &[Block]) -> Vec<f64> {
        block::weights(blocks)
    }

    /// Seconds per iteration from now on, after `done` iterations in `elapsed` seconds of this run;
    /// `None` if that is not known yet.
    fn pace(&self, _renderer: &Renderer, done: u64, elapsed: f64) -> Option<f64> {
        (done > 0).then(|| elapsed / done as f64)
    }

    /// The automatic choice of counts, if it is one.
    fn autopilot(&self) -> Option<&Autopilot> {
        None
    }
}

/// The same counts throughout, measured now and then.
#[derive(Clone, Copy, Debug)]
pub struct Fixed;

impl Steer for Fixed {
    fn steer(&mut self, renderer: &mut Renderer, _: f64) -> Result<Measure> {
        Ok(renderer.scheduled())
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
    fn steer(&mut self, renderer: &mut Renderer, _: f64) -> Result<Measure> {
        let step = self.begun.checked_sub(1).map(|last| &self.plan.steps[last]);
        let rendered = step.map(|step| step.rendered.map_or(u64::MAX, |r| r.iterations));
        let over = rendered.is_none_or(|iterations| renderer.film().iterations >= iterations);
        if over && let Some(next) = self.plan.steps.get(self.begun) {
            renderer.begin_block(next.counts.clone())?;
            self.begun += 1;
        }
        Ok(renderer.scheduled())
    }

    fn weights(&self, blocks: &[Block]) -> Vec<f64> {
        let mut weights = self.plan.weights();
        weights.truncate(blocks.len());
        weights
    }
}
