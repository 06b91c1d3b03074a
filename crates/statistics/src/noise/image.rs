//! Measured noise of a whole image: coefficients, sampled variance and bias of each pixel, and
//! statistics of regions with standard errors.

use super::Coefficients;
use super::film::{BATCHES, BatchCounts, BatchGrain, NoiseFilm};
use crate::film::radiance::Film;

/// Means over the measuring iterations, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseImage {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// `N_F` while measuring.
    pub light_paths: u32,
    /// `N_B` while measuring.
    pub camera_paths: u32,
    /// Measuring iterations.
    pub iterations: u64,
    /// Row by row.
    pub pixels: Vec<PixelEstimate>,
    /// Means over the iterations of each batch, row by row.
    pub batches: Vec<[NoiseSample; BATCHES]>,
    /// Numbers of iterations of the batches.
    pub counts: BatchCounts,
}

/// Estimates for one pixel; luminances.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelEstimate {
    /// Mean value, W/(m^2 sr).
    pub luminance: f64,
    /// Coefficients, variance and nested differences.
    pub noise: NoiseSample,
    /// Standard error of the first nested difference.
    pub nested_error: f64,
}

/// Coefficients, the sampled variance of one iteration's value, which does not depend on formula
/// (1), and the differences that the bias is estimated from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NoiseSample {
    /// `a`, `b`, `f`, squared luminance.
    pub coefficients: Coefficients,
    /// Sample variance of the per-iteration values, squared luminance.
    pub sampled: f64,
    /// `L(r) - L(r/sqrt 2)` and `L(r/sqrt 2) - L(r/2)`.
    pub nested: [f64; 2],
}

/// A statistic with its standard error by the jackknife over batches.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Statistic {
    /// The statistic of all iterations.
    pub value: f64,
    /// The statistic without its bias of the order of one over the number of iterations.
    pub corrected: f64,
    /// Standard error of `value` and `corrected`; infinite if there are too few iterations.
    pub error: f64,
}

impl Statistic {
    /// From the statistic of all iterations, and from that without each of the batches.
    // theory.md (66)
    pub fn jackknife(value: f64, left_out: &[f64]) -> Self {
        let k = left_out.len() as f64;
        let mean = left_out.iter().sum::<f64>() / k;
        let squares: f64 = left_out.iter().map(|x| (x - mean).powi(2)).sum();
        Self {
            value,
            corrected: k * value - (k - 1.0) * mean,
            error: (squares * (k - 1.0) / k).sqrt(),
        }
    }
}

impl NoiseSample {
    /// `a`, `b`, `f`, the sampled variance, and the two nested differences.
    #[inline]
    pub(super) fn to_array(self) -> [f64; 6] {
        let Self { coefficients: Coefficients { a, b, f }, sampled, nested: [first, second] } =
            self;
        [a, b, f, sampled, first, second]
    }

    /// Reads the order of [`Self::to_array`].
    #[inline]
    pub(super) fn from_array([a, b, f, sampled, first, second]: [f64; 6]) -> Self {
        let coefficients = Coefficients { a, b, f };
        Self { coefficients, sampled, nested: [first, second] }
    }
}

impl PixelEstimate {
    /// Unbiased estimate of the squared mean luminance, after `iterations` iterations.
    #[inline]
    pub fn luminance2(&self, iterations: u64) -> f64 {
        self.luminance.powi(2) - self.noise.sampled / iterations as f64
    }
}

impl NoiseImage {
    /// Evaluates the sums of `noise`. Needs batches of single pixels and at least two iterations.
    ///
    /// # Panics
    /// If `noise` has neither, or belongs to another film.
    pub fn new(film: &Film, noise: &NoiseFilm, (light_paths, camera_paths): (u32, u32)) -> Self {
        let (width, height) = film.resolution();
        let n = noise.iterations as f64;
        assert!(noise.iterations >= 2, "a variance takes two iterations");
        assert_eq!(noise.grain(), BatchGrain::Pixel);
        let count = width as usize * height as usize;
        let mut pixels = vec![PixelEstimate::default(); count];
        let mut batches = vec![[NoiseSample::default(); BATCHES]; count];
        let mut sums = noise.sums().values().iter().zip(noise.batches());
        for tile in film.sums.tiles() {
            for index in 0..tile.len() as u32 {
                let (x, y) = tile.pixel(index);
                let place = y as usize * width as usize + x as usize;
                let (sums, batch_sums) = sums.next().expect("the noise belongs to the film");
                // theory.md (68)
                let nested = sums.nested.map(|sum| sum / n);
                let scatter = (sums.nested2 / n - nested[0].powi(2)).max(0.0) / (n - 1.0);
                pixels[place] = PixelEstimate {
                    luminance: sums.value / n,
                    noise: NoiseSample {
                        coefficients: sums.coefficients * n.recip(),
                        sampled: sums.deviations2 / (n - 1.0),
                        nested,
                    },
                    nested_error: scatter.sqrt(),
                };
                for (batch, sums) in batch_sums.iter().enumerate() {
                    let [a, b, f] = sums.coefficients.map(f64::from);
                    let [n, parts] = noise.counts().of_batch(batch);
                    batches[place][batch] = NoiseSample {
                        coefficients: Coefficients { a, b, f } * (1.0 / n.max(1.0)),
                        sampled: f64::from(sums.variance) / parts.max(1.0),
                        nested: sums.nested.map(|sum| f64::from(sum) / n.max(1.0)),
                    };
                }
            }
        }
        let (iterations, counts) = (noise.iterations, *noise.counts());
        Self { width, height, light_paths, camera_paths, iterations, pixels, batches, counts }
    }

    /// Indices of the pixels whose center `contains` (column, row, width, height) accepts.
    pub fn select(&self, contains: impl Fn(u32, u32, u32, u32) -> bool) -> Vec<usize> {
        let (width, height) = (self.width, self.height);
        let inside = |i: &usize| {
            let (x, y) = (*i as u32 % width, *i as u32 / width);
            contains(x, y, width, height)
        };
        (0..self.pixels.len()).filter(inside).collect()
    }

    /// A function of coefficients and variances of the pixels `region`, with its standard error.
    ///
    /// The jackknife leaves out one batch of iterations after the other. So the error takes into
    /// account that coefficients are correlated, and pixels too, by their common light paths.
    // theory.md (66)
    pub fn statistic(&self, region: &[usize], of: impl Fn(&[NoiseSample]) -> f64) -> Statistic {
        let all: Vec<_> = region.iter().map(|&i| self.pixels[i].noise).collect();
        let value = of(&all);
        if self.iterations < 2 * BATCHES as u64 {
            return Statistic { value, corrected: value, error: f64::INFINITY };
        }
        let n = self.iterations as f64;
        let mut without = all.clone();
        let left_out: Vec<f64> = (0..BATCHES)
            .map(|batch| {
                let [n_k, parts_k] = self.counts.of_batch(batch);
                for ((rest, all), &pixel) in without.iter_mut().zip(&all).zip(region) {
                    let own = &self.batches[pixel][batch];
                    rest.coefficients =
                        (all.coefficients * n - own.coefficients * n_k) * (n - n_k).recip();
                    rest.sampled =
                        (all.sampled * (n - 1.0) - own.sampled * parts_k) / (n - 1.0 - parts_k);
                }
                of(&without)
            })
            .collect();
        Statistic::jackknife(value, &left_out)
    }

    /// Pooled RMS `sqrt(mean_p V_p)` of one iteration at any counts, by the formula.
    // theory.md (64)
    pub fn pooled_rms(&self, region: &[usize], n_light: f64, n_camera: f64) -> Statistic {
        self.statistic(region, |pixels| {
            root(mean(pixels, |p| p.coefficients.variance(n_light, n_camera)))
        })
    }

    /// The paper's mean RMS `mean_p sqrt(V_p)` of one iteration at any counts, by the formula.
    /// Negative variances count as 0; the mean of roots is low at few iterations.
    // theory.md (65)
    pub fn mean_rms(&self, region: &[usize], n_light: f64, n_camera: f64) -> Statistic {
        self.statistic(region, |pixels| {
            mean(pixels, |p| root(p.coefficients.variance(n_light, n_camera)))
        })
    }

    /// Pooled RMS of one iteration at the measured counts, from the sampled variance.
    pub fn sampled_pooled_rms(&self, region: &[usize]) -> Statistic {
        self.statistic(region, |pixels| root(mean(pixels, |p| p.sampled)))
    }

    /// Mean RMS of one iteration at the measured counts, from the sampled variance.
    pub fn sampled_mean_rms(&self, region: &[usize]) -> Statistic {
        self.statistic(region, |pixels| mean(pixels, |p| root(p.sampled)))
    }

    /// Mean coefficients of a region.
    pub fn mean_coefficients(&self, region: &[usize]) -> Coefficients {
        let sum: Coefficients = region.iter().map(|&i| self.pixels[i].noise.coefficients).sum();
        sum * (1.0 / region.len() as f64)
    }
}

/// The square root; 0 for a negative estimate.
#[inline]
pub fn root(x: f64) -> f64 {
    x.max(0.0).sqrt()
}

/// Mean of `of` over the pixels.
pub fn mean(pixels: &[NoiseSample], of: impl Fn(&NoiseSample) -> f64) -> f64 {
    pixels.iter().map(of).sum::<f64>() / pixels.len() as f64
}
