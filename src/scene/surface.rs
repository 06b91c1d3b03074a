//! The place where a ray hit.

use super::Material;
use super::diffuse::{DiffusePoint, TriangleSide};
use crate::base::math::Rgb;
use crate::base::rng::Rng;
use crate::scene::bsdf::{Bsdf, BsdfSample, LobeSet, Transport, Vertex};
use glam::{Vec2, Vec3};

/// Where a ray hit, on the side that it came from.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// The point that was hit.
    pub position: Vec3,
    /// The side of the triangle that the ray hit.
    pub facet: TriangleSide,
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

    /// The same for a path that comes from this direction, to either side.
    #[must_use]
    pub fn seen_from(&self, direction: Vec3) -> Self {
        if direction.dot(self.normal) >= 0.0 {
            return Self { wo: direction, ..*self };
        }
        Self {
            wo: direction,
            facet: TriangleSide { side: self.facet.side ^ 1, ..self.facet },
            normal: -self.normal,
            interpolated: self.interpolated.map(|normal| -normal),
            off_surface: self.start(direction),
            front: !self.front,
            ..*self
        }
    }

    /// Unit normal on the side from which light arrives that it scatters to the ray, if it is one side alone.
    pub fn lit_side(&self) -> Option<Vec3> {
        (!self.bsdf.transmits()).then_some(self.normal)
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

    /// Radiance emitted from its front, W/(m^2 sr).
    #[inline]
    pub fn emission(&self) -> Rgb {
        match self.uv {
            None => self.material.emission,
            Some(uv) => self.material.emission_at(uv),
        }
    }

    /// The same as a vertex that scatters by an albedo and the triangle's cosine alone, if it does.
    pub fn diffuse(&self) -> Option<DiffusePoint> {
        let Self { position, facet, normal, off_surface, .. } = *self;
        let albedo = self.bsdf.diffuse_albedo(self.front)?;
        let emission = if self.front { self.emission() } else { Rgb::ZERO };
        let point = DiffusePoint { position, facet, normal, off_surface, albedo, emission };
        self.interpolated.is_none().then_some(point)
    }

    /// Whether `wi` is on the same side of the triangle as of the normal of `at`; else light would
    /// leak through.
    /// theory.md (33).
    #[inline]
    pub fn agrees(&self, at: &Vertex, wi: Vec3) -> bool {
        self.interpolated.is_none() || self.normal.dot(wi) * at.normal.dot(wi) > 0.0
    }

    /// Samples where a light path goes on; the weight is what its flux is multiplied with.
    #[inline(always)] // as the BSDF's
    pub fn scatter_flux(&self, rng: &mut Rng) -> Option<BsdfSample> {
        match self.interpolated {
            None => {
                let at = self.vertex(Transport::Flux);
                self.bsdf.sample(&at, Transport::Flux, LobeSet::All, rng)
            }
            Some(normal) => self.scatter_flux_by(normal, rng),
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
