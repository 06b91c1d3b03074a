//! The stated errors of an image and of its denoised layer, in the metadata of its file.

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

/// Attribute with the relative RMS error of the layer `denoised`. `bdpm denoise` drops attributes
/// whose names begin with that word.
const DENOISED: &str = "denoised relative error";
/// Attributes with both ends of the range of [`DENOISED`], as [`INTERVAL`].
const DENOISED_INTERVAL: [&str; 2] =
    ["denoised relative error at least", "denoised relative error at most"];

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
        record_interval(metadata, INTERVAL, self.interval);
    }

    /// The error that [`Self::record`] added, or `None` if the metadata state none.
    pub fn read(metadata: &Metadata) -> Option<Self> {
        let number = |name| number(metadata, name);
        Some(Self {
            total: number(TOTAL)?,
            noise: number(NOISE)?,
            bias: number(BIAS)?,
            interval: interval(metadata, INTERVAL),
        })
    }
}

/// Relative RMS error that an image states about its layer `denoised`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RecordedDenoisedError {
    /// Noise, and the biases of the denoiser and of merging together.
    pub total: f64,
    /// Range that holds the true relative error with a probability of 90 %, if it is known.
    pub interval: Option<ErrorInterval>,
}

impl RecordedDenoisedError {
    /// Adds the error to the metadata of an image.
    pub fn record(&self, metadata: &mut Metadata) {
        metadata.insert(DENOISED.into(), Value::Number(self.total));
        record_interval(metadata, DENOISED_INTERVAL, self.interval);
    }

    /// The error that [`Self::record`] added, or `None` if the metadata state none.
    pub fn read(metadata: &Metadata) -> Option<Self> {
        let total = number(metadata, DENOISED)?;
        Some(Self { total, interval: interval(metadata, DENOISED_INTERVAL) })
    }

    /// Whether [`Self::record`] adds an attribute of this name.
    pub fn has(name: &str) -> bool {
        name.starts_with(DENOISED)
    }
}

fn record_interval(metadata: &mut Metadata, names: [&str; 2], interval: Option<ErrorInterval>) {
    let ends = interval.map(|ErrorInterval { low, high }| names.into_iter().zip([low, high]));
    for (name, value) in ends.into_iter().flatten() {
        metadata.insert(name.into(), Value::Number(value));
    }
}

fn interval(metadata: &Metadata, [low, high]: [&str; 2]) -> Option<ErrorInterval> {
    Some(ErrorInterval { low: number(metadata, low)?, high: number(metadata, high)? })
}

fn number(metadata: &Metadata, name: &str) -> Option<f64> {
    match metadata.get(name) {
        Some(&Value::Number(value)) => Some(value),
        _ => None,
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

    #[test]
    fn errors_of_the_image_and_of_its_denoised_layer_are_apart() {
        let interval = Some(ErrorInterval { low: 0.01, high: 0.04 });
        let raw = RecordedError { total: 0.2, noise: 0.15, bias: 0.13, interval: None };
        let denoised = RecordedDenoisedError { total: 0.02, interval };
        let mut metadata = Metadata::new();
        raw.record(&mut metadata);
        assert_eq!(RecordedDenoisedError::read(&metadata), None);
        denoised.record(&mut metadata);
        assert_eq!(RecordedError::read(&metadata), Some(raw));
        assert_eq!(RecordedDenoisedError::read(&metadata), Some(denoised));
        let names: Vec<_> = metadata.keys().filter(|n| RecordedDenoisedError::has(n)).collect();
        assert!(names.len() == 3 && names.iter().all(|name| name.starts_with("denoised")));
    }
}
