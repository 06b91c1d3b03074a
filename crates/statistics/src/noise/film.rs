//! Sums over measured iterations: coefficients of each pixel, with batches for standard errors.

use super::Coefficients;
use crate::film::cells::CellGrid;
pub use crate::film::statistic::BatchGrain;
use crate::film::statistic::{CurrentIteration, PixelStatistic, StatisticRequest, StatisticTile};
use crate::film::tiled_buffer::{Tile, TiledBuffer, tiles};
use crate::settings::Settings;
use bytemuck::Zeroable;
use serde::{Deserialize, Serialize};

/// Batches of measured iterations, which go to the batches in turn.
pub const BATCHES: usize = 16;

/// Number of measured iterations of each batch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BatchCounts {
    /// Iterations of each batch.
    pub iterations: [u64; BATCHES],
    /// Batch of the first iteration, which has no term in the sample variance.
    pub first: u8,
}

impl BatchCounts {
    /// Counts after a number of iterations that went to the batches in turn.
    pub fn of(iterations: u64) -> Self {
        let batches = BATCHES as u64;
        let own = |batch| iterations / batches + u64::from((batch as u64) < iterations % batches);
        Self { iterations: std::array::from_fn(own), first: 0 }
    }

    /// Iterations of all batches.
    #[inline]
    pub fn total(&self) -> u64 {
        self.iterations.iter().sum()
    }

    /// Iterations of a batch, and how many of them have a term in the sample variance.
    #[inline]
    pub fn of_batch(&self, batch: usize) -> [f64; 2] {
        let own = self.iterations[batch];
        let first = u64::from(batch == usize::from(self.first));
        [own as f64, own.saturating_sub(first) as f64]
    }

    /// Whether the counts are possible. They may come from a file.
    pub fn is_consistent(&self) -> bool {
        let first = self.iterations.get(usize::from(self.first));
        first.is_some_and(|&own| own > 0 || self.total() == 0)
    }

    /// Batch of the next iteration.
    #[inline]
    fn next(&self) -> usize {
        ((u64::from(self.first) + self.total()) % BATCHES as u64) as usize
    }
}

/// Result of one measured iteration for one pixel; luminances.
#[derive(Clone, Copy, Debug, Default)]
pub struct PixelMeasurement {
    /// Estimated coefficients.
    pub coefficients: Coefficients,
    /// The pixel's value `L_iter`.
    pub value: f64,
    /// Nested differences of the value from the same photons: `L(r) - L(r/sqrt 2)` and
    /// `L(r/sqrt 2) - L(r/2)`.
    pub nested: [f64; 2],
}

/// Sums over the measured iterations of a block, of a pixel or of the mean over a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Zeroable)]
pub struct PixelNoise {
    /// Sum of the coefficients.
    pub coefficients: Coefficients,
    /// Sum of the values.
    pub value: f64,
    /// Sum of squared deviations of the values from their mean.
    pub deviations2: f64,
    /// Sums of the nested differences.
    pub nested: [f64; 2],
    /// Sum of the squares of the first nested difference.
    pub nested2: f64,
}

/// Sums over one batch of iterations, over one pixel or all pixels (in large images: cells) of a
/// tile.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BatchSums {
    /// Sums of `a`, `b`, `f`.
    pub coefficients: [f32; 3],
    /// Sum of terms whose expectation is the variance of the value, see [`PixelNoise::add`].
    pub variance: f32,
    /// Sums of the nested differences.
    pub nested: [f32; 2],
}

impl PixelNoise {
    /// Adds an iteration after `before` others and returns its term of the sample variance.
    ///
    /// The term, `(x - mean before)^2 t/(t + 1)` at iteration `t + 1` (Welford 1962), has the
    /// variance as its expectation at every iteration but the first. The sum of all terms is the
    /// sum of squared deviations from the final mean. theory.md (62).
    #[inline]
    pub fn add(&mut self, measured: &PixelMeasurement, before: u64) -> f64 {
        let PixelMeasurement { coefficients, value, nested } = *measured;
        let term = match before {
            0 => 0.0,
            t => {
                let t = t as f64;
                (value - self.value / t).powi(2) * t / (t + 1.0)
            }
        };
        self.coefficients += coefficients;
        self.value += value;
        self.deviations2 += term;
        self.nested.iter_mut().zip(nested).for_each(|(sum, d)| *sum += d);
        self.nested2 += nested[0].powi(2);
        term
    }

    /// Adds the sums over other iterations and returns the term of the sample variance for the
    /// distance of both means; `counts` are the iterations of both.
    ///
    /// The term, `(m_1 - m_2)^2 n_1 n_2/(n_1 + n_2)` (Chan, Golub and LeVeque 1979), has the
    /// variance as its expectation. It stands for the first of the other iterations, which had no
    /// term. theory.md (62).
    #[inline]
    fn merge(&mut self, other: &Self, [n, m]: [f64; 2]) -> f64 {
        let between = (self.value / n - other.value / m).powi(2) * n * m / (n + m);
        self.coefficients += other.coefficients;
        self.value += other.value;
        self.deviations2 += other.deviations2 + between;
        self.nested.iter_mut().zip(other.nested).for_each(|(sum, d)| *sum += d);
        self.nested2 += other.nested2;
        between
    }
}

impl BatchSums {
    #[inline]
    fn add(&mut self, measured: &PixelMeasurement, variance: f64) {
        let Coefficients { a, b, f } = measured.coefficients;
        for (sum, x) in self.coefficients.iter_mut().zip([a, b, f]) {
            *sum += x as f32;
        }
        self.variance += variance as f32;
        self.nested.iter_mut().zip(measured.nested).for_each(|(sum, d)| *sum += d as f32);
    }
    #[inline]
    fn merge(&mut self, other: &Self) {
        self.coefficients.iter_mut().zip(other.coefficients).for_each(|(sum, x)| *sum += x);
        self.variance += other.variance;
        self.nested.iter_mut().zip(other.nested).for_each(|(sum, d)| *sum += d);
    }
}

/// Sums over the measured iterations of a block, of all pixels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NoiseFilm {
    sums: TiledBuffer<PixelNoise>,
    /// [`BATCHES`] for each pixel or tile, in tile order.
    batches: Vec<BatchSums>,
    grain: BatchGrain,
    /// Measured iterations.
    pub iterations: u64,
    counts: BatchCounts,
}

/// Sums of one tile during a measured iteration.
#[derive(Debug)]
pub struct NoiseTile<'a> {
    pixels: &'a mut [PixelNoise],
    batches: &'a mut [BatchSums],
    grain: BatchGrain,
    iterations: u64,
    batch: usize,
}

impl NoiseFilm {
    /// Sums of no iteration, after `measured_before` iterations that others measure.
    pub fn new(resolution: (u32, u32), grain: BatchGrain, measured_before: u64) -> Self {
        let first = (measured_before % BATCHES as u64) as u8;
        Self {
            sums: TiledBuffer::of_cells(grid(resolution, grain)),
            batches: vec![BatchSums::default(); batch_count(resolution, grain)],
            grain,
            iterations: 0,
            counts: BatchCounts { first, ..BatchCounts::default() },
        }
    }

    /// Sums of each pixel, or of the mean over each [cell](CellGrid) if batches are those of tiles.
    #[inline]
    pub fn sums(&self) -> &TiledBuffer<PixelNoise> {
        &self.sums
    }

    /// Sum of the coefficients of each cell of `grid`, in row order.
    pub fn cell_coefficients(&self, grid: CellGrid) -> Vec<Coefficients> {
        if self.sums.fits_cells(grid) {
            return self.sums.map_rows(|sums| sums.coefficients);
        }
        let pixels = self.sums.values();
        let add = |sum: &mut Coefficients, at: usize| *sum += pixels[at].coefficients;
        let sums = self.sums.fold_cells(grid, Coefficients::default(), add);
        let mean = |(cell, sum)| sum * grid.pixels_of(cell).recip();
        sums.into_iter().enumerate().map(mean).collect()
    }

    /// Sum of the first nested difference and of its square for each cell of `grid`, in row order.
    pub fn cell_nested(&self, grid: CellGrid) -> Vec<[f64; 2]> {
        let nested = |sums: &PixelNoise| [sums.nested[0], sums.nested2];
        if self.sums.fits_cells(grid) {
            return self.sums.map_rows(nested);
        }
        let pixels = self.sums.values();
        let add = |sums: &mut [f64; 2], at: usize| {
            let own = nested(&pixels[at]);
            sums.iter_mut().zip(own).for_each(|(sum, own)| *sum += own);
        };
        let sums = self.sums.fold_cells(grid, [0.0; 2], add);
        let mean = |(cell, sums): (usize, [f64; 2])| sums.map(|sum| sum / grid.pixels_of(cell));
        sums.into_iter().enumerate().map(mean).collect()
    }

    /// Resolution of the batches.
    #[inline]
    pub fn grain(&self) -> BatchGrain {
        self.grain
    }

    /// Number of iterations of each batch.
    #[inline]
    pub fn counts(&self) -> &BatchCounts {
        &self.counts
    }

    /// The [`BATCHES`] batches of each pixel or tile, in tile order.
    #[inline]
    pub fn batches(&self) -> impl Iterator<Item = &[BatchSums]> {
        self.batches.chunks_exact(BATCHES)
    }

    /// Memory per pixel if batches of single pixels are kept.
    pub const BYTES_OF_PIXEL: usize = size_of::<PixelNoise>() + BATCHES * size_of::<BatchSums>();
}

/// The cells whose sums are kept.
#[inline]
fn grid(resolution: (u32, u32), grain: BatchGrain) -> CellGrid {
    match grain {
        BatchGrain::Pixel => CellGrid::single_pixels(resolution),
        BatchGrain::Tile => CellGrid::of(resolution),
    }
}

/// Batches of an image.
fn batch_count(resolution: (u32, u32), grain: BatchGrain) -> usize {
    tiles(resolution).map(|tile| groups(grain, tile.len()) * BATCHES).sum()
}

/// Groups of [`BATCHES`] batches of a tile.
#[inline]
fn groups(grain: BatchGrain, pixels: usize) -> usize {
    match grain {
        BatchGrain::Pixel => pixels,
        BatchGrain::Tile => 1,
    }
}

/// Group of batches of a tile's pixel `index`.
#[inline]
fn group(grain: BatchGrain, index: usize) -> usize {
    match grain {
        BatchGrain::Pixel => index,
        BatchGrain::Tile => 0,
    }
}

impl PixelStatistic for NoiseFilm {
    type Tile<'a> = NoiseTile<'a>;

    fn start(request: &StatisticRequest) -> Option<Self> {
        let resolution = request.settings.resolution();
        request.measured_before.map(|before| Self::new(resolution, request.grain, before))
    }

    /// All tiles count as whole ones.
    fn bytes_per_pixel(request: &StatisticRequest) -> f64 {
        let cell = grid(request.settings.resolution(), request.grain).pixels_per_cell();
        let batches = match request.grain {
            BatchGrain::Pixel => 1.0,
            BatchGrain::Tile => Tile::PIXELS,
        };
        size_of::<PixelNoise>() as f64 / cell + (BATCHES * size_of::<BatchSums>()) as f64 / batches
    }

    fn fits(statistic: Option<&Self>, settings: &Settings) -> bool {
        let resolution = settings.resolution();
        statistic.is_none_or(|noise| {
            noise.sums.fits_cells(grid(resolution, noise.grain))
                && noise.batches.len() == batch_count(resolution, noise.grain)
                && noise.counts.is_consistent()
                && noise.counts.total() == noise.iterations
        })
    }

    fn tiles_mut(&mut self, iteration: CurrentIteration) -> Vec<NoiseTile<'_>> {
        if !iteration.is_measured {
            return Vec::new();
        }
        let (grain, iterations, batch) = (self.grain, self.iterations, self.counts.next());
        let mut rest = &mut self.batches[..];
        let tiles = self.sums.tiles_mut().into_iter();
        tiles
            .map(|(tile, pixels)| {
                let batches = rest.split_off_mut(..groups(grain, tile.len()) * BATCHES);
                let batches = batches.expect("there are batches for each tile");
                NoiseTile { pixels, batches, grain, iterations, batch }
            })
            .collect()
    }

    fn end_iteration(&mut self, iteration: CurrentIteration) {
        if iteration.is_measured {
            self.counts.iterations[self.counts.next()] += 1;
            self.iterations += 1;
        }
    }

    /// A part without a measured iteration has no sums.
    fn can_merge(one: Option<&Self>, other: Option<&Self>) -> bool {
        one.zip(other).is_none_or(|(one, other)| one.grain == other.grain)
    }

    #[inline]
    fn merge(&mut self, other: &Self) {
        if other.iterations == 0 {
            return;
        }
        if self.iterations == 0 {
            self.clone_from(other);
            return;
        }
        let counts = [self.iterations, other.iterations].map(|n| n as f64);
        let first = usize::from(other.counts.first);
        let (mut batches, mut others) = (&mut self.batches[..], other.sums.values().iter());
        for (tile, sums) in self.sums.tiles_mut() {
            let own = batches.split_off_mut(..groups(self.grain, tile.len()) * BATCHES);
            let own = own.expect("there are batches for each tile");
            let mut between = vec![0.0; own.len() / BATCHES];
            for (index, (sums, others)) in sums.iter_mut().zip(others.by_ref()).enumerate() {
                between[group(self.grain, index)] += sums.merge(others, counts);
            }
            for (batches, between) in own.chunks_exact_mut(BATCHES).zip(between) {
                batches[first].variance += between as f32;
            }
        }
        self.batches.iter_mut().zip(&other.batches).for_each(|(own, other)| own.merge(other));
        self.counts.iterations.iter_mut().zip(other.counts.iterations).for_each(|(n, m)| *n += m);
        self.iterations += other.iterations;
    }
}

impl StatisticTile for NoiseTile<'_> {
    type Sample = PixelMeasurement;

    #[inline]
    fn is_by_cell(&self) -> bool {
        self.grain == BatchGrain::Tile
    }

    #[inline]
    fn add_sample(&mut self, index: usize, sample: &PixelMeasurement) {
        let term = self.pixels[index].add(sample, self.iterations);
        let group = group(self.grain, index);
        self.batches[group * BATCHES + self.batch].add(sample, term);
    }
}
