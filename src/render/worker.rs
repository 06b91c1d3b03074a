//! One thread's work on some tiles: camera and merge phases, and what becomes of the pairs.

use super::aov_sums::LayerSums;
use super::tile_paths::TilePaths;
use super::tiles::TileSums;
use crate::base::math;
use crate::film::aov::{AovSelection, LayerValue};
use crate::film::counts::Counts;
use crate::film::radiance::{Tile, luminance};
use crate::noise::film::PixelMeasurement;
use crate::noise::halves::Halves;
use crate::noise::pairs::AllPairs;
use crate::noise::{Estimator, Measure};
use crate::transport::camera_paths::{CameraPass, CameraPaths};
use crate::transport::merge::{Merge, MergeOutput};
use crate::transport::pair_list::Pair;
use glam::DVec3;
use std::time::{Duration, Instant};

/// What the tiles of an iteration have in common.
#[derive(Clone, Copy)]
pub struct Job<'a> {
    /// How camera paths are traced.
    pub pass: CameraPass<'a>,
    /// What they are merged with.
    pub merge: Merge<'a>,
    /// How many of them.
    pub counts: &'a Counts,
    /// Whether noise is measured.
    pub measure: Measure,
    /// How many camera paths are merged together, about.
    pub together: usize,
    /// Iterations that the sums hold already.
    pub before: u64,
    /// What is kept beside the image.
    pub kept: AovSelection,
}

impl<'a> Job<'a> {
    /// Of an iteration that is added to `before` others.
    pub fn new(
        pass: CameraPass<'a>,
        merge: Merge<'a>,
        counts: &'a Counts,
        measure: Measure,
        before: u64,
    ) -> Self {
        let together = merge.batch_size(measure != Measure::Off);
        Self { pass, merge, counts, measure, together, before, kept: AovSelection::default() }
    }

    /// The same, keeping this beside the image.
    pub fn with_aovs(self, kept: AovSelection) -> Self {
        Self { kept, ..self }
    }

    /// Camera paths that each pixel takes at least.
    fn least(&self) -> u32 {
        if self.measure == Measure::Off { 1 } else { 2 }
    }

    /// Tiles that have as many camera paths as are merged together.
    pub fn tiles_together(&self) -> usize {
        let per_pixel = self.counts.camera_paths.mean().max(f64::from(self.least()));
        (self.together as f64 / (per_pixel * Tile::PIXELS)) as usize
    }
}

/// A reusable workspace with counters.
#[derive(Debug, Default)]
pub struct Worker {
    paths: CameraPaths,
    gathered: MergeOutput,
    tiles: Vec<Tile>,
    /// Sum over camera paths of each pixel of the tiles.
    values: Vec<DVec3>,
    /// What is measured of each pixel of the tiles.
    measured: Vec<PixelMeasurement>,
    /// Of what merges beyond half the radii bring, by class of photons; none if it is not asked for.
    beyond: Vec<[DVec3; 2]>,
    /// The same of what is kept beside; none if nothing is.
    layers: Vec<LayerValue>,
    /// Caustics alone, where they have to be gathered again.
    caustics: MergeOutput,
    pairs: AllPairs,
    halves: Halves,
    clock: PhaseClock,
    non_finite: Vec<(u32, u32)>,
}

/// Busy times.
#[derive(Debug, Default)]
pub(super) struct PhaseClock {
    camera: Duration,
    merge: Duration,
}

/// What a worker counted since it was last asked.
#[derive(Debug)]
pub struct WorkerCounts {
    /// Busy time of the camera phase.
    pub camera: Duration,
    /// Busy time of the merge phase.
    pub merge: Duration,
    /// Rays traced.
    pub rays: u64,
    /// Pixels whose value was not finite and was left out.
    pub non_finite: Vec<(u32, u32)>,
}

impl Worker {
    /// Adds one iteration of some tiles to their pixels' sums, and to their noise when it is measured.
    pub fn render(&mut self, job: &Job, tiles: &mut [TileSums]) {
        self.tiles.clear();
        self.tiles.extend(tiles.iter().map(|tile| tile.tile));
        let pixels = self.tiles.iter().map(Tile::len).sum();
        self.values.clear();
        self.values.resize(pixels, DVec3::ZERO);
        self.measured.clear();
        if job.measure != Measure::Off {
            self.measured.resize(pixels, PixelMeasurement::default());
        }
        self.layers.clear();
        if job.kept.any() {
            self.layers.resize(pixels, LayerValue::default());
        }
        self.beyond.clear();
        if job.merge.options().records_annulus {
            self.beyond.resize(pixels, <[DVec3; 2]>::default());
        }
        self.paths.record_aovs(job.kept.any());
        let Self { paths, gathered, values, beyond, measured, pairs, halves, clock, .. } = self;
        let width = job.pass.settings.width;
        let ids = TilePaths::new(&self.tiles, &job.counts.camera_paths, job.least(), width);
        let per_light_path = f64::from(job.counts.light_paths).recip();
        let layers = LayerSums::new(job, &mut self.layers, &mut self.caustics);
        let paths_of = ids.clone();
        let mut image = ImageSums { values, beyond, per_light_path, paths: paths_of, layers };
        match job.measure {
            Measure::Off => trace(job, ids, paths, clock, |paths| {
                job.merge.gather(paths, gathered);
                image.layers.gather_caustics(job, paths);
                for path in 0..paths.direct.len() {
                    image.end_path(paths, gathered, path);
                }
            }),
            Measure::Pairs => {
                let measuring = Measuring::new(job, image, pairs, measured);
                measure(job, ids, (paths, gathered), clock, measuring);
            }
            Measure::Halves => {
                let measuring = Measuring::new(job, image, halves, measured);
                measure(job, ids, (paths, gathered), clock, measuring);
            }
        }
        self.finish(job, tiles);
    }

    /// Moves the tiles' values to the sums over iterations.
    fn finish(&mut self, job: &Job, tiles: &mut [TileSums]) {
        let mut first = 0;
        for TileSums { tile, sums, noise, deviation, beyond, layers } in tiles {
            for ((index, sums), value) in sums.iter_mut().enumerate().zip(&self.values[first..]) {
                let (x, y) = tile.pixel(index as u32);
                let pixel = (y * job.pass.settings.width + x) as usize;
                // theory.md (7)
                let value = value / f64::from(job.counts.camera_paths.at(pixel));
                if !value.is_finite() {
                    self.non_finite.push((x, y));
                    continue;
                }
                *deviation += sums.deviation(value, job.before);
                sums.add(value);
                if let (Some(to), Some(own)) = (&mut *beyond, self.beyond.get(first + index)) {
                    let camera_paths = f64::from(job.counts.camera_paths.at(pixel));
                    to.add(index, value, own.map(|sum| sum / camera_paths));
                }
                if let Some(layer) = self.layers.get(first + index) {
                    let camera_paths = job.counts.camera_paths.at(pixel);
                    layers.add(index, value, layer, camera_paths);
                }
                if let Some(noise) = noise {
                    let value = luminance(value);
                    let measured = self.measured[first + index];
                    noise.add(index, &PixelMeasurement { value, ..measured });
                }
            }
            first += tile.len();
        }
    }

    /// Hands over the counters.
    pub fn take_counts(&mut self) -> WorkerCounts {
        let PhaseClock { camera, merge } = std::mem::take(&mut self.clock);
        WorkerCounts {
            camera,
            merge,
            rays: std::mem::take(&mut self.paths.rays),
            non_finite: std::mem::take(&mut self.non_finite),
        }
    }
}

/// Traces camera paths, and hands over as many at once as are merged together.
pub(super) fn trace(
    job: &Job,
    mut ids: TilePaths,
    paths: &mut CameraPaths,
    clock: &mut PhaseClock,
    mut merge: impl FnMut(&mut CameraPaths),
) {
    while !ids.is_done() {
        let start = Instant::now();
        paths.clear();
        while !ids.is_done() {
            paths.trace(&job.pass, ids.by_ref().take(CameraPaths::BATCH));
            if paths.direct.len().max(paths.gather_points.lanes()) >= job.together {
                break;
            }
        }
        let traced = Instant::now();
        merge(paths);
        clock.camera += traced - start;
        clock.merge += traced.elapsed();
    }
}

/// Traces camera paths, adds them to the image and estimates the coefficients from their pairs.
fn measure<E: Estimator>(
    job: &Job,
    ids: TilePaths,
    (paths, gathered): (&mut CameraPaths, &mut MergeOutput),
    clock: &mut PhaseClock,
    mut measuring: Measuring<E>,
) {
    trace(job, ids, paths, clock, |paths| {
        measuring.image.layers.gather_caustics(job, paths);
        job.merge.gather_pairs(paths, gathered, |gathered, complete| {
            for path in complete {
                for (pairs, nested) in gathered.pairs.of_path(path) {
                    measuring.pairs(pairs, nested);
                }
                measuring.end_path(paths, gathered, path);
            }
        });
    });
}

/// Adds camera paths to the image.
struct ImageSums<'a> {
    values: &'a mut [DVec3],
    beyond: &'a mut [[DVec3; 2]],
    /// `1/N_F`.
    per_light_path: f64,
    /// At the current camera path.
    paths: TilePaths<'a>,
    layers: LayerSums<'a>,
}

impl ImageSums<'_> {
    #[inline]
    fn end_path(&mut self, paths: &CameraPaths, gathered: &MergeOutput, number: usize) {
        let TilePaths { pixel, path, in_image, .. } = self.paths;
        if path < in_image {
            // theory.md (7), of one camera path
            let (direct, merged) = (paths.direct[number], gathered.sums[number]);
            let value = direct.as_dvec3() + merged.as_dvec3() * self.per_light_path;
            self.values[pixel] += value;
            if let Some(sums) = self.beyond.get_mut(pixel) {
                for (sum, own) in sums.iter_mut().zip(gathered.annulus[number]) {
                    *sum += own.as_dvec3() * self.per_light_path;
                }
            }
            self.layers.end_path((paths, gathered), (number, pixel), self.per_light_path);
        }
        self.paths.advance();
    }
}

/// Adds camera paths to the image and estimates the coefficients from their pairs.
struct Measuring<'a, E> {
    image: ImageSums<'a>,
    estimator: &'a mut E,
    measured: &'a mut [PixelMeasurement],
    /// `N_F`.
    n_light: u32,
    /// What the current camera path loses from the merge radii to `1/sqrt(2)` of them, and on to half.
    nested: [f64; 2],
}

impl<'a, E: Estimator> Measuring<'a, E> {
    fn new(
        job: &Job,
        image: ImageSums<'a>,
        estimator: &'a mut E,
        measured: &'a mut [PixelMeasurement],
    ) -> Self {
        estimator.start_pixel();
        Self { image, estimator, measured, n_light: job.counts.light_paths, nested: [0.0; 2] }
    }

    #[inline]
    fn pairs(&mut self, pairs: &[Pair], nested: [f32; 2]) {
        for &Pair { light_path, value } in pairs {
            self.estimator.pair(light_path, f64::from(value));
        }
        self.nested.iter_mut().zip(nested).for_each(|(sum, d)| *sum += f64::from(d));
    }

    #[inline]
    fn end_path(&mut self, paths: &CameraPaths, gathered: &MergeOutput, number: usize) {
        let TilePaths { pixel, path, traced, .. } = self.image.paths;
        self.image.end_path(paths, gathered, number);
        let direct = paths.direct[number];
        self.estimator.end_path(f64::from(math::luminance(direct)), self.n_light);
        let measured = &mut self.measured[pixel];
        // theory.md (68)
        let scale = self.image.per_light_path / f64::from(traced);
        for (sum, nested) in measured.nested.iter_mut().zip(std::mem::take(&mut self.nested)) {
            *sum += nested * scale;
        }
        if path + 1 == traced {
            // theory.md (51) to (61)
            measured.coefficients = self.estimator.finish_pixel(self.n_light, traced);
            self.estimator.start_pixel();
        }
    }
}
