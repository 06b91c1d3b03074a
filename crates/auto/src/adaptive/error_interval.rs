//! How well the relative error of an image is known: an interval for it.

use serde::{Deserialize, Serialize};

/// Probability with which the true error should lie in an [`ErrorInterval`].
pub const COVERAGE: f64 = 0.9;

/// Standard deviations of the normal distribution to either side that hold [`COVERAGE`].
const DEVIATIONS: f64 = 1.6449;

/// Standard deviation of the squared noise that its statistics do not show, relative: of light that
/// is too rare for them, and of a forecast, which assumes that times and variances stay as they
/// are. Fixed by trial: docs/measurements/predictions.md.
const UNSEEN_NOISE: [f64; 2] = [0.2, 0.3];

/// Standard deviation of the squared bias beside that of its estimate, relative: the bias at half
/// of the radius is not measured.
const UNSEEN_BIAS: f64 = 0.5;

/// A squared part of the error and its standard deviation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SquaredPart {
    /// Expectation.
    pub value: f64,
    /// Standard deviation of the true value around it.
    pub deviation: f64,
}

/// Standard deviation of the squared error, relative to it, from which on the estimate is hardly
/// more than its own noise: the error has an upper bound alone.
const HARDLY_KNOWN: f64 = 0.7;

/// Range that holds the true relative error with a probability of 90 %.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorInterval {
    /// Lower end; 0 if only an upper bound of the error is known.
    pub low: f64,
    /// Upper end; infinite if the image may lack light that was never seen.
    pub high: f64,
}

impl SquaredPart {
    /// The part with another deviation, relative to its value.
    fn with(self, relative: f64) -> Self {
        Self { deviation: self.deviation.hypot(relative * self.value), ..self }
    }
}

impl ErrorInterval {
    /// The interval for an image of this noise and bias, now or as they are forecast.
    pub fn new(noise: SquaredPart, bias: SquaredPart, is_forecast: bool) -> Self {
        let unseen = UNSEEN_NOISE[usize::from(is_forecast)];
        Self::of_parts([noise.with(unseen), bias.with(UNSEEN_BIAS)])
    }

    /// The interval for independent squared parts. The logarithm of their sum is taken to be
    /// normal, or the sum itself where it is hardly known: theory.md (93h).
    fn of_parts(parts: [SquaredPart; 2]) -> Self {
        let square: f64 = parts.iter().map(|part| part.value).sum();
        let variance: f64 = parts.iter().map(|part| part.deviation.powi(2)).sum();
        if variance.sqrt() >= HARDLY_KNOWN * square {
            return Self { low: 0.0, high: (square + DEVIATIONS * variance.sqrt()).sqrt() };
        }
        // The error is the root, so that its logarithm has half the deviation.
        let deviation = 0.5 * variance.sqrt() / square;
        let factor = (DEVIATIONS * deviation).exp();
        Self { low: square.sqrt() / factor, high: square.sqrt() * factor }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_add_up() {
        let noise = SquaredPart { value: 9e-4, deviation: 9e-5 };
        let bias = SquaredPart { value: 7e-4, deviation: 1.2e-4 };
        let ErrorInterval { low, high } = ErrorInterval::of_parts([noise, bias]);
        assert!((low * high / 1.6e-3 - 1.0).abs() < 1e-12);
        // Standard deviation 1.5e-4 of 1.6e-3, halved: 4.69 %.
        assert!((high / 0.04 - (1.6449f64 * 0.046_875).exp()).abs() < 1e-12);
        let unknown = SquaredPart { value: 0.0, deviation: 1e-4 };
        let unknown = ErrorInterval::of_parts([unknown, SquaredPart::default()]);
        assert!(unknown.low == 0.0 && (unknown.high - 1.6449e-4f64.sqrt()).abs() < 1e-12);
        let hardly = SquaredPart { value: 1e-4, deviation: 1e-4 };
        let hardly = ErrorInterval::of_parts([hardly, SquaredPart::default()]);
        assert!(hardly.low == 0.0 && (hardly.high - 2.6449e-4f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn forecasts_are_less_certain() {
        let (noise, bias) = (SquaredPart { value: 1e-4, deviation: 0.0 }, SquaredPart::default());
        let [now, later] =
            [false, true].map(|is_forecast| ErrorInterval::new(noise, bias, is_forecast));
        assert!(later.low < now.low && now.low < 0.01 && 0.01 < now.high && now.high < later.high);
    }
}
