//! One thread's work on one tile: camera and merge phases, and what becomes of the pairs.

use crate::camera_paths::{CameraPass, CameraPathId, CameraPaths};
use crate::counts::Counts;
use crate::film::{PixelSums, Tile, luminance};
use crate::math::{self, Rgb};
use crate::merge::{Merge, PairVisitor};
use crate::noise::film::{NoiseTile, PixelMeasurement};
use crate::noise::{Estimator, Measure, halves::Halves, pairs::AllPairs};
use glam::DVec3;
use std::time::{Duration, Instant};

/// Camera paths traced together: enough to fill ray packets, few enough to stay in the
/// second-level cache.
const BATCH: usize = 2048;

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
    /// Iterations that the sums hold already.
    pub before: u64,
}

/// A reusable workspace with counters.
#[derive(Debug, Default)]
pub struct Worker {
    paths: CameraPaths,
    /// Sum over camera paths of each pixel of the tile.
    values: Vec<DVec3>,
    /// What is measured of each pixel of the tile.
    measured: Vec<PixelMeasurement>,
    pairs: AllPairs,
    halves: Halves,
    clock: Clock,
    non_finite: Vec<(u32, u32)>,
}

/// Busy times.
#[derive(Debug, Default)]
struct Clock {
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
    /// Adds one iteration of a tile to its pixels' sums, and to `noise` when it is measured.
    /// Returns the sum over pixels of [`PixelSums::deviation`].
    pub fn render(
        &mut self,
        job: &Job,
        (tile, sums): (Tile, &mut [PixelSums]),
        noise: Option<NoiseTile>,
    ) -> f64 {
        let Self { paths, values, measured, pairs, halves, clock, .. } = self;
        values.clear();
        values.resize(tile.len(), DVec3::ZERO);
        measured.clear();
        measured.resize(tile.len(), PixelMeasurement::default());
        let image = ImageSums {
            values,
            gathered: Rgb::ZERO,
            per_light_path: f64::from(job.counts.light_paths).recip(),
            paths: TilePaths::new(job, tile),
        };
        match job.measure {
            Measure::Off => trace_and_merge(job, tile, paths, clock, image),
            Measure::Pairs => {
                let visitor = Measuring::new(job, image, pairs, measured);
                trace_and_merge(job, tile, paths, clock, visitor);
            }
            Measure::Halves => {
                let visitor = Measuring::new(job, image, halves, measured);
                trace_and_merge(job, tile, paths, clock, visitor);
            }
        }
        self.finish(job, tile, sums, noise)
    }

    /// Moves the tile's values to the sums over iterations.
    fn finish(
        &mut self,
        job: &Job,
        tile: Tile,
        sums: &mut [PixelSums],
        mut noise: Option<NoiseTile>,
    ) -> f64 {
        let mut deviations = 0.0;
        for (index, sums) in sums.iter_mut().enumerate() {
            let (x, y) = tile.pixel(index as u32);
            let pixel = (y * job.pass.settings.width + x) as usize;
            let value = self.values[index] / f64::from(job.counts.camera_paths.at(pixel));
            if !value.is_finite() {
                self.non_finite.push((x, y));
                continue;
            }
            deviations += sums.deviation(value, job.before);
            sums.add(value);
            if let Some(noise) = &mut noise {
                let value = luminance(value);
                noise.add(index, &PixelMeasurement { value, ..self.measured[index] });
            }
        }
        deviations
    }

    /// Hands over the counters.
    pub fn take_counts(&mut self) -> WorkerCounts {
        let Clock { camera, merge } = std::mem::take(&mut self.clock);
        WorkerCounts {
            camera,
            merge,
            rays: std::mem::take(&mut self.paths.rays),
            non_finite: std::mem::take(&mut self.non_finite),
        }
    }
}

/// Traces the tile's camera paths batch by batch and shows all their pairs to `visitor`.
fn trace_and_merge(
    job: &Job,
    tile: Tile,
    paths: &mut CameraPaths,
    clock: &mut Clock,
    mut visitor: impl PairVisitor,
) {
    let mut ids = TilePaths::new(job, tile).peekable();
    while ids.peek().is_some() {
        let start = Instant::now();
        paths.trace(&job.pass, ids.by_ref().take(BATCH));
        let traced = Instant::now();
        job.merge.visit(paths, &mut visitor);
        clock.camera += traced - start;
        clock.merge += traced.elapsed();
    }
}

/// The camera paths of a tile, pixel after pixel.
#[derive(Clone)]
struct TilePaths<'a> {
    tile: Tile,
    width: u32,
    counts: &'a Counts,
    /// Paths that a pixel has at least: measuring takes two, even where the image takes one.
    least: u32,
    pixel: u32,
    /// Column and row of the current pixel.
    place: (u32, u32),
    path: u32,
    /// Paths of the current pixel: those of the image, and those that are traced.
    in_image: u32,
    traced: u32,
}

impl<'a> TilePaths<'a> {
    fn new(job: &Job<'a>, tile: Tile) -> Self {
        let least = if job.measure == Measure::Off { 1 } else { 2 };
        let (width, counts) = (job.pass.settings.width, job.counts);
        let mut paths = Self {
            tile,
            width,
            counts,
            least,
            pixel: 0,
            place: (0, 0),
            path: 0,
            in_image: 0,
            traced: 0,
        };
        paths.enter_pixel();
        paths
    }

    fn enter_pixel(&mut self) {
        if self.pixel as usize == self.tile.len() {
            return;
        }
        let (x, y) = self.tile.pixel(self.pixel);
        self.place = (x, y);
        self.path = 0;
        self.in_image = self.counts.camera_paths.at((y * self.width + x) as usize);
        self.traced = self.in_image.max(self.least);
    }

    /// Goes on to the next path.
    #[inline]
    fn advance(&mut self) {
        self.path += 1;
        if self.path == self.traced {
            self.pixel += 1;
            self.enter_pixel();
        }
    }
}

impl Iterator for TilePaths<'_> {
    type Item = CameraPathId;

    #[inline]
    fn next(&mut self) -> Option<CameraPathId> {
        if self.pixel as usize == self.tile.len() {
            return None;
        }
        let (x, y) = self.place;
        let id = CameraPathId { x, y, index: self.path };
        self.advance();
        Some(id)
    }
}

/// Adds pairs to the image.
struct ImageSums<'a> {
    values: &'a mut [DVec3],
    /// `sum_i I_ij` of the current camera path.
    gathered: Rgb,
    /// `1/N_F`.
    per_light_path: f64,
    /// At the current camera path.
    paths: TilePaths<'a>,
}

impl PairVisitor for ImageSums<'_> {
    #[inline]
    fn pair(&mut self, _: u32, contribution: Rgb, _: bool) {
        self.gathered += contribution;
    }

    #[inline]
    fn end_path(&mut self, direct: Rgb) {
        let TilePaths { pixel, path, in_image, .. } = self.paths;
        if path < in_image {
            let value = direct.as_dvec3() + self.gathered.as_dvec3() * self.per_light_path;
            self.values[pixel as usize] += value;
        }
        self.gathered = Rgb::ZERO;
        self.paths.advance();
    }
}

/// Adds pairs to the image and estimates the coefficients.
struct Measuring<'a, E> {
    image: ImageSums<'a>,
    estimator: &'a mut E,
    measured: &'a mut [PixelMeasurement],
    /// `N_F`.
    n_light: u32,
    /// `sum_i I_ij` less twice its part in the inner half of the kernel: what the current camera
    /// path loses at `1/sqrt(2)` of the radius.
    nested: f64,
}

impl<'a, E: Estimator> Measuring<'a, E> {
    fn new(
        job: &Job,
        image: ImageSums<'a>,
        estimator: &'a mut E,
        measured: &'a mut [PixelMeasurement],
    ) -> Self {
        estimator.start_pixel();
        Self { image, estimator, measured, n_light: job.counts.light_paths, nested: 0.0 }
    }
}

impl<E: Estimator> PairVisitor for Measuring<'_, E> {
    #[inline]
    fn pair(&mut self, light_path: u32, contribution: Rgb, inner: bool) {
        self.image.pair(light_path, contribution, inner);
        let value = f64::from(math::luminance(contribution));
        self.estimator.pair(light_path, value);
        self.nested += if inner { -value } else { value };
    }

    #[inline]
    fn end_path(&mut self, direct: Rgb) {
        let TilePaths { pixel, path, traced, .. } = self.image.paths;
        self.image.end_path(direct);
        self.estimator.end_path(f64::from(math::luminance(direct)), self.n_light);
        let measured = &mut self.measured[pixel as usize];
        measured.nested_difference +=
            std::mem::take(&mut self.nested) * self.image.per_light_path / f64::from(traced);
        if path + 1 == traced {
            measured.coefficients = self.estimator.finish_pixel(self.n_light, traced);
            self.estimator.start_pixel();
        }
    }
}
