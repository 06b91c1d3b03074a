//! The part of a ball or disc in a medium that no surface cuts off.
//!
//! A ball around a point in a medium reaches beyond walls and boundaries, where no photon of the
//! medium is. Rays from the point find the planes of the surfaces around it. The ball is cut by
//! these planes: photons beyond any of them do not count, and the flux is divided by the volume of
//! the rest. theory.md (37j)

use super::clearance::Clearance;
use crate::accel::{Coherence, HitPacket, Intersect, Ray, RayPacket};
use crate::base::math::Frame;
use crate::scene::Scene;
use crate::simd::LANES;
use glam::{Vec2, Vec3, Vec4};
use std::f32::consts::{PI, TAU};
use std::sync::LazyLock;

/// Maximum number of planes that cut a ball: the nearest ones.
const MAX_PLANES: usize = 4;

/// Number of directions in which a ball cut by several planes is measured.
const DIRECTIONS: usize = 256;

/// Number of directions in which a disc cut by several planes is measured.
const ACROSS: usize = 32;

/// Length of the rays that find planes, over the distance of the farthest plane: a ray finds all
/// planes to whose normal it is within 60 degrees, unless it meets another one before.
const RAY_LENGTH: f32 = 2.0;

/// Cosine between the normals of two planes from which on they count as one.
const SAME: f32 = 0.99;

/// Planes of the surfaces around a point.
#[derive(Clone, Copy, Debug, Default)]
pub struct NearPlanes {
    /// Unit normals away from the point, and distances, the nearest first.
    planes: [Vec4; MAX_PLANES],
    count: u8,
}

/// Directions of one packet of rays, spread evenly: every direction is within 39 degrees of one.
static RAYS: LazyLock<[Vec3; LANES]> = LazyLock::new(spread);

/// Unit vectors all around the z axis.
static TURNS: LazyLock<[Vec3; LANES]> = LazyLock::new(|| {
    std::array::from_fn(|i| {
        let (sin, cos) = (TAU * i as f32 / LANES as f32).sin_cos();
        Vec3::new(cos, sin, 0.0)
    })
});

/// Directions in which a ball cut by several planes is measured.
static SPREAD: LazyLock<[Vec3; DIRECTIONS]> = LazyLock::new(spread);

/// Unit vectors that are spread evenly (spherical Fibonacci points).
fn spread<const N: usize>() -> [Vec3; N] {
    let turn = 0.5 * (5f32.sqrt() - 1.0);
    std::array::from_fn(|i| {
        let z = 1.0 - (2 * i + 1) as f32 / N as f32;
        let (sin, cos) = (TAU * (turn * i as f32).fract()).sin_cos();
        let across = (1.0 - z * z).sqrt();
        Vec3::new(across * cos, across * sin, z)
    })
}

/// The surfaces of a scene, between which there are planes.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// The scene's triangles.
    pub accel: &'a dyn Intersect,
    /// Where surfaces are near.
    pub clearance: &'a Clearance,
}

impl Surroundings<'_> {
    /// Finds the planes within `radius` of a point.
    ///
    /// # Panics
    /// If the clearance is known within less than `radius` only.
    pub fn planes(&self, position: Vec3, radius: f32) -> NearPlanes {
        assert!(self.clearance.distance() >= radius, "the clearance is that of smaller balls");
        let mut planes = NearPlanes::default();
        if self.clearance.is_free(position) {
            return planes;
        }
        self.cast(position, radius, &RAYS, &mut planes);
        // In a corner the nearest wall may hide the others from these rays. Rays along it find
        // them.
        if let [nearest, ..] = planes.planes() {
            let frame = Frame::new(nearest.truncate());
            let along = |turn: Vec3| frame.to_world(turn);
            self.cast(position, radius, &TURNS.map(along), &mut planes);
        }
        planes
    }

    /// Adds the planes within `radius` that rays in these directions find.
    fn cast(
        &self,
        position: Vec3,
        radius: f32,
        directions: &[Vec3; LANES],
        planes: &mut NearPlanes,
    ) {
        let Self { scene, accel, .. } = *self;
        let t_far = RAY_LENGTH * radius;
        let rays = directions.map(|direction| Ray { t_far, ..Ray::new(position, direction) });
        let mut hits = [HitPacket::default()];
        accel.intersect(&[RayPacket::of(&rays)], LANES, &mut hits, Coherence::Incoherent);
        for (lane, direction) in directions.iter().enumerate() {
            let hit = hits[0].get(lane);
            if !hit.is_miss() && hit.t < t_far {
                let normal = scene.placed_normal(hit.mesh, hit.triangle);
                let cos = normal.dot(*direction);
                let distance = hit.t * cos.abs();
                if distance < radius {
                    planes.add((cos.signum() * normal).extend(distance));
                }
            }
        }
    }
}

impl NearPlanes {
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

    /// Returns true if there are no planes.
    pub fn is_open(&self) -> bool {
        self.count == 0
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

/// Lines where planes cut the plane of a disc.
#[derive(Clone, Copy, Debug, Default)]
pub struct DiscCut {
    /// Unit normals away from the center of the disc over distances from it, 1/scene unit.
    lines: [Vec2; MAX_PLANES],
    count: usize,
}

/// Unit vectors all around the center of a disc.
static AROUND: LazyLock<[Vec2; ACROSS]> =
    LazyLock::new(|| std::array::from_fn(|i| Vec2::from_angle(TAU * i as f32 / ACROSS as f32)));

impl NearPlanes {
    /// The lines that cut discs around a point at `offset` from the point, within
    /// the planes. The discs are perpendicular to the unit vector `normal`.
    pub fn across(&self, offset: Vec3, normal: Vec3) -> DiscCut {
        let frame = Frame::new(normal);
        let mut cut = DiscCut::default();
        for plane in self.planes() {
            let [x, y, _] = frame.to_local(plane.truncate()).to_array();
            let distance = plane.w - plane.truncate().dot(offset);
            cut.lines[cut.count] = Vec2::new(x, y) / distance.max(1e-9);
            cut.count += 1;
        }
        cut
    }
}

impl DiscCut {
    /// Area of the disc of this radius that the lines leave, over that of the whole disc.
    /// theory.md (37n)
    pub fn share(&self, radius: f32) -> f32 {
        let (mut lines, mut cutting) = ([Vec2::ZERO; MAX_PLANES], 0);
        for line in self.lines[..self.count].iter().map(|line| radius * line) {
            // A line at least a radius away does not cut.
            if line.length_squared() > 1.0 {
                lines[cutting] = line;
                cutting += 1;
            }
        }
        match &lines[..cutting] {
            [] => 1.0,
            [line] => 1.0 - segment(line.length_recip()),
            lines => {
                let square = |direction: &Vec2| {
                    lines
                        .iter()
                        .fold(1.0, |most: f32, line| most.max(line.dot(*direction)))
                        .powi(-2)
                };
                (AROUND.iter().map(square).sum::<f32>() / ACROSS as f32).max(1e-3)
            }
        }
    }
}

/// Share of a disc beyond a line at this distance from its center, in radii.
fn segment(distance: f32) -> f32 {
    let distance = distance.clamp(0.0, 1.0);
    (distance.acos() - distance * (1.0 - distance * distance).sqrt()) / PI
}

/// Share of a ball beyond a plane at this distance from its center, in radii.
fn cap(distance: f32) -> f32 {
    let height = 1.0 - distance.clamp(0.0, 1.0);
    height * height * (3.0 - height) / 4.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planes(all: &[[f32; 4]]) -> NearPlanes {
        let mut planes = NearPlanes::default();
        all.iter().for_each(|plane| planes.add(Vec4::from_array(*plane)));
        planes
    }

    #[test]
    fn shares_of_a_ball_are_those_of_its_caps() {
        let wall = planes(&[[1.0, 0.0, 0.0, 0.0]]);
        assert!((wall.share(2.0) - 0.5).abs() < 1e-6);
        assert_eq!(planes(&[[1.0, 0.0, 0.0, 3.0]]).share(2.0), 1.0);
        // Walls on both sides: two caps
        let slab = planes(&[[1.0, 0.0, 0.0, 0.5], [-1.0, 0.0, 0.0, 0.25]]);
        let expected = 1.0 - cap(0.5) - cap(0.25);
        assert!((slab.share(1.0) / expected - 1.0).abs() < 0.01, "{}", slab.share(1.0));
        // A corner of three walls at the center leaves an eighth.
        let corner = planes(&[[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]]);
        assert!((corner.share(1.0) - 0.125).abs() < 0.01, "{}", corner.share(1.0));
    }

    #[test]
    fn shares_of_a_disc_are_those_of_its_segments() {
        let wall = planes(&[[1.0, 0.0, 0.0, 0.5]]);
        // At the wall, half of a disc along it, and all of a disc parallel to it
        assert!((wall.across(0.5 * Vec3::X, Vec3::Z).share(0.3) - 0.5).abs() < 1e-4);
        assert_eq!(wall.across(0.5 * Vec3::X, Vec3::X).share(0.3), 1.0);
        assert_eq!(wall.across(Vec3::ZERO, Vec3::Z).share(0.49), 1.0);
        // At half a radius: 60 degrees to either side of the perpendicular
        let expected = 1.0 - (PI / 3.0 - 0.75f32.sqrt() / 2.0) / PI;
        assert!((wall.across(Vec3::ZERO, Vec3::Z).share(1.0) - expected).abs() < 1e-6);
        // A disc tilted by 60 degrees meets the wall at twice the distance.
        let tilted = Vec3::new(0.75f32.sqrt(), 0.0, 0.5);
        assert!((wall.across(0.25 * Vec3::X, tilted).share(1.0) - expected).abs() < 1e-6);
        // A corner at the center of the disc leaves a quarter.
        let corner = planes(&[[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]);
        assert!((corner.across(Vec3::ZERO, Vec3::Z).share(1.0) - 0.25).abs() < 0.02);
        // Walls on both sides
        let slab = planes(&[[1.0, 0.0, 0.0, 0.5], [-1.0, 0.0, 0.0, 0.25]]);
        let expected = 1.0 - segment(0.5) - segment(0.25);
        assert!((slab.across(Vec3::ZERO, Vec3::Y).share(1.0) / expected - 1.0).abs() < 0.01);
    }

    #[test]
    fn nearest_planes_are_kept_once() {
        let mut planes = planes(&[[1.0, 0.0, 0.0, 0.5], [0.999, 0.04, 0.0, 0.4]]);
        assert_eq!(planes.planes().len(), 1);
        assert_eq!(planes.planes()[0].w, 0.4);
        for (axis, distance) in [(Vec3::Y, 0.3), (Vec3::Z, 0.2), (-Vec3::X, 0.6), (-Vec3::Y, 0.1)] {
            planes.add(axis.extend(distance));
        }
        let distances: Vec<f32> = planes.planes().iter().map(|plane| plane.w).collect();
        assert_eq!(distances, [0.1, 0.2, 0.3, 0.4]);
        assert!(planes.contains(Vec3::new(0.3, 0.2, 0.1)) && !planes.contains(0.25 * Vec3::Z));
        assert!(planes.contains(-Vec3::X));
    }

    #[test]
    fn rays_go_all_around() {
        let nearest =
            |direction: &Vec3| RAYS.iter().map(|ray| ray.dot(*direction)).fold(0.0, f32::max);
        let worst = SPREAD.iter().map(nearest).fold(1.0, f32::min);
        assert!(worst > 0.77, "{worst}");
    }
}
