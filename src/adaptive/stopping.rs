//! When to stop, how far the image is, and what is to come.

use crate::adaptive::optimize::Objective;
use crate::base::error::{Error, Result};
use crate::film::radiance::{box_filtered, luminance, luminance_weights, total};
use crate::render::block::{Block, CombinedImage};
use crate::settings::policy::{
    LEAST_ITERATIONS_TO_TARGET, LEAST_NOISE_SHARE, PLAIN_SHARE, UPPER_BOUND,
};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::str::FromStr;
use std::time::Duration;

/// Conditions to stop at: the first one that holds ends a render. Without any, it never ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stop {
    /// Number of iterations, those of a resumed image included.
    pub iterations: Option<u64>,
    /// Rendering time.
    pub time: Option<Duration>,
    /// Pooled RMS of the noise.
    pub target: Option<Target>,
    /// Relative RMS error, noise and bias together: 0.01 for 1 %.
    pub error: Option<f64>,
    /// The noise that is to be small: the pooled or the relative one.
    pub objective: Objective,
    /// Squared relative bias of the image, as far as it is known.
    pub bias2: f64,
}

impl Default for Stop {
    /// No condition; the relative error counts.
    fn default() -> Self {
        let (iterations, time, target, error) = (None, None, None, None);
        Self { iterations, time, target, error, objective: Objective::Relative, bias2: 0.0 }
    }
}

impl Stop {
    /// Stops after this rendering time.
    pub fn time(time: Duration) -> Self {
        Self { time: Some(time), ..Self::default() }
    }

    /// Stops at this relative RMS error, noise and bias together: 0.01 for 1 %.
    pub fn error(error: f64) -> Self {
        Self { error: Some(error), ..Self::default() }
    }

    /// Stops after this number of iterations. The counts are then not chosen.
    pub fn iterations(iterations: u64) -> Self {
        Self { iterations: Some(iterations), ..Self::default() }
    }

    /// Relative variance that an error allows beside the bias; a small part of it even if the bias alone exceeds the
    /// error.
    pub fn noise2(&self, error: f64) -> f64 {
        let error2 = error * error;
        (error2 - self.bias2).max(LEAST_NOISE_SHARE * error2)
    }
}

/// Weights of the squared errors of the pixels of an image, by what counts: 1, or by their luminance.
pub fn importance(blocks: &[Block], objective: Objective) -> Vec<f64> {
    let image = CombinedImage::new(blocks, vec![1.0; blocks.len()]);
    let pixels = blocks[0].film.pixels();
    if objective != Objective::Relative {
        return vec![1.0; pixels];
    }
    luminance_weights(&luminances(&image))
}

/// Luminance of each pixel, W/(m^2 sr), without what noise adds to its square; that of its neighborhood where noise
/// hides its own. Of the image as it was merged: what is taken off for its bias decides about no weight.
pub fn luminances(image: &CombinedImage) -> Vec<f64> {
    let mean: Vec<f64> =
        image.uncorrected_mean().into_par_iter().map(|value| luminance(value.as_dvec3())).collect();
    match image.uncorrected_variance() {
        Some(variance) => without_noise(&mean, &variance, image.resolution()),
        None => mean,
    }
}

/// Roots of squared means less their variances, which are what noise adds to the squares; of the neighborhood's where
/// the variance is most of the square.
pub fn without_noise(mean: &[f64], variance: &[f64], (width, height): (u32, u32)) -> Vec<f64> {
    let squares: Vec<_> = mean.par_iter().zip(variance).map(|(l, v)| [l * l - v]).collect();
    let clean = |(index, luminance): (usize, &f64)| {
        let [own] = squares[index];
        let is_plain = own > PLAIN_SHARE * luminance * luminance;
        let [square] = if is_plain { [own] } else { box_filtered(&squares, index, width, height) };
        square.max(0.0).sqrt()
    };
    mean.par_iter().enumerate().map(clean).collect()
}

/// A pooled RMS, the root of the mean variance over all pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Target {
    /// Luminance, W/(m^2 sr).
    Absolute(f64),
    /// Share of the image's mean luminance, 0.01 for 1 %.
    Share(f64),
}

/// Why rendering ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StoppedBy {
    /// All iterations are done.
    Iterations,
    /// The time is over.
    Time,
    /// The noise is low enough.
    Target,
    /// The user had enough.
    Interrupt,
}

impl Target {
    /// As luminance, for an image of this mean luminance.
    pub fn absolute(self, mean_luminance: f64) -> f64 {
        match self {
            Self::Absolute(rms) => rms,
            Self::Share(share) => share * mean_luminance,
        }
    }
}

impl FromStr for Target {
    type Err = Error;

    /// Reads a luminance such as `0.002`, or a share of the mean luminance such as `1%`.
    fn from_str(text: &str) -> Result<Self> {
        let text = text.trim();
        let (number, percent) = match text.strip_suffix('%') {
            Some(number) => (number.trim_end(), true),
            None => (text, false),
        };
        match number.parse::<f64>() {
            Ok(value) if value > 0.0 && value.is_finite() => {
                Ok(if percent { Self::Share(value / 100.0) } else { Self::Absolute(value) })
            }
            _ => Err(Error::new(
                format!("`{text}` is no RMS"),
                "give a positive luminance, or a share of the mean luminance such as 1%",
            )),
        }
    }
}

/// How far an image is; luminances, W/(m^2 sr).
#[derive(Clone, Debug)]
pub struct Convergence {
    /// Weight of an iteration of each block.
    pub weights: Vec<f64>,
    /// Iterations of all blocks.
    pub iterations: u64,
    /// Mean over the image.
    pub mean_luminance: f64,
    /// Pooled variance of the image, and its standard error, once it is known.
    pub variance: Option<(f64, f64)>,
    /// Mean over pixels of their variance by its importance, once it is known: the pooled or the relative one.
    pub weighted_variance: Option<f64>,
    /// Squared relative bias that is left where it is taken off, once it is known.
    pub bias2: Option<f64>,
    /// The same of one iteration at the present counts, once it is known.
    pub per_iteration: Option<f64>,
}

/// What the rest of the rendering leads to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Forecast {
    /// Pooled RMS at the end, W/(m^2 sr).
    pub rms: f64,
    /// Of the variance that counts, the part that is left at the end.
    pub left: f64,
    /// Rendering time from now to the end, seconds.
    pub seconds: f64,
}

impl Convergence {
    /// Of an image with given weights of its blocks, by the importance of its pixels.
    pub fn new(blocks: &[Block], weights: Vec<f64>, importance: &[f64]) -> Self {
        let combined = CombinedImage::new(blocks, weights);
        let mean_of = |variance: &[f64]| {
            let weighted = variance.par_iter().zip(importance).map(|(v, weight)| v * weight);
            total(&weighted.collect::<Vec<f64>>(), |term| *term) / importance.len() as f64
        };
        let film = blocks.last().map(|block| &block.film);
        let own = film.and_then(|film| Some((film.variance_of_mean()?, film.iterations as f64)));
        let of_all = match blocks {
            [_] if combined.bias_correction().is_none() => {
                own.as_ref().map(|(variance, _)| variance.clone())
            }
            _ => combined.variance_of_mean(),
        };
        let bias2 = combined.bias_correction().map(|reduction| mean_of(&reduction.bias2).max(0.0));
        // An iteration leaves the less of its noise, the more of that is taken off.
        let shown = match (combined.bias_correction(), combined.uncorrected_variance()) {
            (Some(_), Some(merged)) => {
                let all = mean_of(&merged);
                of_all.as_deref().map_or(1.0, |of_all| mean_of(of_all) / all)
            }
            _ => 1.0,
        };
        Self {
            iterations: combined.iterations(),
            mean_luminance: combined.mean_luminance(),
            variance: combined.pooled_variance(),
            weighted_variance: of_all.as_deref().map(mean_of),
            bias2,
            per_iteration: own
                .map(|(variance, iterations)| shown * mean_of(&variance) * iterations),
            weights: combined.into_weights(),
        }
    }

    /// The goal with the bias that the image itself shows, if it does.
    pub fn with_measured_bias(&self, goal: &Stop) -> Stop {
        Stop { bias2: self.bias2.unwrap_or(goal.bias2), ..*goal }
    }

    /// Whether an image of this bias has the goal's noise or error.
    pub fn is_good_enough(&self, goal: &Stop) -> bool {
        goal.target.is_some_and(|target| self.reaches(target))
            || goal.error.is_some_and(|error| self.comes_to(goal.noise2(error)))
    }

    /// Whether the upper 90 % bound of the variance that counts lies under `allowed`. Its relative standard error
    /// is at most about that of the pooled one, in which few pixels weigh most.
    fn comes_to(&self, allowed: f64) -> bool {
        let bound = |(weighted, (variance, error)): (f64, (f64, f64))| {
            weighted * (1.0 + UPPER_BOUND * error / variance)
        };
        self.iterations >= LEAST_ITERATIONS_TO_TARGET
            // theory.md (91)
            && self.weighted_variance.zip(self.variance).map(bound).is_some_and(|bound| bound <= allowed)
    }

    /// Relative error, noise and bias, when a part `left` of the noise's square is left, if that is what counts.
    pub fn error(&self, goal: &Stop, left: f64) -> Option<f64> {
        let noise2 = self.weighted_variance.filter(|_| goal.objective == Objective::Relative)?;
        Some((noise2 * left + goal.bias2).sqrt())
    }

    /// The variance that counts as a share: of each pixel's luminance, or of the mean.
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

    /// Whether the upper 90 % bound of the pooled RMS lies under the target.
    pub fn reaches(&self, target: Target) -> bool {
        let allowed = target.absolute(self.mean_luminance).powi(2);
        self.iterations >= LEAST_ITERATIONS_TO_TARGET
            // theory.md (91)
            && self.variance.is_some_and(|(v, error)| v + UPPER_BOUND * error <= allowed)
    }

    /// What is to come if every further iteration takes `tau` seconds and has, of what counts, the variance
    /// `variance`, after `elapsed` seconds of rendering; `None` before the noise is known.
    ///
    /// Information, the reciprocal of the variance, adds up over iterations.
    pub fn forecast(&self, goal: &Stop, variance: f64, tau: f64, elapsed: f64) -> Option<Forecast> {
        let ((pooled, error), now) = (self.variance?, self.weighted_variance?);
        if !(now > 0.0 && variance > 0.0 && tau > 0.0) {
            return Some(Forecast { rms: pooled.sqrt(), left: 1.0, seconds: 0.0 });
        }
        let by_count = goal.iterations.map(|n| n.saturating_sub(self.iterations) as f64);
        let by_time = goal.time.map(|time| ((time.as_secs_f64() - elapsed) / tau).max(0.0));
        let by_target = [
            goal.target.map(|target| target.absolute(self.mean_luminance).powi(2) * now / pooled),
            goal.error.map(|error| goal.noise2(error)),
        ];
        let by_target = by_target.map(|allowed| {
            let allowed = allowed?;
            // The upper bound must come down to the target; its relative distance falls as the
            // root of the iterations.
            let distance = UPPER_BOUND * if error.is_finite() { error / pooled } else { 0.0 };
            let iterations = self.iterations as f64;
            // theory.md (90)
            let needed = |margin: f64| ((margin / allowed - 1.0 / now) * variance).max(0.0);
            let more = needed(1.0);
            let more = needed(1.0 + distance * (iterations / (iterations + more)).sqrt());
            Some(more.max(LEAST_ITERATIONS_TO_TARGET as f64 - iterations).max(0.0))
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

    #[test]
    fn targets_are_luminances_or_shares() {
        assert_eq!("0.25".parse::<Target>().unwrap(), Target::Absolute(0.25));
        assert_eq!(" 1 %".parse::<Target>().unwrap(), Target::Share(0.01));
        assert_eq!(Target::Share(0.01).absolute(30.0), 0.3);
        for bad in ["", "%", "0", "-1%", "nan", "inf", "1e999", "5%%", "x"] {
            let shown = bad.parse::<Target>().unwrap_err().to_string();
            assert!(shown.contains("help: give a positive luminance"), "{bad}: {shown}");
        }
    }

    fn standing(iterations: u64, variance: f64, error: f64) -> Convergence {
        Convergence {
            weights: vec![1.0],
            iterations,
            mean_luminance: 2.0,
            variance: Some((variance, error)),
            weighted_variance: Some(variance),
            bias2: None,
            per_iteration: Some(variance * iterations as f64),
        }
    }

    #[test]
    fn a_target_takes_32_iterations_and_certainty() {
        let target = Target::Share(0.05); // variance 0.01
        assert!(standing(32, 0.009, 0.0005).reaches(target));
        assert!(!standing(31, 0.009, 0.0005).reaches(target));
        assert!(!standing(32, 0.009, 0.001).reaches(target));
        assert!(!standing(32, 0.009, f64::INFINITY).reaches(target));
        let unknown =
            Convergence { variance: None, weighted_variance: None, ..standing(32, 0.0, 0.0) };
        assert!(!unknown.reaches(target));
    }

    #[test]
    fn forecasts_end_at_whatever_comes_first() {
        let now = standing(100, 0.04, 0.0);
        let forecast = |goal: Stop| now.forecast(&goal, 4.0, 0.5, 50.0).unwrap();
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
    fn an_uncertain_variance_makes_it_take_longer() {
        let target = Some(Target::Absolute(0.1));
        let goal = Stop { target, ..Stop::default() };
        let certain = standing(100, 0.04, 0.0).forecast(&goal, 4.0, 0.5, 50.0).unwrap();
        let unsure = standing(100, 0.04, 0.004).forecast(&goal, 4.0, 0.5, 50.0).unwrap();
        assert!(unsure.seconds > 1.05 * certain.seconds && unsure.seconds < 1.2 * certain.seconds);
    }
}
