//! The pixels in which the error of a denoised image is estimated: all, or those of some tiles.

use super::{
    CrossValidation, FoldedImage, Mix, SampledTile, SquaredError, Validation, Window, sample_tiles,
};
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;

/// The sample of an image.
pub(super) struct Sample {
    /// Resolution of the image.
    size: (u32, u32),
    /// The sampled tiles; `None` if the sample is the whole image.
    tiles: Option<Vec<SampledTile>>,
    /// Weights of the squared errors of the sampled pixels.
    weights: Vec<f64>,
}

impl Sample {
    /// The sample for an image whose pixels have these weights and this squared noise.
    pub fn new(
        size: (u32, u32),
        weights: &[f64],
        noise: &[f64],
        Validation { tiles, seed, .. }: Validation,
    ) -> Self {
        let tiles = tiles.map(|n| sample_tiles(size, noise, n, seed));
        let weights = tiles
            .as_ref()
            .map_or_else(|| weights.to_vec(), |tiles| weights_of_tiles(tiles, weights, size.0));
        Self { size, tiles, weights }
    }

    /// Leaves out each fold in turn.
    ///
    /// # Errors
    /// Those of the denoiser.
    pub fn cross_validation(
        &self,
        folded: &FoldedImage,
        denoiser: &mut impl FnMut(Window, &[Rgb]) -> Result<Vec<Rgb>>,
    ) -> Result<CrossValidation> {
        match &self.tiles {
            Some(tiles) => CrossValidation::of_tiles(folded, tiles, denoiser),
            None => CrossValidation::new(folded, denoiser),
        }
    }

    /// The mix with the smallest error: one share for all pixels if only tiles are sampled.
    pub fn mix(&self, of_folds: &CrossValidation) -> Mix {
        Mix::new(of_folds, &self.weights, self.tiles.is_none().then_some(self.size))
    }

    /// Squared error of the images without a fold, with a standard error.
    pub fn estimate(&self, of_folds: &CrossValidation) -> SquaredError {
        let mut estimate = of_folds.estimate(&self.weights);
        if let Some(tiles) = &self.tiles {
            let between = variance_between_tiles(of_folds, tiles, &self.weights);
            estimate.standard_error = estimate.standard_error.hypot(between.sqrt());
        }
        estimate
    }

    /// Squared error of the raw image.
    pub fn raw(&self, of_folds: &CrossValidation) -> f64 {
        of_folds.raw(&self.weights)
    }

    /// RMS error of each pixel as luminance; empty if only tiles are sampled.
    pub fn map(&self, of_folds: &CrossValidation) -> Vec<f32> {
        if self.tiles.is_none() { of_folds.map(self.size) } else { Vec::new() }
    }

    /// Number of sampled tiles; `None` if the sample is the whole image.
    pub fn tiles(&self) -> Option<usize> {
        self.tiles.as_ref().map(Vec::len)
    }
}

/// Weights of the pixels of the cores, so that weighted means over them are estimates of those over
/// the whole image.
fn weights_of_tiles(tiles: &[SampledTile], weights: &[f64], image_width: u32) -> Vec<f64> {
    let sampled = tiles.iter().map(|tile| tile.core.len()).sum::<usize>();
    let scale = sampled as f64 / weights.len() as f64;
    let of_tile = |tile: &SampledTile| {
        let factor = scale * tile.factor;
        let pixels = tile.core.indices(image_width);
        pixels.map(move |index| factor * weights[index]).collect::<Vec<f64>>()
    };
    tiles.iter().flat_map(of_tile).collect()
}

/// Variance of the mean over sampled tiles, by the spread of their terms as if they were drawn
/// independently. It is too large for a systematic sample.
fn variance_between_tiles(
    of_folds: &CrossValidation,
    tiles: &[SampledTile],
    weights: &[f64],
) -> f64 {
    let (mut start, mut terms) = (0, Vec::new());
    for tile in tiles {
        let pixels = start..start + tile.core.len();
        start = pixels.end;
        terms.push(pixels.map(|pixel| weights[pixel] * of_folds.squared(pixel)).sum::<f64>());
    }
    let n = terms.len() as f64;
    let mean = terms.iter().sum::<f64>() / n;
    let spread: f64 = terms.iter().map(|term| (term - mean).powi(2)).sum();
    if n > 1.0 { spread * n / (n - 1.0) / (weights.len() as f64).powi(2) } else { f64::INFINITY }
}
