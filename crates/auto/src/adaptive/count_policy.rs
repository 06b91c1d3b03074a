//! The policy that decides before each iteration on path counts and on measuring.

use super::autopilot::{Autopilot, AutopilotState, Promise};
use super::plan::Plan;
use super::stopping::Stop;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::iteration_set::IterationSet;
use bdpm_core::noise::Measure;
use bdpm_core::noise::schedule::MeasureSchedule;
use bdpm_core::render::Renderer;
use bdpm_core::render::block::{self, Block};
use std::ops::Range;

/// Decides on path counts and measuring while an image is rendered.
#[derive(Debug)]
pub enum CountPolicy {
    /// The counts of the settings for all iterations.
    Fixed(MeasureSchedule),
    /// The steps of a plan, one after the other; the last one has no end.
    Plan(Plan),
    /// The counts with the minimum error for the time, chosen during the render.
    Automatic(Box<Autopilot>),
}

impl CountPolicy {
    /// Prepares the next iteration, after `elapsed` seconds of this run, and returns its
    /// measurement.
    ///
    /// # Errors
    /// If the counts of the next step of a plan do not fit in the memory.
    pub fn prepare(
        &mut self,
        renderer: &mut Renderer,
        stop: &Stop,
        elapsed: f64,
    ) -> Result<Measure> {
        match self {
            Self::Fixed(_) => {}
            Self::Plan(plan) => enter_step(plan, renderer)?,
            Self::Automatic(autopilot) => return Ok(autopilot.prepare(renderer, stop, elapsed)),
        }
        Ok(self.schedule(renderer).measure(
            renderer.block_iteration(),
            &renderer.block().counts,
            renderer.settings(),
        ))
    }

    /// Takes the reason why the latest choice of counts failed, if it did. The counts in force were
    /// kept.
    pub fn take_failure(&mut self) -> Option<Error> {
        let Self::Automatic(autopilot) = self else { return None };
        autopilot.failure.take()
    }

    /// The iterations that are measured before the next decision.
    pub fn schedule(&self, renderer: &Renderer) -> MeasureSchedule {
        match self {
            Self::Fixed(schedule) => *schedule,
            Self::Plan(_) => MeasureSchedule::default(),
            Self::Automatic(autopilot) => autopilot.schedule(renderer),
        }
    }

    /// Iterations that the block with the first iteration `first` may have.
    pub fn range(&self, first: u64) -> Range<u64> {
        let ranges = self.plan().map(Plan::ranges).unwrap_or_default();
        ranges.into_iter().find(|range| range.start == first).unwrap_or(first..u64::MAX)
    }

    /// Weight of an iteration of each block, for this importance of the pixels.
    pub fn weights(&self, blocks: &[Block], importance: &[f64]) -> Vec<f64> {
        let planned = self.plan().map(|plan| plan.weights(blocks));
        planned.unwrap_or_else(|| block::weights(blocks, importance))
    }

    /// Seconds per iteration from now on, after `done` iterations in `elapsed` seconds of this run;
    /// `None` until they are known.
    pub fn iteration_time(&self, renderer: &Renderer, done: u64, elapsed: f64) -> Option<f64> {
        match self {
            Self::Automatic(autopilot) => autopilot.iteration_time(renderer, elapsed),
            Self::Fixed(_) | Self::Plan(_) => (done > 0).then(|| elapsed / done as f64),
        }
    }

    /// State for a checkpoint, after `elapsed` seconds of this run; `None` if the iterations
    /// suffice to resume.
    pub fn state(&self, elapsed: f64) -> Option<AutopilotState> {
        self.autopilot().map(|autopilot| autopilot.state(elapsed))
    }

    /// The plan that is rendered, if there is one.
    pub fn plan(&self) -> Option<&Plan> {
        if let Self::Plan(plan) = self { Some(plan) } else { None }
    }

    /// The promised error or time, once there is one.
    pub fn promise(&self) -> Option<&Promise> {
        self.autopilot()?.promise()
    }

    fn autopilot(&self) -> Option<&Autopilot> {
        if let Self::Automatic(autopilot) = self { Some(autopilot) } else { None }
    }
}

/// Lets the renderer enter the block of the first step of a plan that has iterations to render.
fn enter_step(plan: &Plan, renderer: &mut Renderer) -> Result<()> {
    let ranges = plan.ranges();
    let unfinished = ranges.iter().position(|range| has_remaining(range, renderer));
    let step = unfinished.unwrap_or(ranges.len() - 1);
    let (first, counts) = (ranges[step].start, &plan.steps[step].counts);
    let block = renderer.block();
    if block.first != first || block.counts != *counts {
        renderer.enter_block(first, counts.clone())?;
    }
    Ok(())
}

/// Returns true if the renderer has iterations of a step left to render.
fn has_remaining(range: &Range<u64>, renderer: &Renderer) -> bool {
    let block = renderer.blocks().iter().find(|block| block.first == range.start);
    let assigned = renderer.assigned().within(&IterationSet::from(range.clone()));
    !block.map_or(assigned.clone(), |block| assigned.without(&block.numbers)).is_empty()
}
