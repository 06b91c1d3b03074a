//! Triangles in the layout of shading.

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec2, Vec3};
use std::ops::{Add, Mul};

/// The shading data of a triangle: one cache line.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Triangle {
    /// First vertex.
    pub origin: Vec3,
    /// From the first vertex to the second.
    pub edge1: Vec3,
    /// From the first vertex to the third.
    pub edge2: Vec3,
    /// Unit normal of the front side.
    pub normal: Vec3,
    /// Distance off the surface at which rays start, scene units: more than the rounding errors of
    /// points on it.
    pub offset: f32,
    /// Index into [`Scene::materials`](super::Scene::materials).
    pub material: u32,
    pub(super) area: f32,
    /// Index of its corners in the scene, or [`Triangle::FLAT`].
    pub(super) corners: u32,
}

/// Rounding errors of a point along the normal of its plane, in units in the last place of the
/// coordinates: of the point, of its plane, and of the distance to that plane along a ray.
const OFF_PLANE: f32 = 32.0 * f32::EPSILON;

/// Least ratio of the rounding errors of a point by its barycentric weights to those by its ray at
/// which the ray counts: distances along rays have a few rounding errors more.
const COARSE: f32 = 4.0;

/// A point that a ray of unit direction hits. Barycentric weights of wide triangles place it on a
/// lattice. The ray is then more precise along the triangle, but not across it. `reach` is that of
/// the triangle, and `point` the point of these weights. theory.md (33b)
#[inline(always)] // part of the loop over vertices
pub(super) fn refined(
    (point, normal, reach): (Vec3, Vec3, f32),
    [origin, direction]: [Vec3; 2],
    t: f32,
) -> Vec3 {
    let on_ray = origin + t * direction;
    let is_coarse = reach > COARSE * (origin.abs().max_element() + t);
    if is_coarse { on_ray + normal.dot(point - on_ray) * normal } else { point }
}

/// Shading data of a triangle's corners: one cache line.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct Corners {
    /// Unit normals on the front side.
    pub normals: [Vec3; 3],
    pub uvs: [Vec2; 3],
    unused: u32,
}

impl Corners {
    pub fn new(normals: [Vec3; 3], uvs: [Vec2; 3]) -> Self {
        Self { normals, uvs, unused: 0 }
    }
}

/// A vertex's normal, turned to the front of its triangle with this `normal`, and never in its
/// plane.
pub(super) fn to_front(given: Vec3, normal: Vec3) -> Vec3 {
    match given.dot(normal) {
        0.0 => normal,
        cos => given * cos.signum(),
    }
}

/// The mean of the corners' values with barycentric weights `u`, `v` of the second and third.
#[inline]
pub(super) fn interpolate<T: Copy + Add<Output = T> + Mul<f32, Output = T>>(
    [a, b, c]: [T; 3],
    [u, v]: [f32; 2],
) -> T {
    a * (1.0 - u - v) + b * u + c * v
}

/// Normal of a triangle, twice its area long. In f64 neither overflow nor underflow is possible for
/// f32 corners of up to 1e12.
fn long_normal([a, b, c]: [Vec3; 3]) -> DVec3 {
    (b - a).as_dvec3().cross((c - a).as_dvec3())
}

/// Area of a triangle, scene units squared; 0 where it is too small for a normal number.
pub fn triangle_area(corners: [Vec3; 3]) -> f32 {
    let area = (0.5 * long_normal(corners).length()) as f32;
    if area < f32::MIN_POSITIVE { 0.0 } else { area }
}

impl Triangle {
    /// Nothing varies over the triangle.
    pub(super) const FLAT: u32 = u32::MAX;
    /// Nothing varies over the triangle, but it has several placements.
    pub(super) const PLACED: u32 = u32::MAX - 1;

    pub(super) fn new(corners: [Vec3; 3], material: u32) -> Self {
        let [a, b, c] = corners;
        let (edge1, edge2) = (b - a, c - a);
        let normal = long_normal(corners).normalize_or_zero().as_vec3();
        let offset = Self::offset(normal, Self::largest(corners));
        let area = triangle_area(corners);
        let corners = Self::FLAT;
        Self { origin: a, edge1, edge2, normal, offset, material, area, corners }
    }

    /// The largest coordinates of its corners, axis by axis.
    pub(super) fn largest([a, b, c]: [Vec3; 3]) -> Vec3 {
        a.abs().max(b.abs()).max(c.abs())
    }

    /// Distance off a plane with this unit normal at which rays start, if no coordinate of its
    /// points exceeds `largest`: a bound of the distance by which rounding moves a point off the
    /// plane. Each coordinate has an error of its own, of which only the part along the normal
    /// matters: a ground at a height of zero has none, whatever its size. theory.md (33b)
    pub(super) fn offset(normal: Vec3, largest: Vec3) -> f32 {
        let most = largest.max_element();
        let off_plane = OFF_PLANE * normal.abs().dot(largest).min(most);
        // For planes through the origin of an axis: products with the area of a triangle that large
        // must stay normal numbers.
        off_plane + most * (OFF_PLANE * f32::EPSILON) + f32::MIN_POSITIVE
    }

    /// A bound of the terms that [`Self::point`] adds, hence of its rounding errors.
    #[inline(always)] // part of the loop over vertices
    pub(super) fn reach(&self) -> f32 {
        let Self { origin, edge1, edge2, .. } = *self;
        (origin.abs() + edge1.abs() + edge2.abs()).max_element()
    }

    /// The triangle whose front is the back of this one.
    pub(super) fn flipped(&self) -> Self {
        let Self { edge1, edge2, normal, .. } = *self;
        Self { edge1: edge2, edge2: edge1, normal: -normal, ..*self }
    }

    /// Area, scene units squared.
    pub fn area(&self) -> f32 {
        self.area
    }

    /// The point with barycentric weights `u`, `v` of the second and third vertex.
    #[inline]
    pub fn point(&self, [u, v]: [f32; 2]) -> Vec3 {
        self.origin + u * self.edge1 + v * self.edge2
    }
}
