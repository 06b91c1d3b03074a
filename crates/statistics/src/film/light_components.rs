//! Light of each pixel by component, in one of two representations.
//!
//! Images of up to [`MAX_CELLS`](super::cells::MAX_CELLS) pixels keep [`LightComponents`] in each
//! block, in double precision: 72 bytes per pixel and block. Blocks are weighted when they are
//! combined, and an image may have millions of iterations, whose rounding errors would add up in
//! single precision. Larger images keep [`CompactLight`] once for all blocks: at most 36 bytes per
//! pixel, and none where there is no such light. Their iterations are few. One representation does
//! not serve both: the first would take gigabytes for the blocks of a large image, and shares of
//! unweighted sums are not the components of a weighted mean that other images have.

use super::cells::CellGrid;
use super::folds::FoldedStatistic;
use super::statistic::{PixelSample, StatisticRequest};
use super::tiled_buffer::Accumulate;
use crate::settings::Settings;
use bdpm_base::math::Rgb;
use bytemuck::Zeroable;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Sums of radiance by component, W/(m^2 sr). Indirect light is the remainder of the pixel's value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Zeroable)]
pub struct LightComponents {
    /// Light sources, seen directly or through mirrors and clear glass only.
    pub emission: DVec3,
    /// Light of one bounce off a surface that is neither a mirror nor clear glass.
    pub direct: DVec3,
    /// Light of one such bounce that reached the surface through mirrors or glass.
    pub caustics: DVec3,
}

impl LightComponents {
    /// Adds `other` times `weight`.
    #[inline]
    pub fn add(&mut self, other: &Self, weight: f64) {
        self.emission += other.emission * weight;
        self.direct += other.direct * weight;
        self.caustics += other.caustics * weight;
    }
}

impl Accumulate for LightComponents {
    #[inline]
    fn add_sample(&mut self, sample: &PixelSample) {
        if let Some(aovs) = &sample.aovs {
            self.add(&aovs.light, 1.0);
        }
    }

    #[inline]
    fn merge(&mut self, other: &Self) {
        self.add(other, 1.0);
    }
}

impl FoldedStatistic for LightComponents {
    fn folds(request: &StatisticRequest) -> usize {
        usize::from(request.aovs.light && !is_large(request.settings))
    }

    fn is_possible(folds: usize, settings: &Settings) -> bool {
        folds <= usize::from(!is_large(settings))
    }
}

/// Emission, as the kind of a [`CompactLight`].
pub const EMISSION: usize = 0;
/// Direct light, as the kind of a [`CompactLight`].
pub const DIRECT: usize = 1;
/// Caustics, as the kind of a [`CompactLight`].
pub const CAUSTICS: usize = 2;

/// One component of a large image, over the iterations of all blocks in single precision. Only its
/// share in the unweighted sum of the pixel's values is used, so that the weights of the blocks do
/// not matter.
///
/// Each component has memory of its own, which the system provides where it is first written. Parts
/// of the image without emission or caustics take none for them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Zeroable)]
pub struct CompactLight<const KIND: usize>(Rgb);

impl<const KIND: usize> CompactLight<KIND> {
    /// The component of a pixel of this mean value, from the sum of all values of the pixel.
    #[inline]
    pub fn component(&self, sum: DVec3, mean: DVec3) -> DVec3 {
        // A channel without any light has no shares.
        mean * DVec3::select(sum.cmpgt(DVec3::ZERO), self.0.as_dvec3() / sum, DVec3::ZERO)
    }

    /// Adds light, but does not write zeros.
    #[inline]
    fn add(&mut self, light: Rgb) {
        if light != Rgb::ZERO {
            self.0 += light;
        }
    }
}

impl<const KIND: usize> Accumulate for CompactLight<KIND> {
    #[inline]
    fn add_sample(&mut self, sample: &PixelSample) {
        if let Some(aovs) = &sample.aovs {
            let LightComponents { emission, direct, caustics } = aovs.light;
            self.add([emission, direct, caustics][KIND].as_vec3());
        }
    }

    #[inline]
    fn merge(&mut self, other: &Self) {
        self.add(other.0);
    }
}

impl<const KIND: usize> FoldedStatistic for CompactLight<KIND> {
    fn folds(request: &StatisticRequest) -> usize {
        usize::from(request.aovs.light && is_large(request.settings))
    }

    fn is_possible(folds: usize, settings: &Settings) -> bool {
        folds <= usize::from(is_large(settings))
    }
}

/// Whether layers are kept in single precision.
#[inline]
pub(super) fn is_large(settings: &Settings) -> bool {
    !CellGrid::of(settings.resolution()).is_single_pixels()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_of_compact_light_add_up_to_the_mean() {
        let (sum, mean) = (DVec3::new(4.0, 4.0, 0.0), DVec3::new(0.5, 0.25, 0.0));
        let emission = CompactLight::<EMISSION>(Rgb::new(1.0, 0.0, 0.0)).component(sum, mean);
        let direct = CompactLight::<DIRECT>(Rgb::new(2.0, 3.0, 0.0)).component(sum, mean);
        let caustics = CompactLight::<CAUSTICS>(Rgb::new(1.0, 1.0, 0.0)).component(sum, mean);
        assert_eq!(emission + direct + caustics, mean);
        assert_eq!(direct, DVec3::new(0.25, 0.1875, 0.0));
    }
}
