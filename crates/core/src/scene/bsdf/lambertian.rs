//! Ideal diffuse reflection.

use super::model::{Describe, Lobes, Model, TextureValues, Traits, Transmission, values_by_class};
use super::{Bsdf, BsdfSample, Lobe, LobeSet, LobeValue, Transport, Vertex};
use crate::base::math::{Rgb, cosine_hemisphere, cosine_hemisphere_pdf_w};
use crate::base::rng::Rng;
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

/// [`Bsdf::Lambertian`](super::Bsdf::Lambertian) as a model.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lambertian {
    pub(super) albedo: Rgb,
    pub(super) two_sided: bool,
}

impl Lambertian {
    /// Albedo of the front or the back.
    #[inline]
    pub(super) fn of_side(&self, front: bool) -> Rgb {
        if front || self.two_sided { self.albedo } else { Rgb::ZERO }
    }
}

impl Describe for Lambertian {
    #[inline]
    fn traits(&self) -> Traits {
        Traits {
            classes: Lobes::of(Lobe::Wide),
            transmission: Transmission::None,
            depends_on_tangent: false,
            albedo_bound: self.albedo,
        }
    }

    fn textured(&self, texture: &TextureValues) -> Option<Bsdf> {
        let albedo = self.albedo * texture.color;
        Some(Bsdf::Lambertian { albedo, two_sided: self.two_sided })
    }

    fn color(&self, front: bool) -> Rgb {
        self.of_side(front)
    }
}

/// Without a frame: the cosines with the normal suffice.
impl Model for Lambertian {
    #[inline]
    fn eval(&self, _lobe: Option<Lobe>, at: &Vertex, wi: Vec3) -> Rgb {
        let is_above = wi.dot(at.normal) > 0.0;
        if is_above { self.of_side(at.front) * FRAC_1_PI } else { Rgb::ZERO }
    }

    /// Like the value, also where `wo` is below the horizon of a shading normal.
    #[inline]
    fn pdf_w(&self, _lobe: Lobe, at: &Vertex, wi: Vec3) -> f32 {
        let reflects = at.front || self.two_sided;
        if reflects { cosine_hemisphere_pdf_w(wi.dot(at.normal)) } else { 0.0 }
    }

    fn values(&self, at: &Vertex, wi: Vec3) -> [LobeValue; 2] {
        values_by_class(self, at, wi)
    }

    #[inline]
    fn pass_prob(&self, _at: &Vertex) -> f32 {
        0.0
    }

    #[inline]
    fn sample(
        &self,
        at: &Vertex,
        _transport: Transport,
        _wanted: LobeSet,
        rng: &mut Rng,
    ) -> Option<BsdfSample> {
        (at.front || self.two_sided).then(|| {
            let wi = cosine_hemisphere(at.normal, rng.next_2d());
            BsdfSample { wi, weight: self.albedo, lobe: Lobe::Wide }
        })
    }
}
