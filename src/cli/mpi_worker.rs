//! A render by several processes, as all but the first see it: they render what they are told to.

use super::interrupts::catch_interrupts;
use super::loaded_scene::{self, LoadedScene};
use super::mpi_leader::{Continuation, Ready, RenderSetup, Round, WorkerResult, render_own};
use super::progress::{Manner, Progress, Totals};
use super::render::Args;
use bdpm::adaptive::stopping::Goal;
use bdpm::base::error::Result;
use bdpm::mpi::{Exchange, Ranks, encode};
use bdpm::render::{RenderConfig, Renderer};
use std::sync::atomic::Ordering;

/// Renders its shares until there is none left. Ctrl-C ends a share after the iteration under way.
pub fn follow(args: &Args, ranks: &dyn Ranks) -> Result<()> {
    let begun: Continuation = ranks.broadcast(None)?;
    let begun = begun.as_ref().map(|(origin, file, reuse)| loaded_scene::Continuation {
        origin,
        file,
        reuse: *reuse,
    });
    let prepared = match LoadedScene::new(&args.session, begun) {
        Ok(prepared) => prepared,
        Err(error) => {
            ranks.send(0, &encode(&Ready::Err(error.to_string())));
            // The first one says so, and ends all.
            ranks.broadcast::<RenderSetup>(None)?;
            return Err(error);
        }
    };
    ranks.send(0, &encode(&Ready::Ok(prepared.origin.clone())));
    let RenderSetup { settings, grain, kept } = ranks.broadcast(None)?;
    let new = || Renderer::new(&prepared.scene, &prepared.accel, settings);
    let config =
        RenderConfig { aovs: kept, grain, ranks: ranks.count(), ..RenderConfig::default() };
    let mut renderer = prepared.threads.install(new)?.configure(config)?;
    let interrupted = catch_interrupts(Progress::new(Goal::default(), Manner::Nothing))?;
    let exchange = Exchange::default();
    while let Some(Round { block, schedule, numbers }) = ranks.broadcast::<Option<Round>>(None)? {
        if let Some((first, counts)) = block {
            renderer.enter_block(first, counts)?;
        }
        let own = numbers.share(ranks.rank(), ranks.count());
        let mut totals = Totals::default();
        let is_over = || interrupted.load(Ordering::Relaxed);
        let told = |report: &_, _| totals.add(report);
        render_own((&prepared, &mut renderer), (own, schedule), is_over, told);
        let sums = renderer.take_partial();
        let haul = WorkerResult { sums, totals, is_interrupted: is_over() };
        ranks.reduce(haul, &exchange, WorkerResult::add)?;
    }
    Ok(())
}
