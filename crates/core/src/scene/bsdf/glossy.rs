//! Rough facets over a diffuse base, a mixture of dielectric and metal: glTF's metallic-roughness
//! model.

use super::conductor::multiple_scattering;
use super::ggx::{Ggx, reflect};
use super::layers::{CoatOverBase, facets_lobe};
use super::model::{Describe, TextureValues, Traits, Transmission};
use super::{Bsdf, Lobe, SMOOTH_ALPHA, fresnel};
use crate::base::math::{Rgb, cosine_hemisphere, cosine_hemisphere_pdf_w};
use crate::base::rng::Rng;
use glam::Vec3;
use serde::Serialize;
use std::f32::consts::FRAC_1_PI;

/// The material of glTF 2.0 (Appendix B): a dielectric and a metal of the same GGX facets, mixed by
/// `metallic`, on both sides of the surface. Facets reflect by Schlick's approximation.
///
/// It has two lobes. The lobe of the *facets* is that of both parts; it merges or passes through by
/// its width, like that of metals. The *base* scatters light that enters the dielectric, and is
/// diffuse: `f = albedo (1 - E(wo)) (1 - E(wi)) / (pi (1 - E_mean))`, where `E` is the share that
/// the facets reflect (Kulla and Conty 2017). If facets are narrow or smooth, paths merge by the
/// base and pass through by the facets, as at a coat.
///
/// Reciprocal; lossless where `albedo` is white.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Glossy {
    albedo: Rgb,
    metallic: f32,
    /// Reflectance of the dielectric at normal incidence.
    normal: f32,
    facets: Ggx,
    /// Value of the base over its albedo and both shares that enter, 1/sr.
    #[serde(skip)]
    base: f32,
    /// Multiple scattering of the metal over both shares that are lost, 1/sr.
    #[serde(skip)]
    multiple: Rgb,
}

impl Glossy {
    /// A surface with the share `metallic` of metal, in [0, 1]. `albedo` is the color of the base,
    /// and of the metal at normal incidence. The dielectric has the refractive index `eta` over its
    /// surroundings. `alpha` is the GGX width in [0, 1], smooth below [`SMOOTH_ALPHA`].
    pub fn new(albedo: Rgb, metallic: f32, eta: f32, alpha: f32) -> Self {
        let normal = ((eta - 1.0) / (eta + 1.0)).powi(2);
        Self::with_normal(albedo, metallic.clamp(0.0, 1.0), normal, alpha)
    }

    /// [`Self::new`] by the reflectance of the dielectric at normal incidence.
    pub(super) fn with_normal(albedo: Rgb, metallic: f32, normal: f32, alpha: f32) -> Self {
        let facets = Ggx { alpha: if alpha < SMOOTH_ALPHA { 0.0 } else { alpha.min(1.0) } };
        let multiple = metallic * multiple_scattering(&facets, fresnel::schlick_mean(albedo));
        let own = Self { albedo, metallic, normal, facets, base: 0.0, multiple };
        Self { base: (1.0 - metallic) * FRAC_1_PI / own.mean_enters(), ..own }
    }

    /// The surface with albedo, metallic share and roughness (the square root of the width)
    /// multiplied by factors, as textures do.
    #[must_use]
    pub fn scaled(&self, albedo: Rgb, metallic: f32, roughness: f32) -> Self {
        let alpha = self.facets.alpha * roughness * roughness;
        Self::with_normal(self.albedo * albedo, self.metallic * metallic, self.normal, alpha)
    }

    /// The surface with the dielectric's reflectance at normal incidence multiplied by a factor of
    /// at least 0, and limited to 1. Toward grazing incidence it still grows to 1.
    #[must_use]
    pub fn reflecting(&self, factor: f32) -> Self {
        let normal = (self.normal * factor).min(1.0);
        Self::with_normal(self.albedo, self.metallic, normal, self.facets.alpha)
    }

    /// Color of the base, and of the metal at normal incidence.
    pub fn albedo(&self) -> Rgb {
        self.albedo
    }

    /// Share of the metal.
    pub fn metallic(&self) -> f32 {
        self.metallic
    }

    /// Reflectance of the dielectric at normal incidence.
    pub fn normal_reflectance(&self) -> f32 {
        self.normal
    }

    /// GGX width; 0 if it is smooth.
    pub fn alpha(&self) -> f32 {
        self.facets.alpha
    }

    /// Reflectance of both parts at normal incidence: Schlick's formula is linear in it.
    /// theory.md (32).
    #[inline]
    pub(super) fn mixed_normal(&self) -> Rgb {
        Rgb::splat(self.normal).lerp(self.albedo, self.metallic)
    }

    /// The surface with another color of the base, and of the metal at normal incidence.
    #[must_use]
    pub fn with_albedo(&self, albedo: Rgb) -> Self {
        Self::with_normal(albedo, self.metallic, self.normal, self.facets.alpha)
    }

    /// Multiple scattering of the metal over both shares that are lost, 1/sr.
    pub(super) fn multiple(&self) -> Rgb {
        self.multiple
    }

    /// Mean share of diffuse light that enters the dielectric.
    pub(super) fn mean_enters(&self) -> f32 {
        (1.0 - self.facets.mean_schlick_albedo(self.normal)).max(1e-6)
    }

    /// Share of the light from the cosine `cos` that enters the dielectric.
    #[inline]
    pub(super) fn enters(&self, cos: f32) -> f32 {
        (1.0 - self.facets.schlick_albedo(cos, self.normal)).max(0.0)
    }

    /// Share of the light from the cosine `cos` that single scattering of a white metal loses.
    #[inline]
    fn loss(&self, cos: f32) -> f32 {
        (1.0 - self.facets.single_albedo(cos)).max(0.0)
    }
}

impl Describe for Glossy {
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
        let TextureValues { color, metallic, roughness, .. } = *texture;
        Some(Bsdf::Glossy(self.scaled(color, metallic, roughness)))
    }

    fn color(&self, _front: bool) -> Rgb {
        self.albedo
    }
}

impl CoatOverBase for Glossy {
    #[inline]
    fn coat_lobe(&self) -> Lobe {
        facets_lobe(self.facets.alpha)
    }

    #[inline]
    fn has_base(&self) -> bool {
        self.base * self.albedo.max_element() > 0.0
    }

    fn coat_prob(&self, wo: Vec3) -> f32 {
        let once = self.facets.schlick_albedo(wo.z, self.mixed_normal().max_element());
        let facets = once + self.metallic * self.loss(wo.z);
        let base = (1.0 - self.metallic) * self.albedo.max_element() * self.enters(wo.z);
        if base > 0.0 { facets / (facets + base) } else { 1.0 }
    }

    fn mirrored_share(&self, cos: f32) -> Rgb {
        fresnel::schlick(cos, self.mixed_normal())
    }

    /// theory.md (26), (32).
    fn eval_coat(&self, wo: Vec3, wi: Vec3) -> Rgb {
        let m = (wo + wi).normalize();
        let once = self.facets.d(m) * self.facets.g2(wo, wi) / (4.0 * wo.z * wi.z);
        let again = self.multiple * (self.loss(wo.z) * self.loss(wi.z));
        fresnel::schlick(wo.dot(m), self.mixed_normal()) * once + again
    }

    fn coat_pdf_w(&self, wo: Vec3, wi: Vec3) -> f32 {
        let m = (wo + wi).normalize();
        let once = self.facets.g1(wo) * self.facets.d(m) / (4.0 * wo.z);
        let again = self.metallic * self.loss(wo.z);
        (1.0 - again) * once + again * cosine_hemisphere_pdf_w(wi.z)
    }

    fn sample_coat(&self, wo: Vec3, rng: &mut Rng) -> Vec3 {
        if rng.next_1d() < self.metallic * self.loss(wo.z) {
            return cosine_hemisphere(Vec3::Z, rng.next_2d());
        }
        reflect(wo, self.facets.sample_visible(wo, rng.next_2d()))
    }

    /// theory.md (32).
    fn eval_base(&self, wo: Vec3, wi: Vec3) -> Rgb {
        self.albedo * (self.base * self.enters(wo.z) * self.enters(wi.z))
    }
}
