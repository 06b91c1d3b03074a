//! Merge bias by three nested radii (docs/explanation/theory.md, section 17).

use super::film::BATCHES;
use super::image::{NoiseImage, Statistic};
use serde::Serialize;
use std::f64::consts::FRAC_1_SQRT_2;

/// Standard errors by which a bias must stand out to count as significant.
pub const BIAS_CERTAINTY: f64 = 2.0;

/// Standard errors between an estimate and the upper bound of its one-sided 90 % confidence
/// interval.
pub const UPPER_BOUND: f64 = 1.2816;

/// Bounds of the share of the bias that is left at `1/sqrt(2)` of a radius: the bias is
/// proportional to the squared radius, or to the radius.
const REMAINING: [f64; 2] = [0.5, FRAC_1_SQRT_2];

/// Merge bias of a region; luminances, W/(m^2 sr).
#[derive(Clone, Copy, Debug, Serialize)]
pub struct MergeBias {
    /// Mean over the region.
    pub mean: Statistic,
    /// Root of the mean square, without the part that noise adds to it; 0 if the estimate of the
    /// mean square is negative.
    pub rms: Statistic,
    /// Root of the mean square relative to each pixel's luminance: theory.md (70a).
    pub relative: Statistic,
    /// Whether [`Self::rms`] stands out from the noise. If not, only its upper bound is meaningful.
    pub significant: bool,
    /// Upper 90 % bound of [`Self::rms`]; infinite if standard errors are not known.
    pub upper_bound: f64,
    /// Share of the bias that is left at `1/sqrt(2)` of the merge radius.
    pub falls_to: f64,
    /// Mean luminance of the region.
    pub mean_luminance: f64,
}

/// Means over a region: of the first nested difference, and of the products `S_11` and `S_12`.
type Products = [f64; 3];

impl MergeBias {
    /// Merge bias over the pixels `region`.
    pub fn new(noise: &NoiseImage, region: &[usize]) -> Self {
        let count = region.len() as f64;
        let luminances = || region.iter().map(|&i| noise.pixels[i].luminance);
        let mean_luminance = luminances().sum::<f64>() / count;
        let floor = 0.01 * mean_luminance.powi(2);
        let luminance = |pixel: usize| noise.pixels[pixel].luminance;
        let products = LeftOut::new(noise, region, |_| 1.0);
        // theory.md (70a)
        let relative = LeftOut::new(noise, region, |i| (luminance(i).powi(2) + floor).recip());
        let s_11 = products.statistic(|[_, s_11, _]| s_11);
        let significant = s_11.value > BIAS_CERTAINTY * s_11.error;
        // A bias that is not seen has an unknown slope: take the one with the largest bound.
        let most = if significant { falls_to(&products.all) } else { REMAINING[1] };
        let upper = s_11.value.max(0.0) + UPPER_BOUND * s_11.error;
        Self {
            mean: products.statistic(|all| all[0] / (1.0 - falls_to(&all))),
            rms: root_of(&products.statistic(|all| square(&all))),
            relative: root_of(&relative.statistic(|all| square(&all))),
            significant,
            upper_bound: upper.sqrt() / (1.0 - most),
            falls_to: falls_to(&products.all),
            mean_luminance,
        }
    }
}

/// Weighted mean square of the bias of an image, and the share of the bias that is left at
/// `1/sqrt(2)` of the radius.
// theory.md (70)
pub fn weighted_square(noise: &NoiseImage, weights: &[f64]) -> (Statistic, f64) {
    let all: Vec<usize> = (0..noise.pixels.len()).collect();
    let products = LeftOut::new(noise, &all, |pixel| weights[pixel]);
    (products.statistic(|all| square(&all)), falls_to(&products.all))
}

/// Share of the bias that is left at `1/sqrt(2)` of the radius, from the sums of both nested
/// differences of each tile and batch.
// theory.md (69), (70)
pub fn share_left(tiles: &[[[f64; 2]; BATCHES]]) -> f64 {
    let mut all = [0.0; 3];
    for batches in tiles {
        let total = [0, 1].map(|a| batches.iter().map(|d| d[a]).sum::<f64>());
        all[0] += total[0];
        for b in 0..2 {
            let squares: f64 = batches.iter().map(|d| d[0] * d[b]).sum();
            all[1 + b] += total[0] * total[b] - squares;
        }
    }
    falls_to(&all)
}

/// Share of the bias that is left at `1/sqrt(2)` of the radius.
// theory.md (70)
fn falls_to(&[_, s_11, s_12]: &Products) -> f64 {
    let [least, most] = REMAINING;
    if s_11 > 0.0 { (s_12 / s_11).clamp(least, most) } else { least }
}

/// Mean square of the bias.
// theory.md (70)
fn square(products: &Products) -> f64 {
    products[1] / (1.0 - falls_to(products)).powi(2)
}

/// The root of a mean square whose estimate may be negative.
fn root_of(square: &Statistic) -> Statistic {
    let value = square.value.max(0.0).sqrt();
    // d sqrt(x) = dx / (2 sqrt(x)), and no more than sqrt(dx) near 0.
    let error = (0.5 * square.error / value).min(square.error.sqrt());
    Statistic { value, corrected: value, error }
}

/// Products of all iterations, and without those of each batch.
struct LeftOut {
    all: Products,
    without: [Products; BATCHES],
    iterations: u64,
}

impl LeftOut {
    /// Over the pixels `region`, each with a weight.
    ///
    /// `S_ab = (sum d_a sum d_b - sum_q d_aq d_bq)/(n^2 - sum_q n_q^2)`, the `d_q` being sums over
    /// batches. No batch is multiplied by itself, so that its noise adds nothing to the mean.
    // theory.md (69)
    fn new(noise: &NoiseImage, region: &[usize], weight: impl Fn(usize) -> f64) -> Self {
        let counts = noise.counts.iterations.map(|n| n as f64);
        let (n, n2) = (counts.iter().sum::<f64>(), counts.iter().map(|n| n * n).sum::<f64>());
        let (mut all, mut without) = ([0.0; 3], [[0.0; 3]; BATCHES]);
        let scale = 1.0 / region.len() as f64;
        for &pixel in region {
            let weight = scale * weight(pixel);
            let own = &noise.batches[pixel];
            let sums: [[f64; 2]; BATCHES] =
                std::array::from_fn(|batch| own[batch].nested.map(|d| d * counts[batch]));
            let (mut total, mut squares) = ([0.0; 2], [0.0; 2]);
            for d in &sums {
                (0..2).for_each(|a| total[a] += d[a]);
                (0..2).for_each(|b| squares[b] += d[0] * d[b]);
            }
            let add = |to: &mut Products, left_out: [f64; 2], n_k: f64| {
                let [d1, d2] = [0, 1].map(|a| total[a] - left_out[a]);
                let [p11, p12] = [0, 1].map(|b| squares[b] - left_out[0] * left_out[b]);
                let pairs = (n - n_k).powi(2) - (n2 - n_k * n_k);
                for (sum, term) in to.iter_mut().zip([
                    d1 / (n - n_k),
                    (d1 * d1 - p11) / pairs,
                    (d1 * d2 - p12) / pairs,
                ]) {
                    *sum += weight * term;
                }
            };
            add(&mut all, [0.0; 2], 0.0);
            for (batch, without) in without.iter_mut().enumerate() {
                add(without, sums[batch], counts[batch]);
            }
        }
        Self { all, without, iterations: noise.iterations }
    }

    /// A function of the products with its standard error.
    fn statistic(&self, of: impl Fn(Products) -> f64) -> Statistic {
        let value = of(self.all);
        if self.iterations < 2 * BATCHES as u64 {
            return Statistic { value, corrected: value, error: f64::INFINITY };
        }
        Statistic::jackknife(value, &self.without.map(of))
    }
}

impl NoiseImage {
    /// The bias of each pixel and its standard error, row by row: it is taken to fall with the
    /// radius as that of the whole image does.
    pub fn bias(&self) -> Vec<[f64; 2]> {
        let all: Vec<usize> = (0..self.pixels.len()).collect();
        let scale = 1.0 / (1.0 - falls_to(&LeftOut::new(self, &all, |_| 1.0).all));
        let of = self.pixels.iter().map(|pixel| [pixel.noise.nested[0], pixel.nested_error]);
        of.map(|bias| bias.map(|value| scale * value)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::noise::film::BatchCounts;
    use crate::noise::image::{NoiseSample, PixelEstimate};
    use bdpm_base::rng::{Stream, StreamKey};

    /// An image of 64 pixels whose bias in each is known, with noise of iterations in each batch.
    fn noisy(falls_to: f64, bias: f64, noise: f64, iterations: u64) -> NoiseImage {
        let mut rng = StreamKey::new(5, Stream::Pilot, 0).rng(0);
        let (pixels, counts) = (64, BatchCounts::of(iterations));
        let mut batches = vec![[NoiseSample::default(); BATCHES]; pixels];
        for (index, batches) in batches.iter_mut().enumerate() {
            let sign = if index % 2 == 0 { 1.0 } else { -1.0 };
            for (batch, sample) in batches.iter_mut().enumerate() {
                let [n, _] = counts.of_batch(batch);
                let mut gauss = || (0..12).map(|_| f64::from(rng.next_1d())).sum::<f64>() - 6.0;
                let first = sign * bias * (1.0 - falls_to);
                sample.nested = [first, falls_to * first].map(|d| d + noise / n.sqrt() * gauss());
            }
        }
        let pixels = vec![PixelEstimate { luminance: 2.0, ..Default::default() }; pixels];
        let (light_paths, camera_paths) = (100, 2);
        let (width, height) = (8, 8);
        NoiseImage { width, height, light_paths, camera_paths, iterations, pixels, batches, counts }
    }

    fn all() -> Vec<usize> {
        (0..64).collect()
    }

    #[test]
    fn known_bias_is_estimated_for_every_slope() {
        for falls in [0.5, 0.6, FRAC_1_SQRT_2] {
            // Batches of unequal sizes; noise of the differences ten times as large as they are.
            let found = MergeBias::new(&noisy(falls, 0.1, 0.4, 1000), &all());
            let Statistic { value, error, .. } = found.rms;
            assert!(found.significant && error < 0.03, "{falls}: {found:?}");
            assert!((value - 0.1).abs() < 3.0 * error, "{falls}: {value} +- {error}");
            let relative = 0.05 / (1.01f64).sqrt();
            assert!((found.relative.value - relative).abs() < 3.0 * found.relative.error);
            assert!(found.upper_bound > value);
        }
    }

    #[test]
    fn noise_without_bias_is_not_significant_and_bounds_it() {
        let found = MergeBias::new(&noisy(0.5, 0.0, 0.4, 1000), &all());
        assert!(!found.significant, "{found:?}");
        assert!(found.upper_bound > 0.0 && found.upper_bound < 0.03, "{found:?}");
        assert!(found.mean.value.abs() < 3.0 * found.mean.error);
        // One iteration in each of two batches: an estimate without a standard error.
        let few = MergeBias::new(&noisy(0.5, 0.0, 0.4, 2), &all());
        assert!(few.rms.value.is_finite() && few.upper_bound == f64::INFINITY && !few.significant);
    }
}
