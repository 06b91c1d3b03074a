//! The standard error of a cross-validated squared error (docs/explanation/denoising.md).

use super::cross_validation::{CrossValidation, SquaredError};
use bdpm_core::film::folds::DENOISE_FOLDS;
use rayon::prelude::*;

/// Weighted sums over pixels, `n` by `n`.
pub(super) struct ProductSums {
    squared: f64,
    /// Products of the folds' residuals `r_i = B_i - mean B`.
    gram: Vec<f64>,
    /// Products of `D_-i - mean B` with `r_j`.
    cross: Vec<f64>,
}

impl ProductSums {
    pub(super) fn new(n: usize) -> Self {
        Self { squared: 0.0, gram: vec![0.0; n * n], cross: vec![0.0; n * n] }
    }

    pub(super) fn add(&mut self, validation: &CrossValidation, pixel: usize, weight: f64) {
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

    pub(super) fn append(&mut self, other: &Self) {
        self.squared += other.squared;
        self.gram.iter_mut().zip(&other.gram).for_each(|(a, b)| *a += b);
        self.cross.iter_mut().zip(&other.cross).for_each(|(a, b)| *a += b);
    }

    pub(super) fn estimate(&self, pixels: f64) -> SquaredError {
        let count = self.gram.len().isqrt();
        let n = count as f64;
        let product = |sums: &[f64], i: usize, j: usize| sums[i * count + j] / pixels;
        // Product of factor `i`, minus the mean of the residuals `a`, with residual `j`, minus the
        // mean of the residuals `b`.
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

    /// The variance of the estimate if noise is normal: `T` from all products of residuals (Bai and
    /// Saranadasa 1996), `C` from those of `mean D - mean B`.
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

/// Stripes of an image whose squared errors are compared where there are two iterations only.
const STRIPES: usize = 16;

impl CrossValidation {
    /// The mean over pixels, with an upper bound of its standard error: the squared errors of
    /// stripes of pixels vary by their noise and by what they show, and none of it is told apart.
    /// Two images without parts do not show how much noise they share across stripes.
    pub(super) fn estimate_from_stripes(&self, weights: &[f64]) -> SquaredError {
        let count = weights.iter().filter(|weight| **weight > 0.0).count().max(1) as f64;
        let width = weights.len().div_ceil(STRIPES).max(1);
        let of_stripe = |(stripe, weights): (usize, &[f64])| {
            let pixels = (stripe * width..).zip(weights).filter(|(_, weight)| **weight > 0.0);
            pixels.map(|(pixel, weight)| weight * self.squared(pixel)).sum::<f64>() / count
        };
        let stripes: Vec<f64> = weights.par_chunks(width).enumerate().map(of_stripe).collect();
        SquaredError {
            squared: stripes.iter().sum(),
            standard_error: stripes.iter().map(|own| own * own).sum::<f64>().sqrt(),
        }
    }

    /// The estimate from the products of `D_-i - B_ij` and `D_-i - B_ik` over pairs of parts, with
    /// the jackknife's standard error over the parts of a fold (Efron and Stein 1981). The errors
    /// of both folds count as equal, not as independent, since the denoised image of each holds the
    /// noise of the other.
    pub(super) fn estimate_from_parts(&self, weights: &[f64]) -> SquaredError {
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
        let squared = squared / n - self.mean_excess_noise(weights);
        SquaredError { squared, standard_error: error / n }
    }
}
