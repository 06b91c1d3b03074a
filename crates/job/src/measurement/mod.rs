//! Measurements of illuminance and luminance with their uncertainty: [`MeasureJob`].
//!
//! ```text
//! meters -> one render job per kind and group of lights -> readings -> Measurement
//! ```
//!
//! Each meter is a pixel of the image of a [`RenderJob`], which chooses technique, radii and counts
//! for the relative error of the meters. Groups of lights are measured apart: their errors are
//! independent, so that the uncertainty of any mix of them follows.

mod mean_series;
mod reading;
mod warnings;

pub use reading::{Reading, quantity, student_95, unit};

use crate::job::{Event, RenderJob, RenderResult, RenderState};
use bdpm_auto::adaptive::stopping::{Convergence, Stop, importance};
use bdpm_core::accel::Intersect;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::film::aov::AovSelection;
use bdpm_core::film::radiance::luminance;
use bdpm_core::render::block::CombinedImage;
use bdpm_core::scene::backend::{self, Backend};
use bdpm_core::scene::{LightSource, MeterKind, MeterSet, Scene};
use bdpm_core::settings::{MAX_IMAGE_SIDE, PartialSettings};
use bdpm_load::Loaded;
use mean_series::MeanSeries;
use rayon::ThreadPool;
use std::ops::{ControlFlow, Range};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};
use warnings::{missing_light, unknown_bias};

/// Minimum time of a render job: if the whole time is over, the remaining jobs are as short as
/// possible.
const MIN_TIME: Duration = Duration::from_nanos(1);

/// Target of the expanded uncertainty if there is neither a target nor a time.
pub const DEFAULT_TARGET: f64 = 0.02;

/// Relative RMS error that the render job plans for, over the target of the expanded uncertainty of
/// the worst meter. It is so small that the worst meter reaches its target before.
const PLANNED_SHARE: f64 = 0.1;

/// Share of the mean of a set below which the uncertainty of a meter is not compared with its own
/// value.
const LEAST_SHARE: f64 = 0.01;

/// Minimum number of iterations before a target counts as reached.
const MIN_ITERATIONS: u64 = 32;

/// Iterations without any light after which a measurement without a time ends: no uncertainty would
/// ever be known.
const DARK_ITERATIONS: u64 = 1024;

/// Growth of the number of iterations between two comparisons with the target.
const CHECK_GROWTH: f64 = 1.03;

/// Measures meters in a scene.
///
/// ```no_run
/// use bdpm::MeasureJob;
///
/// let loaded = bdpm::load("room.toml")?;
/// let measurement = MeasureJob::new(&loaded).target(0.01).run(|_| std::ops::ControlFlow::Continue(()))?;
/// for set in &measurement.sets {
///     println!("{}: {} {}", set.name, set.mean.value, set.unit());
/// }
/// # Ok::<(), bdpm::Error>(())
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

/// Readings of all meters.
#[derive(Clone, Debug)]
pub struct Measurement {
    /// Sets of meters, in the order of the job.
    pub sets: Vec<SetReadings>,
    /// True if all uncertainties reached the target.
    pub reached: bool,
    /// Wall-clock time.
    pub time: Duration,
    /// Group of lights, quantity, chosen technique and path counts of each render job.
    pub techniques: Vec<String>,
    /// Light that the measurement cannot include.
    pub warnings: Vec<String>,
}

/// Readings of a set of meters.
#[derive(Clone, Debug)]
pub struct SetReadings {
    /// Name of the set.
    pub name: String,
    /// Quantity of the meters.
    pub kind: MeterKind,
    /// Columns and rows.
    pub grid: [u32; 2],
    /// Readings of all meters, row by row.
    pub readings: Vec<Reading>,
    /// Mean over the meters.
    pub mean: Reading,
    /// Names of groups of lights with the readings of all meters and their mean, if lights were
    /// measured apart.
    pub groups: Vec<(String, Vec<Reading>, Reading)>,
}

impl SetReadings {
    /// Unit of the readings.
    pub fn unit(&self) -> &'static str {
        unit(self.kind)
    }

    /// Smallest and largest value.
    pub fn range(&self) -> [f64; 2] {
        let values = self.readings.iter().map(|reading| reading.value);
        values.fold([f64::INFINITY, 0.0], |[low, high], value| [low.min(value), high.max(value)])
    }

    /// Uniformity `U_0`: the smallest value over the mean.
    pub fn uniformity(&self) -> f64 {
        self.range()[0] / self.mean.value
    }

    /// Largest relative expanded uncertainty of the meters, or that of the mean. Meters with less
    /// than 1 % of the mean are compared with 1 % of the mean.
    pub fn worst(&self, means_only: bool) -> f64 {
        worst(&self.readings, &self.mean, means_only)
    }

    fn add_group(&mut self, name: &str, readings: Vec<Reading>, mean: Reading) {
        if self.readings.is_empty() {
            (self.readings, self.mean) = (readings.clone(), mean);
        } else {
            let sums = self.readings.iter().zip(&readings).map(|(a, b)| a.plus(b)).collect();
            (self.readings, self.mean) = (sums, self.mean.plus(&mean));
        }
        self.groups.push((name.into(), readings, mean));
    }
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
    /// If there are no meters, and those of [`RenderJob::run`].
    pub fn run(
        self,
        mut observer: impl FnMut(MeasureProgress) -> ControlFlow<()>,
    ) -> Result<Measurement> {
        let start = Instant::now();
        if self.sets.iter().all(|set| set.meters.is_empty()) {
            let advice = "add a `[[meter]]` table to the scene file, or give a table of meters";
            return Err(Error::new("the scene has no meters", advice));
        }
        let target = self.target.or(self.time.is_none().then_some(DEFAULT_TARGET));
        let accel = backend::build(self.backend, &self.loaded.scene)?;
        let groups = self.groups()?;
        let kinds: Vec<MeterKind> = [MeterKind::Irradiance, MeterKind::Radiance]
            .into_iter()
            .filter(|kind| self.sets.iter().any(|set| set.kind == *kind))
            .collect();
        let jobs = (groups.len() * kinds.len()) as u32;
        let mut measurement = Measurement {
            sets: self.sets.iter().map(empty_readings).collect(),
            reached: true,
            time: Duration::ZERO,
            techniques: Vec::new(),
            warnings: missing_light(&self.loaded.scene).into_iter().collect(),
        };
        for (number, (name, scene)) in (0..).zip(&groups) {
            for (kind_number, kind) in (0..).zip(&kinds) {
                let left = jobs - (number * kinds.len() as u32 + kind_number);
                let time = self.time.map(|time| {
                    let share = time.saturating_sub(start.elapsed()) / left;
                    share.max(MIN_TIME)
                });
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
                let (readings, result) = of_kind.run(target, time, &mut watched)?;
                let technique = technique(&result);
                measurement.techniques.push(format!("{name}, {}: {technique}", quantity(*kind)));
                let known = &measurement.warnings;
                let warning = unknown_bias(&result).filter(|warning| !known.contains(warning));
                measurement.warnings.extend(warning);
                if are_dark(&readings) {
                    let iterations = result.state.status.iterations;
                    let text =
                        format!("{name}: no light reached a meter in {iterations} iterations");
                    measurement.warnings.push(text);
                    measurement.reached = false;
                }
                if let Some(failure) = result.failure() {
                    let text = format!("the measurement ended too early: {failure}");
                    measurement.warnings.push(text);
                    measurement.reached = false;
                }
                for ((index, _), (readings, mean)) in sets.iter().zip(readings) {
                    measurement.sets[*index].add_group(name, readings, mean);
                }
            }
        }
        for set in &mut measurement.sets {
            if !self.by_light {
                set.groups.clear();
            }
            let worst = set.worst(self.means_only);
            measurement.reached &= target.is_none_or(|target| worst <= target);
        }
        measurement.time = start.elapsed();
        Ok(measurement)
    }

    /// Groups of lights, each with its name and the scene that has only its lights.
    fn groups(&self) -> Result<Vec<(String, Arc<Scene>)>> {
        let scene = &self.loaded.scene;
        if !self.by_light {
            return Ok(vec![("all lights".into(), Arc::clone(scene))]);
        }
        // Materials of one name are one group.
        let mut groups: Vec<(String, Vec<LightSource>)> = Vec::new();
        for (source, name) in scene.light_sources() {
            match groups.iter_mut().find(|(own, _)| *own == name) {
                Some((_, sources)) => sources.push(source),
                None => groups.push((name, vec![source])),
            }
        }
        let only = |(name, sources): (String, Vec<LightSource>)| {
            Ok((name, Arc::new(scene.with_only(&sources)?)))
        };
        groups.into_iter().map(only).collect()
    }
}

fn empty_readings(set: &MeterSet) -> SetReadings {
    SetReadings {
        name: set.name.clone(),
        kind: set.kind,
        grid: set.grid,
        readings: Vec::new(),
        mean: Reading::default(),
        groups: Vec::new(),
    }
}

/// Meters of one kind under one group of lights: one render job.
struct OneKind<'a> {
    job: &'a MeasureJob,
    scene: &'a Scene,
    accel: &'a Arc<dyn Intersect>,
    kind: MeterKind,
    sets: &'a [(usize, &'a MeterSet)],
}

/// Readings of the meters of a set, and of their mean.
type OfSet = (Vec<Reading>, Reading);

impl OneKind<'_> {
    fn run(
        &self,
        target: Option<f64>,
        time: Option<Duration>,
        watched: &mut dyn FnMut(f64, u64) -> ControlFlow<()>,
    ) -> Result<(Vec<OfSet>, RenderResult)> {
        let job = self.job;
        let count: usize = self.sets.iter().map(|(_, set)| set.meters.len()).sum();
        if count > MAX_IMAGE_SIDE as usize {
            let problem = format!("{count} meters measure {}", quantity(self.kind));
            let advice = format!(
                "measure at most {MAX_IMAGE_SIDE} meters of a quantity at a time: give grids fewer \
                 `columns` and `rows`, or several tables of meters"
            );
            return Err(Error::new(problem, advice));
        }
        let meters: Vec<_> = self.sets.iter().flat_map(|(_, set)| set.meters.clone()).collect();
        let resolution = Some([meters.len() as u32, 1]);
        let scene = Arc::new(self.scene.with_meters(self.kind, meters));
        let settings = PartialSettings { resolution, ..job.settings.clone() };
        let error = target.map(|target| PLANNED_SHARE * target);
        let render = RenderJob::new(&Loaded { scene, ..job.loaded.clone() })
            .settings(settings)
            .acceleration(job.backend, Arc::clone(self.accel))
            .stop(Stop { error, time, ..Stop::default() })
            .aovs(AovSelection { light: true, ..AovSelection::default() })
            .interrupted_by(Arc::clone(&job.interrupt));
        let render = match &job.threads {
            Some(threads) => render.threads(Arc::clone(threads)),
            None => render,
        };
        let columns = self.columns();
        let mut series = MeanSeries::new(columns.clone());
        let mut next_check = MIN_ITERATIONS;
        let result = render.run(|event| {
            let Event::Iterated(state) = event else { return ControlFlow::Continue(()) };
            series.add(state);
            let iterations = state.status.iterations;
            if iterations < next_check {
                return ControlFlow::Continue(());
            }
            next_check = (iterations as f64 * CHECK_GROWTH).ceil() as u64 + 1;
            let readings = readings(state, &series, &columns);
            let worst = readings
                .iter()
                .map(|(readings, mean)| worst(readings, mean, job.means_only))
                .fold(0.0, f64::max);
            let is_dark = time.is_none() && iterations >= DARK_ITERATIONS && are_dark(&readings);
            if is_dark || target.is_some_and(|target| worst <= target) {
                return ControlFlow::Break(());
            }
            watched(worst, iterations)
        })?;
        Ok((readings(&result.state, &series, &columns), result))
    }

    /// Columns of the image for each set.
    fn columns(&self) -> Vec<Range<usize>> {
        let mut end = 0;
        let range = |(_, set): &(usize, &MeterSet)| {
            let start = end;
            end += set.meters.len();
            start..end
        };
        self.sets.iter().map(range).collect()
    }
}

/// Returns true if no light was seen.
fn are_dark(sets: &[OfSet]) -> bool {
    sets.iter().flat_map(|(readings, _)| readings).all(|reading| reading.value == 0.0)
}

fn worst(readings: &[Reading], mean: &Reading, means_only: bool) -> f64 {
    if means_only {
        return mean.relative(0.0);
    }
    let least = LEAST_SHARE * mean.value;
    readings.iter().map(|reading| reading.relative(least)).fold(0.0, f64::max)
}

/// Readings of the sets of meters in these columns of the image.
fn readings(state: &RenderState, series: &MeanSeries, columns: &[Range<usize>]) -> Vec<OfSet> {
    let image = state.image();
    let samples = image.iterations() as f64;
    let values: Vec<f64> = image.mean().iter().map(|value| luminance(value.as_dvec3())).collect();
    let variances = variances(&image).unwrap_or_else(|| vec![f64::INFINITY; values.len()]);
    let shared = state.renderer.shared();
    let direct: Vec<f64> = image.light_rows(shared, 0..1).map_or_else(
        || vec![0.0; values.len()],
        |light| light.iter().map(|light| luminance(light.emission)).collect(),
    );
    let blocks = state.renderer.blocks();
    let weights = importance(blocks, state.stop.objective);
    let convergence = Convergence::new(blocks, image.weights().to_vec(), &weights);
    let squared = convergence.squared_bias(&state.stop);
    let bias = (squared.value + squared.deviation).max(0.0).sqrt();
    let of_means = series.variances(image.weights());
    let of_set = |(columns, variance): (&Range<usize>, f64)| {
        let reading = |column: usize| {
            Reading::new(values[column], variances[column], bias, direct[column], samples)
        };
        let mean =
            |values: &[f64]| values[columns.clone()].iter().sum::<f64>() / columns.len() as f64;
        let mean = Reading::new(mean(&values), variance, bias, mean(&direct), samples);
        (columns.clone().map(reading).collect(), mean)
    };
    columns.iter().zip(of_means).map(of_set).collect()
}

/// Variance of the mean of each meter. The estimate for a corrected bias subtracts the noise of the
/// correction, and may be far too small, even 0, with few iterations. It is therefore at least that
/// of the uncorrected mean.
fn variances(image: &CombinedImage) -> Option<Vec<f64>> {
    let pairs = image.variance_of_mean()?.into_iter().zip(image.uncorrected_variance()?);
    Some(pairs.map(|(corrected, uncorrected)| corrected.max(uncorrected)).collect())
}

/// The chosen technique and path counts in words.
fn technique(result: &RenderResult) -> String {
    let Some(selection) = result.selection() else { return "fixed settings".into() };
    let state = &result.state;
    let counts = &state.renderer.block().counts;
    let light_paths = match state.provenance.settings.has_photons() {
        true => format!("{} light paths and ", counts.light_paths),
        false => String::new(),
    };
    format!(
        "{}, {light_paths}{:.0} camera paths per meter, {} iterations",
        selection.best().technique.describe(),
        counts.camera_paths.mean(),
        state.status.iterations
    )
}
