//! What the camera itself does not see: lamps that are in mirrors, behind glass and in no image.

use super::Scene;
use crate::accel::packet::used;
use crate::accel::{Hit, HitPacket, Intersect, Ray, RayPacket, next_after};

impl Scene {
    /// Whether anything is hidden from the camera.
    pub fn hides(&self) -> bool {
        self.materials.iter().any(|material| material.hidden)
    }

    fn is_hidden(&self, hit: &Hit) -> bool {
        let material = self.placements[hit.mesh as usize].material;
        self.materials[material as usize].hidden
    }

    /// What a ray of the camera meets, of which `hit` is the closest hit.
    pub fn first_seen(&self, accel: &dyn Intersect, ray: &Ray, mut hit: Hit) -> Hit {
        let mut step = f32::EPSILON;
        while !hit.is_miss() && self.is_hidden(&hit) {
            (hit, step) = next_after(accel, ray, &hit, step);
        }
        hit
    }

    /// The same for the first `count` rays.
    pub fn pass_hidden(
        &self,
        accel: &dyn Intersect,
        rays: &[RayPacket],
        count: usize,
        hits: &mut [HitPacket],
    ) {
        for ((rays, hits), lanes) in rays.iter().zip(hits).zip(used(count, rays.len())) {
            for lane in lanes {
                let hit = self.first_seen(accel, &rays.get(lane), hits.get(lane));
                hits.set(lane, &hit);
            }
        }
    }
}
