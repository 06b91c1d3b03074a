//! The stated error of an image, in the metadata of its file.

use bdpm_auto::adaptive::error_interval::ErrorInterval;
use bdpm_core::image_io::{Metadata, Value};
use serde::Serialize;

/// Attribute with the relative RMS error, noise and bias together.
const TOTAL: &str = "relative error";
/// Attribute with the relative RMS error of the noise alone.
const NOISE: &str = "relative error of noise";
/// Attribute with the relative RMS error of the bias alone.
const BIAS: &str = "relative error of bias";
/// Attributes with both ends of the range that holds the true error with a probability of 90 %.
const INTERVAL: [&str; 2] = ["relative error at least", "relative error at most"];

/// Attribute with the RMS of the noise, pooled over all pixels: luminance, W/(m^2 sr).
pub const POOLED_RMS: &str = "pooled rms";

/// Adds the pooled RMS in single precision: parts of an image add up in another order than a whole.
pub fn record_pooled_rms(metadata: &mut Metadata, rms: f64) {
    metadata.insert(POOLED_RMS.into(), Value::Number(f64::from(rms as f32)));
}

/// Relative RMS error that an image states about itself.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RecordedError {
    /// Noise and bias together.
    pub total: f64,
    /// Noise alone.
    pub noise: f64,
    /// Bias alone.
    pub bias: f64,
    /// Range that holds the true relative error with a probability of 90 %, if it is known.
    pub interval: Option<ErrorInterval>,
}

impl RecordedError {
    /// Adds the error to the metadata of an image.
    pub fn record(&self, metadata: &mut Metadata) {
        let mut add = |name: &str, value| metadata.insert(name.into(), Value::Number(value));
        for (name, value) in [(TOTAL, self.total), (NOISE, self.noise), (BIAS, self.bias)] {
            add(name, value);
        }
        if let Some(ErrorInterval { low, high }) = self.interval {
            add(INTERVAL[0], low);
            add(INTERVAL[1], high);
        }
    }

    /// The error that [`Self::record`] added, or `None` if the metadata state none.
    pub fn read(metadata: &Metadata) -> Option<Self> {
        let number = |name: &str| match metadata.get(name) {
            Some(&Value::Number(value)) => Some(value),
            _ => None,
        };
        let interval = number(INTERVAL[0]).zip(number(INTERVAL[1]));
        Some(Self {
            total: number(TOTAL)?,
            noise: number(NOISE)?,
            bias: number(BIAS)?,
            interval: interval.map(|(low, high)| ErrorInterval { low, high }),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn metadata_keep_the_error_and_its_interval() {
        let interval = Some(ErrorInterval { low: 0.01, high: 0.04 });
        let whole = RecordedError { total: 0.02, noise: 0.015, bias: 0.013, interval };
        for error in [whole, RecordedError { interval: None, ..whole }] {
            let mut metadata = Metadata::new();
            error.record(&mut metadata);
            assert_eq!(RecordedError::read(&metadata), Some(error));
            metadata.remove(TOTAL);
            assert_eq!(RecordedError::read(&metadata), None);
        }
    }
}
