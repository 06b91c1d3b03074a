//! Conditions to stop at, and how near an image is to them.

mod convergence;
mod importance;

pub use convergence::{Convergence, Forecast, PILOT_SPREAD};
pub use importance::{
    AROUND_PIXEL, LIT_ONCE, MIN_PIXEL_SIGNAL_SHARE, importance, luminances, without_noise,
};

use crate::adaptive::error_interval::SquaredPart;
use crate::adaptive::optimize::Objective;
use bdpm_core::base::error::{Error, Result};
use serde::{Deserialize, Serialize};
use std::str::FromStr;
use std::time::Duration;

/// Minimum number of iterations before a target counts as reached. Stopping at the first low
/// estimate would stop too early on average.
pub const MIN_ITERATIONS_TO_TARGET: u64 = 32;

/// Minimum of the noise's share of the squared target error. It keeps a target reachable whose
/// square is smaller than the squared bias.
pub const MIN_NOISE_SHARE: f64 = 0.1;

/// Conditions to stop at: the first one that holds ends a render. Without any, it never ends. By
/// default the relative error counts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Stop {
    /// Number of iterations, those of a resumed image included.
    pub iterations: Option<u64>,
    /// Rendering time.
    pub time: Option<Duration>,
    /// Pooled RMS of the noise.
    pub target: Option<Target>,
    /// Relative RMS error, noise and bias together: 0.01 for 1 %.
    pub error: Option<f64>,
    /// The noise to minimize: pooled or relative.
    pub objective: Objective,
    /// Latest estimate of the squared relative bias of the image.
    pub bias2: f64,
    /// Squared relative bias that the pilot expects at the end: the prior of what the image
    /// measures.
    pub pilot_bias2: f64,
    /// Squared relative difference that an audit found, if it refuted the image.
    pub difference: Option<SquaredPart>,
}

impl Stop {
    /// These conditions with the squared relative bias that the pilot expects.
    #[must_use]
    pub fn with_pilot_bias2(self, bias2: f64) -> Self {
        Self { bias2, pilot_bias2: bias2, ..self }
    }

    /// These conditions without the result of an audit.
    #[must_use]
    pub fn without_difference(self) -> Self {
        // The latest estimate may be the difference.
        let bias2 = if self.difference.is_some() { self.pilot_bias2 } else { self.bias2 };
        Self { bias2, difference: None, ..self }
    }

    /// Stops after this rendering time. Jobs refuse a time of 0.
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

    /// Relative variance that a total error leaves for noise beside the bias. It is at least
    /// [`MIN_NOISE_SHARE`] of the squared error, even if the bias alone exceeds the error.
    pub fn noise2(&self, error: f64) -> f64 {
        let error2 = error * error;
        (error2 - self.bias2).max(MIN_NOISE_SHARE * error2)
    }
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

/// Reason for the end of a render.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StoppedBy {
    /// All iterations were rendered.
    Iterations,
    /// The time is over.
    Time,
    /// The noise is low enough.
    Target,
    /// The user interrupted the render.
    Interrupt,
    /// A step after the first iteration failed. The image has the iterations before it.
    Failure,
}

impl Target {
    /// The target as luminance, for an image of this mean luminance.
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
                format!("`{text}` is not an RMS"),
                "give a positive luminance, or a share of the mean luminance such as 1%",
            )),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn target_is_a_luminance_or_a_share() {
        assert_eq!("0.25".parse::<Target>().unwrap(), Target::Absolute(0.25));
        assert_eq!(" 1 %".parse::<Target>().unwrap(), Target::Share(0.01));
        assert_eq!(Target::Share(0.01).absolute(30.0), 0.3);
        for bad in ["", "%", "0", "-1%", "nan", "inf", "1e999", "5%%", "x"] {
            let shown = bad.parse::<Target>().unwrap_err().to_string();
            assert!(shown.contains("help: give a positive luminance"), "{bad}: {shown}");
        }
    }
}
