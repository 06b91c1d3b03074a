//! The space around all surfaces, through which light from infinitely far away shines.

use crate::base::math::{Bounds, uniform_disc_inverse, uniform_wide_disc};
use glam::{DVec3, Vec3};
use std::f32::consts::PI;

/// Room around the box of all surfaces, over its sides. Starts of rays are outside of all surfaces.
const ROOM: f32 = 1e-3;

/// Room around a box without a thickness, over its longest side: more than single precision rounds.
const LEAST_ROOM: f32 = 1e-6;

/// A sphere and a box around all surfaces. Light paths are distributed over discs of the sphere.
/// Rays start at the box, where it is nearer: coordinates of single precision are the finer the
/// nearer they are to the surfaces. theory.md (33c)
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Enclosure {
    center: Vec3,
    radius: f32,
    low: Vec3,
    high: Vec3,
}

impl Enclosure {
    /// Encloses a box.
    pub fn new(bounds: &Bounds) -> Self {
        let Bounds { min, max } = *bounds;
        let room = Vec3::splat(LEAST_ROOM * bounds.longest_side())
            + ROOM * (max - min)
            + 32.0 * f32::EPSILON * min.abs().max(max.abs());
        let (center, radius) = (bounds.center(), bounds.enclosing_radius());
        Self { center, radius, low: min - room, high: max + room }
    }

    /// Center of the sphere.
    pub fn center(&self) -> Vec3 {
        self.center
    }

    /// Radius of the sphere, scene units.
    pub fn radius(&self) -> f32 {
        self.radius
    }

    /// Area of the disc that contains all light of a direction that can meet a surface, scene units
    /// squared.
    pub fn disc(&self) -> f32 {
        PI * self.radius * self.radius
    }

    /// Start of a light path from the unit direction `toward`: a point of the disc around the scene
    /// that faces it, moved along the path to the box. Single precision would place paths on a
    /// lattice that small objects on a large ground fall through.
    pub(super) fn start(&self, toward: Vec3, numbers: [f64; 2]) -> Vec3 {
        let [u, v] = uniform_wide_disc(numbers);
        let (right, up) = toward.any_orthonormal_pair();
        let [right, up, toward] = [right, up, toward].map(|axis| axis.as_dvec3());
        let across = u * right + v * up + toward;
        let radius = f64::from(self.radius);
        let start = self.center.as_dvec3() + radius * across;
        // Distance to the plane of each face that the path enters by.
        let mut entry = 0.0f64;
        for axis in 0..3 {
            let face = if toward[axis] > 0.0 { self.high } else { self.low };
            if toward[axis] != 0.0 {
                entry = entry.max((start[axis] - f64::from(face[axis])) / toward[axis]);
            }
        }
        // A path beside the box meets nothing, wherever it starts.
        (start - entry.min(2.0 * radius) * toward).as_vec3()
    }

    /// Inverse of [`Self::start`]: the numbers that give the ray through `point`.
    pub(super) fn numbers(&self, toward: Vec3, point: Vec3) -> [f64; 2] {
        let (right, up) = toward.any_orthonormal_pair();
        let from_center: DVec3 = point.as_dvec3() - self.center.as_dvec3();
        let across = from_center / f64::from(self.radius);
        uniform_disc_inverse([right, up].map(|axis| axis.as_dvec3().dot(across)))
    }

    /// Distance from a point along a unit vector, behind which there is no surface.
    #[inline]
    pub(super) fn exit(&self, point: Vec3, toward: Vec3) -> f32 {
        let mut exit = f32::INFINITY;
        for axis in 0..3 {
            let face = if toward[axis] > 0.0 { self.high } else { self.low };
            let distance = (face[axis] - point[axis]) / toward[axis];
            exit = if toward[axis] == 0.0 { exit } else { exit.min(distance) };
        }
        // Points outside need a segment of a length that rounding does not change.
        let least = LEAST_ROOM * self.radius + 32.0 * f32::EPSILON * point.abs().max_element();
        exit.max(least)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::uniform_sphere;
    use crate::base::rng::{Stream, StreamKey};

    /// Paths over a wide ground start near it, on the rays of the disc, and outside of the box.
    #[test]
    fn starts_of_distant_light_are_near_flat_scenes() {
        let flat = Bounds { min: Vec3::new(-1e6, -1e6, 0.0), max: Vec3::new(1e6, 1e6, 2.0) };
        let own = Enclosure::new(&flat);
        let toward = Vec3::new(0.48, 0.36, 0.8);
        let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
        for _ in 0..1000 {
            let numbers = [rng.next_f64(), rng.next_f64()];
            let start = own.start(toward, numbers);
            let back = own.numbers(toward, start);
            for (back, number) in back.into_iter().zip(numbers) {
                // Of coordinates of 1e6, over a disc with a radius of 1.4e6.
                let off = (back - number).abs();
                assert!(off.min(1.0 - off) < 1e-5, "{back} {number}");
            }
            let is_over = start.x.abs() < 0.99e6 && start.y.abs() < 0.99e6;
            assert!(!is_over || (start.z > 2.0 && start.z < 10.0), "{start}");
        }
    }

    #[test]
    fn exits_are_outside_of_the_box_for_all_directions() {
        let bounds = Bounds { min: Vec3::new(-3.0, 0.0, 1.0), max: Vec3::new(5.0, 0.0, 2.0) };
        let own = Enclosure::new(&bounds);
        let mut rng = StreamKey::new(4, Stream::Test, 0).rng(0);
        let mut directions: Vec<Vec3> =
            (0..100).map(|_| uniform_sphere([rng.next_1d(), rng.next_1d()])).collect();
        directions.extend([Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z]);
        for toward in directions {
            let u = Vec3::new(rng.next_1d(), rng.next_1d(), rng.next_1d());
            let point = bounds.min + u * (bounds.max - bounds.min);
            let exit = own.exit(point, toward);
            let end = point + exit * toward;
            let is_inside = end.cmpge(bounds.min).all() && end.cmple(bounds.max).all();
            assert!(exit.is_finite() && exit > 0.0 && !is_inside, "{point} {toward} {exit}");
            let outside = own.exit(point + 100.0 * toward, toward);
            assert!(outside > 0.0 && outside < 0.01, "{outside}");
        }
    }
}
