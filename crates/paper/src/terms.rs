//! Figures 2 and 3: the three terms of (1) over the region, and their sum beside the sampled noise.

use super::folder::Measured;
use bdpm_auto::adaptive::optimize::predict::Predicted;
use bdpm_core::noise::image::{NoiseImage, NoiseSample, Statistic, mean, root};
use serde::Serialize;

/// Noise of one iteration over the region; luminances, W/(m^2 sr). Means of roots are corrected for
/// their bias of the order of one over the number of iterations.
#[derive(Clone, Debug, Serialize)]
pub struct Terms {
    /// `N_F`.
    pub light_paths: u32,
    /// `N_B`.
    pub camera_paths: u32,
    /// Iterations that were measured.
    pub iterations: u64,
    /// Region means of the roots of the C, B and F term.
    pub roots: [Predicted; 3],
    /// Pixels of the region in which each term is negative; their roots count as 0.
    pub negative: [usize; 3],
    /// Region means of the roots over the mean RMS.
    pub shares: [Predicted; 3],
    /// Mean RMS by formula (1).
    pub formula: Predicted,
    /// Mean RMS sampled.
    pub sampled: Predicted,
    /// Formula over sampled. The error takes into account that both fluctuate together.
    pub ratio: Predicted,
}

/// A statistic corrected for its bias of the order of one over the number of iterations.
pub fn corrected(statistic: Statistic) -> Predicted {
    Predicted { value: statistic.corrected, ..statistic.into() }
}

/// The quotient of independent values.
pub fn quotient(a: Predicted, b: Predicted) -> Predicted {
    let value = a.value / b.value;
    let relative = |x: Predicted| x.error.map(|error| error / x.value);
    let error = relative(a).zip(relative(b)).map(|(a, b)| value.abs() * a.hypot(b));
    Predicted { value, error }
}

/// Mean RMS of one iteration at any counts by the formula.
pub fn mean_rms(pixels: &[NoiseSample], n_light: f64, n_camera: f64) -> f64 {
    mean(pixels, |p| root(p.coefficients.variance(n_light, n_camera)))
}

/// Pooled RMS of one iteration at any counts by the formula.
pub fn pooled_rms(pixels: &[NoiseSample], n_light: f64, n_camera: f64) -> f64 {
    root(mean(pixels, |p| p.coefficients.variance(n_light, n_camera)))
}

/// Region mean of the root of term `k` at any counts.
fn mean_root(pixels: &[NoiseSample], k: usize, n_light: f64, n_camera: f64) -> f64 {
    mean(pixels, |p| root(p.coefficients.paper_terms(n_light, n_camera)[k]))
}

/// Region mean of the root of term `k` over the mean RMS, at any counts.
pub fn share(
    noise: &NoiseImage,
    region: &[usize],
    k: usize,
    [n_light, n_camera]: [f64; 2],
) -> Predicted {
    corrected(noise.statistic(region, |pixels| {
        mean_root(pixels, k, n_light, n_camera) / mean_rms(pixels, n_light, n_camera)
    }))
}

impl Terms {
    /// The terms at the measured counts.
    pub fn new(noise: &NoiseImage, region: &[usize]) -> Self {
        let (n, m) = (f64::from(noise.light_paths), f64::from(noise.camera_paths));
        let sampled = |pixels: &[NoiseSample]| mean(pixels, |p| root(p.sampled));
        let of = |statistic: &dyn Fn(&[NoiseSample]) -> f64| {
            corrected(noise.statistic(region, statistic))
        };
        let negative = |k: usize| {
            let term = |&&i: &&usize| noise.pixels[i].noise.coefficients.paper_terms(n, m)[k] < 0.0;
            region.iter().filter(term).count()
        };
        Self {
            light_paths: noise.light_paths,
            camera_paths: noise.camera_paths,
            iterations: noise.iterations,
            roots: [0, 1, 2].map(|k| of(&|pixels| mean_root(pixels, k, n, m))),
            negative: [0, 1, 2].map(negative),
            shares: [0, 1, 2].map(|k| share(noise, region, k, [n, m])),
            formula: of(&|pixels| mean_rms(pixels, n, m)),
            sampled: of(&sampled),
            ratio: of(&|pixels| mean_rms(pixels, n, m) / sampled(pixels)),
        }
    }
}

impl Measured {
    /// Pooled RMS of one iteration, sampled.
    pub fn rms(&self) -> Predicted {
        corrected(self.pooled_rms)
    }
}
