//! Denoising, and the error of the denoised image.
//!
//! Iterations are dealt out to [`folds`](bdpm_core::film::folds). Each fold in turn is left out.
//! The image that is denoised from the other folds is independent of it, so the fold shows the
//! error, the denoiser's own bias included, without a reference. docs/explanation/denoising.md has
//! the formulas.

mod cross_validation;
mod folded_image;
mod mix;
mod pooling;
mod rare_light;
mod sample;
mod seen_lights;
mod standard_error;
mod window;
#[allow(unsafe_code)] // with a SAFETY argument for each block, as in Embree's layer
mod oidn;

pub use cross_validation::{CrossValidation, SquaredError};
pub use folded_image::{FoldedImage, Guides, guides};
pub use mix::{Mix, mixed};
pub use oidn::{Oidn, Quality};
pub use seen_lights::{denoise_around, isolated_lights};
pub use window::{SampledTile, TILE, Window, sample_tiles};

use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use bdpm_core::film::folds::DENOISE_FOLDS;
use bdpm_core::film::radiance::{luminance_weights, total};
use bdpm_core::image_io::Layer;
use bdpm_core::render::block::CombinedImage;
use rare_light::spread_rare_light;
use sample::Sample;
use serde::Serialize;

/// Errors and mixing weights are pooled over this many pixels to each side: squares of 33 by 33.
pub const BOX_RADIUS: u32 = 16;

/// Relative RMS noise of a raw image above which it is denoised even if the error is unknown.
/// Denoised images of raw images with this noise usually have an error of about half of it
/// (docs/measurements/denoising.md).
const UNKNOWN_ERROR: f64 = 0.1;

/// A denoised image.
#[derive(Clone, Debug)]
pub struct Denoised {
    /// Radiance, W/(m^2 sr), row by row: the denoised image, mixed with the raw one where that has
    /// a smaller error.
    pub image: Vec<Rgb>,
    /// The estimated error; `None` if no fold was left out.
    pub error: Option<DenoisedError>,
    /// True if `image` is the raw image, since that has the smaller error.
    pub is_raw: bool,
}

/// The error of a denoised image, estimated by leaving out each of `n` folds.
#[derive(Clone, Debug)]
pub struct DenoisedError {
    /// Error of the whole image.
    pub whole: ErrorSummary,
    /// RMS error as luminance, W/(m^2 sr), row by row, pooled over squares of `2 BOX_RADIUS + 1`
    /// pixels; empty if the error was estimated in a sample of tiles.
    pub map: Vec<f32>,
    /// Share of the raw image in each pixel.
    pub raw_share: Vec<f32>,
}

/// Squared errors relative to `L_p^2 + 0.01 mean(L)^2`, means over all pixels. They include the
/// noise and the denoiser's bias, but not the merge bias.
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
    /// Squared error of the raw image.
    pub raw: f64,
    /// Mean share of the raw image in the mix.
    pub raw_share: f64,
    /// Share of the pixels in whose neighborhood the denoised image has a larger error than the raw
    /// one.
    pub worse: f64,
    /// Number of folds `n`. Each of them was left out in turn.
    #[serde(rename = "parts")]
    pub folds: usize,
    /// Number of tiles in which the error was estimated; `None` if it was estimated in all pixels.
    pub tiles: Option<usize>,
}

/// How the error of a denoised image is estimated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Validation {
    /// Number of folds that are left out in turn, or fewer if there are not enough iterations; 0
    /// leaves the error unknown.
    pub folds: usize,
    /// Approximate number of [tiles](sample_tiles) in which the error is estimated; `None` for the
    /// whole image.
    pub tiles: Option<usize>,
    /// Seed of the sample of tiles.
    pub seed: u64,
}

impl Validation {
    /// The error is estimated in the whole image, by leaving out this number of folds in turn.
    pub fn folds(folds: usize) -> Self {
        Self { folds, tiles: None, seed: 0 }
    }
}

impl ErrorSummary {
    /// The squared error that is stated: where its own noise hides it, its standard error, but not
    /// more than the squared error of the raw image.
    pub fn stated(&self) -> f64 {
        self.squared.max(self.standard_error.min(self.raw)).max(0.0)
    }

    /// Relative RMS error.
    pub fn relative(&self) -> f64 {
        self.stated().sqrt()
    }

    /// Upper bound of the squared error: the estimate plus this number of standard errors.
    pub fn bound(&self, standard_errors: f64) -> f64 {
        self.squared.max(0.0) + standard_errors * self.standard_error
    }
}

/// Denoises an image, and estimates its error by leaving out folds in turn. The result is never
/// knowingly worse than the raw image: it is the mix with the smallest estimated error, or the raw
/// image if that has a smaller one. If the error is unknown, it is the raw image if its noise is
/// below 10 %. Light sources that pixels see are left as they are. `denoiser` denoises the radiance
/// of a window of the image.
///
/// # Errors
/// Those of the denoiser.
pub fn denoise(
    image: &CombinedImage,
    validation: Validation,
    mut denoiser: impl FnMut(Window, &[Rgb]) -> Result<Vec<Rgb>>,
) -> Result<Denoised> {
    let (raw, size) = (image.mean(), image.resolution());
    let whole = Window::whole(size);
    let seen = isolated_lights(image, whole, |_| true);
    let denoised = denoise_around(&seen, &raw, |rest| {
        denoiser(whole, &spread_rare_light(image, rest.to_vec()))
    })?;
    let weights = importance(&denoised);
    let squared_noise = |variance: Vec<f64>| -> Vec<f64> {
        variance.iter().zip(&weights).map(|(v, w)| v * w).collect()
    };
    let mean = |terms: &Vec<f64>| total(terms, |term| *term) / terms.len() as f64;
    let noise = image.variance_of_mean().map(squared_noise);
    let splits = [DENOISE_FOLDS, DENOISE_FOLDS / 2, 2];
    let splits = splits.into_iter().filter(|split| *split <= validation.folds);
    let folded = splits.filter_map(|split| FoldedImage::new(image, split)).next();
    let (Some(folded), Some(noise)) = (folded, &noise) else {
        let is_raw = noise.is_some_and(|noise| mean(&noise) < UNKNOWN_ERROR.powi(2));
        let image = if is_raw { raw } else { denoised };
        return Ok(Denoised { image, error: None, is_raw });
    };
    // The folds hold the merge bias. Its correction adds noise, which enlarges all errors.
    let growth = match image.bias_correction() {
        Some(_) => image
            .uncorrected_variance()
            .map_or(1.0, |uncorrected| (mean(noise) / mean(&squared_noise(uncorrected))).max(1.0)),
        None => 1.0,
    };
    let sample = Sample::new(size, &weights, noise, validation);
    let of_folds = sample.cross_validation(&folded, &mut denoiser)?;
    Ok(best_mix(raw, &denoised, &sample, &of_folds, growth))
}

/// The mix of a raw and a denoised image with the smallest estimated error. `growth` is the factor
/// by which the correction of the merge bias enlarges squared errors.
fn best_mix(
    raw: Vec<Rgb>,
    denoised: &[Rgb],
    sample: &Sample,
    of_folds: &CrossValidation,
    growth: f64,
) -> Denoised {
    let mix = sample.mix(of_folds);
    let unmixed = sample.estimate(of_folds);
    let raw_squared = sample.raw(of_folds);
    let mut delivered = of_folds.mixed(&mix);
    let mut error = sample.estimate(&delivered);
    // Rare light in one fold can mislead the mix.
    let is_unmixed = unmixed.squared <= error.squared;
    if is_unmixed {
        delivered = of_folds.clone();
        error = unmixed;
    }
    let is_raw = raw_squared <= error.squared;
    if is_raw {
        delivered = of_folds.of_raw();
        error = SquaredError { squared: raw_squared, ..sample.estimate(&delivered) };
    }
    let raw_share = match sample.tiles() {
        _ if is_raw => vec![1.0; raw.len()],
        _ if is_unmixed => vec![0.0; raw.len()],
        Some(_) => vec![mix.shares[0]; raw.len()],
        None => mix.shares.clone(),
    };
    let map = sample.map(&delivered);
    let image = if is_raw { raw } else { mixed(&raw, denoised, &raw_share) };
    let error = DenoisedError {
        whole: ErrorSummary {
            squared: growth * error.squared,
            standard_error: growth * error.standard_error,
            unmixed: growth * unmixed.squared,
            unmixed_error: growth * unmixed.standard_error,
            raw: growth * raw_squared,
            raw_share: total(&raw_share, |share| f64::from(*share)) / raw_share.len() as f64,
            worse: mix.worse,
            folds: of_folds.fold_count(),
            tiles: sample.tiles(),
        },
        map: map.iter().map(|rms| rms * growth.sqrt() as f32).collect(),
        raw_share,
    };
    Denoised { image, error: Some(error), is_raw }
}

/// Weights of squared errors from the luminance of an image: `1/(L_p^2 + 0.01 mean(L)^2)`.
pub fn importance(image: &[Rgb]) -> Vec<f64> {
    let luminance: Vec<f64> =
        image.iter().map(|value| bdpm_core::film::radiance::luminance(value.as_dvec3())).collect();
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
        if !error.map.is_empty() {
            layers.push(one("denoised_error", &error.map));
        }
        layers.push(one("denoised_mix", &error.raw_share));
    }
    layers
}
