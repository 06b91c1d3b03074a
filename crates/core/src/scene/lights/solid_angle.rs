//! Points of a nearby triangle, uniform over its solid angle (Arvo, *Stratified Sampling of
//! Spherical Triangles*, 1995).
//!
//! Where a light touches a surface, points uniform over the light's area give the irradiance
//! unbounded variance.

use crate::base::angles::{sin_cos, upper_angle};
use crate::scene::Triangle;
use glam::{DVec3, Vec3};

/// Minimum solid angle, sr: smaller ones lose too many digits, and points over the area then serve
/// as well.
const LEAST: f64 = 1e-6;

/// A triangle as seen from a point. Its functions are parts of vector loops: they have neither
/// branches nor calls.
#[derive(Clone, Copy)]
pub(super) struct SphericalTriangle {
    /// From the point to the first corner.
    first: DVec3,
    /// From the first corner to the others.
    edges: [DVec3; 2],
    /// Directions of the corners.
    corners: [DVec3; 3],
    /// Sine and cosine of the angle at the first corner.
    alpha: [f64; 2],
    /// Solid angle, sr.
    solid_angle: f64,
    /// Volume that the directions of the corners span: 0 in the triangle's plane.
    determinant: f64,
}

/// A vector of unit length, or 0.
#[inline(always)]
fn unit(v: DVec3) -> DVec3 {
    v / v.length().max(f64::MIN_POSITIVE)
}

/// The part of `v` across the unit vector `axis`, of unit length.
#[inline(always)]
fn across(v: DVec3, axis: DVec3) -> DVec3 {
    unit(v - v.dot(axis) * axis)
}

/// Tests whether a triangle is nearer than its longest edge: farther ones do not repay the effort.
#[inline(always)]
pub(super) fn is_near([origin, edge1, edge2]: [Vec3; 3], position: Vec3) -> bool {
    let edges = [edge1.length_squared(), edge2.length_squared(), (edge2 - edge1).length_squared()];
    let longest2 = edges[0].max(edges[1]).max(edges[2]);
    let to_center = origin + (edge1 + edge2) / 3.0 - position;
    to_center.length_squared() < longest2
}

impl SphericalTriangle {
    /// The spherical triangle if `shape` is near and seen.
    #[inline]
    pub(super) fn if_near(shape: &Triangle, position: Vec3) -> Option<Self> {
        let parts = [shape.origin, shape.edge1, shape.edge2];
        is_near(parts, position).then(|| Self::new(parts, position)).filter(Self::is_seen)
    }

    /// A triangle of this first corner and these edges from there.
    #[inline(always)]
    pub(super) fn new([origin, edge1, edge2]: [Vec3; 3], position: Vec3) -> Self {
        let first = origin.as_dvec3() - position.as_dvec3();
        let edges = [edge1.as_dvec3(), edge2.as_dvec3()];
        let corners = [unit(first), unit(first + edges[0]), unit(first + edges[1])];
        let [a, b, c] = corners;
        // Van Oosterom and Strackee (1983).
        let determinant = a.dot(b.cross(c)).abs();
        // theory.md (14)
        let solid_angle = 2.0 * upper_angle(determinant, 1.0 + a.dot(b) + b.dot(c) + c.dot(a));
        let (to_b, to_c) = (across(b, a), across(c, a));
        let alpha = [to_b.cross(to_c).length(), to_b.dot(to_c)];
        Self { first, edges, corners, alpha, solid_angle, determinant }
    }

    /// Tests whether its solid angle is large enough. In the triangle's plane no direction hits it,
    /// though the angle is 2 pi inside.
    #[inline(always)]
    pub(super) fn is_seen(&self) -> bool {
        (self.solid_angle > LEAST) & (self.determinant > LEAST * LEAST)
    }

    /// Solid angle, sr.
    #[inline(always)]
    pub(super) fn solid_angle(&self) -> f32 {
        self.solid_angle as f32
    }

    /// Barycentric weights (of the second and third corner) of a point that is uniform over the
    /// solid angle, from a uniform point of the unit square.
    #[inline(always)]
    pub(super) fn sample(&self, random: [f32; 2]) -> [f32; 2] {
        let w = self.direction(random);
        // The ray's point in the plane (Möller and Trumbore 1997). Rounding may leave the triangle.
        let [edge1, edge2] = self.edges;
        let p = w.cross(edge2);
        let det = edge1.dot(p);
        let q = edge1.cross(self.first);
        let [u, v] = [-self.first.dot(p) / det, w.dot(q) / det];
        let u = u.clamp(0.0, 1.0);
        [u as f32, v.max(0.0).min(1.0 - u) as f32]
    }

    /// A unit direction that is uniform over the solid angle.
    #[inline(always)]
    fn direction(&self, [u, v]: [f32; 2]) -> DVec3 {
        let [a, b, c] = self.corners;
        // The triangle ABC' of the share u of the angle; c is the side AB. Section 2 there.
        let [sin_alpha, cos_alpha] = self.alpha;
        // Sine and cosine of the share of the solid angle less the angle.
        let (sin, cos) = sin_cos(f64::from(u) * self.solid_angle);
        let s = sin * cos_alpha - cos * sin_alpha;
        let t = cos * cos_alpha + sin * sin_alpha;
        let p = t - cos_alpha;
        let q = s + sin_alpha * a.dot(b);
        let cos_b = ((q * t - p * s) * cos_alpha - q) / ((q * s + p * t) * sin_alpha);
        // No number at the corner itself.
        let cos_b = if cos_b.abs() < f64::INFINITY { cos_b.clamp(-1.0, 1.0) } else { 1.0 };
        let moved = cos_b * a + (1.0 - cos_b * cos_b).sqrt() * across(c, a);
        // A point on the arc from B to C'.
        let z = 1.0 - f64::from(v) * (1.0 - moved.dot(b));
        z * b + (1.0 - z * z).max(0.0).sqrt() * across(moved, b)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::math::uniform_sphere;
    use crate::base::rng::{Stream, StreamKey};

    /// Means of polynomials over the directions, against those over uniform directions that hit.
    #[test]
    fn directions_are_uniform_over_the_solid_angle() {
        let mut rng = StreamKey::new(5, Stream::Test, 0).rng(0);
        let far = [Vec3::new(1.0, 0.2, 2.0), Vec3::new(2.0, 0.1, 2.2), Vec3::new(1.2, 1.3, 2.1)];
        let near =
            [Vec3::new(-3.0, -2.0, 0.5), Vec3::new(4.0, -1.0, 0.4), Vec3::new(0.0, 3.0, 0.3)];
        let needle =
            [Vec3::new(0.1, 0.0, 0.05), Vec3::new(5.0, 0.0, 0.05), Vec3::new(5.0, 0.3, 0.05)];
        for corners in [far, near, needle] {
            let shape = Triangle::new(corners, 0);
            let seen = SphericalTriangle::new([shape.origin, shape.edge1, shape.edge2], Vec3::ZERO);
            assert!(seen.is_seen());
            let moments =
                |w: DVec3| [1.0, w.x, w.y, w.x * w.x, w.x * w.y, w.y * w.y, w.z * w.z * w.x];
            let n = 400_000;
            let mut expected = [[0.0; 2]; 7];
            for _ in 0..n {
                let w = uniform_sphere(rng.next_2d());
                // Möller and Trumbore.
                let p = w.cross(shape.edge2);
                let det = shape.edge1.dot(p);
                let u = -shape.origin.dot(p) / det;
                let q = (-shape.origin).cross(shape.edge1);
                let (v, t) = (w.dot(q) / det, shape.edge2.dot(q) / det);
                if u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 {
                    for (sum, moment) in expected.iter_mut().zip(moments(w.as_dvec3())) {
                        let value = 4.0 * std::f64::consts::PI * moment;
                        sum[0] += value / f64::from(n);
                        sum[1] += value * value / f64::from(n);
                    }
                }
            }
            let mut found = [0.0; 7];
            for _ in 0..n {
                let random = rng.next_2d();
                let w = seen.direction(random);
                assert!((w.length() - 1.0).abs() < 1e-6);
                let point = shape.point(seen.sample(random)).as_dvec3().normalize();
                assert!(point.dot(w) > 1.0 - 1e-9, "{point} {w}");
                for (sum, moment) in found.iter_mut().zip(moments(w)) {
                    *sum += seen.solid_angle * moment / f64::from(n);
                }
            }
            for ([mean, square], found) in expected.into_iter().zip(found) {
                let error = ((square - mean * mean) / f64::from(n)).sqrt();
                // Both have errors; the uniform directions' is the larger one.
                assert!((found - mean).abs() < 5.0 * error + 1e-9, "{found} {mean} +- {error}");
            }
        }
    }

    #[test]
    fn triangles_seen_edge_on_or_far_away_have_no_solid_angle() {
        let shape = Triangle::new([Vec3::ZERO, Vec3::X, Vec3::Y], 0);
        let inside = Vec3::new(0.3, 0.2, 0.0);
        for from in [Vec3::new(3.0, 1.0, 0.0), Vec3::new(0.0, 0.0, 1e5), Vec3::ZERO, inside] {
            let seen = SphericalTriangle::new([shape.origin, shape.edge1, shape.edge2], from);
            assert!(!seen.is_seen(), "{from}");
        }
        assert!(SphericalTriangle::if_near(&shape, Vec3::splat(1.0)).is_some());
        assert!(SphericalTriangle::if_near(&shape, Vec3::splat(3.0)).is_none());
    }
}
