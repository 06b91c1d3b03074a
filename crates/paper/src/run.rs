//! Takes the measurements of an experiment, one after the other.

use super::folder::{Experiment, Folder, Measured};
use super::measurement::{Measurement, Purpose};
use bdpm_auto::adaptive::time_probe;
use bdpm_auto::timing::measure::Recorder;
use bdpm_core::accel::Intersect;
use bdpm_core::base::error::Result;
use bdpm_core::image_io::Value;
use bdpm_core::noise::Measure;
use bdpm_core::noise::file::NoiseFile;
use bdpm_core::noise::film::BATCHES;
use bdpm_core::noise::region;
use bdpm_core::render::{IterationReport, RenderConfig, Renderer};
use bdpm_core::scene::Scene;
use bdpm_core::settings::Settings;
use bdpm_core::settings::provenance::Provenance;
use bdpm_job::output::checkpoint::Checkpoint;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Minimum of iterations in each batch.
const MIN_IN_BATCH: u64 = 2;

/// Time between checkpoints.
const SAVE_EVERY: Duration = Duration::from_secs(20);

/// The scene, and the means to render it.
#[derive(Clone, Copy)]
pub struct SceneContext<'a> {
    /// The scene.
    pub scene: &'a Arc<Scene>,
    /// The scene's triangles.
    pub accel: &'a Arc<dyn Intersect>,
    /// The threads that render.
    pub threads: &'a rayon::ThreadPool,
}

/// An experiment under way.
pub struct Run<'a> {
    context: SceneContext<'a>,
    folder: Folder,
    experiment: Experiment,
}

/// State of an experiment after an iteration.
pub struct RunStatus<'a> {
    /// The measurement under way.
    pub measurement: Measurement,
    /// Index of the measurement, from 0.
    pub index: usize,
    /// Number of measurements.
    pub count: usize,
    /// The iteration.
    pub report: &'a IterationReport,
    /// Rendering time so far, including earlier runs, seconds.
    pub seconds: f64,
    /// Rendering time that is left, seconds.
    pub left: f64,
}

impl<'a> Run<'a> {
    /// Continues `experiment`.
    pub fn new(context: SceneContext<'a>, folder: Folder, experiment: Experiment) -> Self {
        Self { context, folder, experiment }
    }

    /// Minimum rendering time of all measurements, seconds, whatever the budget. A quick estimate.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn least_time(&self) -> Result<f64> {
        let SceneContext { scene, accel, threads } = self.context;
        let settings = &self.experiment.conditions.settings;
        let times = threads.install(|| time_probe::min_times(scene, accel, settings))?;
        let measured = MIN_IN_BATCH * BATCHES as u64;
        let time = |measurement: Measurement| {
            let iterations = (0..).scan(0, |done, iteration| {
                *done += u64::from(measurement.measure(iteration) != Measure::Off);
                (*done <= measured).then_some(())
            });
            let (light, camera) = (measurement.light_paths.into(), measurement.camera_paths.into());
            iterations.count() as f64 * times.iteration(light, camera)
        };
        Ok(Measurement::all().into_iter().map(time).sum())
    }

    /// The state so far.
    pub fn experiment(&self) -> &Experiment {
        &self.experiment
    }

    /// Measures all that is left; `watch` sees every iteration and may stop after it, which loses
    /// nothing but a cell that is under way. Returns whether all is complete.
    ///
    /// # Errors
    /// If a file cannot be written, or the one under way cannot be read.
    pub fn run(&mut self, mut watch: impl FnMut(&RunStatus) -> ControlFlow<()>) -> Result<bool> {
        let all = Measurement::all();
        while let Some(measurement) = all.get(self.experiment.done.len()) {
            if self.measure(*measurement, all.len(), &mut watch)?.is_break() {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Measures one measurement up to its end, or until `watch` has seen enough.
    fn measure(
        &mut self,
        measurement: Measurement,
        count: usize,
        watch: &mut impl FnMut(&RunStatus) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>> {
        let SceneContext { scene, accel, threads } = self.context;
        let origin = self.origin(&measurement);
        let renderer = Renderer::new(scene, accel, origin.settings.clone())?;
        let mut renderer = renderer.configure(RenderConfig::with_pixel_batches())?;
        self.resume(&mut renderer, &origin)?;
        let mut recorder = Recorder::new(threads.current_num_threads());
        let mut saved = Instant::now();
        loop {
            let measure = measurement.measure(renderer.iterations());
            let report = threads.install(|| renderer.iterate(measure));
            if measure == Measure::Off {
                let (light, camera) =
                    (measurement.light_paths.into(), measurement.camera_paths.into());
                recorder.add(light, camera, &report.times);
            }
            self.experiment.under_way += report.times.wall.as_secs_f64();
            if self.is_complete(&measurement, &renderer) {
                self.complete(measurement, &origin, &renderer, &recorder)?;
            }
            let status = RunStatus {
                measurement,
                index: self.experiment.done.len().min(count - 1),
                count,
                report: &report,
                seconds: self.seconds(),
                left: self.left(),
            };
            let flow = watch(&status);
            let complete =
                self.experiment.done.last().is_some_and(|last| last.measurement == measurement);
            if complete {
                return Ok(flow);
            }
            // Cells take seconds, so that they restart after an interruption.
            let stop = flow.is_break();
            if measurement.purpose != Purpose::Cell && (stop || saved.elapsed() > SAVE_EVERY) {
                let sums = Checkpoint::new(origin.clone(), renderer.blocks());
                self.folder.save_under_way(&sums)?;
                self.folder.save(&self.experiment)?;
                saved = Instant::now();
            }
            if stop {
                return Ok(flow);
            }
        }
    }

    /// Scene and settings of a measurement.
    fn origin(&self, measurement: &Measurement) -> Provenance {
        let conditions = &self.experiment.conditions;
        let seed = measurement.seed(conditions.settings.seed);
        let Measurement { light_paths, camera_paths, .. } = *measurement;
        Provenance {
            version: conditions.setup.version.clone(),
            scene: conditions.setup.scene.clone(),
            fingerprint: self.context.scene.fingerprint(),
            backend: conditions.setup.backend.clone(),
            settings: Settings { light_paths, camera_paths, seed, ..conditions.settings.clone() },
        }
    }

    /// Continues with the sums of an earlier run, if they belong to this measurement.
    fn resume(&mut self, renderer: &mut Renderer, origin: &Provenance) -> Result<()> {
        match self.folder.under_way()? {
            Some(mut sums) if sums.provenance == *origin && self.experiment.under_way > 0.0 => {
                renderer.resume(sums.take_partial())
            }
            _ => {
                self.experiment.under_way = 0.0;
                Ok(())
            }
        }
    }

    /// Whether a measurement has had its time and enough iterations, equally many in each batch.
    fn is_complete(&self, measurement: &Measurement, renderer: &Renderer) -> bool {
        let noise = renderer.block().statistics.noise.as_ref();
        let iterations = noise.map_or(0, |noise| noise.iterations);
        let batches = BATCHES as u64;
        match measurement.purpose {
            Purpose::Halves => iterations >= self.experiment.done[0].iterations,
            Purpose::Pairs | Purpose::Cell => {
                let time = measurement.share() * self.experiment.conditions.time;
                self.experiment.under_way >= time
                    && iterations >= MIN_IN_BATCH * batches
                    && iterations.is_multiple_of(batches)
            }
        }
    }

    /// Saves the results of a measurement.
    fn complete(
        &mut self,
        measurement: Measurement,
        origin: &Provenance,
        renderer: &Renderer,
        recorder: &Recorder,
    ) -> Result<()> {
        let (film, noise) = (renderer.film(), renderer.block().noise_image()?);
        let pixels = region::pixels(&self.experiment.conditions.region, &noise)?;
        self.experiment.done.push(Measured {
            measurement,
            iterations: noise.iterations,
            seconds: self.experiment.under_way,
            pooled_rms: noise.sampled_pooled_rms(&pixels),
            mean_rms: noise.sampled_mean_rms(&pixels),
            times: recorder.samples(),
        });
        self.experiment.under_way = 0.0;
        if measurement.purpose != Purpose::Cell {
            let mut facts = origin.to_metadata();
            facts.insert("part".into(), Value::Text(measurement.name()));
            let regions = self.context.scene.regions.clone();
            let file = NoiseFile { noise, pixels: film.mean(), regions, facts };
            self.folder.save_noise(&measurement, &file)?;
        }
        // Keep this order, so that an interruption in between loses nothing.
        self.folder.save(&self.experiment)?;
        self.folder.remove_under_way()
    }

    /// Rendering time so far.
    fn seconds(&self) -> f64 {
        let done: f64 = self.experiment.done.iter().map(|measured| measured.seconds).sum();
        done + self.experiment.under_way
    }

    /// Remaining rendering time.
    fn left(&self) -> f64 {
        let done = &self.experiment.done;
        let rest = Measurement::all().into_iter().skip(done.len());
        let planned: f64 = rest.map(|measurement| measurement.share()).sum();
        // The halves take as many iterations as the pairs, whatever their time.
        let budget = self.experiment.conditions.time;
        (planned * budget - self.experiment.under_way).max(0.0)
    }
}
