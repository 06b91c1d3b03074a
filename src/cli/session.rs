//! What `render` and `analyze` have in common: from the first iteration to the last.

use super::denoising::Denoising;
use super::human_time;
use super::interrupts::catch_interrupts;
use super::loaded_scene::LoadedScene;
use super::mpi_leader::MpiLeader;
use super::progress::{Manner, Progress, Status, Totals};
use bdpm::adaptive::Steer;
use bdpm::adaptive::stopping::{Convergence, Goal, StoppedBy, importance};
use bdpm::base::error::Result;
use bdpm::output::denoise::Denoised;
use bdpm::render::block::CombinedImage;
use bdpm::render::{IterationReport, Renderer};
use bdpm::settings::Settings;
use serde::Serialize;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The part of the result that tells of the run.
#[derive(Serialize)]
pub struct RunReport<'a> {
    version: &'a str,
    scene: &'a str,
    fingerprint: String,
    backend: &'a str,
    pub threads: usize,
    /// Processes, each of so many threads, and bytes that the first received from others.
    pub ranks: u32,
    received_bytes: u64,
    settings: &'a Settings,
    /// Of the image, and of this run.
    pub iterations: u64,
    new_iterations: u64,
    pub stopped_by: StoppedBy,
    pub seconds: Seconds,
    /// Of this run.
    rays: u64,
    pub rays_per_second: f64,
    photons_per_iteration: f64,
    /// W/(m^2 sr).
    pub mean_luminance: f64,
    non_finite: u64,
}

/// Wall-clock times. `light`, `camera` and `merge` are busy thread-seconds over the threads of all processes.
#[derive(Default, Serialize)]
pub struct Seconds {
    load: f64,
    build: f64,
    light: f64,
    camera: f64,
    merge: f64,
    pub render: f64,
    write: f64,
    /// Of several processes: until the others had done their part, and until their sums were added.
    pub waiting: f64,
    pub adding: f64,
}

/// Relative growth of the time between two expectations that are remembered.
const REMEMBER_EVERY: f64 = 1.02;

/// A forecast of this run's rendering time.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Expectation {
    /// Rendering time when it was made, seconds.
    pub said_after: f64,
    /// Time in all that was expected, seconds.
    pub seconds: f64,
    /// Time that it took.
    pub took: f64,
}

/// Where an image stood at a time.
#[derive(Clone, Copy, Debug)]
pub struct Past {
    /// Rendering time of this run, seconds.
    pub seconds: f64,
    /// Relative variance: by what counts, of each pixel's luminance or of the mean.
    pub noise2: f64,
}

/// What is to be told of several processes.
#[derive(Clone, Copy, Debug, Default)]
pub struct Shared {
    pub ranks: u32,
    pub waiting: Duration,
    pub adding: Duration,
    /// Received by this one.
    pub bytes: u64,
}

/// Time between two looks at the whole image's noise, seconds, once some have passed.
const LOOK_EVERY: f64 = 0.5;

/// Before, the share of the time that passes between two.
const LOOK_SHARE: f64 = 0.02;

/// Share of the time that looks may take.
const LOOK_COST: f64 = 0.05;

/// Iterations under way.
pub struct Session<'a> {
    pub prepared: &'a LoadedScene,
    pub goal: Goal,
    /// Iterations of this run at the least, whatever the time.
    least: u64,
    pub progress: Progress,
    pub totals: Totals,
    pub status: Status,
    last_look: f64,
    /// What that took, seconds.
    look_took: f64,
    /// How the noise fell, at times that grow by [`REMEMBER_EVERY`].
    pub history: Vec<Past>,
    /// What was expected and when, at times that grow by [`REMEMBER_EVERY`].
    expectations: Vec<Expectation>,
    start: Instant,
    /// When iterating began.
    first: Instant,
    interrupted: &'static AtomicBool,
    /// Several processes, and the times of what they exchange.
    pub shared: Shared,
    /// The denoiser, if there is one, and what it made last.
    pub denoising: Option<Denoising>,
}

impl<'a> Session<'a> {
    /// Announces the start; `verb` is what is done to the scene, `counts` how.
    pub fn new(
        prepared: &'a LoadedScene,
        (goal, least): (Goal, u64),
        manner: Manner,
        (verb, counts): (&str, &str),
    ) -> Result<Self> {
        let progress = Progress::new(goal, manner);
        let interrupted = catch_interrupts(progress.clone())?;
        let Settings { width, height, .. } = prepared.origin.settings;
        progress.note(&format!("read {}", prepared.summary));
        progress.note(&format!(
            "{verb} {}: {width}x{height} pixels, {counts}, {} threads, {}",
            prepared.origin.scene,
            prepared.threads.current_num_threads(),
            prepared.accel.describe().name,
        ));
        let (totals, start) = (Totals::default(), Instant::now());
        Ok(Self {
            prepared,
            goal,
            least,
            progress,
            totals,
            status: Status::default(),
            last_look: 0.0,
            look_took: 0.0,
            history: Vec::new(),
            expectations: Vec::new(),
            start,
            first: start,
            interrupted,
            shared: Shared { ranks: 1, ..Shared::default() },
            denoising: None,
        })
    }

    /// Time since the first iteration began.
    pub fn elapsed(&self) -> Duration {
        self.start.elapsed()
    }

    /// Counts time that passed before.
    pub fn begun_at(self, start: Instant) -> Self {
        Self { start, ..self }
    }

    /// Takes note of the iteration of this number.
    pub fn count(&mut self, report: &IterationReport, number: u64) {
        self.totals.add(report);
        self.warn_of_bad_pixels(report, number);
    }

    /// Lets it end as Ctrl-C does.
    pub fn interrupt(&self) {
        self.interrupted.store(true, Ordering::Relaxed);
    }

    /// Whether the user wants it to end.
    pub fn is_interrupted(&self) -> bool {
        self.interrupted.load(Ordering::Relaxed)
    }

    /// Iterates up to the goal or an interrupt, or until `between` says why to end, which is called after every
    /// iteration but the last; with others, after every round of iterations that are shared with them.
    ///
    /// # Errors
    /// Those of `steer` and `between`.
    pub fn iterate<S: Steer>(
        &mut self,
        renderer: &mut Renderer,
        steer: &mut S,
        mut crew: Option<&mut MpiLeader>,
        mut between: impl FnMut(&mut Self, &Renderer, &S) -> Result<Option<StoppedBy>>,
    ) -> Result<StoppedBy> {
        loop {
            if let Some(reason) = self.finished(renderer) {
                return Ok(reason);
            }
            let elapsed = self.elapsed().as_secs_f64();
            let threads = &self.prepared.threads;
            let measure = threads.install(|| steer.steer(renderer, elapsed))?;
            if let Some(crew) = &mut crew {
                crew.round(self, renderer, steer)?;
            } else {
                let number = renderer.next_iteration();
                let report = threads.install(|| renderer.iterate(measure));
                self.count(&report, number);
            }
            self.look(renderer, steer);
            self.progress.update(&self.totals, &self.status, self.start.elapsed());
            if self.progress.is_orphan() {
                self.interrupt();
            }
            if self.is_interrupted() {
                return Ok(StoppedBy::Interrupt);
            }
            if let Some(reason) = between(self, renderer, steer)? {
                return Ok(reason);
            }
        }
    }

    /// Finds the error of the denoised image if it is time to; whether it is small enough.
    pub fn denoises_enough<'b>(
        &mut self,
        renderer: &Renderer,
        image: impl FnOnce() -> CombinedImage<'b>,
    ) -> Result<bool> {
        let (elapsed, goal) = (self.elapsed(), self.goal);
        let Some(denoising) = &mut self.denoising else { return Ok(false) };
        if !denoising.is_due(elapsed, renderer.iterations(), &goal) {
            return Ok(false);
        }
        let (threads, image) = (&self.prepared.threads, image());
        threads.install(|| denoising.denoise(renderer, &image))?;
        let reaches = denoising.reaches(elapsed, &goal);
        if let Some(error) = denoising.error() {
            let (relative, after) = (100.0 * error.relative(), elapsed.as_secs_f64());
            let after = human_time(after);
            self.progress.note(&format!("denoised after {after}: relative error {relative:.2} %"));
        }
        Ok(reaches)
    }

    /// Denoises the image at the end, with its error.
    pub fn denoise(&mut self, renderer: &Renderer, image: &CombinedImage) -> Result<()> {
        let threads = &self.prepared.threads;
        match &mut self.denoising {
            Some(denoising) => threads.install(|| denoising.denoise(renderer, image)),
            None => Ok(()),
        }
    }

    /// What was denoised last.
    pub fn denoised(&self) -> Option<&Denoised> {
        self.denoising.as_ref()?.latest.as_ref()
    }

    /// What the image looks like denoised, if it is to be.
    pub fn preview(
        &mut self,
        renderer: &Renderer,
        image: &CombinedImage,
    ) -> Result<Option<Denoised>> {
        let threads = &self.prepared.threads;
        let preview =
            |denoising: &mut Denoising| threads.install(|| denoising.preview(renderer, image));
        self.denoising.as_mut().map(preview).transpose()
    }

    /// Finds where the image stands. That takes a pass over its pixels, so not too often.
    fn look(&mut self, renderer: &Renderer, steer: &impl Steer) {
        self.status.iterations = renderer.iterations();
        let elapsed = self.elapsed().as_secs_f64();
        let pause = LOOK_EVERY.min(LOOK_SHARE * elapsed).max(self.look_took / LOOK_COST);
        if elapsed >= self.last_look + pause {
            self.look_closely(renderer, steer, elapsed);
        }
    }

    /// The same at once, after the last iteration.
    pub fn look_again(&mut self, renderer: &Renderer, steer: &impl Steer) {
        self.look_closely(renderer, steer, self.elapsed().as_secs_f64());
    }

    fn look_closely(&mut self, renderer: &Renderer, steer: &impl Steer, elapsed: f64) {
        self.last_look = elapsed;
        let entered = Instant::now();
        let (blocks, objective) = (renderer.blocks(), self.goal.objective);
        let standing = self.prepared.threads.install(|| {
            let importance = importance(blocks, objective);
            Convergence::new(blocks, steer.weights(blocks, &importance), &importance)
        });
        self.look_took = entered.elapsed().as_secs_f64();
        if standing.variance.is_none() && self.status.standing.is_some() {
            return; // A block's first iteration: what was known before is the better knowledge.
        }
        self.goal = standing.told(&self.goal);
        let pace = steer.pace(renderer, self.totals.iterations, elapsed);
        self.status.forecast = standing
            .per_iteration
            .zip(pace)
            .and_then(|(variance, tau)| standing.forecast(&self.goal, variance, tau, elapsed));
        self.remember(&standing, elapsed);
        self.status.standing = Some(standing);
        let last = self.expectations.last().map_or(0.0, |last| last.said_after);
        if let Some(forecast) = self.status.forecast
            && elapsed > last * REMEMBER_EVERY
        {
            let seconds = elapsed + forecast.seconds;
            self.expectations.push(Expectation { said_after: elapsed, seconds, took: 0.0 });
        }
    }

    fn remember(&mut self, standing: &Convergence, elapsed: f64) {
        let last = self.history.last().map_or(0.0, |last| last.seconds);
        if let Some(noise2) = standing.relative_variance(self.goal.objective)
            && elapsed > last * REMEMBER_EVERY
        {
            self.history.push(Past { seconds: elapsed, noise2 });
        }
    }

    /// What was expected when half of the time had passed.
    pub fn half_way(&self) -> Option<Expectation> {
        let took = self.start.elapsed().as_secs_f64();
        let half = self.expectations.iter().find(|expected| expected.said_after >= 0.5 * took)?;
        Some(Expectation { took, ..*half })
    }

    /// Why no further iteration is to be begun, if so.
    fn finished(&self, renderer: &Renderer) -> Option<StoppedBy> {
        let Goal { iterations, time, .. } = self.goal;
        let done = self.totals.iterations;
        if iterations.is_some_and(|wanted| renderer.iterations() >= wanted) {
            return Some(StoppedBy::Iterations);
        }
        if done < self.least {
            return None;
        }
        let standing = self.status.standing.as_ref();
        if standing.is_some_and(|now| now.is_good_enough(&self.goal)) {
            return Some(StoppedBy::Target);
        }
        // An iteration that would end past the time by more than half of its own is not begun.
        let elapsed = self.start.elapsed().as_secs_f64();
        // theory.md (92)
        let each = self.first.elapsed().as_secs_f64() / done.max(1) as f64;
        let half = 0.5 * each * f64::from(self.shared.ranks);
        let over = time.is_some_and(|time| elapsed + half > time.as_secs_f64());
        over.then_some(StoppedBy::Time)
    }

    /// Tells of the first pixel value that was left out, with what it takes to replay it.
    fn warn_of_bad_pixels(&self, report: &IterationReport, iteration: u64) {
        if let Some((x, y)) = report.non_finite.first()
            && self.totals.non_finite == report.non_finite.len() as u64
        {
            self.progress.note(&format!(
                "warning: pixel ({x}, {y}) was not finite in iteration {iteration} with seed {} \
                 and was left out\nhelp: please report this with the scene; further ones are \
                 counted only",
                self.prepared.origin.settings.seed
            ));
        }
    }

    /// What to report of the run, `write_time` being the time spent on writing files.
    pub fn report(
        &self,
        (iterations, mean_luminance): (u64, f64),
        stopped_by: StoppedBy,
        write_time: Duration,
    ) -> RunReport<'a> {
        let LoadedScene { threads, origin, load_time, build_time, .. } = self.prepared;
        let Totals { iterations: new, rays, photons, non_finite, times } = self.totals;
        let threads = threads.current_num_threads();
        let busy = |time: Duration| time.as_secs_f64() / threads as f64;
        RunReport {
            version: &origin.version,
            scene: &origin.scene,
            fingerprint: format!("{:016x}", origin.fingerprint),
            backend: &origin.backend,
            threads,
            ranks: self.shared.ranks,
            received_bytes: self.shared.bytes,
            settings: &origin.settings,
            iterations,
            new_iterations: new,
            stopped_by,
            seconds: Seconds {
                load: load_time.as_secs_f64(),
                build: build_time.as_secs_f64(),
                light: busy(times.light),
                camera: busy(times.camera),
                merge: busy(times.merge),
                render: times.wall.as_secs_f64(),
                write: write_time.as_secs_f64(),
                waiting: self.shared.waiting.as_secs_f64(),
                adding: self.shared.adding.as_secs_f64(),
            },
            rays,
            rays_per_second: self.totals.rays_per_second(),
            photons_per_iteration: photons as f64 / new.max(1) as f64,
            mean_luminance,
            non_finite,
        }
    }
}
