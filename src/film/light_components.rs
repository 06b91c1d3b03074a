//! Light of each pixel by component.

use super::folds::FoldedStatistic;
use super::statistic::{PixelSample, StatisticRequest};
use super::tiled_buffer::Accumulate;
use crate::settings::Settings;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Sums of radiance by component, W/(m^2 sr). Indirect light is the remainder of the pixel's value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
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

    fn merge(&mut self, other: &Self) {
        self.add(other, 1.0);
    }
}

impl FoldedStatistic for LightComponents {
    fn folds(request: &StatisticRequest) -> usize {
        usize::from(request.aovs.light)
    }

    fn is_possible(folds: usize, _settings: &Settings) -> bool {
        folds <= 1
    }
}
