//! What camera paths tell beside their light, summed up for their pixels.

use super::tiles::LayerTile;
use super::worker::Job;
use crate::film::aov::{Guide, LayerValue, LightComponents, Place};
use crate::settings::Direct;
use crate::transport::camera_paths::{CameraPaths, PathAov};
use crate::transport::merge::MergeOutput;
use glam::DVec3;
use std::mem;

/// Sums over the camera paths of each pixel of some tiles.
pub struct LayerSums<'a> {
    /// None if nothing is kept.
    values: &'a mut [LayerValue],
    /// Caustics of the camera paths that are merged together, where they are not told apart otherwise.
    alone: &'a mut MergeOutput,
    gathers_alone: bool,
    /// Whether light that comes straight from the lights is gathered with the caustics.
    direct_is_gathered: bool,
}

impl<'a> LayerSums<'a> {
    /// To be added to `values`, with room for caustics.
    pub fn new(job: &Job, values: &'a mut [LayerValue], alone: &'a mut MergeOutput) -> Self {
        let direct_is_gathered = job.pass.settings.direct == Direct::PhotonMap;
        let gathers_alone = job.kept.light && !job.merge.separates_caustics();
        Self { values, alone, gathers_alone, direct_is_gathered }
    }

    /// Gathers the caustics of these camera paths by themselves where that has to be.
    pub fn gather_caustics(&mut self, job: &Job, paths: &CameraPaths) {
        if self.gathers_alone {
            job.merge.caustics_only().gather(paths, self.alone);
        }
    }

    /// Adds one camera path to its pixel.
    #[inline]
    pub fn end_path(
        &mut self,
        (paths, gathered): (&CameraPaths, &MergeOutput),
        (number, pixel): (usize, usize),
        per_light_path: f64,
    ) {
        let Some(value) = self.values.get_mut(pixel) else { return };
        let PathAov { emission, direct, albedo, normal, position, depth, hits, .. } =
            paths.aovs[number];
        let caustics = if self.gathers_alone { &self.alone.caustics } else { &gathered.caustics };
        let caustics = caustics.get(number).map_or(DVec3::ZERO, |caustics| caustics.as_dvec3());
        let mut light = LightComponents {
            emission: emission.as_dvec3(),
            direct: direct.as_dvec3(),
            caustics: caustics * per_light_path,
        };
        if self.direct_is_gathered {
            light.direct += mem::take(&mut light.caustics);
        }
        let hits = f64::from(u8::from(hits));
        let place = Place { position: position.as_dvec3(), depth: depth.into(), hits };
        value.add(&LayerValue { light, guide: Guide { albedo, normal }, place }, 1.0);
    }
}

impl LayerTile<'_> {
    /// Adds an iteration to the pixel of this number within the tile: its value, and the sums over its camera paths.
    pub fn add(&mut self, pixel: usize, value: DVec3, sums: &LayerValue, camera_paths: u32) {
        let mut layers = LayerValue::default();
        layers.add(sums, f64::from(camera_paths).recip());
        if let Some(part) = &mut self.part {
            part.add(pixel, value);
        }
        if !layers.is_finite() {
            return;
        }
        if let Some(light) = &mut self.light {
            light[pixel].add(&layers.light, 1.0);
        }
        if let Some(features) = &mut self.features {
            features.add(pixel, &layers);
        }
    }
}
