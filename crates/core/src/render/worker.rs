//! Work of one thread on some tiles: camera phase, merge phase, and the sums of both.

use super::accumulators::{CellSamples, IterationSample};
use super::aov_sums::AovSums;
use super::measured_pixels::{MeasuredPixels, PixelFilter};
use super::suffixes::CacheBias;
use super::tile_paths::TilePaths;
use super::tiles::TileSums;
use crate::base::math;
use crate::film::annulus::CLASSES;
use crate::film::aov::{AovSample, AovSelection};
use crate::film::cells::CellGrid;
use crate::film::counts::Counts;
use crate::film::radiance::luminance;
use crate::film::statistic::PixelSample;
use crate::film::tiled_buffer::Tile;
use crate::noise::film::PixelMeasurement;
use crate::noise::halves::Halves;
use crate::noise::pairs::AllPairs;
use crate::noise::{Estimator, Measure};
use crate::transport::camera_paths::{CameraPass, CameraPaths};
use crate::transport::merge::{Merge, MergeOutput};
use crate::transport::pair_list::Pair;
use crate::transport::photon::PhotonClass;
use glam::DVec3;
use std::mem;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Parameters of an iteration that all tiles have in common.
#[derive(Clone, Copy)]
pub struct Job<'a> {
    /// Parameters of the camera paths.
    pub pass: CameraPass<'a>,
    /// Photons that the camera paths are merged with.
    pub merge: Merge<'a>,
    /// Path counts.
    pub counts: &'a Counts,
    /// Whether the noise coefficients are measured.
    pub measure: Measure,
    /// Layers that are kept beside the image.
    pub aovs: AovSelection,
    /// Approximate number of camera paths that are merged in one batch.
    pub batch_size: usize,
    /// The pixels that are measured, if not all are.
    pub measured: Option<MeasuredPixels>,
    /// Leaves out what camera paths find without photons.
    pub leaves_out_direct: bool,
    /// What the cache adds to the pixels beyond full paths.
    pub cache_bias: Option<&'a CacheBias>,
    /// Leaves out all work once it is true.
    pub interrupt: Option<&'a AtomicBool>,
}

impl<'a> Job<'a> {
    /// Keeps no layers.
    pub fn new(
        pass: CameraPass<'a>,
        merge: Merge<'a>,
        counts: &'a Counts,
        measure: Measure,
    ) -> Self {
        let batch_size = merge.batch_size(measure != Measure::Off);
        let (aovs, measured, interrupt) = (AovSelection::default(), None, None);
        Self {
            pass,
            merge,
            counts,
            measure,
            aovs,
            batch_size,
            measured,
            leaves_out_direct: false,
            cache_bias: None,
            interrupt,
        }
    }

    fn is_interrupted(&self) -> bool {
        self.interrupt.is_some_and(|interrupt| interrupt.load(Ordering::Relaxed))
    }

    /// Minimum number of camera paths that are traced in a pixel.
    fn min_camera_paths(&self) -> u32 {
        if self.measure == Measure::Off { 1 } else { 2 }
    }

    /// Number of tiles with as many camera paths as one batch.
    pub fn tiles_per_batch(&self) -> usize {
        let per_pixel = self.counts.camera_paths.mean().max(f64::from(self.min_camera_paths()));
        (self.batch_size as f64 / (per_pixel * Tile::PIXELS)) as usize
    }

    /// Camera paths of `tiles`; of the measured pixels only, if not all are.
    pub fn paths<'b>(&'b self, tiles: &'b [Tile]) -> TilePaths<'b> {
        let filter = self.measured.map_or(PixelFilter::All, PixelFilter::Measured);
        self.paths_of(tiles, filter, self.min_camera_paths())
    }

    fn paths_of<'b>(
        &'b self,
        tiles: &'b [Tile],
        filter: PixelFilter,
        min_paths: u32,
    ) -> TilePaths<'b> {
        let resolution = self.pass.settings.resolution();
        TilePaths::new(tiles, &self.counts.camera_paths, min_paths, resolution, filter)
    }

    /// Weight of a light path, `1/N_F`.
    pub fn per_light_path(&self) -> f64 {
        f64::from(self.counts.light_paths).recip()
    }
}

/// Reusable workspace of a thread, with counters.
#[derive(Debug, Default)]
pub struct Worker {
    paths: CameraPaths,
    gathered: MergeOutput,
    tiles: Vec<Tile>,
    /// Sum over the camera paths of each pixel.
    values: Vec<DVec3>,
    /// Sum over the camera paths of the contribution from the outer annulus, by photon class; empty
    /// if it is not kept.
    annulus: Vec<[DVec3; CLASSES]>,
    /// Sum over the camera paths of the layers; empty if none is kept.
    aovs: Vec<AovSample>,
    /// Coefficients of each pixel; empty if they are not measured.
    measurements: Vec<PixelMeasurement>,
    /// Means over the cells of a tile; not used if each cell is a single pixel.
    cells: CellSamples,
    pairs: AllPairs,
    halves: Halves,
    counts: WorkerCounts,
}

/// Counters of a thread since they were last taken.
#[derive(Debug, Default)]
pub struct WorkerCounts {
    /// Busy time of the camera phase.
    pub camera: Duration,
    /// Busy time of the merge phase.
    pub merge: Duration,
    /// Traced rays.
    pub rays: u64,
    /// Column and row of the pixels whose value was not finite and was left out.
    pub non_finite: Vec<(u32, u32)>,
}

/// Sets all of `length` values to the default, or removes them if they are not `wanted`.
fn reset<T: Clone + Default>(values: &mut Vec<T>, wanted: bool, length: usize) {
    values.clear();
    values.resize(if wanted { length } else { 0 }, T::default());
}

impl Worker {
    /// Adds one iteration of some tiles to their sums.
    pub fn render(&mut self, job: &Job, tiles: &mut [TileSums]) {
        self.tiles.clear();
        self.tiles.extend(tiles.iter().map(|tile| tile.film.tile));
        let pixels = self.tiles.iter().map(Tile::len).sum();
        reset(&mut self.values, true, pixels);
        reset(&mut self.annulus, job.merge.options().records_annulus, pixels);
        reset(&mut self.aovs, job.aovs.any(), pixels);
        reset(&mut self.measurements, job.measure != Measure::Off, pixels);
        self.paths.record_aovs(job.aovs.any());

        let ids = job.paths(&self.tiles);
        let mut image = ImageSums {
            values: &mut self.values,
            annulus: &mut self.annulus,
            aovs: AovSums::new(job, &mut self.aovs),
            leaves_out_direct: job.leaves_out_direct,
            per_light_path: job.per_light_path(),
            paths: ids.clone(),
        };
        let Self { paths, gathered, measurements, counts, .. } = self;
        let mut render = |ids, image: &mut ImageSums| {
            trace(job, ids, paths, counts, |paths| {
                job.merge.gather(paths, gathered);
                for path in 0..paths.direct.len() {
                    image.end_path(paths, gathered, path);
                }
            });
        };
        if let Some(measured) = job.measured {
            let others = job.paths_of(&self.tiles, PixelFilter::Unmeasured(measured), 1);
            image.paths = others.clone();
            render(others, &mut image);
            image.paths = ids.clone();
        }
        match job.measure {
            Measure::Off => render(ids, &mut image),
            Measure::Pairs => {
                let measuring = Measuring::new(job, image, &mut self.pairs, measurements);
                measuring.run(ids, paths, gathered, counts);
            }
            Measure::Halves => {
                let measuring = Measuring::new(job, image, &mut self.halves, measurements);
                measuring.run(ids, paths, gathered, counts);
            }
        }
        self.finish(job, tiles);
    }

    /// Adds the iteration's pixels to the sums over iterations.
    fn finish(&mut self, job: &Job, tiles: &mut [TileSums]) {
        let side = CellGrid::of(job.pass.settings.resolution()).side();
        let mut first = 0;
        for sums in tiles {
            let tile = sums.film.tile;
            self.cells.start(if side > 1 { tile.cells(side) } else { 0 });
            for index in 0..tile.len() {
                let (x, y) = tile.pixel(index as u32);
                let pixel = (y * job.pass.settings.width + x) as usize;
                let mut sample = self.sample(first + index, job.counts.camera_paths.at(pixel));
                if let (Some(bias), Some(annulus)) = (job.cache_bias, &mut sample.pixel.annulus) {
                    annulus[PhotonClass::Diffuse as usize] = bias.at((x, y));
                }
                if !sample.pixel.value.is_finite() {
                    self.counts.non_finite.push((x, y));
                } else if side == 1 {
                    sums.add_sample(index, &sample);
                } else {
                    sums.add_pixel(index, &sample);
                    let resolution = job.pass.settings.resolution();
                    let is_measured = job.measured.is_none_or(|measured| {
                        PixelFilter::Measured(measured).includes((x, y), resolution)
                    });
                    self.cells.add(tile.cell_of(index as u32, side), &sample, is_measured);
                }
            }
            self.cells.means().for_each(|(cell, mean)| sums.add_cell(cell, &mean));
            first += tile.len();
        }
    }

    /// Means over the camera paths of one pixel.
    fn sample(&self, at: usize, camera_paths: u32) -> IterationSample {
        let n = f64::from(camera_paths);
        // theory.md (7)
        let value = self.values[at] / n;
        let annulus = self.annulus.get(at).map(|sums| sums.map(|sum| sum / n));
        let mean = |sums: &AovSample| {
            let mut mean = AovSample::default();
            mean.add(sums, n.recip());
            mean
        };
        let aovs = self.aovs.get(at).map(mean).filter(AovSample::is_finite);
        let measured = self.measurements.get(at).copied().unwrap_or_default();
        IterationSample {
            pixel: PixelSample { value, annulus, aovs },
            measurement: PixelMeasurement { value: luminance(value), ..measured },
        }
    }

    /// Takes the counters and resets them.
    pub fn take_counts(&mut self) -> WorkerCounts {
        WorkerCounts { rays: mem::take(&mut self.paths.rays), ..mem::take(&mut self.counts) }
    }
}

/// Traces camera paths and calls `merge` with batches of about [`Job::batch_size`].
pub(super) fn trace(
    job: &Job,
    mut ids: TilePaths,
    paths: &mut CameraPaths,
    counts: &mut WorkerCounts,
    mut merge: impl FnMut(&mut CameraPaths),
) {
    while !ids.is_done() && !job.is_interrupted() {
        let start = Instant::now();
        paths.clear();
        while !ids.is_done() {
            paths.trace(&job.pass, ids.by_ref().take(CameraPaths::BATCH));
            let in_media = paths.medium_points.len().max(paths.beams.len());
            if paths.direct.len().max(paths.gather_points.lanes()).max(in_media) >= job.batch_size {
                break;
            }
        }
        let traced = Instant::now();
        merge(paths);
        counts.camera += traced - start;
        counts.merge += traced.elapsed();
    }
}

/// Adds camera paths to the image.
struct ImageSums<'a> {
    values: &'a mut [DVec3],
    annulus: &'a mut [[DVec3; CLASSES]],
    aovs: AovSums<'a>,
    /// Leaves out what camera paths find without photons.
    leaves_out_direct: bool,
    /// `1/N_F`.
    per_light_path: f64,
    /// Position at the current camera path.
    paths: TilePaths<'a>,
}

impl ImageSums<'_> {
    #[inline]
    fn end_path(&mut self, paths: &CameraPaths, gathered: &MergeOutput, number: usize) {
        let TilePaths { pixel, path, in_image, .. } = self.paths;
        if path < in_image {
            // theory.md (7), of one camera path
            let (direct, merged) = (paths.direct[number], gathered.sums[number]);
            let direct = if self.leaves_out_direct { DVec3::ZERO } else { direct.as_dvec3() };
            let mut value = direct + merged.as_dvec3() * self.per_light_path;
            if let Some(cached) = paths.cached.get(number) {
                value += cached.sum.as_dvec3();
            }
            self.values[pixel] += value;
            if let Some(sums) = self.annulus.get_mut(pixel) {
                for (sum, own) in sums.iter_mut().zip(gathered.annulus[number]) {
                    *sum += own.as_dvec3() * self.per_light_path;
                }
            }
            self.aovs.add(paths, gathered, number, pixel);
        }
        self.paths.advance();
    }
}

/// Adds camera paths to the image and estimates the coefficients from their pairs.
struct Measuring<'a, E> {
    job: &'a Job<'a>,
    image: ImageSums<'a>,
    estimator: &'a mut E,
    measurements: &'a mut [PixelMeasurement],
    /// Independent samples of light paths: `N_F`, or the number of sets.
    light_samples: u32,
    /// Light paths of a sample.
    per_sample: f64,
    /// Camera paths end at a cache.
    has_cache: bool,
    /// Nested differences of the current camera path.
    nested: [f64; 2],
}

impl<'a, E: Estimator> Measuring<'a, E> {
    fn new(
        job: &'a Job<'a>,
        image: ImageSums<'a>,
        estimator: &'a mut E,
        measurements: &'a mut [PixelMeasurement],
    ) -> Self {
        estimator.start_pixel();
        let settings = job.pass.settings;
        let light_samples = settings.light_samples(job.counts.light_paths);
        let per_sample = settings.light_sample_size(job.counts.light_paths);
        let (has_cache, nested) = (settings.has_cache(), [0.0; 2]);
        Self { job, image, estimator, measurements, light_samples, per_sample, has_cache, nested }
    }

    fn run(
        mut self,
        ids: TilePaths,
        paths: &mut CameraPaths,
        gathered: &mut MergeOutput,
        counts: &mut WorkerCounts,
    ) {
        let job = self.job;
        trace(job, ids, paths, counts, |paths| {
            job.merge.gather_pairs(paths, gathered, |gathered, complete| {
                for path in complete {
                    for (pairs, nested) in gathered.pairs.of_path(path) {
                        self.add_pairs(pairs, nested);
                    }
                    self.end_path(paths, gathered, path);
                }
            });
        });
    }

    #[inline]
    fn add_pairs(&mut self, pairs: &[Pair], nested: [f32; 2]) {
        for &Pair { light_path, value } in pairs {
            // The samples of a cache are halves, to which light paths belong in turn.
            let sample = if self.has_cache { light_path & 1 } else { light_path };
            // theory.md (40d)
            self.estimator.pair(sample, f64::from(value) / self.per_sample);
        }
        self.nested.iter_mut().zip(nested).for_each(|(sum, d)| *sum += f64::from(d));
    }

    #[inline]
    fn end_path(&mut self, paths: &CameraPaths, gathered: &MergeOutput, number: usize) {
        let TilePaths { pixel, path, traced, .. } = self.image.paths;
        self.image.end_path(paths, gathered, number);
        let direct = paths.direct[number];
        if let Some(cached) = paths.cached.get(number) {
            for (half, value) in (0..).zip(cached.halves) {
                self.estimator.pair(half, f64::from(value));
            }
        }
        self.estimator.end_path(f64::from(math::luminance(direct)), self.light_samples);
        let measurement = &mut self.measurements[pixel];
        // theory.md (68)
        let scale = self.image.per_light_path / f64::from(traced);
        for (sum, nested) in measurement.nested.iter_mut().zip(mem::take(&mut self.nested)) {
            *sum += nested * scale;
        }
        if path + 1 == traced {
            // theory.md (51) to (61)
            let of_samples = self.estimator.finish_pixel(self.light_samples, traced);
            measurement.coefficients = of_samples.per_light_path(self.per_sample);
            self.estimator.start_pixel();
        }
    }
}
