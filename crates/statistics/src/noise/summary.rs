//! Statistics of the noise over a region, as `bdpm analyze` reports them.

use super::image::{NoiseImage, NoiseSample, Statistic, mean, root};
use super::merge_bias::MergeBias;
use serde::Serialize;

/// Noise of one iteration at the measured counts over a region; luminances, W/(m^2 sr).
#[derive(Clone, Debug, Serialize)]
pub struct NoiseSummary {
    /// Pixels in the region.
    pub pixels: usize,
    /// Region mean of the root of the C, B and F term of (1); negative terms count as 0.
    pub mean_root_terms: [Statistic; 3],
    /// Root of the region mean of each term.
    pub pooled_terms: [Statistic; 3],
    /// Pixels in which each term is negative.
    pub negative_terms: [usize; 3],
    /// The paper's mean RMS by formula (1), and of the sampled variance.
    pub mean_rms: Compared,
    /// Pooled RMS by formula (1), and of the sampled variance.
    pub pooled_rms: Compared,
    /// Pixels in which the variance by formula is negative.
    pub negative_variances: usize,
    /// Merge bias.
    pub bias: MergeBias,
    /// Iterations until two standard errors of the pooled RMS by formula are 5 % and 1 % of it;
    /// `None` where the error is not known.
    pub iterations_for: IterationsFor,
}

/// A quantity by formula (1) and from the sampled variance.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Compared {
    /// The quantity by formula.
    pub predicted: Statistic,
    /// Sampled.
    pub sampled: Statistic,
    /// Predicted over sampled. Both fluctuate together, so that the error of the ratio is smaller
    /// than either's.
    pub ratio: Statistic,
}

/// Iterations that an accuracy takes.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct IterationsFor {
    /// Iterations for 5 %.
    pub five_percent: Option<f64>,
    /// Iterations for 1 %.
    pub one_percent: Option<f64>,
}

impl Compared {
    fn new(
        noise: &NoiseImage,
        region: &[usize],
        predicted: impl Fn(&[NoiseSample]) -> f64,
        sampled: impl Fn(&[NoiseSample]) -> f64,
    ) -> Self {
        Self {
            predicted: noise.statistic(region, &predicted),
            sampled: noise.statistic(region, &sampled),
            ratio: noise.statistic(region, |pixels| predicted(pixels) / sampled(pixels)),
        }
    }
}

impl NoiseSummary {
    /// Statistics of the pixels `region` at the measured counts.
    pub fn new(noise: &NoiseImage, region: &[usize]) -> Self {
        let (n, m) = (f64::from(noise.light_paths), f64::from(noise.camera_paths));
        let term = |k: usize| move |p: &NoiseSample| p.coefficients.paper_terms(n, m)[k];
        let variance = |p: &NoiseSample| p.coefficients.variance(n, m);
        let negative = |of: &dyn Fn(&NoiseSample) -> f64| {
            region.iter().filter(|&&i| of(&noise.pixels[i].noise) < 0.0).count()
        };
        let pooled_rms = Compared::new(
            noise,
            region,
            |pixels| root(mean(pixels, variance)),
            |pixels| root(mean(pixels, |p| p.sampled)),
        );
        let mean_rms = Compared::new(
            noise,
            region,
            |pixels| mean(pixels, |p| root(variance(p))),
            |pixels| mean(pixels, |p| root(p.sampled)),
        );
        // Two standard errors, which fall as the root of the number of iterations.
        let Statistic { value, error, .. } = pooled_rms.predicted;
        let iterations_for = |accuracy: f64| {
            // theory.md (67)
            let needed = noise.iterations as f64 * (2.0 * error / (value * accuracy)).powi(2);
            needed.is_finite().then(|| needed.ceil())
        };
        Self {
            pixels: region.len(),
            mean_root_terms: [0, 1, 2]
                .map(|k| noise.statistic(region, |pixels| mean(pixels, |p| root(term(k)(p))))),
            pooled_terms: [0, 1, 2]
                .map(|k| noise.statistic(region, |pixels| root(mean(pixels, term(k))))),
            negative_terms: [0, 1, 2].map(|k| negative(&term(k))),
            mean_rms,
            pooled_rms,
            negative_variances: negative(&variance),
            bias: MergeBias::new(noise, region),
            iterations_for: IterationsFor {
                five_percent: iterations_for(0.05),
                one_percent: iterations_for(0.01),
            },
        }
    }
}
