//! Measurements of illuminance and luminance with their uncertainty: [`MeasureJob`].
//!
//! ```text
//! meters -> one render job per kind and group of lights -> readings -> Measurement
//! ```
//!
//! Each meter is a pixel of the image of a [`RenderJob`](crate::RenderJob), which chooses
//! technique, radii and counts for the relative error of the meters. Groups of lights are measured
//! apart: their errors are independent, so that the uncertainty of any mix of them follows.

mod arriving_light;
#[cfg(test)]
mod coverage_tests;
mod darkness;
mod extremes;
pub mod goniometer;
mod mean_series;
mod meter_photons;
mod polarization;
mod reading;
mod render_meters;
mod requirement;
mod results;
mod room_glare;
mod warnings;

pub use extremes::Estimated;
pub use reading::{Reading, SampleTail, quantity, unit};
pub use requirement::{Judged, Limit, Verdict};
pub use results::{Measurement, MeterPlace, SetReadings};
pub use room_glare::{LuminaireGlare, RoomGlare};
pub use warnings::normal_loss;

use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::backend::{self, Backend};
use bdpm_core::scene::{LightSource, MeterKind, MeterSet, Scene};
use bdpm_core::settings::PartialSettings;
use bdpm_load::Loaded;
use rayon::ThreadPool;
use render_meters::OneKind;
use results::empty_readings;
use room_glare::ratings;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// Minimum time of a render job: if the whole time is over, the remaining jobs are as short as
/// possible.
const MIN_TIME: Duration = Duration::from_nanos(1);

/// Target of the expanded uncertainty if there is neither a target nor a time.
pub const DEFAULT_TARGET: f64 = 0.02;

/// Measures meters in a scene.
///
/// ```no_run
/// use bdpm_job::MeasureJob;
///
/// let loaded = bdpm_load::load("room.toml")?;
/// let measurement = MeasureJob::new(&loaded).target(0.01).run(|_| std::ops::ControlFlow::Continue(()))?;
/// for set in &measurement.sets {
///     println!("{}: {} {}", set.name, set.mean.value, set.unit());
/// }
/// # Ok::<(), bdpm_core::Error>(())
/// ```
#[derive(Clone)]
pub struct MeasureJob {
    loaded: Loaded,
    sets: Vec<MeterSet>,
    settings: PartialSettings,
    target: Option<f64>,
    time: Option<Duration>,
    means_only: bool,
    by_light: bool,
    outdoors: Option<f64>,
    backend: Backend,
    threads: Option<Arc<ThreadPool>>,
    interrupt: Arc<AtomicBool>,
}

/// Progress of a measurement.
#[derive(Clone, Copy, Debug)]
pub struct MeasureProgress<'a> {
    /// Name of the group of lights that is measured.
    pub group: &'a str,
    /// Largest expanded uncertainty so far, relative, of the group.
    pub worst: f64,
    /// Iterations of the group.
    pub iterations: u64,
    /// Time since the start of the measurement.
    pub elapsed: Duration,
}

impl MeasureJob {
    /// Measures the meters of a scene file.
    pub fn new(loaded: &Loaded) -> Self {
        Self {
            sets: loaded.meters.clone(),
            loaded: loaded.clone(),
            settings: PartialSettings::default(),
            target: None,
            time: None,
            means_only: false,
            by_light: false,
            outdoors: None,
            backend: Backend::default(),
            threads: None,
            interrupt: Arc::default(),
        }
    }

    /// Measures these meters instead.
    #[must_use]
    pub fn meters(self, sets: Vec<MeterSet>) -> Self {
        Self { sets, ..self }
    }

    /// Fixes settings, which the job then does not choose.
    #[must_use]
    pub fn settings(self, settings: PartialSettings) -> Self {
        Self { settings, ..self }
    }

    /// Stops when the expanded uncertainty (95 %) of every meter is this share of its value
    /// [default: 2 %, none with a time]. Meters with less than 1 % of the mean of their set are
    /// compared with 1 % of the mean.
    #[must_use]
    pub fn target(self, target: impl Into<Option<f64>>) -> Self {
        Self { target: target.into(), ..self }
    }

    /// Stops after this time, which is divided among the render jobs.
    #[must_use]
    pub fn time(self, time: impl Into<Option<Duration>>) -> Self {
        Self { time: time.into(), ..self }
    }

    /// Applies the target to the mean over each set instead of to every meter.
    #[must_use]
    pub fn means_only(self, means_only: bool) -> Self {
        Self { means_only, ..self }
    }

    /// Measures each light source apart.
    #[must_use]
    pub fn by_light(self, by_light: bool) -> Self {
        Self { by_light, ..self }
    }

    /// Measures daylight factors: the illuminance by the environment alone, in percent of this
    /// illuminance outdoors, lx. The environment is then that of an overcast sky.
    #[must_use]
    pub fn daylight_factor(self, outdoors: impl Into<Option<f64>>) -> Self {
        Self { outdoors: outdoors.into(), ..self }
    }

    /// Finds intersections with this backend.
    #[must_use]
    pub fn backend(self, backend: Backend) -> Self {
        Self { backend, ..self }
    }

    /// Renders on these threads [default: one per processor].
    #[must_use]
    pub fn threads(self, threads: Arc<ThreadPool>) -> Self {
        Self { threads: Some(threads), ..self }
    }

    /// Ends the measurement after the iteration in which this flag is set.
    #[must_use]
    pub fn interrupted_by(self, interrupt: Arc<AtomicBool>) -> Self {
        Self { interrupt, ..self }
    }

    /// Measures, and reports progress to `observer`, which may end the measurement.
    ///
    /// # Errors
    /// If there are no meters, and those of [`RenderJob::run`](crate::RenderJob::run).
    pub fn run(
        self,
        mut observer: impl FnMut(MeasureProgress) -> ControlFlow<()>,
    ) -> Result<Measurement> {
        let start = Instant::now();
        self.check()?;
        let target = self.target.or(self.time.is_none().then_some(DEFAULT_TARGET));
        let accel = backend::build(self.backend, &self.loaded.scene)?;
        let groups = self.groups()?;
        let kinds: Vec<MeterKind> = [MeterKind::Irradiance, MeterKind::Radiance]
            .into_iter()
            .filter(|kind| self.sets.iter().any(|set| set.kind == *kind))
            .collect();
        let jobs = (groups.len() * kinds.len()) as u32;
        let near = self.loaded.scene.near_faces(&*accel).into_iter().map(|pair| pair.describe());
        let mut measurement = Measurement {
            sets: self.sets.iter().map(|set| empty_readings(set, &self.loaded.scene)).collect(),
            reached: true,
            time: Duration::ZERO,
            techniques: Vec::new(),
            warnings: normal_loss(&self.loaded.scene).into_iter().chain(near).collect(),
        };
        for (number, (name, scene)) in (0..).zip(&groups) {
            for (kind_number, kind) in (0..).zip(&kinds) {
                let left = jobs - (number * kinds.len() as u32 + kind_number);
                let share = |time: Duration| time.saturating_sub(start.elapsed()) / left;
                let time = self.time.map(|time| share(time).max(MIN_TIME));
                let sets = (0..).zip(&self.sets).filter(|(_, set)| set.kind == *kind);
                let sets: Vec<(usize, &MeterSet)> = sets.collect();
                let mut watched = |worst, iterations| {
                    observer(MeasureProgress {
                        group: name,
                        worst,
                        iterations,
                        elapsed: start.elapsed(),
                    })
                };
                let of_kind =
                    OneKind { job: &self, scene, accel: &accel, kind: *kind, sets: &sets };
                let own = of_kind.run(target, time, &mut watched)?;
                measurement.add(name, &own);
                let seen = own.readings.into_iter().zip(own.open);
                for ((index, _), ((readings, mean), open)) in sets.iter().zip(seen) {
                    measurement.sets[*index].add_group(name, readings, mean, open);
                }
            }
        }
        for (set, own) in measurement.sets.iter_mut().zip(&self.sets) {
            if own.requirement.ugr.is_some() && self.outdoors.is_none() {
                let rate = || ratings(&self.loaded.scene, &*accel, &own.meters, &set.readings);
                set.ugr = self.threads.as_ref().map_or_else(rate, |threads| threads.install(rate));
            }
            set.finish(self.outdoors, self.by_light);
            let worst = set.worst(self.means_only);
            measurement.reached &= target.is_none_or(|target| worst <= target);
        }
        measurement.reached &= measurement.unknown().is_empty();
        measurement.time = start.elapsed();
        Ok(measurement)
    }

    /// Checks that there are meters, and that daylight factors can be measured, if they are.
    fn check(&self) -> Result<()> {
        check_meters(&self.sets)?;
        if self.outdoors.is_none() {
            return Ok(());
        }
        if self.by_light {
            let advice = "remove --by-light, or measure in lux";
            return Err(Error::new("the daylight factor has the light of the sky alone", advice));
        }
        check_illuminance(&self.sets)
    }

    /// Groups of lights, each with its name and the scene that has only its lights.
    fn groups(&self) -> Result<Vec<(String, Arc<Scene>)>> {
        let scene = &self.loaded.scene;
        if self.outdoors.is_some() {
            let sky = scene.with_only(&[LightSource::Environment])?;
            return Ok(vec![("sky".into(), Arc::new(sky))]);
        }
        if !self.by_light {
            return Ok(vec![("all lights".into(), Arc::clone(scene))]);
        }
        let only = |(name, sources): (String, Vec<LightSource>)| {
            Ok((name, Arc::new(scene.with_only(&sources)?)))
        };
        light_groups(scene).into_iter().map(only).collect()
    }
}

/// Checks that there are meters.
pub(crate) fn check_meters(sets: &[MeterSet]) -> Result<()> {
    if sets.iter().all(|set| set.meters.is_empty()) {
        let advice = "add a `[[meter]]` table to the scene file, or give a table of meters";
        return Err(Error::new("the scene has no meters", advice));
    }
    Ok(())
}

/// Checks that all meters measure illuminance.
pub(crate) fn check_illuminance(sets: &[MeterSet]) -> Result<()> {
    let Some(set) = sets.iter().find(|set| set.kind == MeterKind::Radiance) else { return Ok(()) };
    let problem = format!("the meter `{}` measures luminance", set.name);
    Err(Error::new(problem, "give meters with a `normal`: daylight is illuminance"))
}

/// Light sources of a scene by their names, in the order of the scene: lights and materials of one
/// name are one group.
pub fn light_groups(scene: &Scene) -> Vec<(String, Vec<LightSource>)> {
    let mut groups: Vec<(String, Vec<LightSource>)> = Vec::new();
    for (source, name) in scene.light_sources() {
        match groups.iter_mut().find(|(own, _)| *own == name) {
            Some((_, sources)) => sources.push(source),
            None => groups.push((name, vec![source])),
        }
    }
    groups
}
