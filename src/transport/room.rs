//! The part of a ball in a medium that no surface cuts off.
//!
//! A ball around a point in a medium reaches beyond walls and boundaries, where no photon of the medium is. Rays from
//! the point find the planes of the surfaces around it. The ball is cut by these planes: photons beyond any of them do
//! not count, and the flux is divided by the volume of the rest. theory.md (37j)

use crate::accel::{Coherence, HitPacket, Intersect, Ray, RayPacket};
use crate::scene::Scene;
use glam::{Vec3, Vec4};
use std::f32::consts::TAU;
use std::sync::LazyLock;

/// Maximum number of planes that cut a ball: the nearest ones.
const MAX_PLANES: usize = 4;

/// Number of directions in which a ball cut by several planes is measured.
const DIRECTIONS: usize = 256;

/// Cosine between the normals of two planes from which on they count as one.
const SAME: f32 = 0.99;

/// Planes of the surfaces around a point.
#[derive(Clone, Copy, Debug, Default)]
pub struct Room {
    /// Unit normals away from the point, and distances, the nearest first.
    planes: [Vec4; MAX_PLANES],
    count: u8,
}

/// Unit vectors to the corners of an icosahedron: every direction is within 37.4 degrees of one.
static RAYS: LazyLock<[Vec3; 12]> = LazyLock::new(|| {
    let golden = 0.5 * (1.0 + 5f32.sqrt());
    std::array::from_fn(|i| {
        let [a, b] = [i & 1, i >> 1 & 1].map(|bit| 1.0 - 2.0 * bit as f32);
        let corner = [0.0, a, b * golden];
        let turn = i >> 2;
        Vec3::from_array(std::array::from_fn(|axis| corner[(axis + turn) % 3])).normalize()
    })
});

/// Directions that are spread evenly (spherical Fibonacci points).
static SPREAD: LazyLock<[Vec3; DIRECTIONS]> = LazyLock::new(|| {
    let turn = 0.5 * (5f32.sqrt() - 1.0);
    std::array::from_fn(|i| {
        let z = 1.0 - (2 * i + 1) as f32 / DIRECTIONS as f32;
        let (sin, cos) = (TAU * (turn * i as f32).fract()).sin_cos();
        let across = (1.0 - z * z).sqrt();
        Vec3::new(across * cos, across * sin, z)
    })
});

impl Room {
    /// Finds the planes within `radius` of a point.
    pub fn around(scene: &Scene, accel: &dyn Intersect, position: Vec3, radius: f32) -> Self {
        let rays = RAYS.map(|direction| Ray { t_far: radius, ..Ray::new(position, direction) });
        let mut hits = [HitPacket::default()];
        accel.intersect(&[RayPacket::of(&rays)], rays.len(), &mut hits, Coherence::Incoherent);
        let mut room = Self::default();
        for (lane, ray) in rays.iter().enumerate() {
            let hit = hits[0].get(lane);
            if !hit.is_miss() && hit.t < radius {
                let normal = scene.placed_normal(hit.mesh, hit.triangle);
                let cos = normal.dot(ray.direction);
                room.add((cos.signum() * normal).extend(hit.t * cos.abs()));
            }
        }
        room
    }

    /// Adds a plane, unless it is one of those known or too far behind.
    fn add(&mut self, plane: Vec4) {
        let known = &mut self.planes[..usize::from(self.count)];
        let same = known.iter_mut().find(|own| own.truncate().dot(plane.truncate()) > SAME);
        if let Some(own) = same {
            *own = if plane.w < own.w { plane } else { *own };
        } else if let Some(free) = self.planes.get_mut(usize::from(self.count)) {
            *free = plane;
            self.count += 1;
        } else if let Some(last) = self.planes.last_mut().filter(|last| plane.w < last.w) {
            *last = plane;
        }
        self.planes[..usize::from(self.count)].sort_by(|a, b| a.w.total_cmp(&b.w));
    }

    fn planes(&self) -> &[Vec4] {
        &self.planes[..usize::from(self.count)]
    }

    /// Returns true if a point at this offset from the center is on the same side of all planes.
    #[inline]
    pub fn contains(&self, offset: Vec3) -> bool {
        self.planes().iter().all(|plane| plane.truncate().dot(offset) <= plane.w)
    }

    /// Volume of the ball of this radius that the planes leave, over that of the whole ball.
    pub fn share(&self, radius: f32) -> f32 {
        let cutting = self.planes().iter().filter(|plane| plane.w < radius).count();
        match &self.planes[..cutting] {
            [] => 1.0,
            [plane] => 1.0 - cap(plane.w / radius),
            planes => {
                let cube = |direction: &Vec3| {
                    let reach = planes.iter().fold(radius, |reach, plane| {
                        let cos = plane.truncate().dot(*direction);
                        if cos > 0.0 { reach.min(plane.w / cos) } else { reach }
                    });
                    (reach / radius).powi(3)
                };
                let mean = SPREAD.iter().map(cube).sum::<f32>() / DIRECTIONS as f32;
                // A point in a corner keeps at least some of its ball.
                mean.max(1e-3)
            }
        }
    }
}

/// Share of a ball beyond a plane at this distance from its center, in radii.
fn cap(distance: f32) -> f32 {
    let height = 1.0 - distance.clamp(0.0, 1.0);
    height * height * (3.0 - height) / 4.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn room(planes: &[[f32; 4]]) -> Room {
        let mut room = Room::default();
        planes.iter().for_each(|plane| room.add(Vec4::from_array(*plane)));
        room
    }

    #[test]
    fn shares_of_a_ball_are_those_of_its_caps() {
        let wall = room(&[[1.0, 0.0, 0.0, 0.0]]);
        assert!((wall.share(2.0) - 0.5).abs() < 1e-6);
        assert_eq!(room(&[[1.0, 0.0, 0.0, 3.0]]).share(2.0), 1.0);
        // Walls on both sides: two caps
        let slab = room(&[[1.0, 0.0, 0.0, 0.5], [-1.0, 0.0, 0.0, 0.25]]);
        let expected = 1.0 - cap(0.5) - cap(0.25);
        assert!((slab.share(1.0) / expected - 1.0).abs() < 0.01, "{}", slab.share(1.0));
        // A corner of three walls at the center leaves an eighth.
        let corner = room(&[[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]]);
        assert!((corner.share(1.0) - 0.125).abs() < 0.01, "{}", corner.share(1.0));
    }

    #[test]
    fn nearest_planes_are_kept_once() {
        let mut room = room(&[[1.0, 0.0, 0.0, 0.5], [0.999, 0.04, 0.0, 0.4]]);
        assert_eq!(room.planes().len(), 1);
        assert_eq!(room.planes()[0].w, 0.4);
        for (axis, distance) in [(Vec3::Y, 0.3), (Vec3::Z, 0.2), (-Vec3::X, 0.6), (-Vec3::Y, 0.1)] {
            room.add(axis.extend(distance));
        }
        let distances: Vec<f32> = room.planes().iter().map(|plane| plane.w).collect();
        assert_eq!(distances, [0.1, 0.2, 0.3, 0.4]);
        assert!(room.contains(Vec3::new(0.3, 0.2, 0.1)) && !room.contains(0.25 * Vec3::Z));
        assert!(room.contains(-Vec3::X));
    }

    #[test]
    fn rays_go_all_around() {
        assert!(RAYS.iter().sum::<Vec3>().length() < 1e-6);
        let nearest =
            |direction: &Vec3| RAYS.iter().map(|ray| ray.dot(*direction)).fold(0.0, f32::max);
        let worst = SPREAD.iter().map(nearest).fold(1.0, f32::min);
        assert!(worst > 0.79, "{worst}");
    }
}
