//! The image so far: sums per pixel over iterations, stored tile by tile.

mod merge;

use crate::base::math::Rgb;
use glam::DVec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// Side of a tile, pixels.
const TILE: u32 = 16;

/// A rectangle of pixels that one thread works on.
#[derive(Clone, Copy, Debug)]
pub struct Tile {
    x: u32,
    y: u32,
    width: u32,
    height: u32,
}

impl Tile {
    /// Pixels of a tile that does not lie at the image's border.
    pub const PIXELS: f64 = (TILE * TILE) as f64;

    /// Number of pixels.
    pub fn len(&self) -> usize {
        (self.width * self.height) as usize
    }

    /// Never: tiles hold at least one pixel.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Column and row in the image of the tile's pixel `index`.
    #[inline]
    pub fn pixel(&self, index: u32) -> (u32, u32) {
        (self.x + index % self.width, self.y + index / self.width)
    }

    /// The first column and row beyond it.
    #[inline]
    pub fn end(&self) -> [u32; 2] {
        [self.x + self.width, self.y + self.height]
    }
}

/// Sums over iterations of a pixel's value `L_iter`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
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

    /// What one more value, after `before` others, says of its variance:
    /// `(x - mean before)^2 t/(t + 1)` (Welford 1962). All of these are uncorrelated, have the
    /// variance as their expectation except for the first, which is 0, and add up to the sum of
    /// squared deviations from the final mean.
    /// theory.md (62).
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

/// Sum over pixels of their [`PixelSums::deviation`], iteration after iteration: the pooled variance
/// with a standard error that sees that pixels share light paths.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Deviations {
    count: u64,
    sum: f64,
    sum2: f64,
}

impl Deviations {
    /// Adds an iteration after `before` others.
    pub fn add(&mut self, deviation: f64, before: u64) {
        if before > 0 {
            self.count += 1;
            self.sum += deviation;
            self.sum2 += deviation * deviation;
        }
    }

    /// Mean, and its standard error: infinite for a single one, `None` without any.
    /// theory.md (63).
    pub fn mean(&self) -> Option<(f64, f64)> {
        let n = self.count as f64;
        (self.count > 0).then(|| {
            let mean = self.sum / n;
            let scatter = (self.sum2 / n - mean * mean).max(0.0) / (n - 1.0);
            (mean, if self.count > 1 { scatter.sqrt() } else { f64::INFINITY })
        })
    }
}

/// Luminance Y in f64.
#[inline]
pub fn luminance(radiance: DVec3) -> f64 {
    // theory.md (4)
    radiance.dot(DVec3::new(0.2126, 0.7152, 0.0722))
}

/// Per-pixel sums of a whole image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Film {
    width: u32,
    height: u32,
    /// Tile after tile, rows within a tile.
    sums: Vec<PixelSums>,
    /// Iterations added.
    pub iterations: u64,
    /// What they say of the pooled variance.
    pub deviations: Deviations,
}

impl Film {
    /// A black image.
    pub fn new(width: u32, height: u32) -> Self {
        let pixels = width as usize * height as usize;
        Self {
            width,
            height,
            sums: vec![PixelSums::default(); pixels],
            iterations: 0,
            deviations: Deviations::default(),
        }
    }

    /// Width and height, pixels.
    pub fn resolution(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.sums.len()
    }

    /// Index of a pixel, row by row.
    #[inline]
    pub fn index(&self, x: u32, y: u32) -> usize {
        y as usize * self.width as usize + x as usize
    }

    /// Whether the sums fit the resolution (they may come from a file).
    pub fn is_consistent(&self) -> bool {
        self.sums.len() == self.width as usize * self.height as usize
    }

    /// All tiles, row by row.
    pub fn tiles(&self) -> impl Iterator<Item = Tile> + use<> {
        let (image_width, image_height) = (self.width, self.height);
        (0..image_height).step_by(TILE as usize).flat_map(move |y| {
            (0..image_width).step_by(TILE as usize).map(move |x| {
                let (width, height) = (TILE.min(image_width - x), TILE.min(image_height - y));
                Tile { x, y, width, height }
            })
        })
    }

    /// All tiles with their pixels' sums.
    pub fn tiles_mut(&mut self) -> Vec<(Tile, &mut [PixelSums])> {
        let tiles = self.tiles();
        let mut rest = &mut self.sums[..];
        tiles
            .map(|tile| {
                let (sums, others) = std::mem::take(&mut rest).split_at_mut(tile.len());
                rest = others;
                (tile, sums)
            })
            .collect()
    }

    /// Calls `visit` with the column, row and sums of every pixel.
    pub fn for_each_pixel(&self, mut visit: impl FnMut(u32, u32, &PixelSums)) {
        let mut sums = self.sums.iter();
        for tile in self.tiles() {
            for index in 0..tile.len() as u32 {
                let (x, y) = tile.pixel(index);
                visit(x, y, sums.next().expect("tiles cover the image"));
            }
        }
    }

    /// Where the pixels of a row of the image are stored: a range for each tile.
    fn row(&self, y: u32) -> impl Iterator<Item = Range<usize>> + use<> {
        let (width, height) = (self.width, self.height);
        let top = y - y % TILE;
        let rows = TILE.min(height - top);
        (0..width).step_by(TILE as usize).map(move |left| {
            let columns = TILE.min(width - left);
            let tile = top as usize * width as usize + left as usize * rows as usize;
            let start = tile + (y - top) as usize * columns as usize;
            start..start + columns as usize
        })
    }

    /// Calls `change` with each of `values`, row by row, and the pixel's number among the stored ones, on all threads.
    pub fn zip_pixels<T: Send>(&self, values: &mut [T], change: impl Fn(&mut T, usize) + Sync) {
        let rows = values.par_chunks_mut(self.width as usize).enumerate();
        rows.for_each(|(y, row)| {
            row.iter_mut()
                .zip(self.row(y as u32).flatten())
                .for_each(|(value, at)| change(value, at));
        });
    }

    /// Sums of the pixels by their number.
    pub fn sums(&self) -> &[PixelSums] {
        &self.sums
    }

    /// The mean over iterations, row by row; black before the first.
    pub fn mean(&self) -> Vec<Rgb> {
        let mut image = vec![Rgb::ZERO; self.sums.len()];
        let scale = 1.0 / self.iterations.max(1) as f64;
        self.zip_pixels(&mut image, |value, at| {
            *value = (self.sums[at].radiance * scale).as_vec3()
        });
        image
    }

    /// Mean luminance of the image, W/(m^2 sr).
    pub fn mean_luminance(&self) -> f64 {
        let sum = total(&self.sums, |sums| luminance(sums.radiance));
        sum / (self.iterations.max(1) as f64 * self.sums.len() as f64)
    }

    /// Pooled variance of one iteration, `mean_p V_p`, and its standard error (infinite before the
    /// third iteration); `None` before the second.
    /// theory.md (63).
    pub fn pooled_variance(&self) -> Option<(f64, f64)> {
        let pixels = self.sums.len() as f64;
        self.deviations.mean().map(|(sum, error)| (sum / pixels, error / pixels))
    }

    /// Unbiased estimate of the variance of the mean's luminance in each pixel, row by row; `None`
    /// before the second iteration.
    /// theory.md (62).
    pub fn variance_of_mean(&self) -> Option<Vec<f64>> {
        let n = self.iterations as f64;
        (self.iterations >= 2).then(|| {
            let mut variance = vec![0.0; self.sums.len()];
            self.zip_pixels(&mut variance, |variance, at| {
                let sums = &self.sums[at];
                let mean = luminance(sums.radiance) / n;
                let within = (sums.luminance2 / n - mean * mean).max(0.0);
                *variance = within / (n - 1.0);
            });
            variance
        })
    }
}

/// The sum of `of` over all values, on all threads, in the same order by any number of them.
pub fn total<T: Sync>(values: &[T], of: impl Fn(&T) -> f64 + Sync) -> f64 {
    let part = |values: &[T]| values.iter().map(&of).sum::<f64>();
    let parts: Vec<f64> = values.par_chunks(CHUNK).map(part).collect();
    parts.iter().sum()
}

/// Values that a thread takes at once.
const CHUNK: usize = 4096;

/// Weights of squared errors relative to the luminance of each pixel, `1/(L^2 + 0.01 mean(L)^2)`; all 1 for a black
/// image.
/// theory.md (70a).
pub fn luminance_weights(luminance: &[f64]) -> Vec<f64> {
    let floor = 0.01 * (total(luminance, |l| *l) / luminance.len() as f64).powi(2);
    let weight = |l: &f64| if floor > 0.0 { 1.0 / (l * l + floor) } else { 1.0 };
    luminance.par_iter().map(weight).collect()
}

/// Pixels to each side of one that [`box_filter`] takes in: squares of 5 by 5.
pub const BOX_RADIUS: u32 = 2;

/// Means over the pixels at most [`BOX_RADIUS`] away along either side. Estimates of single pixels, such
/// as variances, are pooled before a root is shown.
pub fn box_filter<const N: usize>(values: &[[f64; N]], width: u32, height: u32) -> Vec<[f64; N]> {
    (0..values.len())
        .into_par_iter()
        .map(|index| box_filtered(values, index, width, height))
        .collect()
}

/// The mean of [`box_filter`] around the pixel `index`.
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
    fn pooling_keeps_constants_at_the_border_and_spreads_a_point() {
        assert!(box_filter(&[[2.0, 3.0, 4.0]; 12], 4, 3).iter().all(|p| *p == [2.0, 3.0, 4.0]));
        let mut point = vec![[0.0; 3]; 81];
        point[40] = [25.0, 0.0, 0.0];
        let pooled = box_filter(&point, 9, 9);
        assert_eq!(pooled.iter().filter(|p| p[0] == 1.0).count(), 25);
    }

    #[test]
    fn tiles_cover_every_pixel_once() {
        for (width, height) in [(1, 1), (16, 16), (17, 15), (100, 37)] {
            let mut film = Film::new(width, height);
            let mut seen = vec![0; (width * height) as usize];
            for (tile, sums) in film.tiles_mut() {
                assert_eq!(tile.len(), sums.len());
                for index in 0..tile.len() as u32 {
                    let (x, y) = tile.pixel(index);
                    seen[(y * width + x) as usize] += 1;
                    sums[index as usize].add(DVec3::new(f64::from(x), f64::from(y), 0.0));
                }
            }
            assert!(seen.iter().all(|&count| count == 1), "{width}x{height}");
            film.iterations = 1;
            for (i, value) in film.mean().iter().enumerate() {
                let (x, y) = (i as u32 % width, i as u32 / width);
                assert_eq!(*value, Rgb::new(x as f32, y as f32, 0.0));
            }
        }
    }

    #[test]
    fn variance_of_the_mean_is_the_textbook_one() {
        let mut film = Film::new(1, 1);
        assert!(film.variance_of_mean().is_none());
        for value in [1.0, 2.0, 4.0, 7.0] {
            film.tiles_mut()[0].1[0].add(DVec3::splat(value));
            film.iterations += 1;
        }
        // Sample variance (6.25 + 2.25 + 0.25 + 12.25) / 3 = 7, over 4 iterations.
        let variance = film.variance_of_mean().unwrap()[0];
        assert!((variance - 7.0 / 4.0).abs() < 1e-12, "{variance}");
        assert!((film.mean_luminance() - 3.5).abs() < 1e-12);
    }
}
