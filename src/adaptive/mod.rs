//! Who decides before each iteration about counts and measuring.

pub mod autopilot;
pub mod stopping;
pub mod time_probe;
pub mod optimize;
pub mod plan;
pub mod technique;

use crate::base::error::Result;
use crate::base::iteration_set::IterationSet;
use crate::film::counts::Counts;
use crate::noise::Measure;
use crate::render::Renderer;
use crate::render::block;
use crate::render::block::Block;
use crate::settings::policy::{FIXED_PILOT, MEASURE_EVERY};
use autopilot::{Promise, State};
use plan::Plan;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Which iterations of a block are measured, by how many go before them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Schedule {
    /// The first ones.
    pub pilot: u64,
    /// Then one in so many.
    pub every: u64,
}

impl Schedule {
    /// Whether to measure the one after `turn` others at these counts.
    pub fn measure(self, turn: u64, counts: &Counts) -> Measure {
        let measures = turn < self.pilot || turn.is_multiple_of(self.every);
        if measures && counts.can_measure() { Measure::Pairs } else { Measure::Off }
    }
}

/// Decides about counts and measuring while an image is rendered.
pub trait Steer: Send + Sync {
    /// Prepares the next iteration, after `elapsed` seconds of this run, and tells whether to
    /// measure.
    ///
    /// # Errors
    /// If other counts are to be taken and do not fit in the memory.
    fn steer(&mut self, renderer: &mut Renderer, elapsed: f64) -> Result<Measure>;

    /// What is measured of the iterations that follow before the next decision.
    fn schedule(&self) -> Schedule {
        Schedule { pilot: FIXED_PILOT, every: MEASURE_EVERY }
    }

    /// IterationSet of the iterations that the block may have that begins with the number `first`.
    fn range(&self, first: u64) -> Range<u64> {
        first..u64::MAX
    }

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

    /// What is rendered step by step, if that is known beforehand.
    fn plan(&self) -> Option<&Plan> {
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
        Ok(self.schedule().measure(renderer.block_iteration(), &renderer.block().counts))
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
    /// IterationSet of the iterations of each step.
    ranges: Vec<Range<u64>>,
}

impl Replay {
    /// Begins with the first step of which there are iterations to render.
    pub fn new(plan: Plan) -> Self {
        let ranges = plan.ranges();
        Self { plan, ranges }
    }

    /// Whether the renderer still has iterations of the step to render.
    fn is_open(range: &Range<u64>, renderer: &Renderer) -> bool {
        let blocks = renderer.blocks();
        let block = blocks.iter().find(|block| block.first == range.start);
        let own = renderer.assigned().within(&IterationSet::from(range.clone()));
        !block.map_or(own.clone(), |block| own.without(&block.numbers)).is_empty()
    }
}

impl Steer for Replay {
    fn steer(&mut self, renderer: &mut Renderer, elapsed: f64) -> Result<Measure> {
        let open = self.ranges.iter().position(|range| Self::is_open(range, renderer));
        let step = open.unwrap_or(self.ranges.len() - 1);
        let (first, counts) = (self.ranges[step].start, &self.plan.steps[step].counts);
        let block = renderer.block();
        if block.first != first || block.counts != *counts {
            renderer.enter_block(first, counts.clone())?;
        }
        Fixed.steer(renderer, elapsed)
    }

    fn range(&self, first: u64) -> Range<u64> {
        let range = self.ranges.iter().find(|range| range.start == first);
        range.cloned().unwrap_or(first..u64::MAX)
    }

    fn weights(&self, blocks: &[Block], _: &[f64]) -> Vec<f64> {
        self.plan.weights(blocks)
    }

    fn plan(&self) -> Option<&Plan> {
        Some(&self.plan)
    }
}
