//! One thread's work on one tile: camera and merge phases, and what becomes of the pairs.

use crate::camera_paths::{CameraPass, CameraPathId, CameraPaths};
use crate::film::{PixelSums, Tile, luminance};
use crate::math::{self, Rgb};
use crate::merge::{Merge, PairVisitor};
use crate::noise::film::{NoiseTile, PixelMeasurement};
use crate::noise::{Estimator, Measure, halves::Halves, pairs::AllPairs};
use glam::DVec3;
use std::time::{Duration, Instant};

/// Camera paths traced together: enough to fill ray packets, few enough to stay in the
/// second-level cache.
const BATCH: u64 = 2048;

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
    camera: Duration,
    merge: Duration,
    non_finite: Vec<(u32, u32)>,
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
    pub fn render(
        &mut self,
        pass: &CameraPass,
        merge: &Merge,
        measure: Measure,
        (tile, sums): (Tile, &mut [PixelSums]),
        noise: Option<NoiseTile>,
    ) {
        let per_pixel = u64::from(pass.settings.camera_paths);
        self.values.clear();
        self.values.resize(tile.len(), DVec3::ZERO);
        self.measured.clear();
        self.measured.resize(tile.len(), PixelMeasurement::default());
        self.pairs.start_pixel();
        self.halves.start_pixel();

        let all = tile.len() as u64 * per_pixel;
        for first in (0..all).step_by(BATCH as usize) {
            let start = Instant::now();
            let ids = (first..all.min(first + BATCH)).map(|path| {
                let (x, y) = tile.pixel((path / per_pixel) as u32);
                CameraPathId { x, y, index: (path % per_pixel) as u32 }
            });
            self.paths.trace(pass, ids);
            let traced = Instant::now();
            self.merge_batch(pass, merge, measure, first);
            self.camera += traced - start;
            self.merge += traced.elapsed();
        }
        self.finish(tile, sums, noise, per_pixel as f64);
    }

    /// Merges the traced batch, whose first path is number `first` of the tile.
    fn merge_batch(&mut self, pass: &CameraPass, merge: &Merge, measure: Measure, first: u64) {
        let (n_light, n_camera) = (pass.settings.light_paths, pass.settings.camera_paths);
        let mut image = ImageSums {
            values: &mut self.values,
            gathered: Rgb::ZERO,
            per_light_path: f64::from(n_light).recip(),
            per_pixel: u64::from(n_camera),
            next: first,
        };
        let measured = &mut self.measured[..];
        let counts = (n_light, n_camera);
        match measure {
            Measure::Off => merge.visit(&self.paths, &mut image),
            Measure::Pairs => {
                let estimator = &mut self.pairs;
                merge.visit(
                    &self.paths,
                    &mut Measuring { image, estimator, measured, counts, nested: 0.0 },
                );
            }
            Measure::Halves => {
                let estimator = &mut self.halves;
                merge.visit(
                    &self.paths,
                    &mut Measuring { image, estimator, measured, counts, nested: 0.0 },
                );
            }
        }
    }

    /// Moves the tile's values to the sums over iterations.
    fn finish(
        &mut self,
        tile: Tile,
        sums: &mut [PixelSums],
        mut noise: Option<NoiseTile>,
        per_pixel: f64,
    ) {
        for (index, sums) in sums.iter_mut().enumerate() {
            let value = self.values[index] / per_pixel;
            if !value.is_finite() {
                self.non_finite.push(tile.pixel(index as u32));
                continue;
            }
            sums.add(value);
            if let Some(noise) = &mut noise {
                let value = luminance(value);
                noise.add(index, &PixelMeasurement { value, ..self.measured[index] });
            }
        }
    }

    /// Hands over the counters.
    pub fn take_counts(&mut self) -> WorkerCounts {
        WorkerCounts {
            camera: std::mem::take(&mut self.camera),
            merge: std::mem::take(&mut self.merge),
            rays: std::mem::take(&mut self.paths.rays),
            non_finite: std::mem::take(&mut self.non_finite),
        }
    }
}

/// Adds pairs to the image.
struct ImageSums<'a> {
    values: &'a mut [DVec3],
    /// `sum_i I_ij` of the current camera path.
    gathered: Rgb,
    /// `1/N_F`.
    per_light_path: f64,
    per_pixel: u64,
    /// Number in the tile of the current camera path.
    next: u64,
}

impl ImageSums<'_> {
    /// Pixel of the current camera path, and whether the path is the pixel's last.
    fn pixel(&self) -> (usize, bool) {
        let pixel = self.next / self.per_pixel;
        (pixel as usize, self.next + 1 == (pixel + 1) * self.per_pixel)
    }
}

impl PairVisitor for ImageSums<'_> {
    #[inline]
    fn pair(&mut self, _: u32, contribution: Rgb, _: bool) {
        self.gathered += contribution;
    }

    #[inline]
    fn end_path(&mut self, direct: Rgb) {
        let value = direct.as_dvec3() + self.gathered.as_dvec3() * self.per_light_path;
        let (pixel, _) = self.pixel();
        self.values[pixel] += value;
        self.gathered = Rgb::ZERO;
        self.next += 1;
    }
}

/// Adds pairs to the image and estimates the coefficients.
struct Measuring<'a, E> {
    image: ImageSums<'a>,
    estimator: &'a mut E,
    measured: &'a mut [PixelMeasurement],
    /// `N_F` and `N_B`.
    counts: (u32, u32),
    /// `sum_i I_ij` less twice its part in the inner half of the kernel: what the current camera
    /// path loses at `1/sqrt(2)` of the radius.
    nested: f64,
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
        let (n_light, n_camera) = self.counts;
        let (pixel, last) = self.image.pixel();
        self.image.end_path(direct);
        self.estimator.end_path(f64::from(math::luminance(direct)), n_light);
        self.measured[pixel].nested_difference +=
            std::mem::take(&mut self.nested) * self.image.per_light_path / f64::from(n_camera);
        if last {
            self.measured[pixel].coefficients = self.estimator.finish_pixel(n_light, n_camera);
            self.estimator.start_pixel();
        }
    }
}
