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

/// Least distance off a plane at which rays from a meter start, over its largest coordinate.
const LEAST_OFFSET: f32 = f32::EPSILON / 8.0;

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
        let offset = Self::offset(Self::largest(corners).max_element());
        let area = triangle_area(corners);
        let corners = Self::FLAT;
        Self { origin: a, edge1, edge2, normal, offset, material, area, corners }
    }

    /// The largest coordinates of its corners, axis by axis.
    pub(super) fn largest([a, b, c]: [Vec3; 3]) -> Vec3 {
        a.abs().max(b.abs()).max(c.abs())
    }

    /// An interpolated point is off its plane by a few units in the last place of the largest
    /// vertex coordinate.
    pub(super) fn offset(largest: f32) -> f32 {
        largest * (32.0 * f32::EPSILON) + f32::MIN_POSITIVE
    }

    /// Distance off a plane with this unit normal at which rays from one of its points start: each
    /// coordinate has a rounding error of its own, of which only the part along the normal matters.
    /// theory.md (33b)
    pub(super) fn point_offset(normal: Vec3, point: Vec3) -> f32 {
        let off_plane = normal.abs().dot(point.abs()) * (32.0 * f32::EPSILON);
        off_plane + point.abs().max_element() * LEAST_OFFSET + f32::MIN_POSITIVE
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
