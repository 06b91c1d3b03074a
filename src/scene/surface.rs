//! The place where a ray hit.

use super::Material;
use crate::bsdf::{Bsdf, Transport, Vertex};
use crate::math::Rgb;
use glam::{Vec2, Vec3};

/// Least cosine between a bent normal and the direction that it is seen from.
const GRAZING: f32 = 1e-3;

/// Where a ray hit, on the side that it came from.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// The point that was hit.
    pub position: Vec3,
    /// Unit normal of the triangle on the ray's side.
    pub normal: Vec3,
    /// Unit normal interpolated between those of the vertices and bent by a map, on the ray's side,
    /// where it differs.
    pub interpolated: Option<Vec3>,
    /// The point, moved off the surface to the ray's side: where new rays to that side start.
    pub off_surface: Vec3,
    /// Unit vector back along the ray.
    pub wo: Vec3,
    /// Whether the ray's side is the front, which may emit.
    pub front: bool,
    /// What the surface is made of.
    pub material: &'a Material,
    /// How it scatters here.
    pub bsdf: Bsdf,
    /// Texture coordinates, where the material varies.
    pub uv: Option<Vec2>,
}

impl Surface<'_> {
    /// A vector on the triangle's front, turned to the ray's side.
    pub(super) fn to_side(self, front: Vec3) -> Vec3 {
        if self.front { front } else { -front }
    }

    /// What its BSDF needs to know.
    #[inline]
    pub fn vertex(&self, transport: Transport) -> Vertex {
        let normal = match self.interpolated {
            None => self.normal,
            Some(normal) => self.shading_normal(normal, transport),
        };
        Vertex { normal, wo: self.wo, front: self.front }
    }

    #[inline(never)] // keeps the common case short
    fn shading_normal(&self, normal: Vec3, transport: Transport) -> Vec3 {
        match (&self.bsdf, transport) {
            // Its value does not depend on where it is seen from, also below the horizon of the
            // normal. Flux leaves by the cosine of the triangle; see `adjoint_correction`.
            (Bsdf::Lambertian { .. }, Transport::Radiance) => normal,
            (Bsdf::Lambertian { .. }, Transport::Flux) => self.normal,
            // A normal that is not seen is bent until it is; its surface would be black.
            _ => (normal + (GRAZING - normal.dot(self.wo)).max(0.0) * self.wo).normalize(),
        }
    }

    /// Radiance emitted from its front, W/(m^2 sr).
    #[inline]
    pub fn emission(&self) -> Rgb {
        match self.uv {
            None => self.material.emission,
            Some(uv) => self.material.emission_at(uv),
        }
    }

    /// The BSDF's value if light from all directions counts by it and the triangle's cosine, 1/sr.
    #[inline]
    pub fn constant(&self) -> Option<Rgb> {
        if self.interpolated.is_some() { None } else { self.bsdf.constant(self.front) }
    }

    /// Whether `wi` is on the same side of the triangle as of the normal of `at`; else light would
    /// leak through.
    #[inline]
    pub fn agrees(&self, at: &Vertex, wi: Vec3) -> bool {
        self.interpolated.is_none() || self.normal.dot(wi) * at.normal.dot(wi) > 0.0
    }

    /// What the flux of a light path is multiplied with where it goes on from `at` toward `wi`:
    /// interpolated normals make scattering asymmetric (Veach 1997, Section 5.3).
    #[inline]
    pub fn adjoint_correction(&self, at: &Vertex, wi: Vec3) -> f32 {
        match self.interpolated {
            None => 1.0,
            Some(interpolated) => self.flux_correction(interpolated, at, wi),
        }
    }

    #[inline(never)] // keeps the common case short
    fn flux_correction(&self, interpolated: Vec3, at: &Vertex, wi: Vec3) -> f32 {
        let arriving = |normal: Vec3| normal.dot(self.wo) / self.normal.dot(self.wo);
        match &self.bsdf {
            Bsdf::Lambertian { .. } => arriving(interpolated).max(0.0),
            _ => arriving(at.normal) * (self.normal.dot(wi) / at.normal.dot(wi)).abs(),
        }
    }

    /// Where new rays toward `direction` start: off the surface, on that side.
    #[inline]
    pub fn start(&self, direction: Vec3) -> Vec3 {
        if direction.dot(self.normal) > 0.0 {
            return self.off_surface;
        }
        2.0 * self.position - self.off_surface
    }
}
