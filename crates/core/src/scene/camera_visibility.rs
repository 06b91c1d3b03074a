//! Surfaces that are invisible to the camera, but visible in mirrors and through glass.

use super::Scene;
use crate::accel::packet::used;
use crate::accel::{Hit, HitPacket, Intersect, Ray, RayPacket, next_after};

impl Scene {
    /// Returns true if any material is hidden from the camera.
    pub fn has_hidden_materials(&self) -> bool {
        self.materials.iter().any(|material| material.hidden_from_camera)
    }

    fn is_hidden(&self, hit: &Hit) -> bool {
        let material = self.placements[hit.mesh as usize].material;
        self.materials[material as usize].hidden_from_camera
    }

    /// The first hit of a camera ray, from its closest hit `hit` on, that the camera sees.
    pub fn first_visible(&self, accel: &dyn Intersect, ray: &Ray, mut hit: Hit) -> Hit {
        let mut step = f32::EPSILON;
        while !hit.is_miss() && self.is_hidden(&hit) {
            (hit, step) = next_after(accel, ray, &hit, step);
        }
        hit
    }

    /// [`Self::first_visible`] for the first `count` rays.
    pub fn skip_hidden(
        &self,
        accel: &dyn Intersect,
        rays: &[RayPacket],
        count: usize,
        hits: &mut [HitPacket],
    ) {
        for ((rays, hits), lanes) in rays.iter().zip(hits).zip(used(count, rays.len())) {
            for lane in lanes {
                let hit = self.first_visible(accel, &rays.get(lane), hits.get(lane));
                hits.set(lane, &hit);
            }
        }
    }
}
