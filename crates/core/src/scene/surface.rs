//! The surface at a hit.

use super::diffuse::{DiffusePoint, TriangleSide};
use super::shading::shading_normal;
use super::{Material, Receiver};
use crate::base::math::Rgb;
use crate::base::rng::Rng;
use crate::base::spectrum::Wavelength;
use crate::scene::bsdf::{Bsdf, BsdfSample, LobeSet, Transport, Vertex};
use glam::{Vec2, Vec3};

/// The surface at a hit, on the side that the ray came from.
#[derive(Clone, Copy, Debug)]
pub struct Surface<'a> {
    /// The point that was hit.
    pub position: Vec3,
    /// The side of the triangle that the ray hit.
    pub facet: TriangleSide,
    /// Unit normal of the triangle on the ray's side.
    pub normal: Vec3,
    /// Unit normal interpolated between those of the vertices and bent by a map, on the ray's side;
    /// `None` if it is the triangle's.
    pub interpolated: Option<Vec3>,
    /// Start of new rays to the ray's side: the point, moved off the surface.
    pub off_surface: Vec3,
    /// Unit vector back along the ray.
    pub wo: Vec3,
    /// True if the ray's side is the front.
    pub front: bool,
    /// Material of the surface.
    pub material: &'a Material,
    /// BSDF at this point, with the light that a smooth normal would lose: theory.md (33a).
    pub bsdf: Bsdf,
    /// Texture coordinates, if the material varies.
    pub uv: Option<Vec2>,
    /// Direction of growing `u`, of any length, if the BSDF depends on it.
    pub tangent: Option<Vec3>,
}

impl Surface<'_> {
    /// Turns a vector from the triangle's front to the ray's side.
    pub(super) fn to_side(self, front: Vec3) -> Vec3 {
        if self.front { front } else { -front }
    }

    /// The arguments of its BSDF as seen from this direction, on either side.
    pub fn vertex_from(&self, direction: Vec3, transport: Transport) -> Vertex {
        let is_same_side = direction.dot(self.normal) >= 0.0;
        let turned = |normal: Vec3| if is_same_side { normal } else { -normal };
        let triangle = turned(self.normal);
        let normal = match self.interpolated {
            None => triangle,
            Some(normal) => {
                shading_normal(&self.bsdf, turned(normal), triangle, direction, transport)
            }
        };
        let front = self.front == is_same_side;
        Vertex { normal, wo: direction, front, tangent: self.tangent }
    }

    /// The point as a receiver of the light that it scatters back along the ray: from one side,
    /// unless it transmits.
    pub fn receiver(&self) -> Receiver {
        let normal = (!self.bsdf.transmits()).then_some(self.normal);
        Receiver { position: self.position, normal }
    }

    /// Gives the BSDF the index of the path's wavelength, where the surface is dispersive. A path
    /// without a wavelength draws one. Returns the factor of its weight. theory.md (47k)
    #[inline]
    pub fn disperse(&mut self, wavelength: &mut Option<Wavelength>, rng: &mut Rng) -> Rgb {
        let Some(dispersion) = &self.material.dispersion else { return Rgb::ONE };
        let (own, factor) = match *wavelength {
            Some(own) => (own, Rgb::ONE),
            None => {
                let drawn = Wavelength::sample(rng.next_1d());
                (drawn, drawn.color())
            }
        };
        *wavelength = Some(own);
        self.bsdf = self.bsdf.with_index(dispersion.relative(own));
        factor
    }

    /// The arguments of its BSDF.
    #[inline]
    pub fn vertex(&self, transport: Transport) -> Vertex {
        let normal = match self.interpolated {
            None => self.normal,
            Some(normal) => self.shading_normal(normal, transport),
        };
        Vertex { normal, wo: self.wo, front: self.front, tangent: self.tangent }
    }

    /// Radiance emitted back along the ray, W/(m^2 sr). Only luminous openings without a thickness
    /// and materials of two-sided emission emit from the back.
    #[inline]
    pub fn emission(&self) -> Rgb {
        if let Some(opening) = &self.material.luminous_opening {
            let emits = self.front || opening.is_flat();
            return if emits { opening.radiance(self.wo) } else { Rgb::ZERO };
        }
        match self.uv {
            _ if !self.front && !self.material.two_sided_emission => Rgb::ZERO,
            None => self.material.emission,
            Some(uv) => self.material.emission_at(uv),
        }
    }

    /// The surface as a diffuse vertex; `None` unless it scatters by an albedo and the triangle's
    /// cosine.
    pub fn diffuse(&self) -> Option<DiffusePoint> {
        let Self { position, facet, normal, off_surface, .. } = *self;
        let albedo = self.bsdf.diffuse_albedo(self.front)?;
        let emission = self.emission();
        let point = DiffusePoint { position, facet, normal, off_surface, albedo, emission };
        self.interpolated.is_none().then_some(point)
    }

    /// Returns true if `wi` is on one side of both the triangle and the normal of `at`; otherwise
    /// light would leak through. theory.md (33).
    #[inline]
    pub fn agrees(&self, at: &Vertex, wi: Vec3) -> bool {
        self.interpolated.is_none() || self.normal.dot(wi) * at.normal.dot(wi) > 0.0
    }

    /// Samples the next direction of a light path, where `at` is its [`Self::vertex`]; the weight
    /// is the factor of its flux.
    #[inline(always)] // like the BSDF's
    pub fn scatter_flux(&self, at: &Vertex, rng: &mut Rng) -> Option<BsdfSample> {
        match self.interpolated {
            None => self.bsdf.sample(at, Transport::Flux, LobeSet::All, rng),
            Some(normal) => self.scatter_flux_by(normal, at, rng),
        }
    }

    /// Start of new rays toward `direction`: off the surface, on that side.
    #[inline]
    pub fn start(&self, direction: Vec3) -> Vec3 {
        if direction.dot(self.normal) > 0.0 {
            return self.off_surface;
        }
        2.0 * self.position - self.off_surface
    }
}
