//! Diffuse vertices of sixteen paths at a time.

use super::{LightSamples, Receivers};
use crate::base::math::{Rgb, cosine_hemisphere};
use crate::simd::{LANES, Mask, Vec3s};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// A side of a triangle.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct TriangleSide {
    /// Index of its instance, as in hits.
    pub mesh: u32,
    /// Twice the index of the triangle in its mesh, plus one for the back.
    pub side: u32,
}

impl TriangleSide {
    /// A side of a triangle, from the indices of a hit.
    #[inline(always)] // part of a vector loop
    pub fn new(mesh: u32, triangle: u32, front: bool) -> Self {
        Self { mesh, side: triangle << 1 | u32::from(!front) }
    }

    /// Whether it is the front.
    #[inline(always)] // part of a vector loop
    pub fn is_front(self) -> bool {
        self.side & 1 == 0
    }

    /// The other side of the same triangle.
    #[must_use]
    pub fn opposite(self) -> Self {
        Self { side: self.side ^ 1, ..self }
    }
}

/// A point of a path on a Lambertian surface, on the side that the path came from.
#[derive(Clone, Copy, Debug)]
pub struct DiffusePoint {
    /// The point that was hit.
    pub position: Vec3,
    /// The side of the triangle that was hit.
    pub facet: TriangleSide,
    /// Unit normal of the triangle.
    pub normal: Vec3,
    /// Start of new rays: the point, moved off the surface.
    pub off_surface: Vec3,
    /// Reflected share of the incident flux, in [0, 1].
    pub albedo: Rgb,
    /// Emitted radiance, W/(m^2 sr).
    pub emission: Rgb,
}

/// Vertices of up to sixteen paths; see [`DiffusePoint`].
#[derive(Clone, Copy, Debug, Default)]
pub struct DiffuseVertices {
    /// Paths that have a vertex; numbers of the others mean nothing.
    pub active: Mask,
    /// True if any vertex emits.
    pub any_emits: bool,
    /// Vertices on the front side.
    pub front: Mask,
    /// The points that were hit.
    pub position: Vec3s,
    /// Instances that they are on; see [`TriangleSide`].
    pub mesh: [u32; LANES],
    /// Sides of triangles that they are on.
    pub side: [u32; LANES],
    /// Unit normals.
    pub normal: Vec3s,
    /// Start points of new rays.
    pub off_surface: Vec3s,
    /// Reflected shares.
    pub albedo: Vec3s,
    /// Emitted radiance, if `any_emits`.
    pub emission: Vec3s,
}

impl DiffuseVertices {
    /// Removes all vertices.
    #[inline(always)] // like most functions below: parts of the loops over vertices
    pub fn clear(&mut self) {
        self.active = Mask::default();
        if self.any_emits {
            self.emission = Vec3s::default();
            self.any_emits = false;
        }
    }

    /// The vertices as receivers of light.
    #[inline(always)]
    pub fn receivers(&self) -> Receivers<'_> {
        Receivers { active: &self.active, position: &self.position, normal: &self.normal }
    }

    /// Adds the vertex of a path that has none.
    pub fn set(&mut self, lane: usize, point: &DiffusePoint) {
        (self.active[lane], self.front[lane]) = (true, true);
        (self.mesh[lane], self.side[lane]) = (point.facet.mesh, point.facet.side);
        self.any_emits |= point.emission != Rgb::ZERO;
        self.position.set(lane, point.position);
        self.normal.set(lane, point.normal);
        self.off_surface.set(lane, point.off_surface);
        self.albedo.set(lane, point.albedo);
        self.emission.set(lane, point.emission);
    }

    /// Throughput `carried` by each path to its vertex, times the BSDF, 1/sr.
    #[inline(always)]
    pub fn weights(&self, carried: &Vec3s) -> Vec3s {
        let mut weights = Vec3s::default();
        for lane in 0..LANES {
            // theory.md (27)
            weights.set(lane, carried.get(lane) * self.albedo.get(lane) * FRAC_1_PI);
        }
        weights
    }

    /// Contribution of the light samples to paths of these [`weights`](Self::weights).
    #[inline(always)]
    pub fn contributions(&self, weights: &Vec3s, light: &LightSamples) -> Vec3s {
        let mut contributions = Vec3s::default();
        for lane in 0..LANES {
            let cos_theta = light.wi.get(lane).dot(self.normal.get(lane)).max(0.0);
            let weight = weights.get(lane) * cos_theta;
            // theory.md (42), third line
            contributions.set(lane, weight * light.irradiance.get(lane));
        }
        contributions
    }

    /// Samples a new direction for each path by two numbers, in proportion to the cosine: its
    /// weight is the albedo.
    #[inline(always)]
    pub fn sample(&self, [u, v]: &[[f32; LANES]; 2]) -> Vec3s {
        let mut directions = Vec3s::default();
        for lane in 0..LANES {
            directions.set(lane, cosine_hemisphere(self.normal.get(lane), [u[lane], v[lane]]));
        }
        directions
    }
}
