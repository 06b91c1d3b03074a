//! Light sources that pixels see, which a denoiser must not spread.
//!
//! A flame in the edge of a pixel is a thousand times as bright as the wall behind it. It is known
//! without noise but for how much of the pixel it covers, so that it is taken from the image before
//! denoising, and added again.

use super::folds::{DENOISE_FOLDS, FoldedStatistic};
use super::statistic::{PixelSample, StatisticRequest};
use super::tiled_buffer::Accumulate;
use crate::settings::Settings;
use bdpm_base::math::Rgb;
use bytemuck::Zeroable;
use serde::{Deserialize, Serialize};

/// Sum of the emission of surfaces that a pixel sees directly, or through mirrors and clear glass
/// only, W/(m^2 sr). Zeros are not written: parts of the image that see no light source take no
/// memory of the system.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Zeroable)]
pub struct SeenLight(Rgb);

impl SeenLight {
    /// The sum.
    #[inline]
    pub fn radiance(&self) -> Rgb {
        self.0
    }

    #[inline]
    fn add(&mut self, light: Rgb) {
        if light != Rgb::ZERO {
            self.0 += light;
        }
    }
}

impl Accumulate for SeenLight {
    #[inline]
    fn add_sample(&mut self, sample: &PixelSample) {
        if let Some(aovs) = &sample.aovs {
            self.add(aovs.seen);
        }
    }

    #[inline]
    fn merge(&mut self, other: &Self) {
        self.add(other.0);
    }
}

impl FoldedStatistic for SeenLight {
    /// Part of the pixels that see light sources, at most, for the memory of an image.
    const WRITTEN: f64 = 0.25;

    fn folds(request: &StatisticRequest) -> usize {
        if request.aovs.folds { DENOISE_FOLDS } else { 0 }
    }

    fn is_possible(folds: usize, _settings: &Settings) -> bool {
        [0, DENOISE_FOLDS].contains(&folds)
    }
}
