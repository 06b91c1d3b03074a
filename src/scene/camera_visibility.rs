//! What the camera itself does not see: lamps that are in mirrors, behind glass and in no image.

use super::Scene;
use crate::accel::packet::used;
use crate::accel::{Hit, HitPacket, Intersect, Ray, RayPacket, next_after};

impl Scene {
    /// Whether anything is hidden from the camera.
    pub fn has_hidden_materials(&self) -> bool {
        self.materials.iter().any(|material| material.hidden_from_camera)
    }

    fn is_hidden(&self, hit: &Hit) -> bool {
        let material = self.placements[hit.mesh as usize].material;
        self.materials[material as usize].hidden_from_camera
    }

    /// What a ray of the camera meets, of which `hit` is the closest hit.
    pub fn first_visible(&self, accel: &dyn Intersect, ray: &Ray, mut hit: Hit) -> Hit {
        let mut step = f32::EPSILON;
        while !hit.is_miss() && self.is_hidden(&hit) {
            (hit, step) = next_after(accel, ray, &hit, step);
        }
        hit
    }

    /// The same for the first `count` rays.
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
