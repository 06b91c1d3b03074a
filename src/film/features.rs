//! Geometry and albedo of the surfaces in each pixel.

use super::aov::AovSelection;
use super::folds::{DENOISE_FOLDS, FoldedBuffer};
use super::statistic::{
    CurrentIteration, PixelSample, PixelStatistic, StatisticRequest, StatisticTile,
};
use super::tiled_buffer::{Accumulate, TiledBuffer};
use crate::base::math::Rgb;
use crate::settings::Settings;
use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

/// Depth of a pixel in which no camera path hits a surface, as compositing programs expect it.
pub const FAR: f32 = 1e10;

/// Sums of the denoiser's auxiliary features, from the first surface that is neither a mirror nor
/// clear glass.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
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

    fn merge(&mut self, other: &Self) {
        self.add(other, 1.0);
    }
}

/// Sums of position and depth of the first surface, whatever its material.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
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

    fn merge(&mut self, other: &Self) {
        self.add(other, 1.0);
    }
}

/// Features of each pixel, over the iterations of all blocks: they do not depend on the path counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FeatureBuffers {
    /// One fold, or [`DENOISE_FOLDS`].
    denoise: FoldedBuffer<DenoiseFeatures>,
    first_hits: TiledBuffer<DepthSample>,
}

impl FeatureBuffers {
    /// Sums of no iteration in one fold or [`DENOISE_FOLDS`].
    pub fn new(resolution: (u32, u32), folds: usize) -> Self {
        let denoise = FoldedBuffer::new(resolution, folds);
        Self { denoise, first_hits: TiledBuffer::new(resolution) }
    }

    /// Whether the denoiser's features are kept by fold.
    pub fn is_folded(&self) -> bool {
        self.folds() == DENOISE_FOLDS
    }

    fn folds(&self) -> usize {
        self.denoise.folds().len()
    }

    /// Mean features of one pixel over the `included` folds; `at` is its index in tile order.
    pub fn denoise_features(&self, at: usize, included: impl Fn(usize) -> bool) -> DenoiseFeatures {
        let (mut sum, mut count) = (DenoiseFeatures::default(), 0);
        let folds = self.denoise.at(at).zip(self.denoise.iterations()).enumerate();
        for (_, (sums, iterations)) in folds.filter(|(fold, _)| included(*fold)) {
            sum.merge(sums);
            count += iterations;
        }
        let scale = (count.max(1) as f32).recip();
        DenoiseFeatures { albedo: sum.albedo * scale, normal: sum.normal * scale }
    }

    /// Fraction of one pixel's camera paths that hit a surface.
    pub fn coverage(&self, at: usize) -> f32 {
        let iterations: u64 = self.denoise.iterations().iter().sum();
        (self.first_hits.values()[at].hits / iterations.max(1) as f64) as f32
    }

    /// Mean position and depth over the camera paths of one pixel that hit a surface; depth is [`FAR`]
    /// if none does.
    pub fn first_hit(&self, at: usize) -> (Vec3, f32) {
        let DepthSample { position, depth, hits } = self.first_hits.values()[at];
        if hits > 0.0 {
            ((position / hits).as_vec3(), (depth / hits) as f32)
        } else {
            (Vec3::ZERO, FAR)
        }
    }
}

/// Features of one tile.
#[derive(Debug)]
pub struct FeatureTile<'a> {
    denoise: &'a mut [DenoiseFeatures],
    first_hits: &'a mut [DepthSample],
}

impl StatisticTile for FeatureTile<'_> {
    type Sample = PixelSample;

    #[inline]
    fn add_sample(&mut self, index: usize, sample: &PixelSample) {
        self.denoise.add_sample(index, sample);
        self.first_hits.add_sample(index, sample);
    }
}

impl PixelStatistic for FeatureBuffers {
    type Tile<'a> = FeatureTile<'a>;

    fn start(request: &StatisticRequest) -> Option<Self> {
        let folds = if request.aovs.folds { DENOISE_FOLDS } else { 1 };
        let is_kept = request.aovs.features || request.aovs.folds;
        is_kept.then(|| Self::new(request.settings.resolution(), folds))
    }

    fn bytes_per_pixel(request: &StatisticRequest) -> usize {
        let folds = match request.aovs {
            AovSelection { folds: true, .. } => DENOISE_FOLDS,
            AovSelection { features: true, .. } => 1,
            _ => return 0,
        };
        folds * size_of::<DenoiseFeatures>() + size_of::<DepthSample>()
    }

    fn fits(&self, settings: &Settings) -> bool {
        let resolution = settings.resolution();
        [1, DENOISE_FOLDS].contains(&self.folds())
            && self.denoise.fits(resolution, self.folds())
            && self.first_hits.fits(resolution)
    }

    fn tiles_mut(&mut self, iteration: CurrentIteration) -> Vec<FeatureTile<'_>> {
        let denoise = self.denoise.tiles_mut(iteration.number).into_iter();
        let tiles = denoise.zip(self.first_hits.tiles_mut());
        tiles.map(|(denoise, (_, first_hits))| FeatureTile { denoise, first_hits }).collect()
    }

    fn end_iteration(&mut self, iteration: CurrentIteration) {
        self.denoise.end_iteration(iteration.number);
    }

    fn can_merge(&self, other: &Self) -> bool {
        self.folds() == other.folds()
    }

    fn merge(&mut self, other: &Self) {
        self.denoise.merge(&other.denoise);
        self.first_hits.merge(&other.first_hits);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::aov::AovSample;

    #[test]
    fn features_are_means_over_hits_and_iterations() {
        for folds in [1, DENOISE_FOLDS] {
            let mut features = FeatureBuffers::new((20, 3), folds);
            for number in 0..11 {
                let iteration = CurrentIteration { number, is_measured: false };
                let albedo = Rgb::splat(number as f32);
                let denoise = DenoiseFeatures { albedo, normal: Vec3::X };
                let hits = f64::from(u8::from(number > 5));
                let first_hit = DepthSample { position: DVec3::Y * hits, depth: 3.0 * hits, hits };
                let aovs = Some(AovSample { denoise, first_hit, ..AovSample::default() });
                let sample = PixelSample { aovs, ..PixelSample::default() };
                for tile in &mut features.tiles_mut(iteration) {
                    tile.add_sample(1, &sample);
                }
                features.end_iteration(iteration);
            }
            let DenoiseFeatures { albedo, normal } = features.denoise_features(1, |_| true);
            assert_eq!((albedo, normal), (Rgb::splat(5.0), Vec3::X));
            assert_eq!(features.first_hit(1), (Vec3::Y, 3.0));
            assert_eq!(features.first_hit(0), (Vec3::ZERO, FAR));
            assert_eq!((features.coverage(0), features.coverage(1)), (0.0, 5.0 / 11.0));
            if features.is_folded() {
                let one = features.denoise_features(1, |fold| fold == 2);
                assert_eq!(one.albedo, Rgb::splat(6.0));
            }
        }
    }
}
