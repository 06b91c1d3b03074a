//! A render by several processes, as rank 0 sees it. It decides what all of them render, in rounds that are long
//! enough that exchanging the sums takes a hundredth of the time.

use super::state::{RenderState, Totals};
use crate::adaptive::stopping::Stop;
use crate::base::error::{Error, Result};
use crate::base::iteration_set::IterationSet;
use crate::film::counts::Counts;
use crate::mpi;
use crate::mpi::{Exchange, Ranks};
use crate::noise::schedule::MeasureSchedule;
use crate::render::{IterationReport, PartialRender, RenderConfig, Renderer};
use crate::settings::Settings;
use crate::settings::provenance::{Provenance, Reuse};
use rayon::ThreadPool;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Time of iterations over the time of the exchange after them.
const ITERATE_SHARE: f64 = 100.0;

/// Longest round, seconds, so that the image is shown and checkpoints are written.
const LONGEST: f64 = 60.0;

/// Longest round over the time of one exchange, if that is more than [`LONGEST`].
const LONGEST_SHARE: f64 = 50.0;

/// Largest growth from one round to the next: the first rounds tell which counts are best.
const GROWTH: u64 = 4;

/// Largest share of the time that is left until a target that goes into one round.
const TOWARD_TARGET: f64 = 0.5;

/// Answer of a worker that prepared its scene: how it would make the image, or why it cannot.
pub(super) type Ready = std::result::Result<Provenance, String>;

/// How all processes render.
#[derive(Serialize, Deserialize)]
pub(super) struct RenderSetup {
    pub backend: String,
    pub settings: Settings,
    pub config: RenderConfig,
}

/// What all processes render next.
#[derive(Serialize, Deserialize)]
pub(super) struct Round {
    /// Number of the first iteration and counts of the block, if a block begins.
    pub block: Option<(u64, Counts)>,
    pub schedule: MeasureSchedule,
    /// Iterations of all processes; each takes its share by its rank.
    pub numbers: IterationSet,
}

/// Sums of a round.
#[derive(Default, Serialize, Deserialize)]
pub(super) struct WorkerResult {
    pub sums: PartialRender,
    pub totals: Totals,
    /// Whether any process was interrupted.
    pub is_interrupted: bool,
}

impl WorkerResult {
    pub fn add(&mut self, other: Self) -> Result<()> {
        self.totals.join(&other.totals);
        self.is_interrupted |= other.is_interrupted;
        self.sums.merge(other.sums)
    }
}

/// Renders the iterations `assigned` unless `is_over` ends that, and returns their reports with their numbers.
pub(super) fn render_assigned(
    threads: &ThreadPool,
    renderer: &mut Renderer,
    assigned: IterationSet,
    schedule: MeasureSchedule,
    is_over: impl Fn() -> bool,
) -> Vec<(IterationReport, u64)> {
    let count = assigned.count();
    renderer.assign(assigned);
    let mut reports = Vec::new();
    for _ in 0..count {
        let number = renderer.next_iteration();
        let measure = schedule.measure(renderer.block_iteration(), &renderer.block().counts);
        reports.push((threads.install(|| renderer.iterate(measure)), number));
        if is_over() {
            break;
        }
    }
    reports
}

/// Rank 0 of several processes.
pub(super) struct Leader<'a> {
    ranks: &'a dyn Ranks,
    exchange: Exchange,
    /// First iteration of the block that the workers know of.
    known_block: Option<u64>,
    /// Iterations of each process in the next round.
    each: u64,
    /// Seconds of an iteration of one process.
    iteration_time: f64,
    /// Seconds of the last exchange.
    adding: f64,
}

impl<'a> Leader<'a> {
    /// Leads `ranks`, if they are several.
    pub fn new(ranks: &'a dyn Ranks) -> Option<Self> {
        let exchange = Exchange::default();
        (ranks.count() > 1).then_some(Self {
            ranks,
            exchange,
            known_block: None,
            each: 1,
            iteration_time: 0.0,
            adding: 0.0,
        })
    }

    /// Waits until all workers have prepared the scene, and refuses those with another scene or version.
    pub fn check_workers(&self, provenance: &Provenance) -> Result<()> {
        // Settings and backend of a resumed image are known to rank 0 alone, which sends them with the setup.
        let Provenance { settings, backend, .. } = provenance;
        for rank in 1..self.ranks.count() {
            self.ranks.wait(rank);
            let ready: Ready = mpi::decode(&self.ranks.receive(rank))?;
            let agrees = ready.and_then(|worker| {
                let (settings, backend) = (settings.clone(), backend.clone());
                let worker = Provenance { settings, backend, ..worker };
                worker.check_agrees(provenance, Reuse::Merge).map_err(|e| e.to_string())
            });
            agrees.map_err(|problem| {
                let advice = "give all machines the same files and the same program";
                Error::new(format!("rank {rank}: {problem}"), advice)
            })?;
        }
        Ok(())
    }

    /// Sends all workers how to render.
    pub fn set_up(&self, made: &Provenance, config: RenderConfig) -> Result<()> {
        let (backend, settings) = (made.backend.clone(), made.settings.clone());
        self.ranks.broadcast(Some(RenderSetup { backend, settings, config })).map(|_| ())
    }

    /// Lets all processes render their shares of the next iterations, and adds up the sums. Returns the reports of
    /// this process; the work of the others is in the state's totals already.
    pub fn round(&mut self, state: &mut RenderState) -> Result<Vec<(IterationReport, u64)>> {
        let numbers = self.next_numbers(state);
        let schedule = state.policy.schedule();
        let renderer = &mut state.renderer;
        let all = renderer.assigned().clone();
        let block = renderer.block();
        let is_new = self.known_block.replace(block.first) != Some(block.first);
        let block = is_new.then(|| (block.first, block.counts.clone()));
        let assigned = numbers.share(0, self.ranks.count());
        self.ranks.broadcast(Some(Some(Round { block, schedule, numbers })))?;

        let start = Instant::now();
        let interrupt = &state.interrupt;
        let is_over = || interrupt.load(std::sync::atomic::Ordering::Relaxed);
        let reports = render_assigned(&state.threads, renderer, assigned, schedule, is_over);
        if !reports.is_empty() {
            self.iteration_time = start.elapsed().as_secs_f64() / reports.len() as f64;
        }
        renderer.assign(all);

        let before = self.exchange.adding.get();
        let reduced =
            self.ranks.reduce(WorkerResult::default(), &self.exchange, WorkerResult::add)?;
        let WorkerResult { sums, totals, is_interrupted } = reduced.unwrap_or_default();
        let adding = Instant::now();
        renderer.add_partial(sums)?;
        let adding = self.exchange.adding.get() + adding.elapsed();
        self.exchange.adding.set(adding);
        self.adding = (adding - before).as_secs_f64();
        state.totals.join(&totals);
        if is_interrupted {
            state.interrupt();
        }
        state.exchanged.waiting = self.exchange.waiting.get();
        state.exchanged.adding = adding;
        state.exchanged.bytes = self.exchange.bytes.get();
        self.grow_round();
        Ok(reports)
    }

    /// Ends all workers.
    pub fn shut_down(self) -> Result<()> {
        self.ranks.broadcast::<Option<Round>>(Some(None)).map(|_| ())
    }

    /// Lengthens the rounds until the exchange takes its share of the time.
    fn grow_round(&mut self) {
        let longest = LONGEST.max(LONGEST_SHARE * self.adding);
        let seconds = (ITERATE_SHARE * self.adding).min(longest);
        self.each = ((seconds / self.iteration_time) as u64).clamp(1, GROWTH * self.each);
    }

    /// Numbers of the next iterations of all processes: no more than the stop conditions may still want.
    fn next_numbers(&self, state: &RenderState) -> IterationSet {
        let Stop { iterations, time, target, error, .. } = state.stop;
        let renderer = &state.renderer;
        let within = |seconds: f64| ((seconds / self.iteration_time).round() as u64).max(1);
        let mut each = self.each;
        if let Some(time) = time
            && self.iteration_time > 0.0
        {
            let left = time.saturating_sub(state.elapsed()).as_secs_f64();
            each = each.min(within(left - self.adding));
        }
        if let Some(forecast) = state.status.forecast
            && (target.is_some() || error.is_some())
            && self.iteration_time > 0.0
        {
            each = each.min(within(TOWARD_TARGET * forecast.seconds));
        }
        let wanted = iterations.map_or(u64::MAX, |wanted| wanted - renderer.iterations());
        let range = IterationSet::from(state.policy.range(renderer.block().first));
        let count = each.saturating_mul(self.ranks.count().into()).min(wanted);
        renderer.remaining().within(&range).take(count)
    }
}
