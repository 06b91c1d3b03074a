//! Noise and bias of an image while it is rendered, and forecasts of its error and time.

use super::{MIN_ITERATIONS_TO_TARGET, Stop, Target};
use crate::adaptive::error_interval::{ErrorInterval, SquaredPart};
use crate::adaptive::optimize::Objective;
use bdpm_core::film::radiance::total;
use bdpm_core::film::windows::sum_of_squared_sums;
use bdpm_core::noise::Coefficients;
use bdpm_core::noise::merge_bias::UPPER_BOUND;
use bdpm_core::render::block::{self, Block, CombinedImage};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Standard deviation of the true squared bias around that of the pilot, relative to the latter:
/// where light is rare, the pilot sees little of the bias.
pub const PILOT_SPREAD: f64 = 4.0;

/// Standard errors of the squared bias of an image beyond which it says that the pilot is wrong.
/// They come from two halves and few pixels hold most of them: with a single one, `daylight` was
/// reported 40 % too high where the image had 3.1 of them by chance.
const CERTAIN_APART: f64 = 4.0;

/// Noise and bias of an image; luminances, W/(m^2 sr).
#[derive(Clone, Debug)]
pub struct Convergence {
    /// Weight of an iteration of each block.
    pub weights: Vec<f64>,
    /// Variance of the image over that of independent iterations.
    pub set_factor: f64,
    /// Iterations of all blocks.
    pub iterations: u64,
    /// Mean luminance of the image.
    pub mean_luminance: f64,
    /// Pooled variance of the image and its standard error, once they are known.
    pub variance: Option<(f64, f64)>,
    /// Mean over pixels of their variance times their importance, once it is known: pooled or
    /// relative.
    pub weighted_variance: Option<f64>,
    /// Squared relative bias that remains after bias correction and its standard error, once it is
    /// measured.
    pub bias2: Option<SquaredPart>,
    /// Standard deviation of the weighted squared noise of this image around its variance, relative
    /// to the variance; 0 if it is not known.
    pub noise_spread: f64,
    /// Weighted variance of one iteration at the present path counts, once it is known.
    pub per_iteration: Option<f64>,
}

/// Standard deviation of the weighted mean of values with expectation 0, whose neighbors are
/// correlated.
fn weighted_deviation(values: &[f64], importance: &[f64], size: (u32, u32)) -> f64 {
    let weighted: Vec<f64> = values.par_iter().zip(importance).map(|(v, w)| v * w).collect();
    sum_of_squared_sums(&weighted, size).sqrt() / values.len() as f64
}

/// Standard deviation of the weighted squared noise of an image around its variance, relative to
/// the variance; 0 if it is not known.
fn noise_spread(
    combined: &CombinedImage,
    importance: &[f64],
    mean_of: impl Fn(&[f64]) -> f64,
) -> f64 {
    let (Some(correction), Some(variance)) =
        (combined.bias_correction(), combined.uncorrected_cell_variance())
    else {
        return 0.0;
    };
    let squares = correction.squared_noise.par_iter().zip(&variance);
    let deviations: Vec<f64> = squares.map(|(square, variance)| square - variance).collect();
    weighted_deviation(&deviations, importance, combined.grid().size()) / mean_of(&variance)
}

/// Variance of each cell of an image of one iteration, by what that iteration has measured; `None`
/// for other images. Its pairs of paths tell the variance before a second iteration does. theory.md
/// (2)
pub(super) fn by_law(blocks: &[Block]) -> Option<Vec<f64>> {
    let [Block { film, counts, .. }] = blocks else { return None };
    if film.iterations != 1 {
        return None;
    }
    let of_cell = |own: &Coefficients| {
        own.variance(f64::from(counts.light_paths), counts.camera_paths.mean())
    };
    Some(block::coefficients(blocks)?.par_iter().map(of_cell).collect())
}

/// Standard deviation of a variance by the law from one iteration, relative to it: rare light is
/// missing.
const BY_LAW: f64 = 0.5;

/// Forecast of the end of a render.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Forecast {
    /// Pooled RMS at the end, W/(m^2 sr).
    pub rms: f64,
    /// Share of the present weighted variance that remains at the end.
    pub left: f64,
    /// Rendering time from now to the end, seconds.
    pub seconds: f64,
}

impl Convergence {
    /// Convergence of an image with these weights of its blocks and importance of its cells.
    pub fn new(blocks: &[Block], weights: Vec<f64>, importance: &[f64]) -> Self {
        Self::of(CombinedImage::new(blocks, weights), importance)
    }

    /// Convergence of an image with this importance of its cells.
    pub fn of(combined: CombinedImage, importance: &[f64]) -> Self {
        let blocks = combined.blocks();
        let mean_of = |variance: &[f64]| {
            let weighted = variance.par_iter().zip(importance).map(|(v, weight)| v * weight);
            total(&weighted.collect::<Vec<f64>>(), |term| *term) / importance.len() as f64
        };
        let (set_factor, film) = (combined.set_factor(), blocks.last().map(|block| &block.film));
        let block_variance =
            film.and_then(|film| Some((film.cell_variance()?, film.iterations as f64)));
        let image_variance = match blocks {
            [_] if combined.bias_correction().is_none() && set_factor == 1.0 => {
                block_variance.as_ref().map(|(variance, _)| variance.clone())
            }
            _ => combined.cell_variance(),
        };
        let size = combined.grid().size();
        let bias2 = combined.bias_correction().map(|correction| SquaredPart {
            value: mean_of(&correction.bias2),
            deviation: weighted_deviation(&correction.bias2_difference, importance, size),
        });
        let noise_spread = noise_spread(&combined, importance, mean_of);
        let uncorrected = combined.uncorrected_cell_variance().as_deref().map(mean_of);
        // The change by the correction is an estimate, too. If it exceeds the variance, it is not
        // used.
        let weighted_variance = image_variance.as_deref().map(mean_of);
        let weighted_variance = weighted_variance
            .filter(|variance| *variance > 0.0)
            .or(uncorrected)
            .or_else(|| by_law(blocks).map(|variance| mean_of(&variance)))
            .filter(|variance| *variance >= 0.0);
        // Bias correction scales the variance of the image. Scale that of one iteration by the same
        // factor.
        let noise_factor = match (weighted_variance, uncorrected) {
            (Some(corrected), Some(uncorrected))
                if uncorrected > 0.0 && combined.bias_correction().is_some() =>
            {
                corrected / uncorrected
            }
            // Iterations to come take the next points of the sets.
            _ => set_factor,
        };
        Self {
            set_factor,
            iterations: combined.iterations(),
            mean_luminance: combined.mean_luminance(),
            variance: combined.pooled_variance(),
            weighted_variance,
            bias2,
            noise_spread,
            per_iteration: block_variance
                .map(|(variance, iterations)| noise_factor * mean_of(&variance) * iterations),
            weights: combined.into_weights(),
        }
    }

    /// The squared bias by the image and by the pilot, or the difference that an audit found if it
    /// is larger.
    pub fn squared_bias(&self, stop: &Stop) -> SquaredPart {
        let known = self.known_bias(stop);
        stop.difference.filter(|difference| difference.value > known.value).unwrap_or(known)
    }

    /// The squared bias by the image and by the pilot. The image measures it better and better:
    /// theory.md (93d).
    fn known_bias(&self, stop: &Stop) -> SquaredPart {
        let prior = PILOT_SPREAD * stop.pilot_bias2;
        let Some(SquaredPart { value, deviation }) = self.bias2 else {
            return SquaredPart { value: stop.without_difference().bias2, deviation: prior };
        };
        // The pilot is as wrong as both are apart, beyond the certain error of the image.
        let certain = CERTAIN_APART * deviation;
        let apart2 = ((value - stop.pilot_bias2).powi(2) - certain.powi(2)).max(0.0);
        let prior2 = prior.powi(2).max(apart2);
        let certainty = if prior > 0.0 { prior2 / (prior2 + deviation.powi(2)) } else { 1.0 };
        let value = (certainty * value + (1.0 - certainty) * stop.pilot_bias2).max(0.0);
        SquaredPart { value, deviation: certainty.sqrt() * deviation }
    }

    /// The stop conditions with the bias that was measured in the image, if there is one.
    pub fn with_measured_bias(&self, stop: &Stop) -> Stop {
        Stop { bias2: self.squared_bias(stop).value, ..*stop }
    }

    /// Returns true if the image has reached the target of its noise or error.
    pub fn is_good_enough(&self, stop: &Stop) -> bool {
        stop.target.is_some_and(|target| self.reaches(target))
            || stop
                .error
                .is_some_and(|error| self.is_at_most(self.weighted_variance, stop.noise2(error)))
    }

    /// Returns true if the upper 90 % bound of a variance of the image is at most `allowed`. Its
    /// relative standard error is that of the pooled variance, whose error is larger since few
    /// pixels dominate it.
    fn is_at_most(&self, variance: Option<f64>, allowed: f64) -> bool {
        let bound = |(own, (pooled, error)): (f64, (f64, f64))| {
            // Without noise, 0/0.
            own + UPPER_BOUND * if own > 0.0 { own * error / pooled } else { error }
        };
        // theory.md (91)
        self.iterations >= MIN_ITERATIONS_TO_TARGET
            && variance.zip(self.variance).is_some_and(|own| bound(own) <= allowed)
    }

    /// Relative error, noise and bias, when the share `left` of the variance remains; `None` for
    /// other objectives.
    pub fn error(&self, stop: &Stop, left: f64) -> Option<f64> {
        let noise2 = self.weighted_variance.filter(|_| stop.objective == Objective::Relative)?;
        Some((noise2 * left + stop.bias2).sqrt())
    }

    /// Interval for [`Self::error`]; `None` while the error of the noise is not known.
    pub fn error_interval(&self, stop: &Stop, left: f64) -> Option<ErrorInterval> {
        let noise2 = self.weighted_variance.filter(|_| stop.objective == Objective::Relative)?;
        let estimate = match self.variance {
            Some((variance, error)) if variance > 0.0 => error / variance,
            Some(_) => 0.0,
            None => BY_LAW,
        };
        let relative = self.noise_spread.hypot(estimate);
        let value = noise2 * left;
        let noise = SquaredPart { value, deviation: value * relative };
        let bias = self.squared_bias(stop);
        let interval = ErrorInterval::new(noise, bias, left < 1.0);
        // What differs between the pixels of a cell counts as noise of their paths.
        let is_bound = self.variance.is_none();
        let interval = if is_bound { ErrorInterval { low: 0.0, ..interval } } else { interval };
        relative.is_finite().then_some(interval)
    }

    /// The weighted variance relative to the squared luminance of each pixel, or of the mean.
    pub fn relative_variance(&self, objective: Objective) -> Option<f64> {
        let scale = match objective {
            Objective::Relative => 1.0,
            _ => self.mean_luminance.powi(2).recip(),
        };
        self.weighted_variance.map(|variance| variance * scale).filter(|share| share.is_finite())
    }

    /// Pooled RMS, W/(m^2 sr).
    pub fn rms(&self) -> Option<f64> {
        self.variance.map(|(variance, _)| variance.sqrt())
    }

    /// Returns true if the upper 90 % bound of the pooled RMS is at most the target.
    pub fn reaches(&self, target: Target) -> bool {
        let pooled = self.variance.map(|(variance, _)| variance);
        self.is_at_most(pooled, target.absolute(self.mean_luminance).powi(2))
    }

    /// Forecast after `elapsed` seconds of rendering if each further iteration takes `tau` seconds
    /// and has the weighted variance `variance`; `None` before the noise is known.
    ///
    /// Information, the reciprocal of the variance, adds up over iterations.
    pub fn forecast(&self, stop: &Stop, variance: f64, tau: f64, elapsed: f64) -> Option<Forecast> {
        let ((pooled, error), now) = (self.variance?, self.weighted_variance?);
        if !(now > 0.0 && variance > 0.0 && tau > 0.0) {
            return Some(Forecast { rms: pooled.sqrt(), left: 1.0, seconds: 0.0 });
        }
        let by_count = stop.iterations.map(|n| n.saturating_sub(self.iterations) as f64);
        let by_time = stop.time.map(|time| ((time.as_secs_f64() - elapsed) / tau).max(0.0));
        let by_target = [
            stop.target.map(|target| target.absolute(self.mean_luminance).powi(2) * now / pooled),
            stop.error.map(|error| stop.noise2(error)),
        ];
        let by_target = by_target.map(|allowed| {
            let allowed = allowed?;
            // The upper bound must decrease to the target. Its relative distance from the estimate
            // decreases with the root of the number of iterations.
            let distance = UPPER_BOUND * if error.is_finite() { error / pooled } else { 0.0 };
            let iterations = self.iterations as f64;
            // theory.md (90)
            let needed = |margin: f64| ((margin / allowed - 1.0 / now) * variance).max(0.0);
            let first = needed(1.0);
            let more = needed(1.0 + distance * (iterations / (iterations + first)).sqrt());
            Some(more.max(MIN_ITERATIONS_TO_TARGET as f64 - iterations).max(0.0))
        });
        let ends = [by_count, by_time].into_iter().chain(by_target);
        let more = ends.flatten().fold(f64::NAN, f64::min);
        // theory.md (89)
        let left = (1.0 + more * now / variance).recip();
        Some(Forecast { rms: (pooled * left).sqrt(), left, seconds: more * tau })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_scene::TestScene;
    use bdpm_core::noise::Measure;
    use bdpm_core::settings::Settings;
    use std::time::Duration;

    fn convergence(iterations: u64, variance: f64, error: f64) -> Convergence {
        Convergence {
            set_factor: 1.0,
            weights: vec![1.0],
            iterations,
            mean_luminance: 2.0,
            variance: Some((variance, error)),
            weighted_variance: Some(variance),
            bias2: None,
            noise_spread: 0.0,
            per_iteration: Some(variance * iterations as f64),
        }
    }

    #[test]
    fn target_needs_32_iterations_and_a_small_standard_error() {
        let target = Target::Share(0.05); // variance 0.01
        assert!(convergence(32, 0.009, 0.0005).reaches(target));
        assert!(!convergence(31, 0.009, 0.0005).reaches(target));
        assert!(!convergence(32, 0.009, 0.001).reaches(target));
        assert!(!convergence(32, 0.009, f64::INFINITY).reaches(target));
        let unknown =
            Convergence { variance: None, weighted_variance: None, ..convergence(32, 0.0, 0.0) };
        assert!(!unknown.reaches(target));
    }

    /// The variance of one iteration, by its own pairs and by the samples of many.
    #[test]
    fn one_iteration_knows_its_noise() {
        let scene = TestScene::new("cornell-box", [24, 18]);
        let ones = vec![1.0; 24 * 18];
        let variance = |seed, iterations| {
            let (light_paths, camera_paths, sobol_set) = (2000, 3, 1);
            let own = scene.settings.clone();
            let own = Settings { light_paths, camera_paths, seed, sobol_set, ..own };
            let mut renderer = scene.renderer(&own);
            for number in 0..iterations {
                let measure = if number == 0 { Measure::Pairs } else { Measure::Off };
                renderer.iterate(measure);
            }
            let weights = vec![1.0];
            let now = Convergence::new(renderer.blocks(), weights, &ones);
            assert_eq!(now.variance.is_none(), iterations == 1);
            now.weighted_variance.unwrap() * iterations as f64
        };
        let of_one: Vec<f64> = (1..=64).map(|seed| variance(seed, 1)).collect();
        let mean = of_one.iter().sum::<f64>() / 64.0;
        let squares = of_one.iter().map(|own| (own - mean).powi(2)).sum::<f64>();
        let error = (squares / (64.0 * 63.0)).sqrt();
        let sampled = variance(100, 400);
        assert!((mean - sampled).abs() < 4.0 * error + 0.03 * sampled, "{mean} {error} {sampled}");
        assert!(error < 0.2 * mean, "the test would pass for any estimate");
    }

    #[test]
    fn forecast_ends_at_the_first_condition() {
        let now = convergence(100, 0.04, 0.0);
        let forecast = |stop: Stop| now.forecast(&stop, 4.0, 0.5, 50.0).unwrap();
        let by_count = forecast(Stop { iterations: Some(400), ..Stop::default() });
        assert!((by_count.rms - 0.1).abs() < 1e-12 && by_count.seconds == 150.0);
        let time = Some(Duration::from_secs(150));
        let by_time = forecast(Stop { time, ..Stop::default() });
        assert!((by_time.rms.powi(2) - 4.0 / 300.0).abs() < 1e-12 && by_time.seconds == 100.0);
        let target = Some(Target::Absolute(0.1));
        let by_target = forecast(Stop { target, ..Stop::default() });
        assert!((by_target.rms - 0.1).abs() < 1e-12 && (by_target.seconds - 150.0).abs() < 1e-9);
        let first = forecast(Stop { iterations: Some(400), time, target, ..Stop::default() });
        assert_eq!(first, by_time);
    }

    #[test]
    fn bias_is_that_of_the_pilot_until_the_image_measures_it() {
        let stop = Stop::default().with_pilot_bias2(1e-4);
        let now = convergence(100, 0.04, 0.0);
        assert_eq!(now.with_measured_bias(&stop).bias2, 1e-4);
        let measured = |stop: Stop, value, deviation| {
            let bias2 = Some(SquaredPart { value, deviation });
            Convergence { bias2, ..now.clone() }.with_measured_bias(&stop).bias2
        };
        // The deviation of the pilot is 4e-4.
        assert!((measured(stop, 9e-4, 4e-4) - 5e-4).abs() < 1e-12);
        assert!((measured(stop, 9e-4, 1e-9) - 9e-4).abs() < 1e-9);
        // A pilot that saw hardly any bias does not outweigh an image that is certain of it, as in
        // a staircase. It does where the image has three deviations by chance, as in daylight.
        let of_cache =
            |value, deviation| measured(Stop::default().with_pilot_bias2(2.6e-5), value, deviation);
        let [certain, chance] = [of_cache(1.6e-3, 3.2e-4), of_cache(8.2e-4, 2.6e-4)];
        assert!((1.4e-3..1.6e-3).contains(&certain) && chance < 2e-4, "{certain} {chance}");
        assert_eq!(measured(stop, -9e-4, 4e-4), 0.0);
        // Its deviation does not grow from one estimate to the next.
        assert_eq!(measured(stop.with_pilot_bias2(0.0), 3e-4, 1.0), 3e-4);
    }

    #[test]
    fn uncertain_variance_prolongs_the_forecast() {
        let target = Some(Target::Absolute(0.1));
        let stop = Stop { target, ..Stop::default() };
        let [certain, uncertain] = [0.0, 0.004].map(|error| {
            convergence(100, 0.04, error).forecast(&stop, 4.0, 0.5, 50.0).unwrap().seconds
        });
        assert!((1.05..1.2).contains(&(uncertain / certain)), "{certain} {uncertain}");
    }
}
