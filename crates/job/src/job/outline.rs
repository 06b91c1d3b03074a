//! Outline of a job: what it would render, without rendering.

use super::audit::AuditPace;
use super::denoise_mode::Denoise;
use super::{Denoising, Prepared, RenderJob, Start, check_time};
use crate::mpi::{Ranks, SingleProcess};
use bdpm_auto::adaptive::plan::Plan;
use bdpm_auto::adaptive::stopping::Stop;
use bdpm_auto::adaptive::technique::FreeParameters;
use bdpm_auto::adaptive::time_probe;
use bdpm_auto::timing::TimeModel;
use bdpm_core::base::error::Result;
use bdpm_core::base::memory::available_memory;
use bdpm_core::render::{MemoryNeed, check_has_light};
use bdpm_core::settings::combinations;
use bdpm_core::settings::provenance::Provenance;
use std::sync::Arc;

/// Outline of a job.
#[derive(Clone, Debug)]
pub struct JobOutline {
    /// Scene, settings and backend. Settings that are chosen have their values before the choice.
    pub provenance: Provenance,
    /// Settings that a pilot would choose; `None` if it does not run.
    pub pilot: Option<FreeParameters>,
    /// True if the path counts are chosen during the render.
    pub is_automatic: bool,
    /// Stop conditions, with the default if none was given.
    pub stop: Stop,
    /// Number of iterations left to render, if it is fixed.
    pub iterations: Option<u64>,
    /// Rendering time until the end, seconds, if it is known: a given time, or a quick estimate for
    /// a fixed number of iterations, which is rather low.
    pub seconds: Option<f64>,
    /// Memory at the path counts of the settings.
    pub memory: MemoryNeed,
    /// Available memory, bytes, if the system reports it.
    pub available_memory: Option<f64>,
    /// Warning about a time that hardly suffices.
    pub warning: Option<String>,
    /// Options that do less than alone, each with the other and the reason.
    pub notes: Vec<String>,
}

impl RenderJob {
    /// Checks the job as [`Self::run`] does and describes it, but renders no image.
    ///
    /// # Errors
    /// As [`Self::run`], as far as they appear before the first iteration.
    pub fn outline(self) -> Result<JobOutline> {
        self.outline_on(&SingleProcess)
    }

    /// Checks and describes the job as rank 0 of several processes would render it, which are not
    /// used.
    ///
    /// # Errors
    /// As [`Self::outline`].
    pub fn outline_on(mut self, ranks: &dyn Ranks) -> Result<JobOutline> {
        let prepared = self.prepare()?;
        let asked = self.asked(&prepared.scene, &prepared.provenance.settings, ranks);
        combinations::check(&asked)?;
        let notes = combinations::notes(&asked).map(ToString::to_string).collect();
        let warning = self.check(&prepared)?;
        let Prepared { scene, accel, threads, provenance, .. } = prepared;
        let is_automatic = self.is_automatic();
        let stop = self.stop_with_default();
        let shard = self.shard_iterations(&stop)?;
        let all = stop.iterations;
        let assigned = shard.map_or(all, |shard| Some(shard.assigned.count()));
        let iterations = assigned.map(|assigned| assigned.saturating_sub(self.begun_iterations()));
        let settings = &provenance.settings;
        let estimate = iterations.filter(|_| !is_automatic).map(|iterations| -> Result<f64> {
            let times = threads.install(|| time_probe::min_times(&scene, &accel, settings))?;
            let light_paths = f64::from(settings.light_paths);
            let uniform = times.iteration(light_paths, settings.camera_paths.into());
            Ok(iterations as f64 * self.mean_planned_time(&times).unwrap_or(uniform))
        });
        let seconds = [estimate.transpose()?, stop.time.map(|time| time.as_secs_f64())];
        let seconds = seconds.into_iter().flatten().reduce(f64::min);
        let memory = MemoryNeed::of_image(
            &scene,
            settings,
            self.kept_aovs(settings, AuditPace::new(self.audit, is_automatic)),
        );
        memory.check(settings)?;
        let pilot = (is_automatic && matches!(self.start, Start::New))
            .then(|| self.chosen_parameters())
            .filter(FreeParameters::any);
        let available_memory = available_memory();
        Ok(JobOutline {
            provenance,
            pilot,
            is_automatic,
            stop,
            iterations,
            seconds,
            memory,
            available_memory,
            warning,
            notes,
        })
    }

    /// Makes the checks that [`Self::run`] makes before the first iteration. Returns a warning
    /// about the time.
    fn check(&self, prepared: &Prepared) -> Result<Option<String>> {
        let Prepared { scene, accel, threads, provenance, .. } = prepared;
        check_has_light(scene)?;
        self.time_model(provenance)?;
        self.batch_grain(&provenance.settings)?;
        if self.denoise == Denoise::Always {
            let size = provenance.settings.resolution();
            let interrupt = Arc::clone(&self.interrupt);
            let threads = threads.current_num_threads();
            Denoising::new(threads, size, &self.stop_with_default(), interrupt)?;
        }
        let (Some(time), Some(counts)) = (self.stop.time, self.fixed_counts(provenance)) else {
            return Ok(None);
        };
        let settings = &provenance.settings;
        let needed = (self.min_iterations, &counts);
        threads.install(|| check_time(scene, accel, settings, time, needed))
    }

    /// The plan that is rendered, if there is one.
    pub(super) fn planned(&self) -> Option<&Plan> {
        match &self.start {
            Start::New => None,
            Start::Plan { plan, .. } => Some(plan),
            Start::Checkpoint { checkpoint, .. } => checkpoint.plan.as_ref(),
        }
    }

    /// Number of iterations of the checkpoint that is resumed.
    fn begun_iterations(&self) -> u64 {
        match &self.start {
            Start::Checkpoint { checkpoint, .. } => {
                checkpoint.blocks.iter().map(|block| block.film.iterations).sum()
            }
            Start::New | Start::Plan { .. } => 0,
        }
    }

    /// Mean time of an iteration over the steps of the plan, seconds, if it has a fixed number of
    /// iterations.
    fn mean_planned_time(&self, times: &TimeModel) -> Option<f64> {
        let plan = self.planned()?;
        let all = plan.iterations()? as f64;
        let steps = plan.steps.iter().filter_map(|step| {
            let iterations = step.rendered?.iterations as f64;
            let counts = &step.counts;
            Some(
                iterations * times.iteration(counts.light_paths.into(), counts.camera_paths.mean()),
            )
        });
        Some(steps.sum::<f64>() / all)
    }
}
