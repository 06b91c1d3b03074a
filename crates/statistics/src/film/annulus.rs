//! Contribution of photons in the outer annulus of the merge disc, between half the radius and the
//! radius. Its moments separate the merge bias of each pixel from its noise: theory.md, section
//! 17a.

use super::folds::FoldedStatistic;
use super::radiance::luminance;
use super::statistic::{PixelSample, StatisticRequest};
use super::tiled_buffer::Accumulate;
use crate::settings::{Kernel, Settings};
use bdpm_base::math::Rgb;
use bytemuck::Zeroable;
use serde::{Deserialize, Serialize};

/// Photon classes, each with its own merge radius.
pub const CLASSES: usize = 2;

/// Folds of the iterations: the bias that is estimated from one fold is subtracted from the other.
pub const FOLDS: usize = 2;

/// Sums over iterations of the contribution of one photon class.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Zeroable)]
pub struct AnnulusMoments {
    /// Sum of the radiance from the annulus, W/(m^2 sr).
    pub sum: Rgb,
    /// Sum of the square of its luminance.
    pub squares: f32,
    /// Sum of the product of its luminance and the luminance of the pixel's value.
    pub products: f32,
}

/// Sums over the iterations of one fold, of a pixel or of the mean over a cell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Zeroable)]
pub struct FoldSums {
    /// Sum of the luminance of the pixel's value, W/(m^2 sr).
    pub value: f32,
    /// Moments of the annulus, by photon class.
    pub classes: [AnnulusMoments; CLASSES],
}

impl Accumulate for FoldSums {
    const BY_CELL: bool = true;

    #[inline]
    fn add_sample(&mut self, sample: &PixelSample) {
        // Without photons there is no annulus, but the value still tells the folds apart.
        let annulus = sample.annulus.unwrap_or_default();
        if !annulus.iter().all(|radiance| radiance.is_finite()) {
            return;
        }
        let value = luminance(sample.value);
        self.value += value as f32;
        for (moments, radiance) in self.classes.iter_mut().zip(annulus) {
            let own = luminance(radiance);
            moments.sum += radiance.as_vec3();
            moments.squares += (own * own) as f32;
            moments.products += (own * value) as f32;
        }
    }

    #[inline]
    fn merge(&mut self, other: &Self) {
        self.value += other.value;
        for (own, other) in self.classes.iter_mut().zip(&other.classes) {
            own.sum += other.sum;
            own.squares += other.squares;
            own.products += other.products;
        }
    }
}

/// Typical merge bias at half the radius, relative to the contribution of the annulus, by photon
/// class.
///
/// Caustics have edges. The share of a disc beyond a straight edge at the distance `s r` is
/// `F(s) = (acos s - s sqrt(1 - s^2))/pi`. The mean squares over all `s` of the bias at the radius,
/// of the annulus, and at half the radius are then as .0681 to .0157 to .0341. The last over the
/// second is 1.47 squared, the first over the second `(1 + 1.08)` squared: the value is between.
/// That of the disc kernel is fitted to renders with known bias. A disc at a distance of less than
/// the radius from an edge loses a part that does not depend on the radius. The other value follows
/// from `TYPICAL_FALL` of the settings.
///
/// Where there is a cache, its bias takes the place of that of diffuse photons: the value is its
/// typical bias within the squares whose mean is measured, over that mean.
#[inline]
pub fn left_at_half(kernel: Kernel, has_cache: bool) -> [f64; CLASSES] {
    let [caustic, diffuse] = match kernel {
        Kernel::Area => [1.2, 0.547],
        Kernel::Disc => [0.7, 1.2],
    };
    [caustic, if has_cache { LEFT_BY_CACHE } else { diffuse }]
}

/// Typical bias of a cache within the squares whose mean is measured, over that mean.
const LEFT_BY_CACHE: f64 = 0.5;

impl FoldedStatistic for FoldSums {
    fn folds(request: &StatisticRequest) -> usize {
        if request.settings.corrects_bias() { FOLDS } else { 0 }
    }

    fn is_possible(folds: usize, settings: &Settings) -> bool {
        folds == if settings.corrects_bias() { FOLDS } else { 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn annulus_that_is_not_finite_is_left_out() {
        let mut sums = FoldSums::default();
        let value = DVec3::splat(2.0);
        for annulus in [[DVec3::splat(0.5), DVec3::ZERO], [DVec3::NAN, DVec3::ONE]] {
            sums.add_sample(&PixelSample { value, annulus: Some(annulus), aovs: None });
        }
        assert_eq!(sums.value, 2.0);
        let AnnulusMoments { sum, squares, products } = sums.classes[0];
        assert_eq!((sum.x, squares, products), (0.5, 0.25, 1.0));
        assert_eq!(sums.classes[1], AnnulusMoments::default());
    }
}
