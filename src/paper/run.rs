//! Measures the parts of an experiment, one after the other.

use super::folder::{Experiment, Folder, Measured};
use super::part::{Part, Purpose};
use crate::accel::Intersect;
use crate::adaptive::time_probe;
use crate::base::error::Result;
use crate::image_io::Value;
use crate::noise::Measure;
use crate::noise::file::NoiseFile;
use crate::noise::film::BATCHES;
use crate::noise::region;
use crate::output::checkpoint::Checkpoint;
use crate::render::{IterationReport, RenderConfig, Renderer};
use crate::scene::Scene;
use crate::settings::Settings;
use crate::settings::provenance::Provenance;
use crate::timing::sample::Recorder;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Iterations in each batch at the least.
const LEAST_IN_BATCH: u64 = 2;

/// Time between checkpoints.
const SAVE_EVERY: Duration = Duration::from_secs(20);

/// What is rendered, with what.
#[derive(Clone, Copy)]
pub struct Bench<'a> {
    /// The scene.
    pub scene: &'a Arc<Scene>,
    /// Its triangles.
    pub accel: &'a Arc<dyn Intersect>,
    /// Who renders.
    pub threads: &'a rayon::ThreadPool,
}

/// An experiment under way.
pub struct Run<'a> {
    bench: Bench<'a>,
    folder: Folder,
    experiment: Experiment,
}

/// Where an experiment stands after an iteration.
pub struct Glimpse<'a> {
    /// The part under way.
    pub part: Part,
    /// Its number, from 0, and how many there are.
    pub number: [usize; 2],
    /// The iteration.
    pub report: &'a IterationReport,
    /// Rendering time so far, those of earlier runs included, seconds.
    pub seconds: f64,
    /// Rendering time that is left, seconds.
    pub left: f64,
}

impl<'a> Run<'a> {
    /// Goes on with `experiment`.
    pub fn new(bench: Bench<'a>, folder: Folder, experiment: Experiment) -> Self {
        Self { bench, folder, experiment }
    }

    /// Rendering time that all parts take at the least, seconds, whatever the budget; by a quick measurement.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn least_time(&self) -> Result<f64> {
        let Bench { scene, accel, threads } = self.bench;
        let settings = &self.experiment.identity.settings;
        let times = threads.install(|| time_probe::least_times(scene, accel, settings))?;
        let measured = LEAST_IN_BATCH * BATCHES as u64;
        let time = |part: Part| {
            let iterations = (0..).scan(0, |done, iteration| {
                *done += u64::from(part.measure(iteration) != Measure::Off);
                (*done <= measured).then_some(())
            });
            let (light, camera) = (part.light_paths.into(), part.camera_paths.into());
            iterations.count() as f64 * times.iteration(light, camera)
        };
        Ok(Part::all().into_iter().map(time).sum())
    }

    /// What is complete.
    pub fn experiment(&self) -> &Experiment {
        &self.experiment
    }

    /// Measures all that is left; `watch` sees every iteration and may stop after it, which loses
    /// nothing but a cell that is under way. Returns whether all is complete.
    ///
    /// # Errors
    /// If a file cannot be written, or the one under way cannot be read.
    pub fn run(&mut self, mut watch: impl FnMut(&Glimpse) -> ControlFlow<()>) -> Result<bool> {
        let all = Part::all();
        while let Some(part) = all.get(self.experiment.done.len()) {
            if self.measure(*part, all.len(), &mut watch)?.is_break() {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Measures one part up to its end, or until `watch` has seen enough.
    fn measure(
        &mut self,
        part: Part,
        parts: usize,
        watch: &mut impl FnMut(&Glimpse) -> ControlFlow<()>,
    ) -> Result<ControlFlow<()>> {
        let Bench { scene, accel, threads } = self.bench;
        let origin = self.origin(&part);
        let renderer = Renderer::new(scene, accel, origin.settings.clone())?;
        let mut renderer = renderer.configure(RenderConfig::with_pixel_batches())?;
        self.resume(&mut renderer, &origin)?;
        let mut recorder = Recorder::new(threads.current_num_threads());
        let mut saved = Instant::now();
        loop {
            let measure = part.measure(renderer.iterations());
            let report = threads.install(|| renderer.iterate(measure));
            if measure == Measure::Off {
                let (light, camera) = (part.light_paths.into(), part.camera_paths.into());
                recorder.add(light, camera, &report.times);
            }
            self.experiment.under_way += report.times.wall.as_secs_f64();
            if self.is_complete(&part, &renderer) {
                self.complete(part, &origin, &renderer, &recorder)?;
            }
            let glimpse = Glimpse {
                part,
                number: [self.experiment.done.len().min(parts - 1), parts],
                report: &report,
                seconds: self.seconds(),
                left: self.left(),
            };
            let flow = watch(&glimpse);
            let complete = self.experiment.done.last().is_some_and(|last| last.part == part);
            if complete {
                return Ok(flow);
            }
            // Cells take seconds: they begin anew.
            let stop = flow.is_break();
            if part.purpose != Purpose::Cell && (stop || saved.elapsed() > SAVE_EVERY) {
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

    /// What a part is rendered from.
    fn origin(&self, part: &Part) -> Provenance {
        let identity = &self.experiment.identity;
        let seed = part.seed(identity.settings.seed);
        let Part { light_paths, camera_paths, .. } = *part;
        Provenance {
            version: identity.setup.version.clone(),
            scene: identity.setup.scene.clone(),
            fingerprint: self.bench.scene.fingerprint(),
            backend: identity.setup.backend.clone(),
            settings: Settings { light_paths, camera_paths, seed, ..identity.settings.clone() },
        }
    }

    /// Takes the sums of an earlier run, if they are of this part.
    fn resume(&mut self, renderer: &mut Renderer, origin: &Provenance) -> Result<()> {
        match self.folder.under_way()? {
            Some(mut sums) if sums.origin == *origin && self.experiment.under_way > 0.0 => {
                renderer.resume(sums.take_partial())
            }
            _ => {
                self.experiment.under_way = 0.0;
                Ok(())
            }
        }
    }

    /// Whether a part has had its time, and enough iterations, as many in each batch.
    fn is_complete(&self, part: &Part, renderer: &Renderer) -> bool {
        let iterations =
            renderer.block().statistics.noise.as_ref().map_or(0, |noise| noise.iterations);
        let batches = BATCHES as u64;
        match part.purpose {
            Purpose::Halves => iterations >= self.experiment.done[0].iterations,
            Purpose::Pairs | Purpose::Cell => {
                let time = part.share() * self.experiment.identity.time_budget;
                self.experiment.under_way >= time
                    && iterations >= LEAST_IN_BATCH * batches
                    && iterations.is_multiple_of(batches)
            }
        }
    }

    /// Keeps the results of a part.
    fn complete(
        &mut self,
        part: Part,
        origin: &Provenance,
        renderer: &Renderer,
        recorder: &Recorder,
    ) -> Result<()> {
        let (film, noise) = (renderer.film(), renderer.block().noise_image()?);
        let pixels = region::pixels(&self.experiment.identity.region, &noise)?;
        self.experiment.done.push(Measured {
            part,
            iterations: noise.iterations,
            seconds: self.experiment.under_way,
            pooled_rms: noise.sampled_pooled_rms(&pixels),
            mean_rms: noise.sampled_mean_rms(&pixels),
            times: recorder.samples(),
        });
        self.experiment.under_way = 0.0;
        if part.purpose != Purpose::Cell {
            let mut facts = origin.to_metadata();
            facts.insert("part".into(), Value::Text(part.name()));
            let regions = self.bench.scene.regions.clone();
            let file = NoiseFile { noise, pixels: film.mean(), regions, facts };
            self.folder.save_noise(&part, &file)?;
        }
        // In this order, so that a stop in between loses nothing.
        self.folder.save(&self.experiment)?;
        self.folder.remove_under_way()
    }

    /// Rendering time so far.
    fn seconds(&self) -> f64 {
        let done: f64 = self.experiment.done.iter().map(|measured| measured.seconds).sum();
        done + self.experiment.under_way
    }

    /// Rendering time that is left.
    fn left(&self) -> f64 {
        let done = &self.experiment.done;
        let rest = Part::all().into_iter().skip(done.len());
        let planned: f64 = rest.map(|part| part.share()).sum();
        // The halves take as many iterations as the pairs, whatever time that is.
        let budget = self.experiment.identity.time_budget;
        (planned * budget - self.experiment.under_way).max(0.0)
    }
}
