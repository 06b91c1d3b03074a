//! The image: sums over iterations of each pixel's value.

use super::cells::CellGrid;
use super::statistic::PixelSample;
use super::tiled_buffer::{Accumulate, CHUNK, Tile, TiledBuffer};
use bdpm_base::math::Rgb;
use bytemuck::Zeroable;
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Sums over iterations of a pixel's value `L_iter`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Zeroable)]
pub struct PixelSums {
    /// Sum of `L_iter`, W/(m^2 sr).
    pub radiance: DVec3,
    /// Sum of the square of its luminance.
    pub luminance2: f64,
}

impl PixelSums {
    /// Adds an iteration's value.
    #[inline]
    pub fn add(&mut self, radiance: DVec3) {
        self.radiance += radiance;
        self.luminance2 += luminance(radiance).powi(2);
    }

    /// Term of the sum of squared deviations from the mean that one more value adds after `before`
    /// others: `(x - mean before)^2 t/(t + 1)` (Welford 1962). The terms are uncorrelated and,
    /// except for the first, which is 0, each has the variance as its expectation. theory.md (62).
    #[inline]
    pub fn deviation(&self, radiance: DVec3, before: u64) -> f64 {
        match before {
            0 => 0.0,
            t => {
                let t = t as f64;
                (luminance(radiance) - luminance(self.radiance) / t).powi(2) * t / (t + 1.0)
            }
        }
    }
}

impl PixelSums {
    /// Unbiased estimate of the variance of the mean's luminance, from this number of iterations,
    /// at least 2. theory.md (62).
    #[inline]
    pub fn variance_of_mean(&self, iterations: u64) -> f64 {
        let n = iterations as f64;
        let mean = luminance(self.radiance) / n;
        let within = (self.luminance2 / n - mean * mean).max(0.0);
        within / (n - 1.0)
    }
}

impl Accumulate for PixelSums {
    #[inline]
    fn add_sample(&mut self, sample: &PixelSample) {
        self.add(sample.value);
    }

    #[inline]
    fn merge(&mut self, other: &Self) {
        self.radiance += other.radiance;
        self.luminance2 += other.luminance2;
    }
}

/// Sums over iterations of [`PixelSums::deviation`], added up over all pixels: the pooled variance,
/// with a standard error that includes the correlation of pixels by common light paths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Deviations {
    count: u64,
    sum: f64,
    sum2: f64,
}

impl Deviations {
    /// Adds an iteration after `before` others.
    #[inline]
    pub fn add(&mut self, deviation: f64, before: u64) {
        if before > 0 {
            self.count += 1;
            self.sum += deviation;
            self.sum2 += deviation * deviation;
        }
    }

    /// Mean, and its standard error: infinite for a single one, `None` without any.
    /// theory.md (63).
    #[inline]
    pub fn mean(&self) -> Option<(f64, f64)> {
        let n = self.count as f64;
        (self.count > 0).then(|| {
            let mean = self.sum / n;
            let scatter = (self.sum2 / n - mean * mean).max(0.0) / (n - 1.0);
            (mean, if self.count > 1 { scatter.sqrt() } else { f64::INFINITY })
        })
    }

    /// Adds the sums of other iterations, and one term for the distance `between` both means, which
    /// has the same expectation (Chan, Golub and LeVeque 1979). theory.md (62).
    fn merge(&mut self, other: &Self, between: Option<f64>) {
        self.count += other.count;
        self.sum += other.sum;
        self.sum2 += other.sum2;
        if let Some(between) = between {
            self.add(between, 1);
        }
    }
}

/// Luminance Y in f64.
#[inline]
pub fn luminance(radiance: DVec3) -> f64 {
    // theory.md (4)
    radiance.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// Sums over iterations of the values of all pixels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Film {
    /// Sums of each pixel.
    pub sums: TiledBuffer<PixelSums>,
    /// Number of iterations.
    pub iterations: u64,
    /// Sums for the pooled variance.
    pub deviations: Deviations,
}

/// Pixels of one tile during an iteration.
#[derive(Debug)]
pub struct FilmTile<'a> {
    /// The tile.
    pub tile: Tile,
    sums: &'a mut [PixelSums],
    /// Iterations that `sums` contain.
    before: u64,
    /// Sum over the pixels of [`PixelSums::deviation`] of this iteration.
    pub deviation: f64,
}

impl FilmTile<'_> {
    /// Adds one iteration to the tile's pixel `index`.
    #[inline]
    pub fn add_sample(&mut self, index: usize, sample: &PixelSample) {
        self.deviation += self.sums[index].deviation(sample.value, self.before);
        self.sums[index].add_sample(sample);
    }
}

impl Film {
    /// A black image.
    pub fn new(width: u32, height: u32) -> Self {
        let sums = TiledBuffer::new((width, height));
        Self { sums, iterations: 0, deviations: Deviations::default() }
    }

    /// Width and height, pixels.
    #[inline]
    pub fn resolution(&self) -> (u32, u32) {
        self.sums.resolution()
    }

    /// Number of pixels.
    #[inline]
    pub fn pixels(&self) -> usize {
        self.sums.pixels()
    }

    /// All tiles, to add an iteration to.
    #[inline]
    pub fn tiles_mut(&mut self) -> impl Iterator<Item = FilmTile<'_>> {
        let before = self.iterations;
        let tiles = self.sums.tiles_mut().into_iter();
        tiles.map(move |(tile, sums)| FilmTile { tile, sums, before, deviation: 0.0 })
    }

    /// Counts an iteration that all tiles have added; `deviation` is the sum of
    /// [`FilmTile::deviation`].
    #[inline]
    pub fn end_iteration(&mut self, deviation: f64) {
        self.deviations.add(deviation, self.iterations);
        self.iterations += 1;
    }

    /// Mean over iterations, in row order; black before the first.
    pub fn mean(&self) -> Vec<Rgb> {
        let scale = 1.0 / self.iterations.max(1) as f64;
        self.sums.map_rows(|sums| (sums.radiance * scale).as_vec3())
    }

    /// Mean luminance of the image, W/(m^2 sr).
    pub fn mean_luminance(&self) -> f64 {
        let sum = total(self.sums.values(), |sums| luminance(sums.radiance));
        sum / (self.iterations.max(1) as f64 * self.pixels() as f64)
    }

    /// Pooled variance of one iteration, `mean_p V_p`, and its standard error (infinite before the
    /// third iteration); `None` before the second.
    /// theory.md (63).
    pub fn pooled_variance(&self) -> Option<(f64, f64)> {
        let pixels = self.pixels() as f64;
        self.deviations.mean().map(|(sum, error)| (sum / pixels, error / pixels))
    }

    /// Unbiased estimate of the variance of the mean's luminance in each pixel, in row order;
    /// `None` before the second iteration. theory.md (62).
    pub fn variance_of_mean(&self) -> Option<Vec<f64>> {
        let n = self.iterations;
        (n >= 2).then(|| self.sums.map_rows(|sums| sums.variance_of_mean(n)))
    }

    /// Mean over each cell of [`Self::variance_of_mean`], in row order.
    pub fn cell_variance(&self) -> Option<Vec<f64>> {
        let (grid, n) = (CellGrid::of(self.resolution()), self.iterations);
        if grid.is_single_pixels() || n < 2 {
            return self.variance_of_mean();
        }
        let pixels = self.sums.values();
        let sums =
            self.sums.fold_cells(grid, 0.0, |sum, at| *sum += pixels[at].variance_of_mean(n));
        let mean = |(cell, sum): (usize, &f64)| sum / grid.pixels_of(cell);
        Some(sums.par_iter().enumerate().map(mean).collect())
    }

    /// Adds the iterations of another image of the same pixels.
    pub fn merge(&mut self, other: &Self) {
        let [n, m] = [self.iterations, other.iterations].map(|n| n as f64);
        let distance2 = |(own, other): (&PixelSums, &PixelSums)| {
            let [one, two] = [luminance(own.radiance), luminance(other.radiance)];
            (one / n - two / m).powi(2) * n * m / (n + m)
        };
        let between = (n * m > 0.0).then(|| {
            let [own, other] = [self, other].map(|film| film.sums.values().par_chunks(CHUNK));
            let chunk = |(own, other): (&[PixelSums], &[PixelSums])| -> f64 {
                own.iter().zip(other).map(distance2).sum()
            };
            own.zip(other).map(chunk).collect::<Vec<f64>>().iter().sum()
        });
        self.sums.merge(&other.sums);
        self.deviations.merge(&other.deviations, between);
        self.iterations += other.iterations;
    }
}

/// Sum of `of` over all values. It does not depend on the number of threads.
pub fn total<T: Sync>(values: &[T], of: impl Fn(&T) -> f64 + Sync) -> f64 {
    let part = |values: &[T]| values.iter().map(&of).sum::<f64>();
    let parts: Vec<f64> = values.par_chunks(CHUNK).map(part).collect();
    parts.iter().sum()
}

/// Weights of squared errors, by the luminance of each pixel: `1/(L^2 + 0.01 mean(L)^2)`; all 1 for
/// a black image. theory.md (70a).
pub fn luminance_weights(luminance: &[f64]) -> Vec<f64> {
    let floor = 0.01 * (total(luminance, |l| *l) / luminance.len() as f64).powi(2);
    let weight = |l: &f64| if floor > 0.0 { 1.0 / (l * l + floor) } else { 1.0 };
    luminance.par_iter().map(weight).collect()
}

/// Radius of [`box_filter`], pixels: squares of 5 by 5.
pub const BOX_RADIUS: u32 = 2;

/// Means over squares of pixels within [`BOX_RADIUS`]. Estimates of single pixels, such as
/// variances, are pooled before their roots are shown.
pub fn box_filter<const N: usize>(values: &[[f64; N]], width: u32, height: u32) -> Vec<[f64; N]> {
    (0..values.len())
        .into_par_iter()
        .map(|index| box_filtered(values, index, width, height))
        .collect()
}

/// Value of [`box_filter`] at the pixel `index`.
pub fn box_filtered<const N: usize>(
    values: &[[f64; N]],
    index: usize,
    width: u32,
    height: u32,
) -> [f64; N] {
    let around = |center: u32, end: u32| {
        center.saturating_sub(BOX_RADIUS)..(center + BOX_RADIUS + 1).min(end)
    };
    let (x, y) = (index as u32 % width, index as u32 / width);
    let mut sums = [0.0; N];
    let mut count = 0.0;
    for row in around(y, height) {
        for column in around(x, width) {
            let values = values[row as usize * width as usize + column as usize];
            sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += value);
            count += 1.0;
        }
    }
    sums.map(|sum| sum / count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_filter_keeps_constants_and_spreads_a_point() {
        assert!(box_filter(&[[2.0, 3.0, 4.0]; 12], 4, 3).iter().all(|p| *p == [2.0, 3.0, 4.0]));
        let mut point = vec![[0.0; 3]; 81];
        point[40] = [25.0, 0.0, 0.0];
        let pooled = box_filter(&point, 9, 9);
        assert_eq!(pooled.iter().filter(|p| p[0] == 1.0).count(), 25);
    }

    #[test]
    fn variance_of_mean_equals_sample_variance_over_n() {
        let mut film = Film::new(1, 1);
        assert!(film.variance_of_mean().is_none());
        for value in [1.0, 2.0, 4.0, 7.0] {
            let sample = PixelSample { value: DVec3::splat(value), ..PixelSample::default() };
            let mut tile = film.tiles_mut().next().unwrap();
            tile.add_sample(0, &sample);
            let deviation = tile.deviation;
            film.end_iteration(deviation);
        }
        // Sample variance (6.25 + 2.25 + 0.25 + 12.25) / 3 = 7, over 4 iterations.
        let variance = film.variance_of_mean().unwrap()[0];
        assert!((variance - 7.0 / 4.0).abs() < 1e-12, "{variance}");
        assert!((film.mean_luminance() - 3.5).abs() < 1e-12);
        let (pooled, _) = film.pooled_variance().unwrap();
        assert!((pooled - 7.0).abs() < 1e-12, "{pooled}");
    }
}
