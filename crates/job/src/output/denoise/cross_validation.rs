//! The error of a denoised image, by leaving folds of the iterations out
//! (docs/explanation/denoising.md).

use super::pooling::boxes;
use super::seen_lights::denoise_around;
use super::standard_error::ProductSums;
use super::window::{SampledTile, Window};
use super::{BOX_RADIUS, FoldedImage, Mix};
use bdpm_core::base::error::Result;
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::film::folds::DENOISE_FOLDS;
use rayon::prelude::*;

/// Luminances, W/(m^2 sr), for each fold `i` of `n`: row by row.
#[derive(Clone, Debug)]
pub struct CrossValidation {
    /// `B_i`, the image of the fold.
    pub(super) fold: Vec<Vec<f32>>,
    /// `R_-i`, the mean of the other folds.
    pub(super) raw: Vec<Vec<f32>>,
    /// `D_-i`, denoised from the other folds.
    pub(super) denoised: Vec<Vec<f32>>,
    /// Independent parts of each fold. Their differences give the noise of the fold where there are
    /// two folds only; empty for more folds, and where the image has too few iterations for parts.
    pub(super) parts: Vec<Vec<Vec<f32>>>,
}

/// Estimate of a squared error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SquaredError {
    /// Weighted mean over pixels. Its noise can make it negative.
    pub squared: f64,
    /// Standard error of `squared`. It holds for correlated noise of pixels as well.
    pub standard_error: f64,
}

impl CrossValidation {
    /// Denoises, for each fold, the image of the other folds.
    ///
    /// # Errors
    /// Those of the denoiser.
    pub fn new(
        image: &FoldedImage,
        denoiser: impl FnMut(Window, &[Rgb]) -> Result<Vec<Rgb>>,
    ) -> Result<Self> {
        let whole = Window::whole(image.resolution());
        Self::of_tiles(image, &[SampledTile { window: whole, core: whole, factor: 1.0 }], denoiser)
    }

    /// Denoises, for each fold, these tiles of the image of the other folds. Pixels of the cores
    /// follow one another, tile by tile, row by row.
    ///
    /// # Errors
    /// Those of the denoiser.
    pub fn of_tiles(
        image: &FoldedImage,
        tiles: &[SampledTile],
        mut denoiser: impl FnMut(Window, &[Rgb]) -> Result<Vec<Rgb>>,
    ) -> Result<Self> {
        let n = image.fold_count();
        let empty = || vec![Vec::new(); n];
        let mut all = Self { fold: empty(), raw: empty(), denoised: empty(), parts: Vec::new() };
        if n == 2 && image.has_parts() {
            all.parts = vec![vec![Vec::new(); DENOISE_FOLDS / n]; n];
        }
        for SampledTile { window, core, .. } in tiles {
            let inner = Window { x: core.x - window.x, y: core.y - window.y, ..*core };
            let luminances = |image: &[Rgb]| {
                let pixels = inner.indices(window.width);
                pixels.map(|index| luminance(image[index])).collect::<Vec<f32>>()
            };
            for fold in 0..n {
                let others = image.without(*window, fold);
                all.fold[fold].extend(image.luminance_of(*core, fold));
                all.raw[fold].extend(luminances(&others));
                let seen = image.seen_without(*window, fold);
                let denoised = denoise_around(&seen, &others, |rest| denoiser(*window, rest))?;
                all.denoised[fold].extend(luminances(&denoised));
                if let Some(parts) = all.parts.get_mut(fold) {
                    let of_tile = image.parts_of(*core, fold);
                    parts.iter_mut().zip(of_tile).for_each(|(all, part)| all.extend(part));
                }
            }
        }
        Ok(all)
    }

    /// Number of folds.
    pub fn fold_count(&self) -> usize {
        self.fold.len()
    }

    /// Cross-validation of the mixed images. The mix of each fold is estimated from the other
    /// folds.
    pub fn mixed(&self, mix: &Mix) -> Self {
        let fold = |((denoised, raw), shares): ((&Vec<f32>, &Vec<f32>), &Vec<f32>)| {
            let pixels = denoised.iter().zip(raw).zip(shares);
            pixels.map(|((d, r), share)| d + share * (r - d)).collect()
        };
        let pairs = self.denoised.par_iter().zip(&self.raw).zip(&mix.fold_shares);
        Self { denoised: pairs.map(fold).collect(), ..self.clone() }
    }

    /// Cross-validation of the raw images.
    pub fn of_raw(&self) -> Self {
        Self { denoised: self.raw.clone(), ..self.clone() }
    }

    /// Estimate of the squared error of a pixel of the image that is denoised from all samples: the
    /// error from `(n-1)/n` of them, minus the excess noise of the images `D_-i`.
    pub fn squared(&self, pixel: usize) -> f64 {
        self.squared_without_one_fold(pixel) - self.excess_noise(pixel)
    }

    /// Noise that the images `D_-i` have in excess of the image from all samples:
    /// `mean_i (D_-i - mean D)^2`, as of the jackknife. It is exact for a linear denoiser, where
    /// the variance is inverse to the number of samples.
    fn excess_noise(&self, pixel: usize) -> f64 {
        let n = self.fold_count() as f64;
        let denoised = |i: usize| f64::from(self.denoised[i][pixel]);
        let mean = (0..self.fold_count()).map(denoised).sum::<f64>() / n;
        (0..self.fold_count()).map(|i| (denoised(i) - mean).powi(2)).sum::<f64>() / n
    }

    /// `mean_i (D_-i - B_i)^2 - s^2` of a pixel: an unbiased estimate of the squared error of an
    /// image from `(n-1)/n` of the samples. With two folds of parts it is the mean product of
    /// `D_-i - B_ij` and `D_-i - B_ik`, over pairs of different parts `B_ij` and `B_ik` of a fold.
    fn squared_without_one_fold(&self, pixel: usize) -> f64 {
        if !self.parts.is_empty() {
            let of_fold = |fold: usize| {
                let (mut sum, mut squares) = (0.0, 0.0);
                for part in &self.parts[fold] {
                    let distance = f64::from(self.denoised[fold][pixel] - part[pixel]);
                    (sum, squares) = (sum + distance, squares + distance * distance);
                }
                let parts = self.parts[fold].len() as f64;
                (sum * sum - squares) / (parts * (parts - 1.0))
            };
            return (0..self.fold_count()).map(of_fold).sum::<f64>() / self.fold_count() as f64;
        }
        let n = self.fold_count() as f64;
        let fold = |i: usize| f64::from(self.fold[i][pixel]);
        let mean = (0..self.fold_count()).map(fold).sum::<f64>() / n;
        let spread: f64 = (0..self.fold_count()).map(|i| (fold(i) - mean).powi(2)).sum();
        let distance: f64 = (0..self.fold_count())
            .map(|i| (f64::from(self.denoised[i][pixel]) - fold(i)).powi(2))
            .sum();
        distance / n - spread / (n - 1.0)
    }

    /// Weighted mean of [`Self::squared`] over all pixels. Pixels of weight 0 do not count.
    ///
    /// With `B_i = L + e_i`, the estimate is
    /// `mean_i [(D_-i - L)^2 - 2 (D_-i - L) e_i] + mean_{i != j} e_i e_j`. The variance of the last
    /// term is `2 T/(n(n-1))`, where `T` is the mean square of `e_i e_j`. That of the middle term
    /// is `4 C/n`, where `C` is the mean square of `(D_-i - L) e_i`. Products are sums over the
    /// pixels.
    ///
    /// `L` is not known. The mean of other folds takes its place, of different folds for each
    /// factor: both factors are then independent, and rare bright noise is not multiplied by
    /// itself. With `m` folds in each mean, `T` is the mean square over `(1 + 1/m)^2`, and `C` is
    /// the mean square over `1 + 1/m`, minus `T/m`.
    ///
    /// This variance is too small for noise that is rarer than the folds can show, and too large
    /// for normal noise. The standard error is the geometric mean of this and the one for normal
    /// noise (docs/explanation/denoising.md).
    pub fn estimate(&self, weights: &[f64]) -> SquaredError {
        if !self.parts.is_empty() {
            return self.estimate_from_parts(weights);
        }
        let n = self.fold_count();
        if n == 2 {
            return self.estimate_from_stripes(weights);
        }
        // Chunks do not depend on the number of threads, so that the sums do not either.
        let chunk = |(chunk, weights): (usize, &[f64])| {
            let mut sums = ProductSums::new(n);
            for (pixel, &weight) in (chunk * CHUNK..).zip(weights).filter(|(_, w)| **w > 0.0) {
                sums.add(self, pixel, weight);
            }
            sums
        };
        let sums: Vec<ProductSums> = weights.par_chunks(CHUNK).enumerate().map(chunk).collect();
        let count = weights.iter().filter(|weight| **weight > 0.0).count().max(1);
        let mut all = ProductSums::new(n);
        sums.iter().for_each(|sums| all.append(sums));
        all.estimate(count as f64)
    }

    /// Weighted mean of [`Self::excess_noise`] over the pixels whose weight is not 0.
    pub(super) fn mean_excess_noise(&self, weights: &[f64]) -> f64 {
        let term = |pixel: usize| weights[pixel] * self.excess_noise(pixel);
        let count = weights.iter().filter(|weight| **weight > 0.0).count().max(1);
        (0..weights.len()).map(term).sum::<f64>() / count as f64
    }

    /// Squared error of the raw image, which is its variance.
    pub fn raw(&self, weights: &[f64]) -> f64 {
        let n = self.fold_count() as f64;
        let variance = |pixel: usize| {
            let fold = |i: usize| f64::from(self.fold[i][pixel]);
            let mean = (0..self.fold_count()).map(fold).sum::<f64>() / n;
            (0..self.fold_count()).map(|i| (fold(i) - mean).powi(2)).sum::<f64>() / (n - 1.0)
        };
        let sum: f64 = (0..weights.len()).map(|pixel| weights[pixel] * variance(pixel)).sum();
        sum / weights.len() as f64 / n
    }

    /// RMS errors pooled over squares of `2 BOX_RADIUS + 1` pixels.
    pub fn map(&self, (width, height): (u32, u32)) -> Vec<f32> {
        let squared: Vec<f64> =
            (0..self.fold[0].len()).into_par_iter().map(|pixel| self.squared(pixel)).collect();
        let pooled = boxes(&squared, (width as usize, height as usize), BOX_RADIUS as usize);
        pooled.iter().map(|squared| squared.max(0.0).sqrt() as f32).collect()
    }
}

/// Pixels of a parallel task.
const CHUNK: usize = 4096;

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use bdpm_core::base::rng::{Rng, Stream, StreamKey};
    use std::f64::consts::TAU;

    const SIDE: usize = 64;
    const N: usize = 8;

    /// A standard normal number (Box and Muller 1958).
    fn normal(rng: &mut Rng) -> f64 {
        let [u, v] = rng.next_2d().map(f64::from);
        (-2.0 * (1.0 - u).ln()).sqrt() * (TAU * v).cos()
    }

    /// A ramp with an edge and a fine grating.
    pub fn truth(contrast: f64) -> Vec<f64> {
        let value = |pixel: usize| {
            let (x, y) = (pixel % SIDE, pixel / SIDE);
            let edge = if x > SIDE / 3 { 1.0 } else { 0.0 };
            let grating = if y > SIDE / 2 && (x + y) % 2 == 0 { contrast } else { 0.0 };
            1.0 + y as f64 / SIDE as f64 + edge + grating
        };
        (0..SIDE * SIDE).map(value).collect()
    }

    /// Folds with independent noise per pixel and noise that wide waves correlate. A blur stands in
    /// for a denoiser.
    pub fn folds(truth: &[f64], (own, shared): (f64, f64), rng: &mut Rng) -> CrossValidation {
        let fold = |rng: &mut Rng| -> Vec<f64> {
            let waves: Vec<[f64; 4]> = (0..12)
                .map(|k| [1.0 + f64::from(k) / 4.0, normal(rng), normal(rng), TAU * normal(rng)])
                .collect();
            let wave = |pixel: usize| -> f64 {
                let (x, y) = ((pixel % SIDE) as f64, (pixel / SIDE) as f64);
                let phase = |[k, a, _, phase]: &[f64; 4]| {
                    a * (TAU * k * (x * phase.cos() + y * phase.sin()) / SIDE as f64 + phase).sin()
                };
                waves.iter().map(phase).sum()
            };
            let value = |(pixel, truth): (usize, &f64)| {
                truth * (1.0 + own * normal(rng) + shared * wave(pixel))
            };
            truth.iter().enumerate().map(value).collect()
        };
        let noisy: Vec<Vec<f64>> = (0..N).map(|_| fold(rng)).collect();
        let without = |i: usize| -> Vec<f64> {
            let sum =
                |pixel: usize| (0..N).filter(|j| *j != i).map(|j| noisy[j][pixel]).sum::<f64>();
            (0..truth.len()).map(|pixel| sum(pixel) / (N - 1) as f64).collect()
        };
        let single = |values: Vec<f64>| values.into_iter().map(|value| value as f32).collect();
        CrossValidation {
            raw: (0..N).map(|i| single(without(i))).collect(),
            denoised: (0..N).map(|i| single(boxes(&without(i), (SIDE, SIDE), 2))).collect(),
            fold: noisy.into_iter().map(single).collect(),
            parts: Vec::new(),
        }
    }

    /// Mean over folds of the weighted squared error of `images`.
    pub fn error(images: &[Vec<f32>], truth: &[f64], weights: &[f64]) -> f64 {
        let of = |image: &Vec<f32>| -> f64 {
            let pixels = image.iter().zip(truth).zip(weights);
            pixels.map(|((d, l), w)| w * (f64::from(*d) - l).powi(2)).sum::<f64>()
        };
        let count = weights.iter().filter(|weight| **weight > 0.0).count();
        images.iter().map(of).sum::<f64>() / (images.len() * count) as f64
    }

    /// The mean of all folds, and its blur.
    pub fn of_all_samples(folds: &CrossValidation, radius: usize) -> [Vec<f32>; 2] {
        let n = folds.fold_count() as f64;
        let sum = |pixel: usize| folds.fold.iter().map(|fold| f64::from(fold[pixel])).sum::<f64>();
        let mean: Vec<f64> = (0..SIDE * SIDE).map(|pixel| sum(pixel) / n).collect();
        let blurred = boxes(&mean, (SIDE, SIDE), radius);
        [mean, blurred].map(|values| values.into_iter().map(|value| value as f32).collect())
    }

    /// Weighted squared error of the blurred mean of all folds.
    fn error_of_all(folds: &CrossValidation, radius: usize, truth: &[f64], weights: &[f64]) -> f64 {
        let [_, blurred] = of_all_samples(folds, radius);
        error(&[blurred], truth, weights)
    }

    #[test]
    fn squared_errors_and_their_standard_errors_are_estimated_without_a_reference() {
        let truth = truth(0.4);
        let mut weights: Vec<f64> = truth.iter().map(|l| 1.0 / (l * l + 0.04)).collect();
        // Independent noise, correlated noise, both, and both in a block of 16 by 16 pixels only.
        for (case, noise) in
            [(0.5, 0.0), (0.05, 0.1), (0.3, 0.05), (0.3, 0.05)].into_iter().enumerate()
        {
            if case == 3 {
                for (pixel, weight) in weights.iter_mut().enumerate() {
                    *weight *= f64::from(u8::from(pixel % SIDE < 16 && pixel / SIDE < 16));
                }
            }
            let mut rng = StreamKey::new(7, Stream::Test, case as u64).rng(0);
            let trials = 150;
            let (mut estimated, mut true_error, mut z, mut z2) = (0.0, 0.0, 0.0, 0.0);
            for _ in 0..trials {
                let folds = folds(&truth, noise, &mut rng);
                let estimate = folds.estimate(&weights);
                let error = error_of_all(&folds, 2, &truth, &weights);
                estimated += estimate.squared;
                true_error += error;
                let deviation = (estimate.squared - error) / estimate.standard_error;
                (z, z2) = (z + deviation, z2 + deviation * deviation);
            }
            let trials = f64::from(trials);
            // Means of z have the standard error 1/sqrt(trials); squares are a little less than 1,
            // since no term of the variance may be negative.
            assert!(
                (z / trials).abs() < 4.0 / trials.sqrt(),
                "{case}: {estimated} {true_error} {}",
                z / trials
            );
            assert!((0.55..1.4).contains(&(z2 / trials)), "{case}: {}", z2 / trials);
        }
    }

    /// Two folds from the even and the odd ones of eight, with these as parts.
    fn two_folds(eight: &CrossValidation) -> CrossValidation {
        let parts: Vec<Vec<Vec<f32>>> =
            (0..2).map(|fold| eight.fold.iter().skip(fold).step_by(2).cloned().collect()).collect();
        let mean = |parts: &Vec<Vec<f32>>| -> Vec<f64> {
            let sum = |pixel: usize| parts.iter().map(|part| f64::from(part[pixel])).sum::<f64>();
            (0..SIDE * SIDE).map(|pixel| sum(pixel) / parts.len() as f64).collect()
        };
        let single = |values: &[f64]| -> Vec<f32> { values.iter().map(|v| *v as f32).collect() };
        let means = [0, 1].map(|fold| mean(&parts[fold]));
        CrossValidation {
            fold: means.iter().map(|mean| single(mean)).collect(),
            raw: means.iter().rev().map(|mean| single(mean)).collect(),
            denoised: means.iter().rev().map(|m| single(&boxes(m, (SIDE, SIDE), 2))).collect(),
            parts,
        }
    }

    #[test]
    fn two_folds_estimate_the_error_and_do_not_understate_its_standard_error() {
        let truth = truth(0.4);
        let weights: Vec<f64> = truth.iter().map(|l| 1.0 / (l * l + 0.04)).collect();
        for (case, noise) in [(0.5, 0.0), (0.05, 0.1), (0.3, 0.05)].into_iter().enumerate() {
            let mut rng = StreamKey::new(10, Stream::Test, case as u64).rng(0);
            let trials = 150;
            let (mut difference, mut difference2, mut z2) = (0.0, 0.0, 0.0);
            let (mut halves_z, mut halves_z2) = (0.0, 0.0);
            for _ in 0..trials {
                let folds = two_folds(&folds(&truth, noise, &mut rng));
                let estimate = folds.estimate(&weights);
                let of_pixels: f64 = (0..truth.len()).map(|p| weights[p] * folds.squared(p)).sum();
                let of_pixels = of_pixels / truth.len() as f64;
                assert!((of_pixels - estimate.squared).abs() < 1e-5 * of_pixels.abs().max(0.01));
                // Without parts the estimate of a pixel has more noise, and is as right.
                let halves = CrossValidation { parts: Vec::new(), ..folds.clone() };
                let of_halves = halves.estimate(&weights);
                let off_halves = of_halves.squared - error_of_all(&folds, 2, &truth, &weights);
                halves_z += off_halves / of_halves.standard_error;
                halves_z2 += (off_halves / of_halves.standard_error).powi(2);
                let off = estimate.squared - error_of_all(&folds, 2, &truth, &weights);
                (difference, difference2) = (difference + off, difference2 + off * off);
                z2 += (off / estimate.standard_error).powi(2);
            }
            let trials = f64::from(trials);
            let deviation = difference / difference2.sqrt();
            assert!(deviation.abs() < 4.0, "{case}: {deviation} standard errors off");
            // Standard errors of four parts scatter, and they count the errors of both folds as
            // equal.
            assert!((0.2..2.0).contains(&(z2 / trials)), "{case}: {}", z2 / trials);
            // The standard error of stripes is an upper bound, but for noise that waves correlate
            // across stripes.
            let mean = halves_z / trials;
            println!("{case}: {mean} {}", halves_z2 / trials);
            assert!(mean.abs() < 4.0 * (halves_z2 / trials / trials).sqrt(), "{case}: {mean}");
            assert!(halves_z2 / trials < 1.5, "{case}: {}", halves_z2 / trials);
        }
    }

    #[test]
    fn rare_bright_noise_does_not_inflate_the_standard_error() {
        // Spikes in one pixel of a thousand, a hundred times as bright, each in one fold only.
        let truth = truth(0.0);
        let weights = vec![1.0; truth.len()];
        let mut rng = StreamKey::new(8, Stream::Test, 0).rng(0);
        let (trials, mut z2, mut ratio) = (60, 0.0, 0.0);
        for _ in 0..trials {
            let fold = |rng: &mut Rng| -> Vec<f64> {
                let spike = |rng: &mut Rng| if rng.next_1d() < 1e-3 { 100.0 } else { 0.9 };
                truth.iter().map(|l| l * spike(rng) / (0.1 + 0.9 * 0.999)).collect()
            };
            let noisy: Vec<Vec<f64>> = (0..N).map(|_| fold(&mut rng)).collect();
            let without = |i: usize| -> Vec<f64> {
                let others =
                    |p: usize| (0..N).filter(|j| *j != i).map(|j| noisy[j][p]).sum::<f64>();
                (0..truth.len()).map(|p| others(p) / (N - 1) as f64).collect()
            };
            let single = |values: Vec<f64>| values.into_iter().map(|value| value as f32).collect();
            let folds = CrossValidation {
                raw: (0..N).map(|i| single(without(i))).collect(),
                denoised: (0..N).map(|i| single(boxes(&without(i), (SIDE, SIDE), 4))).collect(),
                fold: noisy.iter().cloned().map(single).collect(),
                parts: Vec::new(),
            };
            let estimate = folds.estimate(&weights);
            let error = error_of_all(&folds, 4, &truth, &weights);
            z2 += ((estimate.squared - error) / estimate.standard_error).powi(2);
            ratio += estimate.standard_error / folds.raw(&weights);
        }
        let [z2, ratio] = [z2, ratio].map(|sum| sum / f64::from(trials));
        assert!((0.01..2.0).contains(&z2), "{z2}");
        assert!(ratio < 0.5, "{ratio}");
    }
}
