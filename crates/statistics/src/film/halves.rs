//! Luminance of both halves of the iterations, for an audit of the image: theory.md, section 22b.

use super::folds::FoldedStatistic;
use super::radiance::luminance;
use super::statistic::{PixelSample, StatisticRequest};
use super::tiled_buffer::Accumulate;
use crate::settings::Settings;
use bytemuck::Zeroable;
use serde::{Deserialize, Serialize};

/// Number of halves.
pub const HALVES: usize = 2;

/// Sum of the luminance of a pixel, or of the mean over a cell, W/(m^2 sr).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Zeroable)]
pub struct LuminanceSum(pub f32);

impl Accumulate for LuminanceSum {
    const BY_CELL: bool = true;

    #[inline]
    fn add_sample(&mut self, sample: &PixelSample) {
        self.0 += luminance(sample.value) as f32;
    }

    #[inline]
    fn merge(&mut self, other: &Self) {
        self.0 += other.0;
    }
}

impl FoldedStatistic for LuminanceSum {
    fn folds(request: &StatisticRequest) -> usize {
        if request.aovs.halves { HALVES } else { 0 }
    }

    fn is_possible(folds: usize, _settings: &Settings) -> bool {
        [0, HALVES].contains(&folds)
    }
}
