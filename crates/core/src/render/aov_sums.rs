//! Sums of the layers over the camera paths of each pixel, during one iteration.

use super::worker::Job;
use crate::base::math::Rgb;
use crate::film::aov::AovSample;
use crate::film::features::{DenoiseFeatures, DepthSample};
use crate::film::light_components::LightComponents;
use crate::settings::Direct;
use crate::transport::camera_paths::{CameraPaths, PathAov};
use crate::transport::merge::MergeOutput;
use glam::DVec3;
use std::mem;

/// Adds camera paths to the layers of their pixels.
pub struct AovSums<'a> {
    /// One sum for each pixel; empty if no layer is kept.
    sums: &'a mut [AovSample],
    /// Whether direct light comes from the photon map, which stores it with the caustics.
    direct_is_gathered: bool,
    /// `1/N_F`.
    per_light_path: f64,
}

impl<'a> AovSums<'a> {
    /// Adds to `sums`.
    pub fn new(job: &Job, sums: &'a mut [AovSample]) -> Self {
        Self {
            sums,
            direct_is_gathered: job.pass.settings.direct == Direct::PhotonMap,
            per_light_path: job.per_light_path(),
        }
    }

    /// Adds the camera path `number` to its pixel.
    #[inline]
    pub fn add(
        &mut self,
        paths: &CameraPaths,
        gathered: &MergeOutput,
        number: usize,
        pixel: usize,
    ) {
        let Some(sum) = self.sums.get_mut(pixel) else { return };
        let PathAov { emission, direct, caustics, albedo, normal, position, depth, hits, .. } =
            paths.aovs[number];
        let merged = gathered.caustics.get(number).map_or(DVec3::ZERO, |own| own.as_dvec3());
        let mut light = LightComponents {
            emission: emission.as_dvec3(),
            direct: direct.as_dvec3(),
            caustics: merged * self.per_light_path,
        };
        if self.direct_is_gathered {
            light.direct += mem::take(&mut light.caustics);
        }
        light.caustics += caustics.as_dvec3();
        let seen = if hits { emission } else { Rgb::ZERO };
        let hits = f64::from(u8::from(hits));
        let denoise = DenoiseFeatures { albedo, normal };
        let first_hit = DepthSample { position: position.as_dvec3(), depth: depth.into(), hits };
        sum.add(&AovSample { light, denoise, seen, first_hit }, 1.0);
    }
}
