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
pub use folded_image::{FoldedImage, Guides};
pub use mix::Mix;
pub use oidn::Oidn;

use crate::base::error::Result;
use crate::base::math::Rgb;
use crate::film::features::FeatureFolds;
use crate::film::radiance::{luminance_weights, total};
use crate::image_io::Layer;
use crate::render::block::CombinedImage;
use serde::Serialize;

/// Errors and mixing weights are pooled over this many pixels to each side: squares of 33 by 33.
pub const BOX_RADIUS: u32 = 16;

/// A denoised image.
#[derive(Clone, Debug)]
pub struct Denoised {
    /// Radiance, W/(m^2 sr), row by row: the denoised image, mixed with the raw one where that has a smaller error.
    pub image: Vec<Rgb>,
    /// The estimated error; `None` if no fold was left out.
    pub error: Option<DenoisedError>,
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

/// Denoises an image, and estimates its error by leaving out each of `n` folds. `n` is a function of whether the guides
/// are clean; 0 leaves the error unknown.
///
/// # Errors
/// Those of the denoiser.
pub fn denoise(
    image: &CombinedImage,
    features: Option<&FeatureFolds>,
    n: impl FnOnce(bool) -> usize,
    mut denoiser: impl FnMut(&[Rgb], &Guides) -> Result<Vec<Rgb>>,
) -> Result<Denoised> {
    let raw = image.mean();
    let clean = folded_image::are_clean(image, features);
    let whole = Guides { clean, ..folded_image::guides(image, features, |_| true) };
    let denoised = denoiser(&raw, &whole)?;
    let n = n(clean);
    let Some(folded) = FoldedImage::new(image, features, n) else {
        return Ok(Denoised { image: denoised, error: None });
    };
    let resolution = image.resolution();
    let weights = importance(&denoised);
    let validation = CrossValidation::new(&folded, &mut denoiser)?;
    let mix = Mix::new(&validation, &weights, resolution);
    let mixed = validation.mixed(&mix);
    let estimate = mixed.estimate(&weights);
    let unmixed = validation.estimate(&weights);
    let pixels = raw.len() as f64;
    let error = DenoisedError {
        whole: ErrorSummary {
            squared: estimate.squared,
            standard_error: estimate.standard_error,
            unmixed: unmixed.squared,
            unmixed_error: unmixed.standard_error,
            raw: validation.raw(&weights),
            raw_share: total(&mix.shares, |share| f64::from(*share)) / pixels,
            worse: mix.worse,
            folds: n,
        },
        map: mixed.map(resolution),
        raw_share: mix.shares.clone(),
    };
    Ok(Denoised { image: mix.apply(&raw, &denoised), error: Some(error) })
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
