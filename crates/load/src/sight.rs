//! Lines of sight, which pass glass as if it were air.

use bdpm_core::accel::{Intersect, Ray};
use bdpm_core::scene::Scene;
use glam::Vec3;

/// Maximum number of glass surfaces that a line of sight passes.
const PANES: u32 = 16;

/// What can be seen in a scene.
pub(super) struct Sight<'a> {
    pub scene: &'a Scene,
    pub accel: &'a dyn Intersect,
}

impl Sight<'_> {
    /// Distance along a ray to the first surface that is not glass, in lengths of its direction;
    /// infinite if there is none.
    pub fn along(&self, mut ray: Ray) -> f32 {
        for _ in 0..PANES {
            let hit = self.accel.closest_hit(&ray);
            if hit.is_miss() {
                return f32::INFINITY;
            }
            let material = self.scene.placements()[hit.mesh as usize].material;
            if !self.scene.materials()[material as usize].bsdf.transmits() {
                return hit.t;
            }
            ray.t_near = (hit.t * (1.0 + 1e-5)).max(f32::MIN_POSITIVE);
        }
        ray.t_near
    }

    /// Distance along a unit vector to the first surface that is not glass, scene units.
    pub fn distance(&self, from: Vec3, direction: Vec3) -> f32 {
        self.along(Ray::new(from, direction))
    }

    /// Whether no line of sight leaves the scene from a point into a few directions around a unit
    /// vector.
    pub fn is_hidden(&self, from: Vec3, direction: Vec3) -> bool {
        let (u, v) = direction.any_orthonormal_pair();
        let around = [Vec3::ZERO, u, -u, v, -v].map(|side| direction + 0.7 * side);
        around.into_iter().all(|direction| self.distance(from, direction).is_finite())
    }
}
