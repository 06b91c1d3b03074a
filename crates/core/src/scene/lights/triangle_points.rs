//! Points of triangles that light positions: one, or as many as there are lanes at once.

use super::LightSample;
use super::emitter::toward;
use super::solid_angle::{SphericalTriangle, is_near};
use crate::base::math::{Rgb, uniform_triangle};
use crate::scene::Triangle;
use crate::simd::dispatch::vectorized;
use crate::simd::f32x8::EIGHT;
use crate::simd::{LANES, Vec3s};
use glam::Vec3;

/// A point of a triangle's front, as seen from a position.
#[derive(Clone, Copy, Debug)]
pub(super) struct TrianglePoint {
    /// Barycentric weights of the second and third corner.
    pub weights: [f32; 2],
    /// The point, off the surface.
    pub target: Vec3,
    /// Unit vector from the position to the point.
    pub wi: Vec3,
    /// Reciprocal of the density in solid angle, sr; not positive from behind.
    inverse_pdf_w: f32,
}

impl TrianglePoint {
    /// A connection with this point, which emits `radiance`; the light was chosen with probability
    /// `prob`. `None` from behind.
    pub fn sample(&self, radiance: Rgb, prob: f32) -> Option<LightSample> {
        let Self { target, wi, inverse_pdf_w, .. } = *self;
        let inverse_pdf_w = inverse_pdf_w / prob;
        let irradiance = radiance * inverse_pdf_w;
        let sample = LightSample { target, wi, irradiance, relative: 1.0, inverse_pdf_w };
        (inverse_pdf_w > 0.0).then_some(sample)
    }
}

/// Unit vector from `position` to `target`, a point of a triangle of this unit normal and area, and
/// the reciprocal of its density in solid angle if it is uniform over the area, sr.
#[inline(always)] // part of a vector loop
fn sight(target: Vec3, normal: Vec3, area: f32, position: Vec3) -> (Vec3, f32) {
    let (wi, distance2) = toward(target, position);
    (wi, -wi.dot(normal) * area / distance2)
}

impl Triangle {
    /// A point to light `position` with, from a uniform point of the unit square: uniform over the
    /// solid angle if the triangle is near, otherwise over the area.
    pub(super) fn point_to_light(&self, position: Vec3, random: [f32; 2]) -> TrianglePoint {
        let near = SphericalTriangle::if_near(self, position);
        let weights =
            near.as_ref().map_or_else(|| uniform_triangle(random), |near| near.sample(random));
        let target = self.point(weights) + self.normal * self.offset;
        let (wi, inverse) = sight(target, self.normal, self.area(), position);
        // theory.md (14) where it is near
        let inverse_pdf_w = match near {
            Some(near) if inverse > 0.0 => near.solid_angle(),
            _ => inverse,
        };
        TrianglePoint { weights, target, wi, inverse_pdf_w }
    }
}

/// Triangles with positions that they light.
#[derive(Clone, Debug, Default)]
pub(super) struct TriangleQueue {
    count: usize,
    /// Numbers of the positions among all that are connected.
    numbers: [usize; LANES],
    position: Vec3s,
    /// The first corner, and the edges from there.
    parts: [Vec3s; 3],
    normal: Vec3s,
    offset: [f32; LANES],
    area: [f32; LANES],
    random: [[f32; LANES]; 2],
}

/// A point of each triangle of a queue.
#[derive(Default)]
pub(super) struct TrianglePoints {
    weights: [[f32; LANES]; 2],
    target: Vec3s,
    wi: Vec3s,
    inverse_pdf_w: [f32; LANES],
}

impl TrianglePoints {
    /// One of them.
    pub fn get(&self, lane: usize) -> TrianglePoint {
        TrianglePoint {
            weights: [self.weights[0][lane], self.weights[1][lane]],
            target: self.target.get(lane),
            wi: self.wi.get(lane),
            inverse_pdf_w: self.inverse_pdf_w[lane],
        }
    }
}

impl TriangleQueue {
    /// Adds a position of this number.
    ///
    /// # Panics
    /// If there are [`LANES`] of them.
    pub fn add(&mut self, number: usize, shape: &Triangle, position: Vec3, random: [f32; 2]) {
        let lane = self.count;
        self.count += 1;
        self.numbers[lane] = number;
        self.position.set(lane, position);
        self.parts[0].set(lane, shape.origin);
        self.parts[1].set(lane, shape.edge1);
        self.parts[2].set(lane, shape.edge2);
        self.normal.set(lane, shape.normal);
        self.offset[lane] = shape.offset;
        self.area[lane] = shape.area();
        [self.random[0][lane], self.random[1][lane]] = random;
    }

    /// Numbers of the positions.
    pub fn numbers(&self) -> &[usize] {
        &self.numbers[..self.count]
    }

    /// [`Triangle::point_to_light`] for each position.
    pub fn points(&self) -> TrianglePoints {
        let mut points = TrianglePoints::default();
        vectorized(
            #[inline(always)]
            |_| self.choose(&mut points),
        );
        points
    }

    #[inline(always)] // vectorized, as the functions below
    fn parts(&self, lane: usize) -> [Vec3; 3] {
        [self.parts[0].get(lane), self.parts[1].get(lane), self.parts[2].get(lane)]
    }

    /// Lanes behind the last triangle have arbitrary points.
    #[inline(always)]
    fn choose(&self, points: &mut TrianglePoints) {
        for begin in (0..self.count.min(LANES)).step_by(EIGHT) {
            self.choose_eight(begin, points);
        }
    }

    /// Loops of constant length leave no rest that is done one by one.
    #[inline(always)]
    fn choose_eight(&self, begin: usize, points: &mut TrianglePoints) {
        let mut any_near = false;
        for lane in begin..begin + EIGHT {
            let [u, v] = uniform_triangle([self.random[0][lane], self.random[1][lane]]);
            (points.weights[0][lane], points.weights[1][lane]) = (u, v);
            any_near |= is_near(self.parts(lane), self.position.get(lane));
        }
        if any_near {
            // Until the last loop, the reciprocal densities are solid angles, 0 where none is near.
            for lane in begin..begin + EIGHT {
                let (parts, position) = (self.parts(lane), self.position.get(lane));
                let seen = SphericalTriangle::new(parts, position);
                let is_seen = is_near(parts, position) & seen.is_seen();
                let [u, v] = seen.sample([self.random[0][lane], self.random[1][lane]]);
                let [far_u, far_v] = [points.weights[0][lane], points.weights[1][lane]];
                points.weights[0][lane] = if is_seen { u } else { far_u };
                points.weights[1][lane] = if is_seen { v } else { far_v };
                points.inverse_pdf_w[lane] = if is_seen { seen.solid_angle() } else { 0.0 };
            }
        }
        for lane in begin..begin + EIGHT {
            let [origin, edge1, edge2] = self.parts(lane);
            let (normal, position) = (self.normal.get(lane), self.position.get(lane));
            let at = origin + points.weights[0][lane] * edge1 + points.weights[1][lane] * edge2;
            let target = at + normal * self.offset[lane];
            let (wi, inverse) = sight(target, normal, self.area[lane], position);
            points.target.set(lane, target);
            points.wi.set(lane, wi);
            let solid_angle = points.inverse_pdf_w[lane];
            let is_near = (solid_angle > 0.0) & (inverse > 0.0);
            points.inverse_pdf_w[lane] = if is_near { solid_angle } else { inverse };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::uniform_sphere;
    use crate::base::rng::{Stream, StreamKey};

    /// Points of many triangles together are those of each alone.
    #[test]
    fn points_of_a_queue_are_those_of_single_triangles() {
        let mut rng = StreamKey::new(8, Stream::Test, 0).rng(0);
        let (mut near, mut behind) = (0, 0);
        for round in 0..2000 {
            let mut queue = TriangleQueue::default();
            let mut expected = Vec::new();
            for number in 0..1 + round % LANES {
                let corners = [(); 3].map(|()| 2.0 * uniform_sphere(rng.next_2d()));
                let shape = Triangle::new(corners, 0);
                let distance = 4.0 * rng.next_1d();
                let (position, random) = (distance * uniform_sphere(rng.next_2d()), rng.next_2d());
                queue.add(3 * number, &shape, position, random);
                expected.push(shape.point_to_light(position, random));
                near += u32::from(SphericalTriangle::if_near(&shape, position).is_some());
            }
            let points = queue.points();
            assert!(queue.numbers().iter().copied().eq((0..expected.len()).map(|i| 3 * i)));
            for (lane, expected) in expected.iter().enumerate() {
                let point = points.get(lane);
                assert_eq!(format!("{point:?}"), format!("{expected:?}"));
                behind += u32::from(point.sample(Rgb::ONE, 1.0).is_none());
            }
        }
        assert!(near > 2000 && behind > 2000, "{near} {behind}");
    }
}
