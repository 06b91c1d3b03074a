//! The other ranks of several processes, which render the iterations that rank 0 assigns to them.

use super::Prepared;
use super::audit::Audit;
use super::root_rank::{Ready, RenderSetup, Round, WorkerResult, render_assigned};
use super::status::Totals;
use super::step::{PlantedFailure, Step, attempt};
use crate::mpi::{Exchange, Ranks, encode};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::render::Renderer;
use bdpm_core::scene::backend;
use bdpm_core::scene::backend::Backend;
use std::sync::atomic::{AtomicBool, Ordering};

/// Renders assigned iterations until rank 0 ends the job. An interrupt ends a round after the
/// current iteration.
pub(super) fn follow(
    ranks: &dyn Ranks,
    prepared: Result<Prepared>,
    interrupt: &AtomicBool,
    planted: Option<PlantedFailure>,
) -> Result<()> {
    let Prepared { scene, mut accel, threads, provenance, .. } = match prepared {
        Ok(prepared) => prepared,
        Err(error) => return report_failure(ranks, error),
    };
    let prepared_backend = provenance.backend.clone();
    ranks.send(0, &encode(&Ready::Ok(provenance)));
    let setup = ranks.broadcast::<Option<RenderSetup>>(None)?;
    // Rank 0 reports why it ended before the render.
    let Some(RenderSetup { backend, settings, config, audit }) = setup else { return Ok(()) };
    if backend != prepared_backend
        && let Some(backend) = Backend::named(&backend)
    {
        accel = threads.install(|| backend::build(backend, &scene))?;
    }
    let renderer = threads.install(|| Renderer::new(&scene, &accel, settings))?;
    let mut renderer = renderer.configure(config)?;
    let audit = audit.map(|pace| threads.install(|| Audit::new(&renderer, pace))).transpose()?;
    let mut audit = audit.flatten();
    let exchange = Exchange::default();
    let mut failure = None;
    let mut done = 0;
    while let Some(round) = ranks.broadcast::<Option<Round>>(None)? {
        let is_over = || interrupt.load(Ordering::Relaxed);
        let mut totals = Totals::default();
        // After a failure this rank has no iterations, so that rank 0 keeps those of the others.
        if failure.is_none() {
            let rendered = attempt(Step::Iteration, done, planted, || {
                let Round { block, schedule, numbers } = round;
                if let Some((first, counts)) = block {
                    renderer.enter_block(first, counts)?;
                }
                let assigned = numbers.share(ranks.rank(), ranks.count());
                let both = (&mut renderer, audit.as_mut());
                Ok(render_assigned(&threads, both, assigned, schedule, is_over))
            });
            match rendered {
                Ok(reports) => reports.iter().for_each(|(report, _)| totals.add(report)),
                Err(error) => failure = Some(format!("rank {}: {error}", ranks.rank())),
            }
            done += totals.iterations;
        }
        let (sums, is_interrupted) = (renderer.take_partial(), is_over());
        let audit = audit.as_mut().map(Audit::take_sums);
        let failure = failure.clone();
        let result = WorkerResult { sums, totals, is_interrupted, failure, audit };
        ranks.reduce(result, &exchange, WorkerResult::add)?;
    }
    Ok(())
}

/// Lets rank 0 report why this worker cannot render. Rank 0 then ends all processes, so that the
/// error is shown once.
///
/// # Errors
/// The error itself, if rank 0 does not end this process.
pub fn report_failure(ranks: &dyn Ranks, error: Error) -> Result<()> {
    ranks.send(0, &encode(&Ready::Err(error.to_string())));
    ranks.broadcast::<Option<RenderSetup>>(None)?;
    Err(error)
}
