//! The error by leaving parts out.

use super::{BOX_RADIUS, Guides, InParts, Mix};
use crate::base::error::Result;
use crate::base::math::{Rgb, luminance};
use rayon::prelude::*;

/// Luminances, W/(m^2 sr), for each part `i` of `n`: row by row.
#[derive(Clone, Debug)]
pub struct Folds {
    /// `B_i`, the part.
    pub(super) part: Vec<Vec<f32>>,
    /// `R_-i`, the mean of the others.
    pub(super) raw: Vec<Vec<f32>>,
    /// `D_-i`, denoised from the others.
    pub(super) denoised: Vec<Vec<f32>>,
}

/// A squared error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Weighted mean over pixels; may come out negative.
    pub squared: f64,
    /// Its standard error: also where noise is shared by pixels.
    pub standard_error: f64,
}

impl Folds {
    /// Denoises the others of each part.
    ///
    /// # Errors
    /// Those of the denoiser.
    pub fn new(
        parts: &InParts,
        mut denoiser: impl FnMut(&[Rgb], &Guides) -> Result<Vec<Rgb>>,
    ) -> Result<Self> {
        let luminances = |image: &[Rgb]| image.iter().map(|value| luminance(*value)).collect();
        let mut folds = Self { part: Vec::new(), raw: Vec::new(), denoised: Vec::new() };
        for part in 0..parts.len() {
            let (others, guides) = parts.without(part);
            folds.part.push(parts.luminance_of(part));
            folds.raw.push(luminances(&others));
            folds.denoised.push(luminances(&denoiser(&others, &guides)?));
        }
        Ok(folds)
    }

    /// How many parts.
    pub fn len(&self) -> usize {
        self.part.len()
    }

    /// Never.
    pub fn is_empty(&self) -> bool {
        self.part.is_empty()
    }

    /// Luminance of what is denoised from the others of each part, row by row.
    pub fn images(&self) -> &[Vec<f32>] {
        &self.denoised
    }

    /// The same for mixed images, each with weights that its part was not asked for.
    pub fn mixed(&self, mix: &Mix) -> Self {
        let fold = |((denoised, raw), shares): ((&Vec<f32>, &Vec<f32>), &Vec<f32>)| {
            let pixels = denoised.iter().zip(raw).zip(shares);
            pixels.map(|((d, r), share)| d + share * (r - d)).collect()
        };
        let pairs = self.denoised.par_iter().zip(&self.raw).zip(&mix.of_folds);
        Self { denoised: pairs.map(fold).collect(), ..self.clone() }
    }

    /// Of a pixel `mean_i (D_-i - B_i)^2 - s^2`: an unbiased estimate of the squared error of an image made of
    /// `(n-1)/n` of the samples.
    pub fn squared(&self, pixel: usize) -> f64 {
        let n = self.len() as f64;
        let part = |i: usize| f64::from(self.part[i][pixel]);
        let mean = (0..self.len()).map(part).sum::<f64>() / n;
        let spread: f64 = (0..self.len()).map(|i| (part(i) - mean).powi(2)).sum();
        let distance: f64 =
            (0..self.len()).map(|i| (f64::from(self.denoised[i][pixel]) - part(i)).powi(2)).sum();
        distance / n - spread / (n - 1.0)
    }

    /// The weighted mean of [`Self::squared`] over all pixels: weights are 0 for those that do not count.
    ///
    /// With `B_i = L + e_i`, the estimate is `mean_i [(D_-i - L)^2 - 2 (D_-i - L) e_i] + mean_{i != j} e_i e_j`. The
    /// variance of the last term is `2 T/(n(n-1))`, with `T` the mean square of `e_i e_j`; that of the middle one `4 C/n`, with `C`
    /// that of `(D_-i - L) e_i`, products being sums over the pixels. `L` is not known: means of other parts stand for it, of
    /// parts of their own for each factor, so that both factors are independent and rare bright noise does not
    /// meet itself. What is rarer than the parts show then counts too little, and if the noise were normal too
    /// much: the standard error is the geometric mean of both. With `m` parts in each mean, `T` is the mean square over `(1 + 1/m)^2`, and `C` that over
    /// `1 + 1/m`, less `T/m`. docs/denoising.md
    pub fn estimate(&self, weights: &[f64]) -> Estimate {
        let n = self.len();
        // The same chunks on any number of threads.
        let chunk = |(chunk, weights): (usize, &[f64])| {
            let mut sums = Sums::new(n);
            for (pixel, &weight) in (chunk * CHUNK..).zip(weights).filter(|(_, w)| **w > 0.0) {
                sums.add(self, pixel, weight);
            }
            sums
        };
        let sums: Vec<Sums> = weights.par_chunks(CHUNK).enumerate().map(chunk).collect();
        let count = weights.iter().filter(|weight| **weight > 0.0).count().max(1);
        let mut all = Sums::new(n);
        sums.iter().for_each(|sums| all.append(sums));
        all.estimate(count as f64)
    }

    /// The same of the raw image of as many samples: its variance alone.
    pub fn raw(&self, weights: &[f64]) -> f64 {
        let n = self.len() as f64;
        let variance = |pixel: usize| {
            let part = |i: usize| f64::from(self.part[i][pixel]);
            let mean = (0..self.len()).map(part).sum::<f64>() / n;
            (0..self.len()).map(|i| (part(i) - mean).powi(2)).sum::<f64>() / (n - 1.0)
        };
        let sum: f64 = (0..weights.len()).map(|pixel| weights[pixel] * variance(pixel)).sum();
        sum / weights.len() as f64 / (n - 1.0)
    }

    /// RMS errors pooled over squares of `2 BOX_RADIUS + 1` pixels.
    pub fn map(&self, (width, height): (u32, u32)) -> Vec<f32> {
        let squared: Vec<f64> =
            (0..self.part[0].len()).into_par_iter().map(|pixel| self.squared(pixel)).collect();
        let pooled = boxes(&squared, (width as usize, height as usize), BOX_RADIUS as usize);
        pooled.iter().map(|squared| squared.max(0.0).sqrt() as f32).collect()
    }
}

/// Pixels that a thread takes at once.
const CHUNK: usize = 4096;

/// Weighted sums over pixels, `n` by `n`.
struct Sums {
    squared: f64,
    /// Products of the parts' residuals `r_i = B_i - mean B`.
    gram: Vec<f64>,
    /// Products of `D_-i - mean B` with `r_j`.
    cross: Vec<f64>,
}

impl Sums {
    fn new(n: usize) -> Self {
        Self { squared: 0.0, gram: vec![0.0; n * n], cross: vec![0.0; n * n] }
    }

    fn add(&mut self, folds: &Folds, pixel: usize, weight: f64) {
        let n = folds.len();
        let [mut residual, mut off] = [[0.0; crate::film::folds::DENOISE_FOLDS]; 2];
        let part = |i: usize| f64::from(folds.part[i][pixel]);
        let mean = (0..n).map(part).sum::<f64>() / n as f64;
        for i in 0..n {
            residual[i] = part(i) - mean;
            off[i] = weight * (f64::from(folds.denoised[i][pixel]) - mean);
        }
        self.squared += weight * folds.squared(pixel);
        for i in 0..n {
            for j in 0..n {
                self.gram[i * n + j] += weight * residual[i] * residual[j];
                self.cross[i * n + j] += off[i] * residual[j];
            }
        }
    }

    fn append(&mut self, other: &Self) {
        self.squared += other.squared;
        self.gram.iter_mut().zip(&other.gram).for_each(|(a, b)| *a += b);
        self.cross.iter_mut().zip(&other.cross).for_each(|(a, b)| *a += b);
    }

    fn estimate(&self, pixels: f64) -> Estimate {
        let count = self.gram.len().isqrt();
        let n = count as f64;
        let product = |sums: &[f64], i: usize, j: usize| sums[i * count + j] / pixels;
        // Of factor `i`, less the mean of the residuals `a`, with residual `j` less the mean of the residuals `b`.
        let centered = |first: &[f64], (i, a): (usize, &[usize]), (j, b): (usize, &[usize])| {
            let mean = |of: &dyn Fn(usize) -> f64, parts: &[usize]| {
                parts.iter().map(|&part| of(part)).sum::<f64>() / parts.len() as f64
            };
            product(first, i, j)
                - mean(&|b| product(first, i, b), b)
                - mean(&|a| product(&self.gram, a, j) - mean(&|b| product(&self.gram, a, b), b), a)
        };
        let (mut t, mut middle) = (0.0, Vec::new());
        for i in 0..count {
            for j in (0..count).filter(|&j| j != i) {
                let [a, b] = halves(count, |part| part != i && part != j);
                t += centered(&self.gram, (i, &a), (j, &b)).powi(2) / (n * (n - 1.0));
            }
            let [a, b] = halves(count, |part| part != i);
            let both = [(&a, &b), (&b, &a)];
            let product = |(a, b): (&Vec<_>, &Vec<_>)| centered(&self.cross, (i, a), (i, b));
            middle.push(both.map(product).iter().sum::<f64>() / 2.0);
        }
        // Less their mean: what is denoised holds noise of the parts in `b`.
        let mean = middle.iter().sum::<f64>() / n;
        let mut c = middle.iter().map(|w| (w - mean).powi(2)).sum::<f64>() / (n - 1.0);
        // Parts in a mean.
        let m = ((count - 2) / 2) as f64;
        t /= (1.0 + 1.0 / m).powi(2);
        c = (c / (1.0 + 1.0 / m) - t / m).max(0.0);
        let variance = 2.0 * t / (n * (n - 1.0)) + 4.0 * c / n;
        let both = (variance * self.variance_if_normal(pixels)).sqrt();
        Estimate { squared: self.squared / pixels, standard_error: both.sqrt() }
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
        let off = |j: usize| (0..count).map(|i| self.cross[i * count + j]).sum::<f64>() / n;
        let cross2: f64 = (0..count).map(|j| (off(j) / pixels).powi(2)).sum();
        let c = (cross2 / (n - 1.0) - t / n).max(0.0);
        2.0 * t / (n * (n - 1.0)) + 4.0 * c / n
    }
}

/// Parts that are `wanted`, in two equal halves in turn; an odd one out is left over.
fn halves(count: usize, wanted: impl Fn(usize) -> bool) -> [Vec<usize>; 2] {
    let all: Vec<usize> = (0..count).filter(|&part| wanted(part)).collect();
    let half = all.len() / 2;
    let of = |first: usize| all.iter().copied().skip(first).step_by(2).take(half).collect();
    [of(0), of(1)]
}

/// Means over the pixels at most `radius` away along either side.
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

    /// Parts of images with noise of each pixel's own and noise that wide waves share, and a blur for a denoiser.
    pub fn folds(truth: &[f64], (own, shared): (f64, f64), rng: &mut Rng) -> Folds {
        let part = |rng: &mut Rng| -> Vec<f64> {
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
        let parts: Vec<Vec<f64>> = (0..N).map(|_| part(rng)).collect();
        let without = |i: usize| -> Vec<f64> {
            let sum =
                |pixel: usize| (0..N).filter(|j| *j != i).map(|j| parts[j][pixel]).sum::<f64>();
            (0..truth.len()).map(|pixel| sum(pixel) / (N - 1) as f64).collect()
        };
        let single = |values: Vec<f64>| values.into_iter().map(|value| value as f32).collect();
        Folds {
            raw: (0..N).map(|i| single(without(i))).collect(),
            denoised: (0..N).map(|i| single(boxes(&without(i), (SIDE, SIDE), 2))).collect(),
            part: parts.into_iter().map(single).collect(),
        }
    }

    /// Mean over parts of the weighted squared error of what is denoised.
    pub fn error(images: &[Vec<f32>], truth: &[f64], weights: &[f64]) -> f64 {
        let of = |image: &Vec<f32>| -> f64 {
            let pixels = image.iter().zip(truth).zip(weights);
            pixels.map(|((d, l), w)| w * (f64::from(*d) - l).powi(2)).sum::<f64>()
        };
        let count = weights.iter().filter(|weight| **weight > 0.0).count();
        images.iter().map(of).sum::<f64>() / (images.len() * count) as f64
    }

    #[test]
    fn errors_are_told_without_a_reference_and_so_is_their_uncertainty() {
        let truth = truth(0.4);
        let mut weights: Vec<f64> = truth.iter().map(|l| 1.0 / (l * l + 0.04)).collect();
        // Own noise, noise that pixels share, both; last a block of 16 by 16 pixels alone.
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
            let (mut told, mut came, mut z, mut z2) = (0.0, 0.0, 0.0, 0.0);
            for _ in 0..trials {
                let folds = folds(&truth, noise, &mut rng);
                let estimate = folds.estimate(&weights);
                let error = error(&folds.denoised, &truth, &weights);
                told += estimate.squared;
                came += error;
                let off = (estimate.squared - error) / estimate.standard_error;
                (z, z2) = (z + off, z2 + off * off);
            }
            let trials = f64::from(trials);
            // Means of z have the standard error 1/sqrt(trials); squares are a little less than 1, since no part of
            // the variance is taken to be negative.
            assert!(
                (z / trials).abs() < 4.0 / trials.sqrt(),
                "{case}: {told} {came} {}",
                z / trials
            );
            assert!((0.55..1.4).contains(&(z2 / trials)), "{case}: {}", z2 / trials);
        }
    }

    #[test]
    fn rare_bright_noise_does_not_pass_for_uncertainty() {
        // Spikes in one pixel of a thousand, a hundred times as bright, in parts of their own.
        let truth = truth(0.0);
        let weights = vec![1.0; truth.len()];
        let mut rng = StreamKey::new(8, Stream::Test, 0).rng(0);
        let (trials, mut z2, mut ratio) = (60, 0.0, 0.0);
        for _ in 0..trials {
            let part = |rng: &mut Rng| -> Vec<f64> {
                let spike = |rng: &mut Rng| if rng.next_1d() < 1e-3 { 100.0 } else { 0.9 };
                truth.iter().map(|l| l * spike(rng) / (0.1 + 0.9 * 0.999)).collect()
            };
            let parts: Vec<Vec<f64>> = (0..N).map(|_| part(&mut rng)).collect();
            let without = |i: usize| -> Vec<f64> {
                let others =
                    |p: usize| (0..N).filter(|j| *j != i).map(|j| parts[j][p]).sum::<f64>();
                (0..truth.len()).map(|p| others(p) / (N - 1) as f64).collect()
            };
            let single = |values: Vec<f64>| values.into_iter().map(|value| value as f32).collect();
            let folds = Folds {
                raw: (0..N).map(|i| single(without(i))).collect(),
                denoised: (0..N).map(|i| single(boxes(&without(i), (SIDE, SIDE), 4))).collect(),
                part: parts.iter().cloned().map(single).collect(),
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
    fn boxes_are_means_also_at_the_border() {
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
