//! Denoising, and how wrong the denoised image is.
//!
//! Iterations are dealt out to parts ([`folds`](crate::film::folds)). Each part in turn is left out: what is
//! denoised from the others is independent of it, so that the part tells the error without a reference, the
//! denoiser's own bias included. docs/denoising.md has the formulas.

mod folds;
mod mix;
#[allow(unsafe_code)] // with a SAFETY argument for each block, as in Embree's layer
mod oidn;
mod parts;

pub use folds::{Estimate, Folds};
pub use mix::Mix;
pub use oidn::Oidn;
pub use parts::{Guides, InParts};

use crate::base::error::Result;
use crate::base::math::Rgb;
use crate::film::features::FeatureFolds;
use crate::film::radiance::{luminance_weights, total};
use crate::image_io::Layer;
use crate::render::block::CombinedImage;
use serde::Serialize;

/// Pixels to each side of one over which errors and mixing weights are pooled: squares of 33 by 33.
pub const BOX_RADIUS: u32 = 16;

/// A denoised image.
#[derive(Clone, Debug)]
pub struct Denoised {
    /// Radiance, W/(m^2 sr), row by row: the denoiser's and the raw image's, mixed where that has less error.
    pub image: Vec<Rgb>,
    /// What is known of its error; nothing where nothing was left out.
    pub error: Option<DenoisedError>,
}

/// The error of a denoised image, as found by leaving parts of the samples out: that of an image of `(n-1)/n` of them.
#[derive(Clone, Debug)]
pub struct DenoisedError {
    /// Whole image.
    pub whole: ErrorSummary,
    /// RMS error as luminance, W/(m^2 sr), row by row, pooled over squares of `2 BOX_RADIUS + 1` pixels.
    pub map: Vec<f32>,
    /// Share of the raw image in each pixel.
    pub raw_share: Vec<f32>,
}

/// Squared errors relative to `L_p^2 + 0.01 mean(L)^2`, means over all pixels. Each is of the noise and the denoiser's
/// bias; the merge bias comes on top.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ErrorSummary {
    /// Of the image that is delivered, and its standard error.
    pub squared: f64,
    /// See `squared`.
    pub standard_error: f64,
    /// Of what the denoiser made, unmixed, and its standard error.
    pub unmixed: f64,
    /// See `unmixed`.
    pub unmixed_error: f64,
    /// Of the raw image of as many samples.
    pub raw: f64,
    /// Mean share of the raw image in the mix.
    pub raw_share: f64,
    /// Share of the pixels in whose neighborhood the denoiser alone made things worse.
    pub worse: f64,
    /// Parts, each left out in turn: `n`.
    pub parts: usize,
}

impl ErrorSummary {
    /// Relative RMS error; 0 where noise hides it.
    pub fn relative(&self) -> f64 {
        self.squared.max(0.0).sqrt()
    }

    /// Upper bound of the squared error, so many standard errors up.
    pub fn bound(&self, standard_errors: f64) -> f64 {
        self.squared.max(0.0) + standard_errors * self.standard_error
    }
}

/// Denoises an image; finds its error by leaving out each of `n` parts, unless that is 0, which may depend on whether
/// guides are clean.
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
    let clean = parts::are_clean(image, features);
    let whole = Guides { clean, ..parts::guides(image, features, |_| true) };
    let denoised = denoiser(&raw, &whole)?;
    let n = n(clean);
    let Some(in_parts) = InParts::new(image, features, n) else {
        return Ok(Denoised { image: denoised, error: None });
    };
    let resolution = image.resolution();
    let weights = importance(&denoised);
    let folds = Folds::new(&in_parts, &mut denoiser)?;
    let mix = Mix::new(&folds, &weights, resolution);
    let mixed = folds.mixed(&mix);
    let estimate = mixed.estimate(&weights);
    let unmixed = folds.estimate(&weights);
    let pixels = raw.len() as f64;
    let error = DenoisedError {
        whole: ErrorSummary {
            squared: estimate.squared,
            standard_error: estimate.standard_error,
            unmixed: unmixed.squared,
            unmixed_error: unmixed.standard_error,
            raw: folds.raw(&weights),
            raw_share: total(&mix.shares, |share| f64::from(*share)) / pixels,
            worse: mix.worse,
            parts: n,
        },
        map: mixed.map(resolution),
        raw_share: mix.shares.clone(),
    };
    Ok(Denoised { image: mix.apply(&raw, &denoised), error: Some(error) })
}

/// Weights of squared errors by the luminance of an image: `1/(L_p^2 + 0.01 mean(L)^2)`.
pub fn importance(image: &[Rgb]) -> Vec<f64> {
    let luminance: Vec<f64> =
        image.iter().map(|value| crate::film::radiance::luminance(value.as_dvec3())).collect();
    luminance_weights(&luminance)
}

/// The denoised image with its error as layers of a file.
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
