//! Sums of the measured coefficients, pixel by pixel, with batches for standard errors.

use super::Coefficients;
use crate::image::film::Tile;
use serde::{Deserialize, Serialize};

/// Batches of iterations: iteration `t` of the measuring ones belongs to batch `t % BATCHES`.
pub const BATCHES: usize = 16;

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

/// Measured sums of a whole image, in the tile order of [`crate::image::film::Film`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct NoiseFilm {
    pixels: Vec<PixelNoise>,
    /// [`BATCHES`] for each pixel or tile.
    batches: Vec<BatchSums>,
    grain: BatchGrain,
    /// Iterations measured.
    pub iterations: u64,
}

/// The part of a [`NoiseFilm`] that belongs to one tile.
#[derive(Debug)]
pub struct NoiseTile<'a> {
    pixels: &'a mut [PixelNoise],
    batches: &'a mut [BatchSums],
    grain: BatchGrain,
    iterations: u64,
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
        }
    }

    /// Whether it was made for `tiles` (it may come from a file).
    pub fn fits(&self, tiles: impl Iterator<Item = Tile>) -> bool {
        let empty = Self::new(tiles, self.grain);
        (self.pixels.len(), self.batches.len()) == (empty.pixels.len(), empty.batches.len())
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
        let (grain, iterations) = (self.grain, self.iterations);
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
                NoiseTile { pixels: own_pixels, batches: own_batches, grain, iterations }
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

    /// Iterations in a batch.
    pub fn batch_size(&self, batch: usize) -> u64 {
        let batches = BATCHES as u64;
        self.iterations / batches + u64::from((batch as u64) < self.iterations % batches)
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
        let batch = (self.iterations % BATCHES as u64) as usize;
        self.batches[group * BATCHES + batch].add(measured, part);
    }
}
