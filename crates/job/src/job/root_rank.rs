//! Rank 0 of several processes. It assigns iterations to all of them, in rounds so long that the
//! exchange of the sums takes a hundredth of the time.

use super::audit::{Audit, AuditPace};
use super::state::RenderState;
use super::status::Totals;
use crate::mpi;
use crate::mpi::{Exchange, Ranks};
use bdpm_auto::adaptive::stopping::Stop;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::iteration_set::IterationSet;
use bdpm_core::film::counts::Counts;
use bdpm_core::noise::schedule::MeasureSchedule;
use bdpm_core::render::audit::AuditSums;
use bdpm_core::render::{IterationReport, PartialRender, RenderConfig, Renderer};
use bdpm_core::settings::Settings;
use bdpm_core::settings::provenance::{Provenance, Reuse};
use rayon::ThreadPool;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Ratio of the time of a round to the time of the exchange after it.
const ROUND_RATIO: f64 = 100.0;

/// Maximum time of a round, seconds, so that the image is shown and checkpoints are written.
const MAX_ROUND: f64 = 60.0;

/// Maximum ratio of a round to one exchange, if that is longer than [`MAX_ROUND`].
const MAX_ROUND_RATIO: f64 = 50.0;

/// Maximum growth from one round to the next, since the choice of path counts needs the results of
/// short rounds.
const MAX_GROWTH: u64 = 4;

/// Maximum share of a round in the remaining time until a target.
const MAX_TARGET_SHARE: f64 = 0.5;

/// Answer of a worker that loaded its scene: the provenance of its image, or an error.
pub(super) type Ready = std::result::Result<Provenance, String>;

/// Settings of all processes.
#[derive(Serialize, Deserialize)]
pub(super) struct RenderSetup {
    pub backend: String,
    pub settings: Settings,
    pub config: RenderConfig,
    pub audit: Option<AuditPace>,
}

/// The next round of iterations.
#[derive(Serialize, Deserialize)]
pub(super) struct Round {
    /// First iteration and path counts of a new block, if one starts.
    pub block: Option<(u64, Counts)>,
    pub schedule: MeasureSchedule,
    /// Iterations of all processes. Each process renders a share of them by its rank.
    pub numbers: IterationSet,
}

/// Sums of a round.
#[derive(Default, Serialize, Deserialize)]
pub(super) struct WorkerResult {
    pub sums: PartialRender,
    pub totals: Totals,
    /// True if any process was interrupted.
    pub is_interrupted: bool,
    /// Error of a process that could not render its iterations.
    pub failure: Option<String>,
    /// Sums of the audits.
    pub audit: Option<AuditSums>,
}

impl WorkerResult {
    pub fn add(&mut self, other: Self) -> Result<()> {
        self.totals.join(&other.totals);
        self.is_interrupted |= other.is_interrupted;
        self.failure = self.failure.take().or(other.failure);
        match (&mut self.audit, other.audit) {
            (Some(own), Some(other)) => own.merge(&other),
            (own @ None, other) => *own = other,
            (Some(_), None) => {}
        }
        self.sums.merge(other.sums)
    }
}

/// Renders the `assigned` iterations and their part of the `audit` until `is_over` returns true.
/// Returns their reports and numbers.
pub(super) fn render_assigned(
    threads: &ThreadPool,
    (renderer, mut audit): (&mut Renderer, Option<&mut Audit>),
    assigned: IterationSet,
    schedule: MeasureSchedule,
    is_over: impl Fn() -> bool,
) -> Vec<(IterationReport, u64)> {
    let count = assigned.count();
    renderer.assign(assigned);
    let mut reports = Vec::new();
    for _ in 0..count {
        let number = renderer.next_iteration();
        let measure = schedule.measure(
            renderer.block_iteration(),
            &renderer.block().counts,
            renderer.settings(),
        );
        reports.push((threads.install(|| renderer.iterate(measure)), number));
        if let Some(audit) = &mut audit {
            let counts = (&renderer.block().counts, renderer.settings().pixels());
            audit.after_iteration(threads, number, counts);
        }
        if is_over() {
            break;
        }
    }
    reports
}

/// Rank 0 of several processes.
pub(super) struct RootRank<'a> {
    ranks: &'a dyn Ranks,
    exchange: Exchange,
    /// First iteration of the block that the workers render.
    known_block: Option<u64>,
    /// Iterations of each process in the next round.
    each: u64,
    /// Seconds of an iteration of one process.
    iteration_time: f64,
    /// Seconds of the last exchange.
    adding: f64,
    stage: Stage,
}

/// What the workers wait for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Setup,
    Round,
    Nothing,
}

impl<'a> RootRank<'a> {
    /// The root of `ranks`; `None` for a single process.
    pub fn new(ranks: &'a dyn Ranks) -> Option<Self> {
        let exchange = Exchange::default();
        (ranks.count() > 1).then_some(Self {
            ranks,
            exchange,
            known_block: None,
            each: 1,
            iteration_time: 0.0,
            adding: 0.0,
            stage: Stage::Setup,
        })
    }

    /// Waits until all workers have loaded the scene. Refuses workers with another scene or
    /// version.
    pub fn check_workers(&self, provenance: &Provenance) -> Result<()> {
        // Only rank 0 knows the settings and backend of a resumed image. It sends them with the
        // setup.
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

    /// Sends the setup to all workers.
    pub fn set_up(
        &mut self,
        provenance: &Provenance,
        config: RenderConfig,
        audit: Option<AuditPace>,
    ) -> Result<()> {
        let (backend, settings) = (provenance.backend.clone(), provenance.settings.clone());
        self.stage = Stage::Round;
        let setup = RenderSetup { backend, settings, config, audit };
        self.ranks.broadcast(Some(Some(setup))).map(|_| ())
    }

    /// Renders one round on all processes and adds up their sums. Returns the reports of this
    /// process. The work of the others is added to the totals of the state.
    pub fn round(&mut self, state: &mut RenderState) -> Result<Vec<(IterationReport, u64)>> {
        let numbers = self.next_numbers(state);
        let schedule = state.policy.schedule(&state.renderer);
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
        let reports = render_assigned(
            &state.threads,
            (renderer, state.audit.as_mut()),
            assigned,
            schedule,
            is_over,
        );
        if !reports.is_empty() {
            self.iteration_time = start.elapsed().as_secs_f64() / reports.len() as f64;
        }
        renderer.assign(all);

        let before = self.exchange.adding.get();
        let reduced =
            self.ranks.reduce(WorkerResult::default(), &self.exchange, WorkerResult::add)?;
        let WorkerResult { sums, totals, is_interrupted, failure, audit } =
            reduced.unwrap_or_default();
        if let (Some(own), Some(others)) = (&mut state.audit, audit) {
            own.add(&others);
        }
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
        if let Some(failure) = failure {
            let advice = "the image has the iterations of the other ranks";
            let failure = Error::new(format!("a rank stopped: {failure}"), advice);
            state.failure.get_or_insert(failure);
        }
        Ok(reports)
    }

    /// Ends all workers that were not ended before.
    pub fn dismiss(&mut self) -> Result<()> {
        match std::mem::replace(&mut self.stage, Stage::Nothing) {
            Stage::Setup => self.ranks.broadcast::<Option<RenderSetup>>(Some(None)).map(|_| ()),
            Stage::Round => self.ranks.broadcast::<Option<Round>>(Some(None)).map(|_| ()),
            Stage::Nothing => Ok(()),
        }
    }

    /// Makes the next round longer, until the exchange takes only its share of the time.
    fn grow_round(&mut self) {
        let max = MAX_ROUND.max(MAX_ROUND_RATIO * self.adding);
        let seconds = (ROUND_RATIO * self.adding).min(max);
        self.each = ((seconds / self.iteration_time) as u64).clamp(1, MAX_GROWTH * self.each);
    }

    /// The next iterations of all processes, within the stop conditions.
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
            each = each.min(within(MAX_TARGET_SHARE * forecast.seconds));
        }
        let wanted = iterations.map_or(u64::MAX, |wanted| wanted - renderer.iterations());
        let range = IterationSet::from(state.policy.range(renderer.block().first));
        let count = each.saturating_mul(self.ranks.count().into()).min(wanted);
        renderer.remaining().within(&range).take(count)
    }
}
