//! The error of a denoised image, by leaving folds of the iterations out (docs/explanation/denoising.md).

use super::{BOX_RADIUS, FoldedImage, Mix};
use crate::base::error::Result;
use crate::base::math::{Rgb, luminance};
use crate::film::folds::DENOISE_FOLDS;
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
    /// Independent parts of each fold. Their differences give the noise of the fold where there are two folds only;
    /// empty for more folds.
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
        mut denoiser: impl FnMut(&[Rgb]) -> Result<Vec<Rgb>>,
    ) -> Result<Self> {
        let luminances = |image: &[Rgb]| image.iter().map(|value| luminance(*value)).collect();
        let [fold, raw, denoised] = [const { Vec::new() }; 3];
        let mut validation = Self { fold, raw, denoised, parts: Vec::new() };
        for fold in 0..image.fold_count() {
            let others = image.without(fold);
            validation.fold.push(image.luminance_of(fold));
            validation.raw.push(luminances(&others));
            validation.denoised.push(luminances(&denoiser(&others)?));
            if image.fold_count() == 2 {
                validation.parts.push(image.parts_of(fold));
            }
        }
        Ok(validation)
    }

    /// Number of folds.
    pub fn fold_count(&self) -> usize {
        self.fold.len()
    }

    /// Luminance of the images that are denoised without one of the folds, row by row.
    pub fn images(&self) -> &[Vec<f32>] {
        &self.denoised
    }

    /// Cross-validation of the mixed images. The mix of each fold is estimated from the other folds.
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

    /// `mean_i (D_-i - B_i)^2 - s^2` of a pixel: an unbiased estimate of the squared error of an image from `(n-1)/n`
    /// of the samples. With two folds it is the mean product of `D_-i - B_ij` and `D_-i - B_ik`, over pairs of
    /// different parts `B_ij` and `B_ik` of a fold.
    pub fn squared(&self, pixel: usize) -> f64 {
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
    /// With `B_i = L + e_i`, the estimate is `mean_i [(D_-i - L)^2 - 2 (D_-i - L) e_i] + mean_{i != j} e_i e_j`. The
    /// variance of the last term is `2 T/(n(n-1))`, where `T` is the mean square of `e_i e_j`. That of the middle term
    /// is `4 C/n`, where `C` is the mean square of `(D_-i - L) e_i`. Products are sums over the pixels.
    ///
    /// `L` is not known. The mean of other folds takes its place, of different folds for each factor: both factors are
    /// then independent, and rare bright noise is not multiplied by itself. With `m` folds in each mean, `T` is the mean
    /// square over `(1 + 1/m)^2`, and `C` is the mean square over `1 + 1/m`, minus `T/m`.
    ///
    /// This variance is too small for noise that is rarer than the folds can show, and too large for normal noise. The
    /// standard error is the geometric mean of this and the one for normal noise (docs/explanation/denoising.md).
    pub fn estimate(&self, weights: &[f64]) -> SquaredError {
        if !self.parts.is_empty() {
            return self.estimate_from_parts(weights);
        }
        let n = self.fold_count();
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

    /// The estimate from the products of `D_-i - B_ij` and `D_-i - B_ik` over pairs of parts, with the jackknife's
    /// standard error over the parts of a fold (Efron and Stein 1981). The errors of both folds count as equal, not as
    /// independent, since the denoised image of each holds the noise of the other.
    fn estimate_from_parts(&self, weights: &[f64]) -> SquaredError {
        let count = weights.iter().filter(|weight| **weight > 0.0).count().max(1) as f64;
        let of_fold = |fold: usize| {
            let parts = self.parts[fold].len();
            let pairs: Vec<(usize, usize)> =
                (0..parts).flat_map(|j| (0..j).map(move |k| (j, k))).collect();
            let product = |(j, k): &(usize, usize)| {
                let value = |pixel: usize| {
                    let distance = |part: usize| {
                        f64::from(self.denoised[fold][pixel] - self.parts[fold][part][pixel])
                    };
                    weights[pixel] * distance(*j) * distance(*k)
                };
                (0..weights.len()).map(value).sum::<f64>() / count
            };
            let products: Vec<f64> = pairs.par_iter().map(product).collect();
            let mean_without = |left_out: Option<usize>| {
                let taken = pairs.iter().zip(&products);
                let taken = taken.filter(|((j, k), _)| ![Some(*j), Some(*k)].contains(&left_out));
                let (sum, n) = taken.fold((0.0, 0.0), |(sum, n), (_, p)| (sum + p, n + 1.0));
                sum / n
            };
            let without: Vec<f64> = (0..parts).map(|part| mean_without(Some(part))).collect();
            let mean = without.iter().sum::<f64>() / parts as f64;
            let spread: f64 = without.iter().map(|value| (value - mean).powi(2)).sum();
            (mean_without(None), (spread * (parts as f64 - 1.0) / parts as f64).sqrt())
        };
        let n = self.fold_count() as f64;
        let (squared, error) = (0..self.fold_count())
            .map(of_fold)
            .fold((0.0, 0.0), |(sum, errors), (squared, error)| (sum + squared, errors + error));
        SquaredError { squared: squared / n, standard_error: error / n }
    }

    /// Squared error of the raw image from as many samples, which is its variance.
    pub fn raw(&self, weights: &[f64]) -> f64 {
        let n = self.fold_count() as f64;
        let variance = |pixel: usize| {
            let fold = |i: usize| f64::from(self.fold[i][pixel]);
            let mean = (0..self.fold_count()).map(fold).sum::<f64>() / n;
            (0..self.fold_count()).map(|i| (fold(i) - mean).powi(2)).sum::<f64>() / (n - 1.0)
        };
        let sum: f64 = (0..weights.len()).map(|pixel| weights[pixel] * variance(pixel)).sum();
        sum / weights.len() as f64 / (n - 1.0)
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

/// Weighted sums over pixels, `n` by `n`.
struct ProductSums {
    squared: f64,
    /// Products of the folds' residuals `r_i = B_i - mean B`.
    gram: Vec<f64>,
    /// Products of `D_-i - mean B` with `r_j`.
    cross: Vec<f64>,
}

impl ProductSums {
    fn new(n: usize) -> Self {
        Self { squared: 0.0, gram: vec![0.0; n * n], cross: vec![0.0; n * n] }
    }

    fn add(&mut self, validation: &CrossValidation, pixel: usize, weight: f64) {
        let n = validation.fold_count();
        let [mut residual, mut distance] = [[0.0; DENOISE_FOLDS]; 2];
        let fold = |i: usize| f64::from(validation.fold[i][pixel]);
        let mean = (0..n).map(fold).sum::<f64>() / n as f64;
        for i in 0..n {
            residual[i] = fold(i) - mean;
            distance[i] = weight * (f64::from(validation.denoised[i][pixel]) - mean);
        }
        self.squared += weight * validation.squared(pixel);
        for i in 0..n {
            for j in 0..n {
                self.gram[i * n + j] += weight * residual[i] * residual[j];
                self.cross[i * n + j] += distance[i] * residual[j];
            }
        }
    }

    fn append(&mut self, other: &Self) {
        self.squared += other.squared;
        self.gram.iter_mut().zip(&other.gram).for_each(|(a, b)| *a += b);
        self.cross.iter_mut().zip(&other.cross).for_each(|(a, b)| *a += b);
    }

    fn estimate(&self, pixels: f64) -> SquaredError {
        let count = self.gram.len().isqrt();
        let n = count as f64;
        let product = |sums: &[f64], i: usize, j: usize| sums[i * count + j] / pixels;
        // Product of factor `i`, minus the mean of the residuals `a`, with residual `j`, minus the mean of the
        // residuals `b`.
        let centered = |first: &[f64], (i, a): (usize, &[usize]), (j, b): (usize, &[usize])| {
            let mean = |of: &dyn Fn(usize) -> f64, folds: &[usize]| {
                folds.iter().map(|&fold| of(fold)).sum::<f64>() / folds.len() as f64
            };
            product(first, i, j)
                - mean(&|b| product(first, i, b), b)
                - mean(&|a| product(&self.gram, a, j) - mean(&|b| product(&self.gram, a, b), b), a)
        };
        let (mut t, mut middle) = (0.0, Vec::new());
        for i in 0..count {
            for j in (0..count).filter(|&j| j != i) {
                let [a, b] = halves(count, |fold| fold != i && fold != j);
                t += centered(&self.gram, (i, &a), (j, &b)).powi(2) / (n * (n - 1.0));
            }
            let [a, b] = halves(count, |fold| fold != i);
            let both = [(&a, &b), (&b, &a)];
            let product = |(a, b): (&Vec<_>, &Vec<_>)| centered(&self.cross, (i, a), (i, b));
            middle.push(both.map(product).iter().sum::<f64>() / 2.0);
        }
        // Subtract their mean: the denoised images hold noise of the folds in `b`.
        let mean = middle.iter().sum::<f64>() / n;
        let mut c = middle.iter().map(|w| (w - mean).powi(2)).sum::<f64>() / (n - 1.0);
        // Number of folds in a mean.
        let m = ((count - 2) / 2) as f64;
        t /= (1.0 + 1.0 / m).powi(2);
        c = (c / (1.0 + 1.0 / m) - t / m).max(0.0);
        let variance = 2.0 * t / (n * (n - 1.0)) + 4.0 * c / n;
        let both = (variance * self.variance_if_normal(pixels)).sqrt();
        SquaredError { squared: self.squared / pixels, standard_error: both.sqrt() }
    }

    /// The variance of the estimate if noise is normal: `T` from all products of residuals (Bai and Saranadasa 1996),
    /// `C` from those of `mean D - mean B`.
    fn variance_if_normal(&self, pixels: f64) -> f64 {
        let count = self.gram.len().isqrt();
        let n = count as f64;
        let trace =
            (0..count).map(|i| self.gram[i * count + i]).sum::<f64>() / (pixels * (n - 1.0));
        let norm2: f64 = self.gram.iter().map(|product| (product / pixels).powi(2)).sum();
        let norm2 = norm2 / (n - 1.0).powi(2);
        let factor = (n - 1.0).powi(2) / ((n - 2.0) * (n + 1.0));
        let t = (factor * (norm2 - trace * trace / (n - 1.0))).max(0.0);
        let column_mean = |j: usize| (0..count).map(|i| self.cross[i * count + j]).sum::<f64>() / n;
        let cross2: f64 = (0..count).map(|j| (column_mean(j) / pixels).powi(2)).sum();
        let c = (cross2 / (n - 1.0) - t / n).max(0.0);
        2.0 * t / (n * (n - 1.0)) + 4.0 * c / n
    }
}

/// The folds for which `wanted` returns true, in two equal halves. An odd one is left out.
fn halves(count: usize, wanted: impl Fn(usize) -> bool) -> [Vec<usize>; 2] {
    let all: Vec<usize> = (0..count).filter(|&fold| wanted(fold)).collect();
    let half = all.len() / 2;
    let of = |first: usize| all.iter().copied().skip(first).step_by(2).take(half).collect();
    [of(0), of(1)]
}

/// Means over the pixels at most `radius` away along either axis.
pub(super) fn boxes(values: &[f64], (width, height): (usize, usize), radius: usize) -> Vec<f64> {
    // Sums over rectangles from the corner, one column and row larger.
    let mut corner = vec![0.0; (width + 1) * (height + 1)];
    for y in 0..height {
        let mut row = 0.0;
        for x in 0..width {
            row += values[y * width + x];
            corner[(y + 1) * (width + 1) + x + 1] = corner[y * (width + 1) + x + 1] + row;
        }
    }
    let at = |x: usize, y: usize| corner[y * (width + 1) + x];
    let mean = |index: usize| {
        let (x, y) = (index % width, index / width);
        let (left, right) = (x.saturating_sub(radius), (x + radius + 1).min(width));
        let (top, bottom) = (y.saturating_sub(radius), (y + radius + 1).min(height));
        let sum = at(right, bottom) - at(left, bottom) - at(right, top) + at(left, top);
        sum / ((right - left) * (bottom - top)) as f64
    };
    (0..width * height).into_par_iter().map(mean).collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::base::rng::{Rng, Stream, StreamKey};
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

    /// Folds with independent noise per pixel and noise that wide waves correlate. A blur stands in for a denoiser.
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
                let error = error(&folds.denoised, &truth, &weights);
                estimated += estimate.squared;
                true_error += error;
                let deviation = (estimate.squared - error) / estimate.standard_error;
                (z, z2) = (z + deviation, z2 + deviation * deviation);
            }
            let trials = f64::from(trials);
            // Means of z have the standard error 1/sqrt(trials); squares are a little less than 1, since no term of
            // the variance may be negative.
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
            for _ in 0..trials {
                let folds = two_folds(&folds(&truth, noise, &mut rng));
                let estimate = folds.estimate(&weights);
                let of_pixels: f64 = (0..truth.len()).map(|p| weights[p] * folds.squared(p)).sum();
                let of_pixels = of_pixels / truth.len() as f64;
                assert!((of_pixels - estimate.squared).abs() < 1e-5 * of_pixels.abs().max(0.01));
                let off = estimate.squared - error(&folds.denoised, &truth, &weights);
                (difference, difference2) = (difference + off, difference2 + off * off);
                z2 += (off / estimate.standard_error).powi(2);
            }
            let trials = f64::from(trials);
            let deviation = difference / difference2.sqrt();
            assert!(deviation.abs() < 4.0, "{case}: {deviation} standard errors off");
            // Standard errors of four parts scatter, and they count the errors of both folds as equal.
            assert!((0.2..2.0).contains(&(z2 / trials)), "{case}: {}", z2 / trials);
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
            let error = error(&folds.denoised, &truth, &weights);
            z2 += ((estimate.squared - error) / estimate.standard_error).powi(2);
            ratio += estimate.standard_error / folds.raw(&weights);
        }
        let [z2, ratio] = [z2, ratio].map(|sum| sum / f64::from(trials));
        assert!((0.01..2.0).contains(&z2), "{z2}");
        assert!(ratio < 0.5, "{ratio}");
    }

    #[test]
    fn boxes_at_the_border_are_means_over_the_inside() {
        let values: Vec<f64> = (0..35).map(|i| f64::from(i * i % 11)).collect();
        for radius in [0, 1, 3, 40] {
            for (index, mean) in boxes(&values, (7, 5), radius).into_iter().enumerate() {
                let near = |i: &usize| {
                    (i % 7).abs_diff(index % 7) <= radius && (i / 7).abs_diff(index / 7) <= radius
                };
                let own: Vec<f64> = (0..35).filter(near).map(|i| values[i]).collect();
                let expected = own.iter().sum::<f64>() / own.len() as f64;
                assert!((mean - expected).abs() < 1e-9, "{radius} {index}");
            }
        }
    }
}
