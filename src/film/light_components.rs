//! Light of each pixel by component.

use super::statistic::{CurrentIteration, PixelSample, PixelStatistic, StatisticRequest};
use super::tiled_buffer::{Accumulate, TiledBuffer};
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

impl PixelStatistic for TiledBuffer<LightComponents> {
    type Tile<'a> = &'a mut [LightComponents];

    fn start(request: &StatisticRequest) -> Option<Self> {
        request.aovs.light.then(|| Self::new(request.settings.resolution()))
    }

    fn bytes_per_pixel(request: &StatisticRequest) -> usize {
        if request.aovs.light { size_of::<LightComponents>() } else { 0 }
    }

    fn fits(&self, settings: &Settings) -> bool {
        self.fits(settings.resolution())
    }

    fn tiles_mut(&mut self, _iteration: CurrentIteration) -> Vec<&mut [LightComponents]> {
        self.tiles_mut().into_iter().map(|(_, sums)| sums).collect()
    }

    fn end_iteration(&mut self, _iteration: CurrentIteration) {}

    fn merge(&mut self, other: &Self) {
        self.merge(other);
    }
}
