//! Sums of the measured coefficients, pixel by pixel, with batches for standard errors.

mod merge;

use super::Coefficients;
use crate::film::radiance::Tile;
use serde::{Deserialize, Serialize};

/// Batches of iterations, to which the measuring ones are dealt out in turn.
pub const BATCHES: usize = 16;

/// How many measuring iterations belong to each batch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BatchCounts {
    /// Of each batch.
    pub iterations: [u64; BATCHES],
    /// The batch of the one iteration that says nothing of the variance: the first.
    pub first: u8,
}

impl BatchCounts {
    /// Of so many iterations that were dealt out one after another.
    pub fn of(iterations: u64) -> Self {
        let batches = BATCHES as u64;
        let own = |batch| iterations / batches + u64::from((batch as u64) < iterations % batches);
        Self { iterations: std::array::from_fn(own), first: 0 }
    }

    /// Iterations of all batches.
    pub fn total(&self) -> u64 {
        self.iterations.iter().sum()
    }

    /// Iterations in a batch, and of its parts of the sample variance.
    pub fn of_batch(&self, batch: usize) -> [f64; 2] {
        let own = self.iterations[batch];
        let first = u64::from(batch == usize::from(self.first));
        [own as f64, own.saturating_sub(first) as f64]
    }

    /// Whether these are batches (they may come from a file).
    pub fn is_consistent(&self) -> bool {
        let first = self.iterations.get(usize::from(self.first));
        first.is_some_and(|&own| own > 0 || self.total() == 0)
    }

    /// The batch of the next iteration.
    fn next(&self) -> usize {
        ((u64::from(self.first) + self.total()) % BATCHES as u64) as usize
    }
}

/// What one measuring iteration says of one pixel; luminances.
#[derive(Clone, Copy, Debug, Default)]
pub struct PixelMeasurement {
    /// Estimated coefficients.
    pub coefficients: Coefficients,
    /// The pixel's value `L_iter`.
    pub value: f64,
    /// From the same photons: the value less that at `1/sqrt(2)` of the merge radii, and that less the value
    /// at half of them.
    pub nested: [f64; 2],
}

/// Sums over the measuring iterations of one block of equal settings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PixelNoise {
    /// Sum of the coefficients.
    pub coefficients: Coefficients,
    /// Sum of the values.
    pub value: f64,
    /// Sum of squared deviations of the values from their mean.
    pub deviations2: f64,
    /// Sums of the nested differences.
    pub nested: [f64; 2],
    /// Sum of the squares of the first.
    pub nested2: f64,
}

/// Sums over one batch of iterations, over one pixel or all pixels of a tile.
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
    /// Adds an iteration after `before` others and returns its part of the sample variance.
    ///
    /// That part, `(x - mean before)^2 t/(t + 1)` at the `t + 1`-st iteration (Welford 1962), has the
    /// variance as its expectation at every iteration but the first, and the sum of all parts is the
    /// sum of squared deviations from the final mean.
    /// theory.md (62).
    pub fn add(&mut self, measured: &PixelMeasurement, before: u64) -> f64 {
        let PixelMeasurement { coefficients, value, nested } = *measured;
        let part = match before {
            0 => 0.0,
            t => {
                let t = t as f64;
                (value - self.value / t).powi(2) * t / (t + 1.0)
            }
        };
        self.coefficients += coefficients;
        self.value += value;
        self.deviations2 += part;
        self.nested.iter_mut().zip(nested).for_each(|(sum, d)| *sum += d);
        self.nested2 += nested[0].powi(2);
        part
    }
}

impl BatchSums {
    fn add(&mut self, measured: &PixelMeasurement, variance: f64) {
        let Coefficients { a, b, f } = measured.coefficients;
        for (sum, x) in self.coefficients.iter_mut().zip([a, b, f]) {
            *sum += x as f32;
        }
        self.variance += variance as f32;
        self.nested.iter_mut().zip(measured.nested).for_each(|(sum, d)| *sum += d as f32);
    }
}

/// How finely batches are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum BatchGrain {
    /// For each pixel, 384 bytes: standard errors of any function of single pixels.
    Pixel,
    /// For each tile: standard errors of sums over many pixels.
    Tile,
}

/// Measured sums of a whole image, in the tile order of [`crate::film::radiance::Film`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NoiseFilm {
    pixels: Vec<PixelNoise>,
    /// [`BATCHES`] for each pixel or tile.
    batches: Vec<BatchSums>,
    grain: BatchGrain,
    /// Iterations measured.
    pub iterations: u64,
    counts: BatchCounts,
}

/// The part of a [`NoiseFilm`] that belongs to one tile.
#[derive(Debug)]
pub struct NoiseTile<'a> {
    pixels: &'a mut [PixelNoise],
    batches: &'a mut [BatchSums],
    grain: BatchGrain,
    iterations: u64,
    batch: usize,
}

impl NoiseFilm {
    /// Nothing measured yet, for an image cut into `tiles`.
    pub fn new(tiles: impl Iterator<Item = Tile>, grain: BatchGrain) -> Self {
        let (tile_count, pixel_count) =
            tiles.fold((0, 0), |(tiles, pixels), tile| (tiles + 1, pixels + tile.len()));
        let groups = match grain {
            BatchGrain::Pixel => pixel_count,
            BatchGrain::Tile => tile_count,
        };
        Self {
            pixels: vec![PixelNoise::default(); pixel_count],
            batches: vec![BatchSums::default(); groups * BATCHES],
            grain,
            iterations: 0,
            counts: BatchCounts::default(),
        }
    }

    /// The same, to go on after so many iterations that others measure.
    #[must_use]
    pub fn after(mut self, measured: u64) -> Self {
        self.counts.first = (measured % BATCHES as u64) as u8;
        self
    }

    /// Whether it was made for `tiles` (it may come from a file).
    pub fn fits(&self, tiles: impl Iterator<Item = Tile>) -> bool {
        let empty = Self::new(tiles, self.grain);
        (self.pixels.len(), self.batches.len()) == (empty.pixels.len(), empty.batches.len())
            && self.counts.is_consistent()
            && self.counts.total() == self.iterations
    }

    /// Bytes per pixel at the given grain (tiles counted as if they were whole).
    pub const fn bytes_per_pixel(grain: BatchGrain) -> usize {
        size_of::<PixelNoise>()
            + match grain {
                BatchGrain::Pixel => BATCHES * size_of::<BatchSums>(),
                BatchGrain::Tile => BATCHES * size_of::<BatchSums>() / 256,
            }
    }

    /// The parts of all `tiles`, which must be those it was made for.
    pub fn tiles_mut(&mut self, tiles: impl Iterator<Item = Tile>) -> Vec<NoiseTile<'_>> {
        let (mut pixels, mut batches) = (&mut self.pixels[..], &mut self.batches[..]);
        let (grain, iterations, batch) = (self.grain, self.iterations, self.counts.next());
        tiles
            .map(|tile| {
                let groups = match grain {
                    BatchGrain::Pixel => tile.len(),
                    BatchGrain::Tile => 1,
                };
                let (own_pixels, rest) = std::mem::take(&mut pixels).split_at_mut(tile.len());
                pixels = rest;
                let (own_batches, rest) =
                    std::mem::take(&mut batches).split_at_mut(groups * BATCHES);
                batches = rest;
                NoiseTile { pixels: own_pixels, batches: own_batches, grain, iterations, batch }
            })
            .collect()
    }

    /// Sums of all pixels in tile order.
    pub fn pixels(&self) -> &[PixelNoise] {
        &self.pixels
    }

    /// How finely batches are kept.
    pub fn grain(&self) -> BatchGrain {
        self.grain
    }

    /// Takes note that all tiles have another iteration.
    pub fn end_iteration(&mut self) {
        self.counts.iterations[self.counts.next()] += 1;
        self.iterations += 1;
    }

    /// How the iterations belong to batches.
    pub fn counts(&self) -> &BatchCounts {
        &self.counts
    }

    /// The [`BATCHES`] batches of each pixel or tile, in tile order.
    pub fn batches(&self) -> impl Iterator<Item = &[BatchSums]> {
        self.batches.chunks_exact(BATCHES)
    }
}

impl NoiseTile<'_> {
    /// Adds an iteration of the tile's pixel `index`.
    pub fn add(&mut self, index: usize, measured: &PixelMeasurement) {
        let part = self.pixels[index].add(measured, self.iterations);
        let group = match self.grain {
            BatchGrain::Pixel => index,
            BatchGrain::Tile => 0,
        };
        self.batches[group * BATCHES + self.batch].add(measured, part);
    }
}
