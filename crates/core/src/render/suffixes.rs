//! Suffix paths: full camera paths that fill the cache of an iteration, and tell what it adds to
//! the image beyond them. theory.md, section 11c.

use super::Renderer;
use crate::base::pool::Pool;
use crate::base::rng::{Rng, Stream, StreamKey};
use crate::settings::Settings;
use crate::transport::camera_paths::{CameraPass, CameraPathId, CameraPaths};
use crate::transport::merge::MergeOutput;
use crate::transport::suffix_cache::{SuffixCache, SuffixRecord, SuffixRecorder};
use glam::DVec3;
use rayon::prelude::*;
use std::mem;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Mean number of suffix paths in each square of pixels in which the bias is averaged.
const PATHS_PER_SQUARE: f64 = 16.0;

/// Least side of these squares, pixels.
const LEAST_SIDE: u32 = 8;

/// The suffix paths of an iteration; buffers are reused by the next.
#[derive(Debug, Default)]
pub(super) struct Suffixes {
    records: Vec<SuffixRecord>,
    cache: Option<SuffixCache>,
    bias: Option<CacheBias>,
    workers: Pool<SuffixWorker>,
    count: u64,
    rays: u64,
    busy: Duration,
}

/// Reusable workspace of a thread.
#[derive(Debug, Default)]
struct SuffixWorker {
    paths: CameraPaths,
    merged: MergeOutput,
}

/// Radiance that the cache of an iteration adds to parts of the image beyond full paths, with the
/// noise of the suffix paths.
#[derive(Debug)]
pub struct CacheBias {
    /// Side of the squares, pixels.
    side: u32,
    /// Squares across.
    across: usize,
    /// Mean of each square, W/(m^2 sr).
    squares: Vec<DVec3>,
}

/// Pixel of each suffix path: they fill the image evenly.
#[derive(Clone, Copy)]
struct Places {
    resolution: [u32; 2],
    shift: [f64; 2],
}

impl Places {
    /// Generator of the additive recurrence of two dimensions that is most even (Roberts 2018): the
    /// powers of the reciprocal of the plastic number.
    const STEP: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_3];

    fn new(settings: &Settings, mut rng: Rng) -> Self {
        let shift = [rng.next_f64(), rng.next_f64()];
        Self { resolution: [settings.width, settings.height], shift }
    }

    fn of(&self, path: u32) -> CameraPathId {
        let [x, y] = [0, 1].map(|axis| {
            let at = (self.shift[axis] + f64::from(path) * Self::STEP[axis]).fract();
            let pixels = self.resolution[axis];
            ((at * f64::from(pixels)) as u32).min(pixels - 1)
        });
        CameraPathId { x, y, index: path }
    }
}

impl Renderer {
    /// Fills the cache of an iteration, if the strategy has one.
    pub(super) fn fill_cache(
        &mut self,
        count: u32,
        (iteration, interrupt): (u64, Option<&AtomicBool>),
    ) {
        if self.settings.has_cache() {
            let mut suffixes = mem::take(&mut self.suffixes);
            suffixes.fill(self, count, (iteration, interrupt));
            self.suffixes = suffixes;
        }
    }
}

impl Suffixes {
    /// The cache of the current iteration.
    pub fn cache(&self) -> Option<&SuffixCache> {
        self.cache.as_ref()
    }

    /// What this cache adds to the image beyond full paths, if the bias is corrected.
    pub fn bias(&self) -> Option<&CacheBias> {
        self.bias.as_ref()
    }

    /// Number of suffix paths.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Traced rays.
    pub fn rays(&self) -> u64 {
        self.rays
    }

    /// Time on all threads together.
    pub fn busy_time(&self) -> Duration {
        self.busy
    }

    /// Traces `count` paths of an iteration, and fills the cache with their suffixes.
    fn fill(
        &mut self,
        renderer: &Renderer,
        count: u32,
        (iteration, interrupt): (u64, Option<&AtomicBool>),
    ) {
        let Renderer { scene, settings, .. } = renderer;
        let key = StreamKey::new(settings.seed, Stream::SuffixPath, iteration);
        let (pass, merge) = renderer.passes(iteration);
        let (points, cache, light_edges) = (None, None, None);
        let pass = CameraPass { key, hides_lights: false, points, cache, light_edges, ..pass };
        let places = Places::new(settings, key.rng(u64::MAX));
        let batches = (0..count.div_ceil(CameraPaths::BATCH as u32)).into_par_iter();
        let merge = (&merge, (count as f32).recip());
        let trace = |SuffixWorker { paths, merged }: &mut SuffixWorker, batch: u32| {
            let start = Instant::now();
            let first = batch * CameraPaths::BATCH as u32;
            let end = count.min(first + CameraPaths::BATCH as u32);
            let is_over = interrupt.is_some_and(|own| own.load(Ordering::Relaxed));
            let end = if is_over { first } else { end };
            paths.suffixes.get_or_insert_with(SuffixRecorder::default);
            paths.clear();
            let rays = paths.rays;
            paths.trace(&pass, (first..end).map(|path| places.of(path)));
            let own = |record| SuffixRecord { path: record_path(&record, first), ..record };
            let records = paths.end_suffixes(merge, merged).into_iter().map(own);
            let records: Vec<SuffixRecord> = records.collect();
            (records, paths.rays - rays, start.elapsed())
        };
        let traced: Vec<_> =
            batches.map_init(|| self.workers.lease(), |own, batch| trace(own, batch)).collect();
        self.records.clear();
        (self.count, self.rays, self.busy) = (u64::from(count), 0, Duration::ZERO);
        for (records, rays, busy) in traced {
            self.records.extend(records);
            self.rays += rays;
            self.busy += busy;
        }
        let build = Instant::now();
        let cache = SuffixCache::new(&self.records, scene.bounds(), settings.radius);
        self.bias =
            settings.corrects_bias().then(|| CacheBias::new(self, &cache, &places, settings));
        self.cache = Some(cache);
        self.busy += build.elapsed() * rayon::current_num_threads() as u32;
    }
}

/// Number of a record's path in the iteration, whose batch begins at `first`.
fn record_path(record: &SuffixRecord, first: u32) -> u32 {
    first + record.path
}

/// Side of the squares of pixels in which the bias of a cache of so many suffix paths is averaged.
pub(super) fn square_side((width, height): (u32, u32), count: u64) -> u32 {
    let pixels = f64::from(width) * f64::from(height);
    let side = (PATHS_PER_SQUARE * pixels / count.max(1) as f64).sqrt().ceil() as u32;
    side.clamp(LEAST_SIDE, width.max(height).max(LEAST_SIDE))
}

impl CacheBias {
    /// The means of what short paths would have more than the suffix paths themselves, by the half
    /// of the cache that is not their own. theory.md (44j)
    fn new(suffixes: &Suffixes, cache: &SuffixCache, places: &Places, settings: &Settings) -> Self {
        let Settings { width, height, .. } = *settings;
        let side = square_side((width, height), suffixes.count);
        let [across, down] = [width, height].map(|own| own.div_ceil(side) as usize);
        let mut sums = vec![(DVec3::ZERO, 0u32); across * down];
        let square = |path: u32| {
            let CameraPathId { x, y, .. } = places.of(path);
            (y / side) as usize * across + (x / side) as usize
        };
        (0..suffixes.count as u32).for_each(|path| sums[square(path)].1 += 1);
        // Records of a path are in the order of its vertices, but not next to each other.
        let mut ended = vec![false; suffixes.count as usize];
        for own in &suffixes.records {
            let is_over = &mut ended[own.path as usize];
            if *is_over {
                continue;
            }
            let SuffixRecord { at, distance, carried, light, prob, path, .. } = *own;
            let Some(found) = cache.find(at, distance) else { continue };
            *is_over = true;
            let more = (carried * found.halves[1 - own.half()] - light) / prob;
            if more.is_finite() {
                sums[square(path)].0 += more.as_dvec3();
            }
        }
        let mean = |(sum, count): &(DVec3, u32)| *sum / f64::from((*count).max(1));
        Self { side, across, squares: sums.iter().map(mean).collect() }
    }

    /// The mean at a pixel, linear between the centers of squares.
    pub fn at(&self, (x, y): (u32, u32)) -> DVec3 {
        let down = self.squares.len() / self.across;
        let place = |pixel: u32, count: usize| {
            let at = (f64::from(pixel) + 0.5) / f64::from(self.side) - 0.5;
            let at = at.clamp(0.0, (count - 1) as f64);
            let first = (at as usize).min(count.saturating_sub(2));
            (first, (first + 1).min(count - 1), at - first as f64)
        };
        let ((left, right, u), (top, bottom, v)) = (place(x, self.across), place(y, down));
        let row = |row: usize| {
            let row = &self.squares[row * self.across..];
            row[left].lerp(row[right], u)
        };
        row(top).lerp(row(bottom), v)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bias_is_linear_between_squares() {
        let squares = [1.0, 3.0, 5.0, 7.0].map(DVec3::splat).to_vec();
        let bias = CacheBias { side: 8, across: 2, squares };
        assert_eq!(bias.at((0, 0)), DVec3::splat(1.0));
        assert_eq!(bias.at((15, 15)), DVec3::splat(7.0));
        let between = |x: u32| 1.0 + 2.0 * ((f64::from(x) + 0.5) / 8.0 - 0.5);
        assert!((bias.at((6, 0)) - between(6)).abs().max_element() < 1e-12);
        let one = CacheBias { side: 64, across: 1, squares: vec![DVec3::ONE] };
        assert_eq!(one.at((63, 5)), DVec3::ONE);
    }

    #[test]
    fn suffix_paths_fill_the_image_evenly() {
        let rng = StreamKey::new(3, Stream::Test, 0).rng(0);
        let places = Places { resolution: [40, 30], shift: [0.3, 0.9] };
        let mut counts = [0u32; 12];
        for path in 0..1200 {
            let CameraPathId { x, y, index } = places.of(path);
            assert_eq!(index, path);
            counts[(y / 10 * 4 + x / 10) as usize] += 1;
        }
        assert!(counts.iter().all(|count| (95..=105).contains(count)), "{counts:?}");
        let settings = Settings::resolve(&Default::default(), &Default::default(), 1.0).unwrap();
        let shifted = Places::new(&settings, rng);
        assert!(shifted.shift.iter().all(|own| (0.0..1.0).contains(own)));
    }
}
