//! Error and time of denoising as reports state them.

use crate::output::denoise::ErrorSummary;
use crate::output::recorded_error::RecordedDenoisedError;
use bdpm_auto::adaptive::error_interval::ErrorInterval;
use serde::Serialize;

/// A promise about the relative error of the denoised image at the end.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct DenoisedPromise {
    /// Relative RMS error at the end: noise and the biases of denoiser and merging.
    pub error: f64,
    /// Rendering time at which the promise was made, seconds.
    pub said_after: f64,
}

/// Error and time of denoising, for reports.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct DenoisedReport {
    /// Relative RMS error, including the denoiser's bias.
    pub relative_error: Option<f64>,
    /// Relative RMS error including the merge bias as well.
    pub total_error: Option<f64>,
    /// Range in which the true relative error should lie.
    pub interval: Option<ErrorInterval>,
    /// Squared errors and their components.
    pub error: Option<ErrorSummary>,
    /// The promised error, if one was made.
    pub promise: Option<DenoisedPromise>,
    /// True if the raw image is the result: it has the smaller error, or denoising was given up.
    pub is_raw: bool,
    /// True if denoising was given up because of an interrupt.
    pub is_interrupted: bool,
    /// Time of all runs of the denoiser, seconds.
    pub seconds: f64,
}

impl DenoisedReport {
    /// The error as an image file states it, if it was estimated.
    pub fn recorded(&self) -> Option<RecordedDenoisedError> {
        Some(RecordedDenoisedError { total: self.total_error?, interval: self.interval })
    }
}
