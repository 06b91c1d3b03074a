//! The render job of the meters of one quantity under one group of lights.

use super::arriving_light::ArrivingLight;
use super::darkness::{Darkness, TracedPaths, are_certainly_dark, are_dark};
use super::mean_series::MeanSeries;
use super::polarization::NeglectedPolarization;
use super::reading::{Reading, quantity};
use super::results::{worst, worst_of};
use super::{MIN_TIME, MeasureJob};
use crate::job::{Event, RenderJob, RenderResult, RenderState};
use bdpm_auto::adaptive::stopping::{Convergence, Stop, importance};
use bdpm_core::accel::Intersect;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::film::aov::AovSelection;
use bdpm_core::film::radiance::luminance;
use bdpm_core::render::block::{Block, CombinedImage};
use bdpm_core::scene::{MeterKind, MeterSet, Scene};
use bdpm_core::settings::{MAX_IMAGE_SIDE, PartialSettings};
use bdpm_load::Loaded;
use std::ops::{ControlFlow, Range};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Relative RMS error that the render job plans for, over the target of the expanded uncertainty of
/// the worst meter. It is so small that the worst meter reaches its target before.
const PLANNED_SHARE: f64 = 0.1;

/// Iterations without any light after which a measurement without a time ends: no uncertainty would
/// ever be known.
const DARK_ITERATIONS: u64 = 1024;

/// Growth of the number of iterations between two comparisons with the target.
const CHECK_GROWTH: f64 = 1.03;

/// Share of the target for the light that a render job measures, and for that of photons at meters.
/// Both together keep the target.
const TARGET_SHARES: [f64; 2] = [0.85, 0.5];

/// Share of the time for learning from where light arrives at meters.
const LEARNING_TIME: f64 = 0.1;

/// Share of the time after learning for the photons at meters.
const PHOTON_TIME: f64 = 0.3;

/// Number of iterations that are rendered whatever the time: a block of one iteration has no
/// uncertainty, and the first one may be a block of its own.
const LEAST_ITERATIONS: u64 = 3;

/// Minimum number of iterations before a target counts as reached, and that if an interval is open
/// above.
const MIN_ITERATIONS: u64 = 32;
const CLOSED_ITERATIONS: u64 = 64;

/// Meters of one kind under one group of lights: one render job.
pub(super) struct OneKind<'a> {
    pub job: &'a MeasureJob,
    pub scene: &'a Scene,
    pub accel: &'a Arc<dyn Intersect>,
    pub kind: MeterKind,
    pub sets: &'a [(usize, &'a MeterSet)],
}

/// Readings of the meters of a set, and of their mean.
pub(super) type OfSet = (Vec<Reading>, Reading);

/// Readings of a render job, and of the photons at its meters.
pub(super) struct JobReadings {
    pub kind: MeterKind,
    /// Of each set.
    pub readings: Vec<OfSet>,
    pub result: RenderResult,
    /// For each set the number of its meters whose intervals are open above.
    pub open: Vec<usize>,
    /// Counts of the photons at meters, in words.
    pub photons: Option<String>,
    /// Largest relative widening of an interval by neglected polarization, if it is worth a note.
    pub neglected_polarization: Option<f64>,
}

impl OneKind<'_> {
    /// Measures. `watched` gets the largest relative uncertainty and the number of iterations.
    pub fn run(
        &self,
        target: Option<f64>,
        time: Option<Duration>,
        watched: &mut dyn FnMut(f64, u64) -> ControlFlow<()>,
    ) -> Result<JobReadings> {
        let start = Instant::now();
        let meters: Vec<_> = self.sets.iter().flat_map(|(_, set)| set.meters.clone()).collect();
        self.check_count(meters.len())?;
        let scene = Arc::new(self.scene.with_meters(self.kind, meters));
        let list = &scene.meters().expect("just set").list;
        // Luminance meters see no light without a surface, neither straight nor in mirrors.
        let has_photons = self.kind == MeterKind::Irradiance;
        let seed = self.job.settings.seed.or(self.job.loaded.defaults.seed).unwrap_or(1);
        let learning = time.map(|time| time.mul_f64(LEARNING_TIME));
        let new =
            || ArrivingLight::new(&scene, &**self.accel, list, self.columns(), seed, learning);
        let mut arriving = has_photons.then(|| self.on_threads(new)).flatten();
        let [share, photon_share] = if arriving.is_some() { TARGET_SHARES } else { [1.0; 2] };
        let render_time = match &arriving {
            // Learning has taken a part of the time.
            Some(_) => time.map(|time| {
                time.saturating_sub(start.elapsed()).mul_f64(1.0 - PHOTON_TIME).max(MIN_TIME)
            }),
            None => time,
        };
        let target_of_render = target.map(|target| share * target);
        let mut darkness = Darkness::new(&scene, &**self.accel);
        let limits = (target_of_render, render_time);
        let (seen, result) = self.render(&scene, limits, &mut darkness, watched)?;
        let SeenLight { sets: mut readings, open } = seen;
        if let Some(arriving) = &mut arriving {
            let left = time.map(|time| time.saturating_sub(start.elapsed()));
            let enough = photon_share * target.unwrap_or(0.0);
            let is_enough = |own: &ArrivingLight| {
                self.is_interrupted() || self.worst_of_photons(&readings, own) <= enough
            };
            self.on_threads(|| arriving.run(left, is_enough));
            readings = self.with_arriving(&readings, arriving);
        }
        let polarization = self.on_threads(|| NeglectedPolarization::new(&scene, &**self.accel));
        let mut neglected_polarization = None;
        if let Some(own) = polarization {
            (readings, neglected_polarization) = own.add(&readings, &self.columns());
        }
        let readings = darkness.complete(&readings, &self.columns(), traced(&result.state));
        let photons = arriving.map(|arriving| arriving.technique());
        let kind = self.kind;
        Ok(JobReadings { kind, readings, result, open, photons, neglected_polarization })
    }

    fn is_interrupted(&self) -> bool {
        self.job.interrupt.load(Ordering::Relaxed)
    }

    /// Runs `work` on the threads of the job.
    fn on_threads<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        match &self.job.threads {
            Some(threads) => threads.install(work),
            None => work(),
        }
    }

    /// The largest uncertainty of the photons at meters, relative to all light there.
    fn worst_of_photons(&self, readings: &[OfSet], arriving: &ArrivingLight) -> f64 {
        let with = self.with_arriving(readings, arriving);
        let of_set = |(set, (all, mean_of_all)): (usize, &OfSet)| {
            let (mut own, mut mean) = arriving.readings(set);
            own.iter_mut().zip(all).for_each(|(own, all)| own.value = all.value);
            mean.value = mean_of_all.value;
            let lit: Vec<Reading> = own.into_iter().filter(|own| own.value > 0.0).collect();
            if lit.is_empty() { 0.0 } else { worst(&lit, &mean, self.job.means_only) }
        };
        with.iter().enumerate().map(of_set).fold(0.0, f64::max)
    }

    /// The readings with the light of photons at meters.
    fn with_arriving(&self, readings: &[OfSet], arriving: &ArrivingLight) -> Vec<OfSet> {
        let with = |(set, (own, mean)): (usize, &OfSet)| {
            let (photons, of_mean) = arriving.readings(set);
            let sums = own.iter().zip(&photons).map(|(a, b)| a.plus(b)).collect();
            (sums, mean.plus(&of_mean))
        };
        readings.iter().enumerate().map(with).collect()
    }

    /// Refuses more meters than an image has columns.
    fn check_count(&self, count: usize) -> Result<()> {
        if count > MAX_IMAGE_SIDE as usize {
            let problem = format!("{count} meters measure {}", quantity(self.kind));
            let advice = format!(
                "measure at most {MAX_IMAGE_SIDE} meters of a quantity at a time: give grids fewer \
                 `columns` and `rows`, or several tables of meters"
            );
            return Err(Error::new(problem, advice));
        }
        Ok(())
    }

    fn render(
        &self,
        scene: &Arc<Scene>,
        (target, time): (Option<f64>, Option<Duration>),
        darkness: &mut Darkness,
        watched: &mut dyn FnMut(f64, u64) -> ControlFlow<()>,
    ) -> Result<(SeenLight, RenderResult)> {
        let job = self.job;
        let count = scene.meters().expect("with meters").list.len();
        let resolution = Some([count as u32, 1]);
        let scene = Arc::clone(scene);
        let settings = PartialSettings { resolution, ..job.settings.clone() };
        let error = target.map(|target| PLANNED_SHARE * target);
        let render = RenderJob::new(&Loaded { scene, ..job.loaded.clone() })
            .settings(settings)
            .acceleration(job.backend, Arc::clone(self.accel))
            .stop(Stop { error, time, ..Stop::default() })
            .at_least(LEAST_ITERATIONS)
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
            let SeenLight { sets, open } = seen_light(state, &series, &columns);
            let readings = darkness.complete(&sets, &columns, traced(state));
            // A few more iterations close intervals that a few dominant ones opened.
            let is_open = iterations < CLOSED_ITERATIONS && open.iter().any(|count| *count > 0);
            let is_late = time.is_none() && iterations >= DARK_ITERATIONS;
            let worst = worst_of(&readings, job.means_only, is_late);
            let is_dark = is_late && are_dark(&readings) || are_certainly_dark(&readings);
            if is_dark || !is_open && target.is_some_and(|target| worst <= target) {
                return ControlFlow::Break(());
            }
            watched(worst, iterations)
        })?;
        Ok((seen_light(&result.state, &series, &columns), result))
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

/// Light that the paths of a render job saw.
struct SeenLight {
    /// Readings of each set. Those of meters that no light reached are 0.
    sets: Vec<OfSet>,
    /// For each set the number of its meters whose intervals are open above.
    open: Vec<usize>,
}

/// Light at the sets of meters in these columns of the image.
fn seen_light(state: &RenderState, series: &MeanSeries, columns: &[Range<usize>]) -> SeenLight {
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
    let (tails, meters) = (series.tails(image.weights()), values.len());
    let mut open = vec![0; columns.len()];
    // Meters whose light looks certain have fewer paths than others.
    let paths = |column: usize| -> f64 {
        let of_block = |block: &Block| {
            block.film.iterations as f64 * f64::from(block.counts.camera_paths.at(column))
        };
        blocks.iter().map(of_block).sum()
    };
    let of_set = |(set, (columns, variance)): (usize, (&Range<usize>, f64))| {
        let mut reading = |column: usize| {
            let (value, direct) = (values[column], direct[column]);
            let own = Reading::new(value, variances[column], bias, direct, samples);
            open[set] += usize::from(own.is_open(&tails[column]));
            own.with_tail(&tails[column]).with_unseen_dark(paths(column))
        };
        let mean =
            |values: &[f64]| values[columns.clone()].iter().sum::<f64>() / columns.len() as f64;
        let of_meters = columns.clone().map(&mut reading).collect();
        let mean = Reading::new(mean(&values), variance, bias, mean(&direct), samples);
        let all = columns.clone().map(paths).sum();
        (of_meters, mean.with_tail(&tails[meters + set]).with_unseen_dark(all))
    };
    let sets = columns.iter().zip(of_means).enumerate().map(of_set).collect();
    SeenLight { sets, open }
}

/// Paths of a render job so far.
fn traced(state: &RenderState) -> TracedPaths {
    let counts = &state.renderer.block().counts;
    let iterations = state.status.iterations as f64;
    let settings = &state.provenance.settings;
    let (scene, _) = state.renderer.scene_and_accel();
    let radius = f64::from(settings.radius.min(settings.caustic_radius));
    let merged =
        std::f64::consts::PI * radius * radius * f64::from(counts.light_paths) * iterations;
    let power = f64::from(bdpm_core::base::math::luminance(scene.lights().power()));
    TracedPaths {
        camera_paths: counts.camera_paths.mean() * iterations,
        of_one_photon: if settings.has_photons() { power / merged } else { 0.0 },
    }
}

/// Variance of the mean of each meter. The estimate for a corrected bias subtracts the noise of the
/// correction, and may be far too small, even 0, with few iterations. It is therefore at least that
/// of the uncorrected mean.
fn variances(image: &CombinedImage) -> Option<Vec<f64>> {
    let pairs = image.variance_of_mean()?.into_iter().zip(image.uncorrected_variance()?);
    Some(pairs.map(|(corrected, uncorrected)| corrected.max(uncorrected)).collect())
}

/// The chosen technique and path counts in words.
pub(super) fn technique(result: &RenderResult) -> String {
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
