//! A render by several processes, as the first of them sees it: it decides, tells the others what to render, and gets
//! their sums, in rounds of as many iterations as make what is exchanged take a hundredth of the time.

use super::loaded_scene::LoadedScene;
use super::progress::Totals;
use super::session::{Session, Shared};
use bdpm::adaptive::stopping::Goal;
use bdpm::adaptive::{Schedule, Steer};
use bdpm::base::error::{Error, Result};
use bdpm::base::iteration_set::IterationSet;
use bdpm::film::aov::AovSelection;
use bdpm::film::counts::Counts;
use bdpm::mpi::{Exchange, Ranks};
use bdpm::noise::film::BatchGrain;
use bdpm::render::{IterationReport, PartialRender, Renderer};
use bdpm::settings::Settings;
use bdpm::settings::provenance::{Provenance, Reuse};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::time::Instant;

/// Time of iterations per time of exchange.
const ITERATE_SHARE: f64 = 100.0;

/// The longest round, seconds, so that the image is seen and checkpoints are written; or so many exchanges.
const LONGEST: f64 = 60.0;

/// See [`LONGEST`].
const LONGEST_SHARE: f64 = 50.0;

/// The most by which a round is longer than the one before: the first ones tell what counts are best.
const GROWTH: u64 = 4;

/// Of the time that is left until a target, the most that goes into one round.
const TOWARD_TARGET: f64 = 0.5;

/// What there is of an image, for all to load the scene by: what it was made of, its file, what is done with it.
pub type Continuation = Option<(Provenance, PathBuf, Reuse)>;

/// What others say when they have loaded the scene.
pub type Ready = std::result::Result<Provenance, String>;

/// How all render.
#[derive(Serialize, Deserialize)]
pub struct RenderSetup {
    pub settings: Settings,
    pub grain: BatchGrain,
    pub kept: AovSelection,
}

/// What all render next; the shares of all in the order of their ranks.
#[derive(Serialize, Deserialize)]
pub struct Round {
    /// The number of its first iteration and its counts, where a block begins.
    pub block: Option<(u64, Counts)>,
    pub schedule: Schedule,
    pub numbers: IterationSet,
}

/// What became of it.
#[derive(Default, Serialize, Deserialize)]
pub struct WorkerResult {
    pub sums: PartialRender,
    pub totals: Totals,
    /// Whether any was asked to end.
    pub is_interrupted: bool,
}

impl WorkerResult {
    pub fn add(&mut self, other: Self) -> Result<()> {
        self.totals.join(&other.totals);
        self.is_interrupted |= other.is_interrupted;
        self.sums.merge(other.sums)
    }
}

/// Renders the iterations `own`, until that is done or `is_over`; `told` hears of each with its number.
pub fn render_own(
    (prepared, renderer): (&LoadedScene, &mut Renderer),
    (own, schedule): (IterationSet, Schedule),
    is_over: impl Fn() -> bool,
    mut told: impl FnMut(&IterationReport, u64),
) {
    let count = own.count();
    renderer.assign(own);
    for _ in 0..count {
        let number = renderer.next_iteration();
        let measure = schedule.measure(renderer.block_iteration(), &renderer.block().counts);
        let report = prepared.threads.install(|| renderer.iterate(measure));
        told(&report, number);
        if is_over() {
            break;
        }
    }
}

/// All processes, led by this one.
pub struct MpiLeader<'a> {
    ranks: &'a dyn Ranks,
    exchange: Exchange,
    /// First iteration of the block that the others know of.
    known: Option<u64>,
    /// Iterations of each process in the next round.
    each: u64,
    /// Seconds of an iteration of one process.
    tau: f64,
    /// Seconds of the last exchange.
    adding: f64,
}

impl<'a> MpiLeader<'a> {
    /// Those of `ranks`, if they are several.
    pub fn new(ranks: &'a dyn Ranks) -> Option<Self> {
        let exchange = Exchange::default();
        (ranks.count() > 1).then_some(Self {
            ranks,
            exchange,
            known: None,
            each: 1,
            tau: 0.0,
            adding: 0.0,
        })
    }

    /// Lets all load the scene.
    pub fn begin(&self, begun: Continuation) -> Result<()> {
        self.ranks.broadcast(Some(begun)).map(|_| ())
    }

    /// Waits until all have; refuses those that have another scene or version.
    pub fn check_workers(&self, prepared: &LoadedScene) -> Result<()> {
        for rank in 1..self.ranks.count() {
            self.ranks.wait(rank);
            let ready: Ready = bdpm::mpi::decode(&self.ranks.receive(rank))?;
            let agrees = ready.and_then(|own| {
                own.check_agrees(&prepared.origin, Reuse::Merge).map_err(|e| e.to_string())
            });
            agrees.map_err(|problem| {
                let advice = "give all machines the same files and the same program";
                Error::new(format!("rank {rank}: {problem}"), advice)
            })?;
        }
        Ok(())
    }

    /// Tells all how to render.
    pub fn set_up(&self, setup: RenderSetup) -> Result<()> {
        self.ranks.broadcast(Some(setup)).map(|_| ())
    }

    /// Lets all render a share of the next iterations, and adds up what they have.
    pub fn round(
        &mut self,
        session: &mut Session,
        renderer: &mut Renderer,
        steer: &impl Steer,
    ) -> Result<()> {
        let all = renderer.assigned().clone();
        let numbers = self.numbers(session, renderer, steer);
        let block = renderer.block();
        let is_new = self.known.replace(block.first) != Some(block.first);
        let block = is_new.then(|| (block.first, block.counts.clone()));
        let schedule = steer.schedule();
        let own = numbers.share(0, self.ranks.count());
        let count = own.count();
        self.ranks.broadcast(Some(Some(Round { block, schedule, numbers })))?;
        let start = Instant::now();
        let (prepared, mut reports) = (session.prepared, Vec::new());
        let is_over = || session.is_interrupted();
        let told = |report: &IterationReport, number| reports.push((report.clone(), number));
        render_own((prepared, renderer), (own, schedule), is_over, told);
        reports.iter().for_each(|(report, number)| session.count(report, *number));
        if count > 0 {
            self.tau = start.elapsed().as_secs_f64() / reports.len() as f64;
        }
        renderer.assign(all);
        let before = self.exchange.adding.get();
        let haul = self.ranks.reduce(WorkerResult::default(), &self.exchange, WorkerResult::add)?;
        let WorkerResult { sums, totals, is_interrupted } = haul.unwrap_or_default();
        let adding = Instant::now();
        renderer.add_partial(sums)?;
        let adding = self.exchange.adding.get() + adding.elapsed();
        self.exchange.adding.set(adding);
        self.adding = (adding - before).as_secs_f64();
        session.totals.join(&totals);
        if is_interrupted {
            session.interrupt();
        }
        let (waiting, bytes) = (self.exchange.waiting.get(), self.exchange.bytes.get());
        session.shared = Shared { ranks: self.ranks.count(), waiting, adding, bytes };
        self.grow_round();
        Ok(())
    }

    /// Lets all end.
    pub fn shut_down(self) -> Result<()> {
        self.ranks.broadcast::<Option<Round>>(Some(None)).map(|_| ())
    }

    /// Rounds grow until the exchange takes its share.
    fn grow_round(&mut self) {
        let longest = LONGEST.max(LONGEST_SHARE * self.adding);
        let seconds = (ITERATE_SHARE * self.adding).min(longest);
        self.each = ((seconds / self.tau) as u64).clamp(1, GROWTH * self.each);
    }

    /// IterationSet of the next iterations: no more than the goal may still want.
    fn numbers(&self, session: &Session, renderer: &Renderer, steer: &impl Steer) -> IterationSet {
        let Goal { iterations, time, target, error, .. } = session.goal;
        let within = |seconds: f64| ((seconds / self.tau).round() as u64).max(1);
        let mut each = self.each;
        if let Some(time) = time
            && self.tau > 0.0
        {
            let left = time.saturating_sub(session.elapsed()).as_secs_f64();
            each = each.min(within(left - self.adding));
        }
        if let Some(forecast) = session.status.forecast
            && (target.is_some() || error.is_some())
            && self.tau > 0.0
        {
            each = each.min(within(TOWARD_TARGET * forecast.seconds));
        }
        let wanted = iterations.map_or(u64::MAX, |wanted| wanted - renderer.iterations());
        let range = IterationSet::from(steer.range(renderer.block().first));
        let count = each.saturating_mul(self.ranks.count().into()).min(wanted);
        renderer.remaining().within(&range).take(count)
    }
}
