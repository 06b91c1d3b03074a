//! The loop over the iterations of a job.

use super::Event;
use super::leader::Leader;
use super::result::RenderResult;
use super::state::RenderState;
use crate::adaptive::stopping::StoppedBy;
use crate::base::error::Result;
use crate::render::IterationReport;
use std::ops::ControlFlow;
use std::sync::Arc;

/// Renders until a stop condition holds, or the user or `observer` interrupts.
pub(super) fn run(
    mut state: RenderState,
    mut leader: Option<Leader>,
    observer: &mut impl FnMut(Event) -> ControlFlow<()>,
) -> Result<RenderResult> {
    if observer(Event::Started(&state)).is_break() {
        state.interrupt();
    }
    let stopped_by = loop {
        if let Some(reason) = state.finished() {
            break reason;
        }
        iterate(&mut state, leader.as_mut(), observer)?;
        state.estimate_if_due();
        if state.revise_choice()? {
            let _ = observer(Event::Revised(&state));
            continue;
        }
        if let Some((error, suffices)) = state.denoised_error()? {
            let _ = observer(Event::Denoised(&error, state.elapsed()));
            if suffices {
                break StoppedBy::Target;
            }
        }
        if observer(Event::Iterated(&mut state)).is_break() || state.is_interrupted() {
            break StoppedBy::Interrupt;
        }
    };
    if let Some(leader) = leader {
        leader.shut_down()?;
    }
    RenderResult::new(state, stopped_by)
}

/// Renders one iteration, or one round of iterations of all processes.
fn iterate(
    state: &mut RenderState,
    leader: Option<&mut Leader>,
    observer: &mut impl FnMut(Event) -> ControlFlow<()>,
) -> Result<()> {
    let elapsed = state.elapsed().as_secs_f64();
    let threads = Arc::clone(&state.threads);
    let RenderState { policy, renderer, .. } = &mut *state;
    let measure = threads.install(|| policy.prepare(renderer, elapsed))?;
    let reports = match leader {
        Some(leader) => leader.round(state)?,
        None => {
            let number = renderer.next_iteration();
            vec![(threads.install(|| renderer.iterate(measure)), number)]
        }
    };
    for (report, number) in &reports {
        state.totals.add(report);
        if let Some(warning) = bad_pixel(state, report, *number) {
            let _ = observer(Event::Warning(warning));
        }
    }
    Ok(())
}

/// A warning about the first non-finite pixel value, with the seed and iteration that reproduce it.
fn bad_pixel(state: &RenderState, report: &IterationReport, iteration: u64) -> Option<String> {
    let (x, y) = report.non_finite.first()?;
    let is_first = state.totals.non_finite == report.non_finite.len() as u64;
    is_first.then(|| {
        format!(
            "pixel ({x}, {y}) is not finite in iteration {iteration} with seed {} and was left \
             out\nhelp: please report this with the scene; further pixels are only counted",
            state.provenance.settings.seed
        )
    })
}
