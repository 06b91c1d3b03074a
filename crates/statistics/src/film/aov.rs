//! Layers beside the image (arbitrary output variables): which are kept, and their values.

use super::features::{DenoiseFeatures, DepthSample};
use super::folds::DENOISE_FOLDS;
use super::light_components::LightComponents;
use bdpm_base::math::Rgb;
use serde::{Deserialize, Serialize};

/// Statistics that are kept for layers beside the image and for the denoiser.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct AovSelection {
    /// Emission, direct light and caustics: [`LightComponents`].
    pub light: bool,
    /// Albedo, normal, position and depth: [`DenoiseFeatures`].
    pub features: bool,
    /// Radiance, albedo and normal of each of [`DENOISE_FOLDS`] folds of the iterations.
    pub folds: bool,
    /// Luminance of both halves of the iterations, for an audit of an image that keeps its merge
    /// bias.
    pub halves: bool,
}

impl AovSelection {
    /// Memory per pixel beside the sums, for the denoiser. Layers are written row by row.
    #[inline]
    pub fn output_bytes_per_pixel(self) -> usize {
        // Luminance of each fold and of the others, their moments, and the denoiser's workspace.
        if self.folds { DENOISE_FOLDS * 5 * size_of::<f64>() + 400 } else { 0 }
    }

    /// Whether camera paths must record any layer.
    #[inline]
    pub fn any(self) -> bool {
        self.light || self.features || self.folds
    }
}

/// Values of all layers of one pixel, from one camera path or one iteration.
#[derive(Clone, Copy, Debug, Default)]
pub struct AovSample {
    /// Light by component.
    pub light: LightComponents,
    /// Albedo and normal for the denoiser.
    pub denoise: DenoiseFeatures,
    /// Emission of `light` by paths that hit a surface: without the sky behind all surfaces.
    pub seen: Rgb,
    /// Position and depth of the first surface.
    pub first_hit: DepthSample,
}

impl AovSample {
    /// Adds `other` times `weight`.
    #[inline]
    pub fn add(&mut self, other: &Self, weight: f64) {
        self.light.add(&other.light, weight);
        self.denoise.add(&other.denoise, weight as f32);
        self.seen += other.seen * weight as f32;
        self.first_hit.add(&other.first_hit, weight);
    }

    /// Whether all values are finite.
    #[inline]
    pub fn is_finite(&self) -> bool {
        let Self { light, denoise, seen, first_hit } = self;
        light.emission.is_finite()
            && seen.is_finite()
            && light.direct.is_finite()
            && light.caustics.is_finite()
            && denoise.albedo.is_finite()
            && denoise.normal.is_finite()
            && first_hit.position.is_finite()
            && first_hit.depth.is_finite()
    }
}
