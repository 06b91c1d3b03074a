//! The loop over the iterations of a job.

use super::Event;
use super::audit::Outcome;
use super::result::RenderResult;
use super::root_rank::RootRank;
use super::state::RenderState;
use super::step::Step;
use bdpm_auto::adaptive::stopping::StoppedBy;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::render::IterationReport;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Instant;

/// Renders until a stop condition holds, or the user or `observer` interrupts. An error after the
/// first iteration ends the render with the image so far.
pub(super) fn run(
    mut state: RenderState,
    root: &mut Option<RootRank>,
    observer: &mut impl FnMut(Event) -> ControlFlow<()>,
) -> Result<RenderResult> {
    if observer(Event::Started(&state)).is_break() {
        state.interrupt();
    }
    let stopped_by = loop {
        if let Some(reason) = state.finished() {
            break reason;
        }
        match advance(&mut state, root.as_mut(), observer) {
            Ok(ControlFlow::Continue(())) => {}
            Ok(ControlFlow::Break(reason)) => break reason,
            Err(error) if state.renderer.iterations() == 0 => return Err(error),
            Err(error) => {
                state.failure.get_or_insert(error);
                break StoppedBy::Failure;
            }
        }
    };
    if let Some(root) = root
        && let Err(error) = root.dismiss()
    {
        state.failure.get_or_insert(error);
    }
    Ok(RenderResult::new(state, stopped_by))
}

/// Renders one iteration, and decides what follows from it.
fn advance(
    state: &mut RenderState,
    root: Option<&mut RootRank>,
    observer: &mut impl FnMut(Event) -> ControlFlow<()>,
) -> Result<ControlFlow<StoppedBy>> {
    iterate(state, root, observer)?;
    if state.renderer.iterations() == 0 {
        return Err(Error::interrupted());
    }
    state.estimate_if_due()?;
    match state.look_at_audit() {
        Ok(Outcome::Nothing) => {}
        Ok(Outcome::Warned(warning)) => {
            if !state.has_warned_of_audit {
                let _ = observer(Event::Warning(warning));
            }
            state.has_warned_of_audit = true;
        }
        Ok(Outcome::Restarted(reason)) => {
            let _ = observer(Event::Warning(reason));
            let _ = observer(Event::Restarted(state));
            return Ok(ControlFlow::Continue(()));
        }
        Err(error) => {
            let _ = observer(Event::Warning(format!("the technique is kept: {error}")));
        }
    }
    match state.denoised_error() {
        Ok(None) => {}
        Ok(Some((error, suffices))) => {
            let _ = observer(Event::Denoised(&error, state.elapsed()));
            if suffices {
                return Ok(ControlFlow::Break(StoppedBy::Target));
            }
        }
        Err(error) => {
            let _ = observer(Event::Warning(format!("the image will not be denoised: {error}")));
            state.failure.get_or_insert(error);
        }
    }
    let is_over = observer(Event::Iterated(state)).is_break() || state.is_interrupted();
    Ok(if is_over { ControlFlow::Break(StoppedBy::Interrupt) } else { ControlFlow::Continue(()) })
}

/// Renders one iteration, or one round of iterations of all processes.
fn iterate(
    state: &mut RenderState,
    root: Option<&mut RootRank>,
    observer: &mut impl FnMut(Event) -> ControlFlow<()>,
) -> Result<()> {
    let elapsed = state.elapsed().as_secs_f64();
    let threads = Arc::clone(&state.threads);
    let preparing = Instant::now();
    let measure = state.attempt(Step::Preparation, |state| {
        let RenderState { policy, renderer, stop, .. } = state;
        threads.install(|| policy.prepare(renderer, stop, elapsed))
    })?;
    state.clock.spent.choices += preparing.elapsed();
    if let Some(error) = state.policy.take_failure() {
        let _ = observer(Event::Warning(format!("the path counts are kept: {error}")));
    }
    let (begun, areas) = (Instant::now(), state.renderer.area_work());
    let reports = state.attempt(Step::Iteration, |state| match root {
        Some(root) => root.round(state),
        None => {
            let renderer = &mut state.renderer;
            let number = renderer.next_iteration();
            let report = threads.install(|| renderer.iterate(measure));
            if let Some(audit) = &mut state.audit {
                let counts = (&renderer.block().counts, renderer.settings().pixels());
                audit.after_iteration(&threads, number, counts);
            }
            Ok(vec![(report, number)])
        }
    })?;
    let areas =
        state.renderer.area_work().since(areas).time / state.threads.current_num_threads() as u32;
    state.clock.latest_iteration = begun.elapsed().saturating_sub(areas).as_secs_f64();
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
