//! The principled BSDF of Burley 2012 and 2015, as the plugin `principled` of Mitsuba 3 has it.

use super::anisotropic_ggx::AnisotropicGgx;
use super::dielectric::{relative, transmission_scale};
use super::ggx::reflect;
use super::gtr1::Gtr1;
use super::layers::facets_lobe;
use super::model::{Describe, Lobes, Local, LocalModel, TextureValues, Traits, Transmission};
use super::rough_dielectric::{RoughDielectric, refraction};
use super::{Bsdf, BsdfSample, Lobe, LobeSet, LobeValue, Transport, fresnel};
use crate::base::math::{Rgb, cosine_hemisphere, cosine_hemisphere_pdf_w, luminance};
use crate::base::rng::Rng;
use glam::Vec3;
use serde::Serialize;
use std::f32::consts::FRAC_1_PI;

/// Parameters of [`Principled`]; all numbers but `eta` are in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PrincipledParameters {
    /// Color of the base, of the metal at normal incidence, and squared of light that crosses the
    /// surface.
    pub base_color: Rgb,
    /// Square root of the width of the main facets.
    pub roughness: f32,
    /// Degree to which facets are wider along the tangent than across it.
    pub anisotropic: f32,
    /// Share of the metal.
    pub metallic: f32,
    /// Share of what is not metal that is glass instead of a diffuse base.
    pub spec_trans: f32,
    /// Refractive index behind the surface over that in front.
    pub eta: f32,
    /// Share of the dielectric's reflection that has the hue of the base.
    pub spec_tint: f32,
    /// Amount of reflection at grazing half-vectors, as of cloth.
    pub sheen: f32,
    /// Share of the sheen that has the hue of the base.
    pub sheen_tint: f32,
    /// Share of the base that scatters like a flat subsurface medium.
    pub flatness: f32,
    /// Amount of a second, narrow and clear coat.
    pub clearcoat: f32,
    /// Gloss of the coat: its width falls from .1 to .001.
    pub clearcoat_gloss: f32,
    /// If true, the back looks as the front; otherwise it is black. Surfaces that light crosses
    /// ignore it.
    pub two_sided: bool,
}

impl Default for PrincipledParameters {
    fn default() -> Self {
        Self {
            base_color: Rgb::splat(0.5),
            roughness: 0.5,
            anisotropic: 0.0,
            metallic: 0.0,
            spec_trans: 0.0,
            eta: 1.5,
            spec_tint: 0.0,
            sheen: 0.0,
            sheen_tint: 0.0,
            flatness: 0.0,
            clearcoat: 0.0,
            clearcoat_gloss: 0.0,
            two_sided: true,
        }
    }
}

/// Disney's principled BSDF: a diffuse base with retroreflection and sheen, the main facets, which
/// reflect as a mixture of dielectric and metal and may transmit, and a clear coat.
///
/// The facets are one lobe. It passes through if it transmits or is narrow; otherwise it merges, as
/// the base does. The coat is narrow and passes through.
///
/// Reciprocal. It does not conserve energy: retroreflection, sheen and coat are added to the base,
/// while facets lose what they would scatter again.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Principled {
    parameters: PrincipledParameters,
    #[serde(skip)]
    facets: AnisotropicGgx,
    #[serde(skip)]
    coat: Gtr1,
    /// Weight of the diffuse base.
    #[serde(skip)]
    base: f32,
    /// Weight of transmission.
    #[serde(skip)]
    crossing: f32,
    /// Color of transmission.
    #[serde(skip)]
    transmittance: Rgb,
    /// Reflectance of the tinted dielectric at normal incidence.
    #[serde(skip)]
    tinted_normal: Rgb,
    /// Value of the sheen before its Fresnel weight, 1/sr.
    #[serde(skip)]
    sheen: Rgb,
}

/// Minimum width of the main facets.
const MIN_ALPHA: f32 = 1e-3;
/// Width of the facets that mask the coat.
const COAT_MASKING: AnisotropicGgx = AnisotropicGgx { x: 0.25, y: 0.25 };
/// Reflectance of the coat at normal incidence.
const COAT_NORMAL: f32 = 0.04;
/// Minimum probability of a lobe that scatters light, before all are divided by their sum.
const MIN_PROB: f32 = 0.02;

/// Probabilities of the lobes; their sum is 1, or 0 where all is black.
#[derive(Clone, Copy, Debug)]
struct LobeProbs {
    base: f32,
    facets: f32,
    coat: f32,
}

impl Principled {
    /// The BSDF of these parameters.
    pub fn new(parameters: PrincipledParameters) -> Self {
        let PrincipledParameters { base_color, roughness, anisotropic, metallic, .. } = parameters;
        let PrincipledParameters { spec_trans, eta, sheen, sheen_tint, .. } = parameters;
        let alpha = roughness * roughness;
        let aspect = (1.0 - 0.9 * anisotropic).sqrt();
        let brightness = luminance(base_color);
        let hue = if brightness > 0.0 { base_color / brightness } else { Rgb::ONE };
        let normal = ((eta - 1.0) / (eta + 1.0)).powi(2);
        Self {
            parameters,
            facets: AnisotropicGgx {
                x: (alpha / aspect).max(MIN_ALPHA),
                y: (alpha * aspect).max(MIN_ALPHA),
            },
            coat: Gtr1 { alpha: 0.1 + (1e-3 - 0.1) * parameters.clearcoat_gloss },
            base: (1.0 - metallic) * (1.0 - spec_trans),
            crossing: (1.0 - metallic) * spec_trans,
            transmittance: base_color.max(Rgb::ZERO).map(f32::sqrt),
            tinted_normal: hue * normal,
            sheen: sheen * (1.0 - metallic) * Rgb::ONE.lerp(hue, sheen_tint),
        }
    }

    /// The surface with base color, metallic share and roughness multiplied by factors, as textures
    /// do.
    #[must_use]
    pub fn scaled(&self, base_color: Rgb, metallic: f32, roughness: f32) -> Self {
        let own = &self.parameters;
        Self::new(PrincipledParameters {
            base_color: own.base_color * base_color,
            metallic: own.metallic * metallic,
            roughness: own.roughness * roughness,
            ..*own
        })
    }

    /// The parameters.
    pub fn parameters(&self) -> &PrincipledParameters {
        &self.parameters
    }

    /// Returns true if light crosses the surface.
    #[inline]
    pub(super) fn transmits(&self) -> bool {
        self.crossing > 0.0
    }

    /// Returns true if the side scatters as the front does.
    #[inline]
    fn is_front(&self, front: bool) -> bool {
        front || self.parameters.two_sided && !self.transmits()
    }

    /// Class of the lobe of the main facets.
    #[inline]
    fn facets_lobe(&self) -> Lobe {
        let is_glass = self.transmits();
        if is_glass { Lobe::Rough } else { facets_lobe((self.facets.x * self.facets.y).sqrt()) }
    }

    #[inline]
    fn has_base(&self) -> bool {
        self.base * self.parameters.base_color.max_element() > 0.0 || self.sheen != Rgb::ZERO
    }

    #[inline]
    fn has_coat(&self) -> bool {
        self.parameters.clearcoat > 0.0
    }

    /// Schlick's weight of the reflectance at grazing incidence on a facet seen from the front.
    /// theory.md (32b).
    #[inline]
    fn schlick_weight(&self, cos: f32) -> f32 {
        if self.parameters.eta > 1.0 {
            return schlick_weight(cos);
        }
        // Rarer behind: the cosine of the refracted direction, 0 for total reflection.
        schlick_weight(fresnel::dielectric(cos, self.parameters.eta).1)
    }

    /// Share of the light that a facet reflects and weight of what it transmits.
    /// theory.md (32b).
    fn facet_shares(&self, cos: f32, front: bool) -> (Rgb, Rgb) {
        let PrincipledParameters { base_color, metallic, spec_tint, eta, .. } = self.parameters;
        let (reflected, _) = fresnel::dielectric(cos, relative(eta, front));
        let transmitted = self.transmittance * (self.crossing * (1.0 - reflected));
        if !front {
            return (Rgb::splat(self.crossing * reflected), transmitted);
        }
        let weight = if metallic > 0.0 || spec_tint > 0.0 { self.schlick_weight(cos) } else { 0.0 };
        let schlick = |normal: Rgb| normal + (Rgb::ONE - normal) * weight;
        let clear = (1.0 - metallic) * (1.0 - spec_tint) * reflected;
        let tinted = (1.0 - metallic) * spec_tint * schlick(self.tinted_normal);
        (clear + tinted + metallic * schlick(base_color), transmitted)
    }

    /// Probabilities of the lobes as seen from `wo`: about their shares of the scattered light.
    fn probs(&self, wo: Vec3, front: bool) -> LobeProbs {
        let (reflected, transmitted) = self.facet_shares(wo.z, front);
        let facets = reflected.max_element() + transmitted.max_element();
        if !front {
            return LobeProbs {
                base: 0.0,
                facets: if facets > 0.0 { 1.0 } else { 0.0 },
                coat: 0.0,
            };
        }
        let base = self.base * self.parameters.base_color.max_element();
        let sheen = self.sheen.max_element() * schlick_weight(wo.z);
        let base = if self.has_base() { (base + sheen).max(MIN_PROB) } else { 0.0 };
        let coat = self.parameters.clearcoat * self.coat_fresnel(wo.z) * wo.z;
        let coat = if self.has_coat() { coat.max(MIN_PROB) } else { 0.0 };
        let facets = facets.max(MIN_PROB);
        let sum = base + facets + coat;
        LobeProbs { base: base / sum, facets: facets / sum, coat: coat / sum }
    }

    /// Probabilities of the lobes of the classes that are wanted, which are not divided by their
    /// sum.
    fn wanted_probs(&self, wo: Vec3, front: bool, wanted: impl Fn(Lobe) -> bool) -> LobeProbs {
        let LobeProbs { base, facets, coat } = self.probs(wo, front);
        let some = |lobe: Lobe, prob: f32| if wanted(lobe) { prob } else { 0.0 };
        LobeProbs {
            base: some(Lobe::Wide, base),
            facets: some(self.facets_lobe(), facets),
            coat: some(Lobe::Rough, coat),
        }
    }

    /// theory.md (32a), (29).
    fn eval_facets(&self, wo: Vec3, wi: Vec3, front: bool) -> Rgb {
        if wi.z <= 0.0 && !self.transmits() {
            return Rgb::ZERO;
        }
        let eta = relative(self.parameters.eta, front);
        let Some(m) = RoughDielectric::facet(wo, wi, eta) else { return Rgb::ZERO };
        let (reflected, transmitted) = self.facet_shares(wo.dot(m), front);
        let masking = self.facets.g1(wo) * self.facets.g1(wi);
        let visible = self.facets.d(m) * masking / (wo.z * wi.z.abs());
        if wi.z > 0.0 {
            return reflected * (0.25 * visible);
        }
        let scale = transmission_scale(Transport::Radiance, eta);
        transmitted * (visible * wo.dot(m) * refraction(wo, wi, m, eta) * scale)
    }

    fn coat_fresnel(&self, cos: f32) -> f32 {
        COAT_NORMAL + (1.0 - COAT_NORMAL) * self.schlick_weight(cos)
    }

    /// theory.md (32c).
    fn eval_coat(&self, wo: Vec3, wi: Vec3) -> f32 {
        if !self.has_coat() {
            return 0.0;
        }
        let m = (wo + wi).normalize();
        let masking = COAT_MASKING.g1(wo) * COAT_MASKING.g1(wi);
        0.25 * self.parameters.clearcoat * self.coat_fresnel(wo.dot(m)) * self.coat.d(m) * masking
    }

    /// theory.md (32d), (32e).
    fn eval_base(&self, wo: Vec3, wi: Vec3) -> Rgb {
        let PrincipledParameters { base_color, roughness, flatness, .. } = self.parameters;
        let half = wi.dot((wo + wi).normalize());
        let sheen = self.sheen * schlick_weight(half);
        if self.base == 0.0 {
            return sheen;
        }
        let [o, i] = [wo.z, wi.z].map(schlick_weight);
        let retro = 2.0 * roughness * half * half;
        let mut value = (1.0 - 0.5 * o) * (1.0 - 0.5 * i) + retro * (o + i + o * i * (retro - 1.0));
        if flatness > 0.0 {
            let grazing = |weight: f32| 1.0 + (0.5 * retro - 1.0) * weight;
            let flat = 1.25 * (grazing(o) * grazing(i) * (1.0 / (wo.z + wi.z) - 0.5) + 0.5);
            value += flatness * (flat - value);
        }
        base_color * (self.base * FRAC_1_PI * value) + sheen
    }

    fn density(&self, probs: &LobeProbs, wo: Vec3, wi: Vec3, front: bool) -> f32 {
        let facets = if probs.facets > 0.0 { self.facets_pdf_w(wo, wi, front) } else { 0.0 };
        if wi.z <= 0.0 {
            return probs.facets * facets;
        }
        let coat = if probs.coat > 0.0 {
            let m = (wo + wi).normalize();
            self.coat.pdf_w(m) / (4.0 * wo.dot(m))
        } else {
            0.0
        };
        probs.facets * facets + probs.coat * coat + probs.base * cosine_hemisphere_pdf_w(wi.z)
    }

    fn facets_pdf_w(&self, wo: Vec3, wi: Vec3, front: bool) -> f32 {
        let eta = relative(self.parameters.eta, front);
        let Some(m) = RoughDielectric::facet(wo, wi, eta) else { return 0.0 };
        let mirror = self.mirror_prob(wo.dot(m), front);
        let visible = self.facets.visible_pdf_w(wo, m);
        if wi.z > 0.0 {
            return mirror * visible / (4.0 * wo.dot(m));
        }
        (1.0 - mirror) * visible * refraction(wo, wi, m, eta)
    }

    /// Probability that a facet reflects instead of transmitting.
    fn mirror_prob(&self, cos: f32, front: bool) -> f32 {
        let (reflected, transmitted) = self.facet_shares(cos, front);
        let [reflected, transmitted] = [reflected, transmitted].map(Rgb::max_element);
        if transmitted > 0.0 { reflected / (reflected + transmitted) } else { 1.0 }
    }

    /// A direction from the main facets; `None` if it is on the wrong side of the surface.
    fn sample_facets(&self, wo: Vec3, front: bool, rng: &mut Rng) -> Option<Vec3> {
        let eta = relative(self.parameters.eta, front);
        let m = self.facets.sample_visible(wo, rng.next_2d());
        let cos = wo.dot(m);
        let is_mirrored = !self.transmits() || rng.next_1d() < self.mirror_prob(cos, front);
        if is_mirrored {
            let wi = reflect(wo, m);
            return (wi.z > 0.0).then_some(wi);
        }
        let (_, cos_t) = fresnel::dielectric(cos, eta);
        let wi = ((cos / eta - cos_t) * m - wo / eta).normalize();
        (wi.z < 0.0).then_some(wi)
    }
}

impl Describe for Principled {
    #[inline]
    fn traits(&self) -> Traits {
        let facets = self.facets_lobe();
        let diffuse = self.has_base() || facets == Lobe::Wide;
        let rough = self.has_coat() || facets == Lobe::Rough;
        Traits {
            classes: Lobes { diffuse, rough, delta: false },
            transmission: if self.transmits() { Transmission::Passing } else { Transmission::None },
            depends_on_tangent: self.facets.x != self.facets.y,
            albedo_bound: Rgb::ONE,
        }
    }

    fn textured(&self, texture: &TextureValues) -> Option<Bsdf> {
        let TextureValues { color, metallic, roughness, .. } = *texture;
        Some(Bsdf::Principled(self.scaled(color, metallic, roughness)))
    }

    fn color(&self, _front: bool) -> Rgb {
        self.parameters.base_color
    }
}

impl LocalModel for Principled {
    fn eval(&self, lobe: Option<Lobe>, Local { wo, front }: Local, wi: Vec3) -> Rgb {
        let front = self.is_front(front);
        let wanted = |own: Lobe| lobe.is_none_or(|lobe| lobe == own);
        let facets =
            if wanted(self.facets_lobe()) { self.eval_facets(wo, wi, front) } else { Rgb::ZERO };
        if !front || wi.z <= 0.0 {
            return facets;
        }
        let coat = if wanted(Lobe::Rough) { self.eval_coat(wo, wi) } else { 0.0 };
        let base = if wanted(Lobe::Wide) { self.eval_base(wo, wi) } else { Rgb::ZERO };
        facets + base + coat
    }

    fn pdf_w(&self, lobe: Lobe, Local { wo, front }: Local, wi: Vec3) -> f32 {
        let front = self.is_front(front);
        self.density(&self.wanted_probs(wo, front, |own| own == lobe), wo, wi, front)
    }

    fn values(&self, _at: Local, _wi: Vec3) -> Option<[LobeValue; 2]> {
        None
    }

    fn pass_prob(&self, Local { wo, front }: Local) -> f32 {
        let front = self.is_front(front);
        let LobeProbs { base, facets, coat } = self.wanted_probs(wo, front, Lobe::passes_through);
        base + facets + coat
    }

    fn sample(
        &self,
        at: Local,
        transport: Transport,
        wanted: LobeSet,
        rng: &mut Rng,
    ) -> Option<BsdfSample> {
        let (wo, front) = (at.wo, self.is_front(at.front));
        let is_wanted = |lobe: Lobe| wanted == LobeSet::All || lobe.passes_through();
        let probs = self.wanted_probs(wo, front, is_wanted);
        let sum = probs.base + probs.facets + probs.coat;
        let chosen = rng.next_1d() * sum;
        if sum <= 0.0 {
            return None;
        }
        // A direction on the wrong side of the surface meets another facet: its light is lost.
        let (wi, lobe) = if chosen < probs.base {
            (Some(cosine_hemisphere(Vec3::Z, rng.next_2d())), Lobe::Wide)
        } else if chosen < probs.base + probs.coat {
            let wi = reflect(wo, self.coat.sample(rng.next_2d()));
            ((wi.z > 0.0).then_some(wi), Lobe::Rough)
        } else {
            (self.sample_facets(wo, front, rng), self.facets_lobe())
        };
        let Some(wi) = wi else { return Some(BsdfSample::lost(lobe)) };
        let pdf = self.pdf_w(lobe, at, wi) / sum;
        let mut weight = self.eval(Some(lobe), at, wi) * (wi.z.abs() / pdf);
        if wi.z < 0.0 && transport == Transport::Flux {
            weight /= transmission_scale(Transport::Radiance, relative(self.parameters.eta, front));
        }
        (pdf > 0.0).then_some(BsdfSample { wi, weight, lobe })
    }
}

/// The weight of Schlick's approximation, `(1 - cos)^5`.
#[inline]
fn schlick_weight(cos: f32) -> f32 {
    (1.0 - cos).clamp(0.0, 1.0).powi(5)
}
