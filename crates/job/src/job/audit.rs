//! The audit of a job's image: when it is rendered, and what follows from it. theory.md, section
//! 22b.

use super::audit_report::{AuditReport, Verdict};
use super::state::RenderState;
use super::step::Step;
use bdpm_auto::adaptive::error_interval::SquaredPart;
use bdpm_auto::adaptive::stopping::Stop;
use bdpm_auto::adaptive::technique::TimeShare;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::film::counts::Counts;
use bdpm_core::render::Renderer;
use bdpm_core::render::audit::{AuditSums, Auditor, brightest_path};
use rayon::ThreadPool;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Share of the rendering time that an audit takes, unless a job has a share of its own.
pub const DEFAULT_SHARE: f64 = 0.05;

/// Shares of the rendering time after which the audit is compared with the image, beside the end.
const LOOKS: [f64; 4] = [0.125, 0.25, 0.4, 0.7];

/// Share of the rendering time until which a refuted image starts again. Later, it ends with the
/// larger error.
const LAST_RESTART: f64 = 0.45;

/// A refuted image starts again if its squared difference exceeds this share of the squared error
/// at the end.
const WORTHWHILE: f64 = 0.5;

/// Maximum number of times that an image starts again.
const MAX_RESTARTS: u64 = 2;

/// Smallest relative difference for which an image starts again.
const LEAST_DIFFERENCE: f64 = 0.01;

/// Maximum number of steps of an audit after an iteration of the image.
const MAX_STEPS: u64 = 64;

/// Time of a path before any was measured, seconds.
const TIME_PER_PATH: f64 = 1e-6;

/// How an audit shares the time with the image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct AuditPace {
    /// Share of the audit.
    pub share: f64,
    /// The share is that of the time, not that of the paths. Audits at fixed path counts follow the
    /// paths, so that equal iterations of the image have equal audits.
    pub is_timed: bool,
}

/// The audit of an image that is being rendered.
pub struct Audit {
    auditor: Auditor,
    pace: AuditPace,
    /// Start of the image, and time of the audit since then.
    started: Instant,
    busy: Duration,
    last_step: Duration,
    /// Number of times that the image started again.
    restarts: u64,
    /// Number of looks at the image.
    looks: usize,
    /// The largest luminance that a path is likely to find.
    brightest: f64,
}

impl AuditPace {
    /// The pace of the audit of a job; `share` is that of its options. `None` if the job has none.
    pub fn new(share: Option<f64>, is_automatic: bool) -> Option<Self> {
        // Without a choice of settings, nothing but the reported error would depend on the audit.
        let share = share.unwrap_or(if is_automatic { DEFAULT_SHARE } else { 0.0 });
        (share > 0.0).then_some(Self { share, is_timed: is_automatic })
    }
}

impl Audit {
    /// Prepares to audit the image of a renderer. `None` if that is not possible: see
    /// [`Auditor::new`].
    ///
    /// # Errors
    /// Those of [`Auditor::new`].
    pub(super) fn new(renderer: &Renderer, pace: AuditPace) -> Result<Option<Self>> {
        let auditor = Auditor::new(renderer)?;
        Ok(auditor.map(|auditor| Self {
            last_step: Duration::from_secs_f64(TIME_PER_PATH * auditor.paths_per_step()),
            auditor,
            pace,
            started: Instant::now(),
            busy: Duration::ZERO,
            restarts: 0,
            looks: 0,
            brightest: brightest_path(renderer.scene_and_accel().0),
        }))
    }

    /// The audit with the sums of an earlier run.
    #[must_use]
    pub(super) fn resumed(mut self, sums: Option<&AuditSums>) -> Self {
        if let Some(sums) = sums {
            self.auditor.add(sums);
        }
        self
    }

    /// The sums so far.
    pub fn sums(&self) -> &AuditSums {
        self.auditor.sums()
    }

    /// Share of the rendering time that the audit took.
    pub fn share_of_time(&self) -> f64 {
        self.busy.as_secs_f64() / self.started.elapsed().as_secs_f64().max(1e-9)
    }

    /// Time that its paths took.
    pub(super) fn time_of_paths(&self) -> Duration {
        self.busy
    }

    /// Takes the sums of this process, to add them to those of another.
    pub(super) fn take_sums(&mut self) -> AuditSums {
        self.auditor.take_sums()
    }

    /// Adds the sums of another process.
    pub(super) fn add(&mut self, sums: &AuditSums) {
        self.auditor.add(sums);
    }

    /// Renders the steps that are due after the iteration `number` of the image with these path
    /// counts.
    pub(super) fn after_iteration(
        &mut self,
        threads: &ThreadPool,
        number: u64,
        (counts, pixels): (&Counts, usize),
    ) {
        let steps = match self.pace.is_timed {
            true => MAX_STEPS,
            false => {
                let camera_paths = counts.camera_paths.mean() * pixels as f64;
                let paths = f64::from(counts.light_paths) + camera_paths;
                steps_after(number, self.pace.share * paths / self.auditor.paths_per_step())
            }
        };
        for step in 0..steps {
            let allowed = self.started.elapsed().mul_f64(self.pace.share);
            if self.pace.is_timed && self.busy + self.last_step > allowed {
                return;
            }
            let start = Instant::now();
            // Numbers of iterations are below 2^48, and an image starts again a few times at most.
            let number = (self.restarts << 48 | number) * MAX_STEPS + step;
            threads.install(|| self.auditor.step(number));
            self.last_step = start.elapsed();
            self.busy += self.last_step;
        }
    }
}

/// Number of steps after an iteration of the image, if `rate` of them are due in each.
fn steps_after(number: u64, rate: f64) -> u64 {
    let until = |iterations: u64| (iterations as f64 * rate) as u64;
    (until(number + 1) - until(number)).min(MAX_STEPS)
}

/// What follows from a look at the audit.
pub(super) enum Outcome {
    /// Nothing.
    Nothing,
    /// The image starts again, for this reason.
    Restarted(String),
    /// The error of the image is larger than its own estimates. The warning says so.
    Warned(String),
}

impl RenderState {
    /// Compares the image with its audit so far; `None` if there is no audit, or before both have
    /// enough samples.
    pub fn audit_report(&self) -> Option<AuditReport> {
        let audit = self.audit.as_ref()?;
        let image = self.image();
        let audited = audit.sums().compare(&image, audit.brightest)?;
        let own = self.stop.without_difference();
        let convergence = self.status.convergence.as_ref();
        let bias = convergence.map_or(SquaredPart { value: own.bias2, deviation: 0.0 }, |known| {
            known.squared_bias(&own)
        });
        let looks = LOOKS.len() as u32 + 1;
        let place = (&**self.renderer.scene_and_accel().0, &**self.renderer.scene_and_accel().1);
        let settings = self.renderer.settings();
        let share = audit.share_of_time();
        let report = AuditReport::new(&audited, bias, looks, share, (place, settings));
        Some(report.with_unseen(self.unseen_light().map(|light| light.describe())))
    }

    /// Looks at the audit if that is due.
    ///
    /// # Errors
    /// If the image cannot start again. It is kept.
    pub(super) fn look_at_audit(&mut self) -> Result<Outcome> {
        let elapsed = self.elapsed().as_secs_f64();
        let (_, fraction) = self.status.time_left(&self.stop, elapsed);
        let Some(audit) = &mut self.audit else { return Ok(Outcome::Nothing) };
        if LOOKS.get(audit.looks).is_none_or(|look| fraction < *look) {
            return Ok(Outcome::Nothing);
        }
        // A long iteration may pass several of them.
        audit.looks = LOOKS.iter().filter(|look| fraction >= **look).count();
        let start = Instant::now();
        let outcome = self.attempt(Step::Audit, |state| {
            let threads = Arc::clone(&state.threads);
            let Some(report) = threads.install(|| state.audit_report()) else {
                return Ok(Outcome::Nothing);
            };
            state.apply_audit(&report);
            if report.verdict != Verdict::Differs {
                return Ok(Outcome::Nothing);
            }
            if fraction < LAST_RESTART && state.start_without_refuted(&report)? {
                let finding = report.finding().unwrap_or_default();
                let technique = state.selection.as_ref().map(|own| own.best().technique.describe());
                let technique = technique.unwrap_or_default();
                return Ok(Outcome::Restarted(format!(
                    "{finding}; it starts again with {technique}"
                )));
            }
            Ok(Outcome::Warned(report.warning().unwrap_or_default()))
        });
        self.clock.spent.audit += start.elapsed();
        outcome
    }

    /// Lets the difference count as an error of the image, if there is one.
    pub(super) fn apply_audit(&mut self, report: &AuditReport) {
        let difference = report.error();
        self.stop = Stop { difference, ..self.stop.without_difference() };
    }

    /// Starts again with another technique, if a difference of this size is worth it and there is
    /// another one.
    fn start_without_refuted(&mut self, report: &AuditReport) -> Result<bool> {
        let Some(convergence) = &self.status.convergence else { return Ok(false) };
        let left = self.status.forecast.map_or(1.0, |forecast| forecast.left);
        let own = convergence.error(&self.stop.without_difference(), left).unwrap_or(0.0);
        let least = (WORTHWHILE * own * own).max(LEAST_DIFFERENCE.powi(2));
        let is_over = self.audit.as_ref().is_none_or(|audit| audit.restarts >= MAX_RESTARTS);
        if is_over || report.square < least {
            return Ok(false);
        }
        let elapsed = self.elapsed().as_secs_f64();
        let time = TimeShare {
            done: self.clock.rendering_time(),
            left: self.stop.time.map(|time| (time.as_secs_f64() - elapsed).max(0.0)),
        };
        let Some(selection) = self.selection.clone() else { return Ok(false) };
        let Some(others) = &mut self.alternatives else { return Ok(false) };
        let Some(again) = others.without_refuted(&selection, time, report.square.sqrt()) else {
            return Ok(false);
        };
        self.start_again(again)?;
        self.stop.difference = None;
        if let Some(audit) = &mut self.audit {
            audit.restarts += 1;
        }
        if !self.provenance.settings.has_photons() {
            self.audit = None; // Path tracing would audit itself.
        }
        Ok(true)
    }

    /// The report of the final image.
    pub(super) fn finish_audit(&mut self) -> Option<AuditReport> {
        let (threads, start) = (Arc::clone(&self.threads), Instant::now());
        let done = self.attempt(Step::Audit, |state| {
            let report = threads.install(|| state.audit_report());
            if let Some(report) = &report {
                state.apply_audit(report);
            }
            Ok(report)
        });
        self.clock.spent.audit += start.elapsed();
        done.unwrap_or_else(|error: Error| {
            self.failure.get_or_insert(error);
            None
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_of_all_iterations_have_the_rate() {
        for rate in [0.01, 0.3, 1.0, 2.7, 63.9] {
            let all: u64 = (0..1000).map(|number| steps_after(number, rate)).sum();
            assert_eq!(all, (1000.0 * rate) as u64, "{rate}");
        }
    }

    #[test]
    fn images_with_fixed_counts_are_audited_only_if_asked() {
        assert_eq!(AuditPace::new(None, false), None);
        assert_eq!(AuditPace::new(Some(0.0), true), None);
        let pace = |share, is_automatic| AuditPace::new(share, is_automatic).unwrap();
        assert_eq!(pace(None, true), AuditPace { share: 0.05, is_timed: true });
        assert_eq!(pace(Some(0.1), false), AuditPace { share: 0.1, is_timed: false });
    }
}
