//! The phases of a job before its loop: plan -> prepare -> choose -> hand over.

use super::audit::{Audit, AuditPace};
use super::denoise_mode::Denoise;
use super::root_rank::RootRank;
use super::run_clock::RunClock;
use super::shard::ShardIterations;
use super::state::RenderState;
use super::status::{Exchanged, Status, Totals};
use super::{Denoising, Event, Prepared, RenderJob, RenderResult, Start};
use super::{check_time, iterate, near_layers, pilot_end, reduced_size};
use crate::mpi::Ranks;
use bdpm_auto::adaptive::stopping::Stop;
use bdpm_auto::adaptive::technique;
use bdpm_auto::adaptive::technique::{Alternatives, Selection, VISIBLE_NOISE};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::render::{RenderConfig, Renderer};
use bdpm_core::settings::combinations;
use std::ops::ControlFlow;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Least share of the given time for rendering where the denoiser takes longer than the rest.
const LEAST_RENDERING: f64 = 0.5;

/// Maximum share of the given time for a denoiser that nobody asked for: few iterations need it
/// more than twice as many would.
const MOST_DENOISING: f64 = 0.4;

fn takes_too_long(denoising: &Denoising, stop: &Stop) -> bool {
    stop.time.is_some_and(|time| denoising.reserve() > time.mul_f64(MOST_DENOISING))
}

/// A job between its phases.
pub(super) struct Run {
    /// Scene, settings and threads.
    pub prepared: Prepared,
    is_automatic: bool,
    /// The conditions of the loop: their time is without what follows it.
    stop: Stop,
    /// The iterations of the shard, if the job renders one.
    iterations: Option<ShardIterations>,
    pub denoising: Option<Denoising>,
    /// Why a denoiser that might pay cannot run.
    without_denoiser: Option<Error>,
    /// Time for the caller's work after the render.
    reserve: Duration,
    pub config: RenderConfig,
    selection: Option<Selection>,
    alternatives: Option<Alternatives>,
    /// Width and height that were asked for, if the image has fewer pixels.
    pub full_size: Option<(u32, u32)>,
}

impl RenderJob {
    /// Renders as the only process, or as that which leads the others.
    pub(super) fn run_root(
        mut self,
        ranks: &dyn Ranks,
        root: &mut Option<RootRank>,
        observer: &mut impl FnMut(Event) -> ControlFlow<()>,
    ) -> Result<RenderResult> {
        let start = self.started.unwrap_or_else(Instant::now);
        if self.stop.time.is_some_and(|time| time.is_zero()) {
            let advice = "give a time above 0, or a number of iterations";
            return Err(Error::new("nothing can be rendered in a time of 0", advice));
        }
        let prepared = self.prepare()?;
        if let Some(root) = root {
            root.check_workers(&prepared.provenance)?;
        }
        let mut run = self.planned_run(prepared, ranks)?;
        let renderer = self.first_renderer(&mut run, observer)?;
        let mut renderer = self.reduce_size(&mut run, renderer, start)?;
        self.divide_time(&mut run);
        if let (Some(full), Some(time)) = (run.full_size, self.stop.time) {
            let size = run.prepared.provenance.settings.resolution();
            let _ = observer(Event::Warning(reduced_size::warning(time, size, full)));
        }
        if run.is_automatic && matches!(self.start, Start::New) {
            renderer = self.choose(&mut run, renderer, root.is_none(), observer)?;
        }
        self.check_given_time(&run, observer)?;
        let state = self.hand_over(run, renderer, root, start)?;
        iterate::run(state, root, observer)
    }

    /// Divides the time, and checks what needs no renderer.
    fn planned_run(&mut self, prepared: Prepared, ranks: &dyn Ranks) -> Result<Run> {
        let Prepared { scene, threads, provenance, .. } = &prepared;
        let settings = &provenance.settings;
        let mut stop = self.stop_with_default();
        combinations::check(&self.asked(scene, settings, ranks))?;
        let iterations = self.shard_iterations(&stop)?;
        if let Some(iterations) = &iterations {
            stop.iterations = Some(iterations.assigned.count());
        }
        let (mut denoising, mut without_denoiser) = (None, None);
        if self.denoise == Denoise::IfNoisy && !self.is_timed_picture(scene) {
            self.denoise = Denoise::Never;
        }
        if self.denoises() {
            let threads = threads.current_num_threads();
            let interrupt = Arc::clone(&self.interrupt);
            match Denoising::new(threads, settings.resolution(), &stop, interrupt) {
                Ok(new) if self.denoise == Denoise::IfNoisy && takes_too_long(&new, &stop) => {
                    self.denoise = Denoise::Never;
                }
                Ok(new) => denoising = Some(new),
                Err(error) if self.denoise == Denoise::Always || error.is_interrupt() => {
                    return Err(error);
                }
                Err(error) => {
                    self.denoise = Denoise::Never;
                    without_denoiser = Some(error);
                }
            }
        }
        Ok(Run {
            prepared,
            is_automatic: self.is_automatic(),
            stop,
            iterations,
            denoising,
            without_denoiser,
            reserve: Duration::ZERO,
            config: RenderConfig { ranks: ranks.count(), ..RenderConfig::default() },
            selection: None,
            alternatives: None,
            full_size: None,
        })
    }

    /// Leaves time for what follows the iterations.
    fn divide_time(&self, run: &mut Run) {
        let pixels = run
            .full_size
            .map_or(run.prepared.provenance.settings.pixels(), |(w, h)| w as usize * h as usize);
        run.reserve = self.reserve(pixels, run.full_size.is_some());
        if let Some(time) = &mut run.stop.time {
            let denoising = run.denoising.as_ref().map_or(Duration::ZERO, Denoising::reserve);
            // Half of a time that the denoiser alone would take is left for the image.
            let least = time.mul_f64(LEAST_RENDERING);
            *time = time.saturating_sub(denoising).max(least).saturating_sub(run.reserve);
        }
    }

    /// The renderer of the settings before any choice.
    fn first_renderer(
        &self,
        run: &mut Run,
        observer: &mut impl FnMut(Event) -> ControlFlow<()>,
    ) -> Result<Renderer> {
        let Prepared { scene, accel, threads, provenance, .. } = &mut run.prepared;
        let has_choice = scene.lights().has_choice();
        if run.is_automatic && has_choice && matches!(self.start, Start::New) {
            provenance.settings.light_visibility =
                self.visibility_rays(scene, &provenance.settings, self.stop.time);
        }
        let new = || {
            Renderer::new(scene, accel, provenance.settings.clone())
                .map(|new| new.interrupted_by(Arc::clone(&self.interrupt)))
        };
        let renderer = threads.install(new)?.configure(run.config)?;
        if let Some(warning) = near_layers::warning(scene, &**accel, &provenance.settings) {
            let _ = observer(Event::Warning(warning));
        }
        for pair in scene.near_faces(&**accel) {
            let _ = observer(Event::Warning(pair.describe()));
        }
        Ok(renderer)
    }

    /// Lets the pilot choose settings, and returns their renderer.
    fn choose(
        &mut self,
        run: &mut Run,
        renderer: Renderer,
        is_alone: bool,
        observer: &mut impl FnMut(Event) -> ControlFlow<()>,
    ) -> Result<Renderer> {
        let free = self.chosen_parameters();
        let Prepared { threads, provenance, .. } = &mut run.prepared;
        let _ = observer(Event::Choosing(free, provenance));
        let (end, denoises) = (pilot_end(&run.stop), run.denoising.is_some());
        let (chosen, alternatives) =
            threads.install(|| technique::choose(&renderer, free, end, denoises))?;
        let (noise, pays) = (alternatives.noise_before_denoising(), alternatives.is_denoised());
        // Workers know only the settings of the start.
        run.alternatives = (free.any() && is_alone).then_some(alternatives);
        provenance.settings = chosen.apply(&provenance.settings);
        run.stop = run.stop.with_pilot_bias2(chosen.best().bias.powi(2));
        if let (Some(time), Some(unused)) = (&mut run.stop.time, &run.denoising)
            && !(unused.can_pay(noise) && (pays || self.denoise == Denoise::Always))
        {
            *time += unused.reserve();
            run.denoising = None;
            let is_asked = self.denoise == Denoise::Always;
            self.denoise = Denoise::Never;
            if is_asked {
                let noise = 100.0 * noise;
                let reason = format!("the noise will be {noise:.1} % without it");
                let warning = format!("the image will not be denoised: {reason}");
                let _ = observer(Event::Warning(warning));
            }
        }
        if let Some(error) = run.without_denoiser.take().filter(|_| noise > VISIBLE_NOISE) {
            let warning = format!("the image will be noisy, and is not denoised: {error}");
            let _ = observer(Event::Warning(warning));
        }
        let settings = provenance.settings.clone();
        let renderer = threads.install(|| renderer.with_settings(settings))?;
        run.selection = Some(chosen);
        Ok(renderer)
    }

    /// Checks that the first iterations fit in the time, if they are fixed.
    fn check_given_time(
        &self,
        run: &Run,
        observer: &mut impl FnMut(Event) -> ControlFlow<()>,
    ) -> Result<()> {
        let Prepared { scene, accel, threads, provenance, .. } = &run.prepared;
        let (Some(time), Some(counts)) = (self.stop.time, self.fixed_counts(provenance)) else {
            return Ok(());
        };
        let needed = (self.min_iterations, &counts);
        let check = || check_time(scene, accel, &provenance.settings, time, needed);
        if let Some(warning) = threads.install(check)? {
            let _ = observer(Event::Warning(warning));
        }
        Ok(())
    }

    /// Configures renderer and workers for the loop.
    fn hand_over(
        mut self,
        run: Run,
        renderer: Renderer,
        root: &mut Option<RootRank>,
        start: Instant,
    ) -> Result<RenderState> {
        let Run { prepared, is_automatic, mut stop, iterations, mut config, selection, .. } = run;
        let Prepared { scene, accel, threads, provenance, build_time } = prepared;
        config.grain = self.batch_grain(&provenance.settings)?;
        let pace = AuditPace::new(self.audit, is_automatic);
        config.aovs = self.kept_aovs(&provenance.settings, pace);
        let mut renderer = renderer.configure(config)?;
        if let Some(iterations) = &iterations {
            renderer.assign(iterations.assigned.clone());
        }
        let times = self.time_model(&provenance)?;
        let choice = (&mut stop, selection.as_ref());
        let policy = self.policy(&mut renderer, choice, times, iterations.as_ref())?;
        if let Some(root) = root {
            root.set_up(&provenance, *renderer.config(), pace)?;
        }
        let earlier = self.audited.take();
        let audit = pace.map(|pace| threads.install(|| Audit::new(&renderer, pace))).transpose()?;
        let regions = scene.regions.iter();
        let regions = regions.filter_map(|region| region.within(&provenance.settings)).collect();
        Ok(RenderState {
            provenance,
            accel_name: accel.describe().name,
            build_time,
            earlier: policy.state(0.0).map_or(0.0, |state| state.elapsed),
            renderer,
            policy,
            stop,
            is_automatic,
            selection,
            alternatives: run.alternatives,
            denoising: run.denoising,
            audit: audit.flatten().map(|audit| audit.resumed(earlier.as_ref())),
            has_warned_of_audit: false,
            full_size: run.full_size,
            sharded: iterations.map(|iterations| iterations.sharded),
            regions,
            totals: Totals::default(),
            status: Status::default(),
            history: Vec::new(),
            exchanged: Exchanged::new(config.ranks),
            interrupt: self.interrupt,
            threads,
            latest: Mutex::default(),
            failure: None,
            planted: self.planted,
            clock: RunClock::new(start, self.min_iterations, run.reserve),
        })
    }
}
