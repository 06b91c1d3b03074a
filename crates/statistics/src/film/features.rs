//! Geometry and albedo of the surfaces in each pixel.

use super::aov::AovSelection;
use super::folds::{DENOISE_FOLDS, FoldedBuffer, FoldedStatistic};
use super::light_components::is_large;
use super::statistic::{PixelSample, StatisticRequest};
use super::tiled_buffer::Accumulate;
use crate::settings::Settings;
use bdpm_base::math::Rgb;
use bytemuck::Zeroable;
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

/// Depth of a pixel in which no camera path hits a surface, as compositing programs expect it.
pub const FAR: f32 = 1e10;

/// Sums of the denoiser's auxiliary features, from the first surface that is neither a mirror nor
/// clear glass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Zeroable)]
pub struct DenoiseFeatures {
    /// Albedo, times the tint of the mirrors and glass before the surface.
    pub albedo: Rgb,
    /// Unit shading normal on the visible side, in world space.
    pub normal: Vec3,
}

impl DenoiseFeatures {
    /// Adds `other` times `weight`.
    #[inline]
    pub fn add(&mut self, other: &Self, weight: f32) {
        self.albedo += other.albedo * weight;
        self.normal += other.normal * weight;
    }
}

impl Accumulate for DenoiseFeatures {
    #[inline]
    fn add_sample(&mut self, sample: &PixelSample) {
        if let Some(aovs) = &sample.aovs {
            self.add(&aovs.denoise, 1.0);
        }
    }

    #[inline]
    fn merge(&mut self, other: &Self) {
        self.add(other, 1.0);
    }
}

/// Values of position and depth of the first surface, whatever its material.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Zeroable)]
pub struct DepthSample {
    /// Position in world space, scene units.
    pub position: DVec3,
    /// Distance along the camera's axis, scene units.
    pub depth: f64,
    /// Fraction of the camera paths that hit a surface.
    pub hits: f64,
}

impl DepthSample {
    /// Adds `other` times `weight`.
    #[inline]
    pub fn add(&mut self, other: &Self, weight: f64) {
        self.position += other.position * weight;
        self.depth += other.depth * weight;
        self.hits += other.hits * weight;
    }
}

impl Accumulate for DepthSample {
    #[inline]
    fn add_sample(&mut self, sample: &PixelSample) {
        if let Some(aovs) = &sample.aovs {
            self.add(&aovs.first_hit, 1.0);
        }
    }

    #[inline]
    fn merge(&mut self, other: &Self) {
        self.add(other, 1.0);
    }
}

/// Sums of [`DepthSample`] in single precision, for large images: 20 bytes per pixel instead of 40.
/// They have few iterations, so that rounding errors do not add up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Zeroable)]
pub struct CompactDepth {
    position: Vec3,
    depth: f32,
    hits: f32,
}

impl Accumulate for CompactDepth {
    #[inline]
    fn add_sample(&mut self, sample: &PixelSample) {
        if let Some(aovs) = &sample.aovs {
            self.position += aovs.first_hit.position.as_vec3();
            self.depth += aovs.first_hit.depth as f32;
            self.hits += aovs.first_hit.hits as f32;
        }
    }

    #[inline]
    fn merge(&mut self, other: &Self) {
        self.position += other.position;
        self.depth += other.depth;
        self.hits += other.hits;
    }
}

impl From<CompactDepth> for DepthSample {
    #[inline]
    fn from(CompactDepth { position, depth, hits }: CompactDepth) -> Self {
        Self { position: position.as_dvec3(), depth: depth.into(), hits: hits.into() }
    }
}

impl FoldedStatistic for CompactDepth {
    fn folds(request: &StatisticRequest) -> usize {
        let is_kept = request.aovs.features || request.aovs.folds;
        usize::from(is_kept && is_large(request.settings))
    }

    fn is_possible(folds: usize, settings: &Settings) -> bool {
        folds <= usize::from(is_large(settings))
    }
}

impl FoldedStatistic for DenoiseFeatures {
    fn folds(request: &StatisticRequest) -> usize {
        match request.aovs {
            AovSelection { folds: true, .. } => DENOISE_FOLDS,
            AovSelection { features, .. } => usize::from(features),
        }
    }

    fn is_possible(folds: usize, _settings: &Settings) -> bool {
        [0, 1, DENOISE_FOLDS].contains(&folds)
    }
}

impl FoldedStatistic for DepthSample {
    fn folds(request: &StatisticRequest) -> usize {
        let is_kept = request.aovs.features || request.aovs.folds;
        usize::from(is_kept && !is_large(request.settings))
    }

    fn is_possible(folds: usize, settings: &Settings) -> bool {
        folds <= usize::from(!is_large(settings))
    }
}

/// Features of each fold of the iterations, or of all.
pub type FeatureFolds = FoldedBuffer<DenoiseFeatures>;

impl FeatureFolds {
    /// Whether the features of [`DENOISE_FOLDS`] folds are kept.
    #[inline]
    pub fn is_folded(&self) -> bool {
        self.folds().len() == DENOISE_FOLDS
    }

    /// Mean features of one pixel over the `included` folds; `at` is its index in tile order.
    pub fn mean(&self, at: usize, included: impl Fn(usize) -> bool) -> DenoiseFeatures {
        let (mut sum, mut count) = (DenoiseFeatures::default(), 0);
        let folds = self.at(at).zip(self.iterations()).enumerate();
        for (_, (sums, iterations)) in folds.filter(|(fold, _)| included(*fold)) {
            sum.merge(sums);
            count += iterations;
        }
        let scale = (count.max(1) as f32).recip();
        DenoiseFeatures { albedo: sum.albedo * scale, normal: sum.normal * scale }
    }
}

impl<T: Copy + Into<DepthSample>> FoldedBuffer<T> {
    /// Fraction of one pixel's camera paths that hit a surface; `at` is its index in tile order.
    #[inline]
    pub fn coverage(&self, at: usize) -> f32 {
        let sums: DepthSample = self.folds()[0].values()[at].into();
        (sums.hits / self.total().max(1) as f64) as f32
    }

    /// Mean position and depth over the camera paths of one pixel that hit a surface; depth is
    /// [`FAR`] if none does.
    #[inline]
    pub fn mean_hit(&self, at: usize) -> (Vec3, f32) {
        let DepthSample { position, depth, hits } = self.folds()[0].values()[at].into();
        if hits > 0.0 {
            ((position / hits).as_vec3(), (depth / hits) as f32)
        } else {
            (Vec3::ZERO, FAR)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::aov::AovSample;
    use crate::film::statistic::{BatchGrain, CurrentIteration, PixelStatistic, StatisticTile};
    use crate::settings::PartialSettings;

    #[test]
    fn features_are_means_over_hits_and_iterations() {
        let partial = PartialSettings { resolution: Some([20, 3]), ..Default::default() };
        let settings = &Settings::resolve(&partial, &Default::default(), 1.0).unwrap();
        for folds in [false, true] {
            let aovs = AovSelection { features: true, folds, light: false, halves: false };
            let grain = BatchGrain::Tile;
            let request = StatisticRequest {
                settings,
                aovs,
                grain,
                measured_before: None,
                independent_paths: false,
            };
            let mut features = FoldedBuffer::<DenoiseFeatures>::start(&request).unwrap();
            let mut first_hits = FoldedBuffer::<DepthSample>::start(&request).unwrap();
            for number in 0..11 {
                let iteration = CurrentIteration { number, is_measured: false };
                let albedo = Rgb::splat(number as f32);
                let denoise = DenoiseFeatures { albedo, normal: Vec3::X };
                let hits = f64::from(u8::from(number > 5));
                let first_hit = DepthSample { position: DVec3::Y * hits, depth: 3.0 * hits, hits };
                let aovs = Some(AovSample { denoise, first_hit, ..AovSample::default() });
                let sample = PixelSample { aovs, ..PixelSample::default() };
                features.tiles_mut(iteration)[0].add_sample(1, &sample);
                first_hits.tiles_mut(iteration)[0].add_sample(1, &sample);
                features.end_iteration(iteration);
                first_hits.end_iteration(iteration);
            }
            let DenoiseFeatures { albedo, normal } = features.mean(1, |_| true);
            assert_eq!((albedo, normal), (Rgb::splat(5.0), Vec3::X));
            assert_eq!(first_hits.mean_hit(1), (Vec3::Y, 3.0));
            assert_eq!(first_hits.mean_hit(0), (Vec3::ZERO, FAR));
            assert_eq!((first_hits.coverage(0), first_hits.coverage(1)), (0.0, 5.0 / 11.0));
            assert_eq!(features.is_folded(), folds);
            if folds {
                let one = features.mean(1, |fold| fold == 2);
                assert_eq!(one.albedo, Rgb::splat(6.0));
            }
        }
    }
}
