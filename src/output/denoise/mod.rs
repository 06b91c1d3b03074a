//! Denoising, and the error of the denoised image.
//!
//! Iterations are dealt out to [`folds`](crate::film::folds). Each fold in turn is left out. The image that is denoised
//! from the other folds is independent of it, so the fold shows the error, the denoiser's own bias included, without a
//! reference. docs/explanation/denoising.md has the formulas.

mod cross_validation;
mod folded_image;
mod mix;
#[allow(unsafe_code)] // with a SAFETY argument for each block, as in Embree's layer
mod oidn;

pub use cross_validation::{CrossValidation, SquaredError};
pub use folded_image::{FoldedImage, Guides, guides};
pub use mix::Mix;
pub use oidn::{Oidn, Quality};

use crate::base::error::Result;
use crate::base::math::Rgb;
use crate::film::folds::DENOISE_FOLDS;
use crate::film::radiance::{luminance_weights, total};
use crate::image_io::Layer;
use crate::render::block::CombinedImage;
use serde::Serialize;

/// Errors and mixing weights are pooled over this many pixels to each side: squares of 33 by 33.
pub const BOX_RADIUS: u32 = 16;

/// Relative RMS noise of a raw image above which it is denoised even if the error is unknown. Denoised images of raw
/// images with this noise usually have an error of about half of it (docs/measurements/denoising.md).
const UNKNOWN_ERROR: f64 = 0.1;

/// A denoised image.
#[derive(Clone, Debug)]
pub struct Denoised {
    /// Radiance, W/(m^2 sr), row by row: the denoised image, mixed with the raw one where that has a smaller error.
    pub image: Vec<Rgb>,
    /// The estimated error; `None` if no fold was left out.
    pub error: Option<DenoisedError>,
    /// True if `image` is the raw image, since that has the smaller error.
    pub is_raw: bool,
}

/// The error of a denoised image from `(n-1)/n` of the samples, estimated by leaving out each of `n` folds.
#[derive(Clone, Debug)]
pub struct DenoisedError {
    /// Error of the whole image.
    pub whole: ErrorSummary,
    /// RMS error as luminance, W/(m^2 sr), row by row, pooled over squares of `2 BOX_RADIUS + 1` pixels.
    pub map: Vec<f32>,
    /// Share of the raw image in each pixel.
    pub raw_share: Vec<f32>,
}

/// Squared errors relative to `L_p^2 + 0.01 mean(L)^2`, means over all pixels. They include the noise and the
/// denoiser's bias, but not the merge bias.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ErrorSummary {
    /// Squared error of the final image.
    pub squared: f64,
    /// Standard error of `squared`.
    pub standard_error: f64,
    /// Squared error of the denoised image before the raw image is mixed in.
    pub unmixed: f64,
    /// Standard error of `unmixed`.
    pub unmixed_error: f64,
    /// Squared error of the raw image from as many samples.
    pub raw: f64,
    /// Mean share of the raw image in the mix.
    pub raw_share: f64,
    /// Share of the pixels in whose neighborhood the denoised image has a larger error than the raw one.
    pub worse: f64,
    /// Number of folds `n`. Each of them was left out in turn.
    #[serde(rename = "parts")]
    pub folds: usize,
}

impl ErrorSummary {
    /// Relative RMS error; 0 if noise hides it.
    pub fn relative(&self) -> f64 {
        self.squared.max(0.0).sqrt()
    }

    /// Upper bound of the squared error: the estimate plus this number of standard errors.
    pub fn bound(&self, standard_errors: f64) -> f64 {
        self.squared.max(0.0) + standard_errors * self.standard_error
    }
}

/// Denoises an image, and estimates its error by leaving out each of `n` folds, or fewer if there are not enough
/// iterations; 0 leaves the error unknown. The result is never knowingly worse than the raw image: it is the mix with
/// the smallest estimated error, or the raw image if that has a smaller one. If the error is unknown, it is the raw
/// image if its noise is below 10 %.
///
/// # Errors
/// Those of the denoiser.
pub fn denoise(
    image: &CombinedImage,
    n: usize,
    mut denoiser: impl FnMut(&[Rgb]) -> Result<Vec<Rgb>>,
) -> Result<Denoised> {
    let raw = image.mean();
    let denoised = denoiser(&raw)?;
    let weights = importance(&denoised);
    let noise2 = |variance: Vec<f64>| {
        let terms: Vec<f64> = variance.iter().zip(&weights).map(|(v, w)| v * w).collect();
        total(&terms, |term| *term) / terms.len() as f64
    };
    let splits = [DENOISE_FOLDS, DENOISE_FOLDS / 2, 2].into_iter().filter(|split| *split <= n);
    let Some(folded) = splits.filter_map(|split| FoldedImage::new(image, split)).next() else {
        let is_raw = image.variance_of_mean().is_some_and(|v| noise2(v) < UNKNOWN_ERROR.powi(2));
        let image = if is_raw { raw } else { denoised };
        return Ok(Denoised { image, error: None, is_raw });
    };
    // The folds hold the merge bias. Its correction adds noise, which enlarges all errors.
    let growth = match image.bias_correction() {
        Some(_) => {
            let both = image.variance_of_mean().zip(image.uncorrected_variance());
            both.map_or(1.0, |(corrected, sampled)| (noise2(corrected) / noise2(sampled)).max(1.0))
        }
        None => 1.0,
    };
    let resolution = image.resolution();
    let validation = CrossValidation::new(&folded, &mut denoiser)?;
    let mix = Mix::new(&validation, &weights, resolution);
    let unmixed = validation.estimate(&weights);
    let raw_squared = validation.raw(&weights);
    let mut delivered = validation.mixed(&mix);
    let mut estimate = delivered.estimate(&weights);
    let is_raw = raw_squared <= estimate.squared;
    if is_raw {
        delivered = validation.of_raw();
        estimate = SquaredError { squared: raw_squared, ..delivered.estimate(&weights) };
    }
    let raw_share = if is_raw { vec![1.0; raw.len()] } else { mix.shares.clone() };
    let error = DenoisedError {
        whole: ErrorSummary {
            squared: growth * estimate.squared,
            standard_error: growth * estimate.standard_error,
            unmixed: growth * unmixed.squared,
            unmixed_error: growth * unmixed.standard_error,
            raw: growth * raw_squared,
            raw_share: total(&raw_share, |share| f64::from(*share)) / raw.len() as f64,
            worse: mix.worse,
            folds: folded.fold_count(),
        },
        map: delivered.map(resolution).iter().map(|rms| rms * growth.sqrt() as f32).collect(),
        raw_share,
    };
    let image = if is_raw { raw } else { mix.apply(&raw, &denoised) };
    Ok(Denoised { image, error: Some(error), is_raw })
}

/// Weights of squared errors from the luminance of an image: `1/(L_p^2 + 0.01 mean(L)^2)`.
pub fn importance(image: &[Rgb]) -> Vec<f64> {
    let luminance: Vec<f64> =
        image.iter().map(|value| crate::film::radiance::luminance(value.as_dvec3())).collect();
    luminance_weights(&luminance)
}

/// Layers of a file with the denoised image and its error.
pub fn layers(denoised: &Denoised) -> Vec<Layer> {
    let mut layers = vec![Layer::rgb("denoised", &denoised.image)];
    if let Some(error) = &denoised.error {
        let one = |name: &str, values: &[f32]| Layer {
            name: name.into(),
            channels: vec![("Y".into(), values.to_vec())],
        };
        layers.push(one("denoised_error", &error.map));
        layers.push(one("denoised_mix", &error.raw_share));
    }
    layers
}
