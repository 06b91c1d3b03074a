//! The minimum of noise times time, here and by the published numbers, and its causes.

use super::implied;
use super::published::{BEST_LIGHT_PATHS, CAMERA_PATHS, TIME};
use super::terms::pooled_rms;
use bdpm_auto::adaptive::optimize::NEAR_OPTIMUM;
use bdpm_auto::adaptive::optimize::predict::{Optimum, Predicted, RenderTime, Source};
use bdpm_auto::timing::TimeModel;
use bdpm_core::noise::Coefficients;
use bdpm_core::noise::image::NoiseImage;
use serde::Serialize;

/// The best number of light paths at `N_B = 25`, and the range around it.
#[derive(Clone, Debug, Serialize)]
pub struct Best {
    /// `N_F` with the least pooled RMS; the error is that of the noise alone.
    pub light_paths: Predicted,
    /// The numbers of light paths whose RMS is at most [`NEAR_OPTIMUM`] over the least.
    pub flat: [f64; 2],
    /// `sqrt(t/s)` and `sqrt(p/q)`, whose product is the best number: an iteration of `N_F` light
    /// paths takes the time `t + s N_F` and leaves the variance `q + p/N_F`.
    pub factors: [f64; 2],
}

/// The minima here and in the paper.
#[derive(Clone, Debug, Serialize)]
pub struct Optima {
    /// Measured here.
    pub here: Best,
    /// By the time model for an image of [`Self::pixels`] pixels, in which a light path takes the
    /// share of an iteration that it takes in Table 2.
    pub rescaled: Best,
    /// Pixels of the image of [`Self::rescaled`].
    pub pixels: f64,
    /// By Figure 3a and the times of Table 2.
    pub implied: Best,
    /// Read off Figure 4 by the authors.
    pub published: f64,
    /// The best counts here with `N_B` free.
    pub free: Optimum,
}

impl Best {
    fn new(source: &Source, mean: Coefficients, model: TimeModel) -> Self {
        let n_camera = f64::from(CAMERA_PATHS[0]);
        let render = RenderTime { model, time: TIME };
        let light_paths = source.best_light_paths(n_camera, &render).light_paths;
        let [t, s] = model.in_light_paths(n_camera);
        let (p, q) = (mean.a / n_camera + mean.f, mean.b / n_camera);
        // (t + s x)(q + p/x) = k is a quadratic equation in x; its least k is (sqrt tq + sqrt
        // sp)^2. theory.md (81)
        let least = ((t * q).sqrt() + (s * p).sqrt()).powi(2);
        let half = 0.5 * (least * (1.0 + NEAR_OPTIMUM).powi(2) - t * q - s * p) / (s * q);
        let distance = (half * half - t * p / (s * q)).max(0.0).sqrt();
        Self {
            light_paths,
            flat: [(half - distance).max(1.0), half + distance],
            factors: [(t / s).sqrt(), (p / q).sqrt()],
        }
    }
}

impl Optima {
    /// From the noise of the region and the times here.
    pub fn new(noise: &NoiseImage, region: &[usize], model: TimeModel) -> Self {
        let source = Source::Measured(noise, region);
        let published = implied::coefficients();
        let given = Source::Given(published);
        let mean = noise.mean_coefficients(region).clamped();
        let rescaled = rescaled(model);
        Self {
            here: Best::new(&source, mean, model),
            rescaled: Best::new(&source, mean, rescaled),
            pixels: rescaled.pixels,
            implied: Best::new(&given, published, implied::time_model()),
            published: BEST_LIGHT_PATHS,
            free: source.optimum(&RenderTime { model, time: TIME }),
        }
    }
}

/// The time model for a larger image, in which tracing a light path takes the share of tracing the
/// camera paths that it takes in Table 2. The paper does not give its resolution.
pub fn rescaled(model: TimeModel) -> TimeModel {
    let there = implied::time_model();
    let share = there.light_path / (there.camera_path * there.pixels);
    TimeModel { pixels: (model.light_path / (model.camera_path * share)).max(1.0), ..model }
}

/// Pooled RMS after any time at `n_light` over that at the best number of light paths, `N_B = 25`.
pub fn over_least(
    noise: &NoiseImage,
    region: &[usize],
    model: &TimeModel,
    best: f64,
    n_light: f64,
) -> Predicted {
    let m = f64::from(CAMERA_PATHS[0]);
    let time = (model.iteration(n_light, m) / model.iteration(best, m)).sqrt();
    let source = Source::Measured(noise, region);
    source.statistic(|pixels| time * pooled_rms(pixels, n_light, m) / pooled_rms(pixels, best, m))
}

/// RMS after any time at `n_light` over the least, `N_B = 25`, by the published numbers.
pub fn implied_over_least(n_light: f64) -> f64 {
    let m = f64::from(CAMERA_PATHS[0]);
    let model = implied::time_model();
    let after = |n: f64| implied::rms(n, m) * model.iteration(n, m).sqrt();
    after(n_light) / after(implied::best_light_paths())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_of_the_flat_range_have_the_allowed_rms() {
        let (c, model) = (implied::coefficients(), implied::time_model());
        let best = Best::new(&Source::Given(c), c, model);
        let x = best.light_paths.value;
        assert!((best.factors[0] * best.factors[1] / x - 1.0).abs() < 1e-12);
        for end in best.flat {
            let over = implied_over_least(end);
            assert!((over - 1.0 - NEAR_OPTIMUM).abs() < 1e-9, "{over}");
        }
        assert!(best.flat[0] < x && x < best.flat[1]);
    }
}
