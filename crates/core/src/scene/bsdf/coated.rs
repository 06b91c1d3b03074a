//! A Lambertian base under a smooth, clear dielectric coat, with all reflections in between.

use super::layers::CoatOverBase;
use super::model::{Describe, TextureValues, Traits, Transmission};
use super::{Bsdf, Lobe, fresnel};
use crate::base::math::Rgb;
use crate::base::rng::Rng;
use glam::Vec3;
use serde::Serialize;
use std::f32::consts::FRAC_1_PI;

/// A diffuse base under a coat, on both sides of the surface. The coat mirrors (a delta lobe). The
/// light that enters, `T = 1 - F`, is reflected by the base `n >= 1` times, and by the coat's
/// inside in between: `f = T(wo) T(wi) / eta^2 * albedo / (pi (1 - albedo F_in))`. Lossless for a
/// white base.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Coated {
    albedo: Rgb,
    eta: f32,
    /// Value of the base over both transmittances, 1/sr.
    #[serde(skip)]
    base: Rgb,
    /// Mean transmittance of diffuse light from outside.
    #[serde(skip)]
    mean_transmittance: f32,
}

impl Coated {
    /// A base that reflects `albedo` under a coat of refractive index `eta` over its surroundings.
    pub fn new(albedo: Rgb, eta: f32) -> Self {
        let outside = fresnel::diffuse_mean(|cos| Rgb::splat(fresnel::dielectric(cos, eta).0)).x;
        let mean_transmittance = 1.0 - outside;
        Self { albedo, eta, base: Rgb::ZERO, mean_transmittance }.with_albedo(albedo)
    }

    /// This coat over another base.
    #[must_use]
    pub fn with_albedo(&self, albedo: Rgb) -> Self {
        // The transmitted fluxes are in balance: (1 - F_in) eta^2 = 1 - F_out.
        let inside = 1.0 - self.mean_transmittance / (self.eta * self.eta);
        let base = albedo * FRAC_1_PI / (self.eta * self.eta * (Rgb::ONE - albedo * inside));
        Self { albedo, base, ..*self }
    }

    /// Albedo of the base.
    pub fn albedo(&self) -> Rgb {
        self.albedo
    }

    /// Refractive index of the coat over that of its surroundings.
    pub fn eta(&self) -> f32 {
        self.eta
    }

    fn reflected(&self, cos: f32) -> f32 {
        fresnel::dielectric(cos, self.eta).0
    }

    /// Share of the light from the cosine `cos` that leaves after reflection by the base.
    fn diffuse_albedo(&self, cos: f32) -> Rgb {
        let scale = (1.0 - self.reflected(cos)) * self.mean_transmittance;
        self.base * (std::f32::consts::PI * scale)
    }
}

impl Describe for Coated {
    #[inline]
    fn traits(&self) -> Traits {
        Traits {
            classes: self.coat_and_base(),
            transmission: Transmission::None,
            depends_on_tangent: false,
            albedo_bound: Rgb::ONE,
        }
    }

    fn textured(&self, texture: &TextureValues) -> Option<Bsdf> {
        Some(Bsdf::Coated(self.with_albedo(self.albedo * texture.color)))
    }

    fn color(&self, _front: bool) -> Rgb {
        self.albedo
    }
}

impl CoatOverBase for Coated {
    #[inline]
    fn coat_lobe(&self) -> Lobe {
        Lobe::Delta
    }

    #[inline]
    fn has_base(&self) -> bool {
        true
    }

    /// theory.md (31).
    fn coat_prob(&self, wo: Vec3) -> f32 {
        let mirrored = self.reflected(wo.z);
        mirrored / (mirrored + self.diffuse_albedo(wo.z).max_element())
    }

    fn mirrored_share(&self, cos: f32) -> Rgb {
        Rgb::splat(self.reflected(cos))
    }

    fn eval_coat(&self, _wo: Vec3, _wi: Vec3) -> Rgb {
        Rgb::ZERO
    }

    fn coat_pdf_w(&self, _wo: Vec3, _wi: Vec3) -> f32 {
        0.0
    }

    fn sample_coat(&self, wo: Vec3, _rng: &mut Rng) -> Vec3 {
        Vec3::new(-wo.x, -wo.y, wo.z)
    }

    /// theory.md (31).
    fn eval_base(&self, wo: Vec3, wi: Vec3) -> Rgb {
        self.base * ((1.0 - self.reflected(wo.z)) * (1.0 - self.reflected(wi.z)))
    }
}
