//! Diffuse bases under coats, sixteen at a time: surfaces that are Lambertian,
//! [`Plastic`](super::Plastic), [`Coated`](super::Coated) or [`Glossy`], and metals that reflect by
//! Schlick's approximation and scatter light between their facets.
//!
//! The constant parameter `METAL` tells whether coats may be metal: their reflectance has a color,
//! and the light that single scattering loses leaves as a wide lobe. Other coats are compiled
//! without both.
//!
//! The formulas are those of `layers`, `plastic`, `glossy` and `facets`. Directions are in scene
//! space: facets of coats are isotropic, so that cosines and distances from the normal say
//! everything. Loops over lanes have neither calls nor branches, so that they become vector
//! instructions.

use super::coat_columns::{CoatedBases, Metals, across2, grazing};
use super::coated_base::CoatedBase;
use super::facets::{FacetModel, Facets};
use super::ggx::reflect;
use super::{DIFFUSE_ALPHA, Glossy, fresnel};
use crate::base::math::{Frame, Rgb, cosine_hemisphere};
use crate::simd::{LANES, Mask, Vec3s, bits, lanes_of};
use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, PI};

/// Sixteen surfaces of coats over bases, each seen from a direction.
#[derive(Clone, Copy, Debug, Default)]
pub struct SeenCoats<const METAL: bool> {
    coats: CoatedBases,
    /// Without meaning unless coats may be metal.
    metals: Metals,
    /// Albedos of the bases; black at sides that do not reflect.
    pub albedo: Vec3s,
    /// Value of the base over both transmittances, 1/sr.
    base: Vec3s,
    /// Unit shading normals.
    normal: Vec3s,
    /// Unit vectors toward the viewer.
    wo: Vec3s,
    /// Cosines of `wo`, and share of the light from there that enters the coat.
    cos: [f32; LANES],
    enters: [f32; LANES],
    /// Probability of the coat's lobe; 0 without a coat.
    coat_prob: [f32; LANES],
    /// Share of the light from there that single scattering of a white metal loses.
    lost: [f32; LANES],
}

/// Values of both lobes over their colors, 1/sr, and densities of sampling them, 1/sr. All are 0
/// below the surface, and those of a smooth coat.
#[derive(Clone, Copy, Debug, Default)]
struct LobeScales {
    base: [f32; LANES],
    base_pdf_w: [f32; LANES],
    /// Value over the tint. If coats may be metal, the value of single scattering by facets that
    /// reflect all light.
    coat: [f32; LANES],
    coat_pdf_w: [f32; LANES],
    /// `(1 - cos)^5` at the facet, if coats may be metal, as the next.
    grazing: [f32; LANES],
    /// Both shares that single scattering loses.
    lost: [f32; LANES],
}

/// Lobes of one class of sixteen surfaces; see [`LobeValue`](super::LobeValue).
#[derive(Clone, Copy, Debug, Default)]
pub struct LobeValues {
    /// Values, 1/sr.
    pub value: Vec3s,
    /// Densities in solid angle, 1/sr.
    pub pdf_w: [f32; LANES],
}

/// Directions that were sampled; see [`BsdfSample`](super::BsdfSample).
#[derive(Clone, Copy, Debug, Default)]
pub struct CoatSamples {
    /// Lanes with a direction above the surface.
    pub is_some: Mask,
    /// Unit directions.
    pub wi: Vec3s,
    /// Factors of the throughput.
    pub weight: Vec3s,
    /// Directions that pass through: of a rough or a smooth coat.
    pub passes_through: Mask,
    /// Lanes of a smooth coat.
    pub is_delta: Mask,
    /// Densities of the sampled class of lobes, 1/sr; 0 of a smooth coat.
    pub pdf_w: [f32; LANES],
    /// Largest channels of the values of that class, 1/sr.
    pub value: [f32; LANES],
}

impl<const METAL: bool> SeenCoats<METAL> {
    /// Surfaces seen from `wo` by their shading normals. `color` is a factor of the albedos of
    /// coats that are no metal, and `front` the side that is seen.
    #[inline(always)]
    pub(in crate::scene) fn new(
        (coats, metals): (&CoatedBases, &Metals),
        color: &Vec3s,
        front: &Mask,
        normal: &Vec3s,
        wo: &Vec3s,
    ) -> Self {
        let mut seen = Self { coats: *coats, ..Self::default() };
        if METAL {
            seen.metals = *metals;
            for lane in 0..LANES {
                let (albedo, metallic) = (coats.albedo.get(lane), metals.metallic[lane]);
                let share = (1.0 - metallic) * FRAC_1_PI / coats.mean_transmittance[lane];
                seen.albedo.set(lane, albedo);
                seen.base.set(lane, albedo * share);
            }
            return seen.seen_from(normal, wo);
        }
        for (lane, front) in front.iter().enumerate() {
            let reflects = front | coats.has(CoatedBase::TWO_SIDED, lane);
            let side = if reflects { 1.0 } else { 0.0 };
            let albedo = coats.albedo.get(lane) * color.get(lane) * side;
            let saturates = coats.saturates[lane];
            let again = albedo * saturates + (1.0 - saturates);
            let saturation = (Rgb::ONE - again * coats.inside[lane]).max(Rgb::splat(1e-6));
            let is_schlick = coats.has(CoatedBase::IS_SCHLICK, lane);
            let eta2 = if is_schlick { 1.0 } else { coats.eta[lane] * coats.eta[lane] };
            seen.albedo.set(lane, albedo);
            seen.base.set(lane, albedo * FRAC_1_PI / (eta2 * saturation));
        }
        seen.seen_from(normal, wo)
    }

    /// The same surfaces, seen from other directions `wo` by these shading normals.
    #[inline(always)]
    pub fn seen_from(&self, normal: &Vec3s, wo: &Vec3s) -> Self {
        let mut seen = Self { normal: *normal, wo: *wo, ..*self };
        for lane in 0..LANES {
            seen.cos[lane] = normal.get(lane).dot(wo.get(lane));
        }
        let shares = self.coats.shares::<METAL>(&self.metals, &seen.cos);
        (seen.enters, seen.lost) = (shares.enters, shares.lost);
        for lane in 0..LANES {
            let mut coat = shares.reflected[lane];
            if METAL {
                coat += self.metals.metallic[lane] * shares.lost[lane];
            }
            let base = self.base.get(lane).max_element();
            let below = PI * base * shares.enters[lane] * self.coats.mean_transmittance[lane];
            let most = if METAL { 1.0 } else { 1.0 - 1e-3 };
            let prob = if below > 0.0 { (coat / (coat + below)).min(most) } else { 1.0 };
            let has_coat = self.coats.has(CoatedBase::HAS_COAT, lane);
            seen.coat_prob[lane] = if has_coat { prob } else { 0.0 };
        }
        seen
    }

    /// 1 if the surface of a lane has a coat, else 0.
    #[inline(always)]
    pub fn has_coat(&self, lane: usize) -> f32 {
        self.coats.has_coat(lane)
    }

    /// Photons merge at the surface of a lane; see [`Bsdf::merges`](super::Bsdf::merges).
    #[inline(always)]
    pub fn merges(&self, lane: usize) -> bool {
        let has_coat = self.coats.has(CoatedBase::HAS_COAT, lane);
        !has_coat | !self.is_narrow(lane) | self.has_base(lane)
    }

    /// The base of a lane reflects light.
    #[inline(always)]
    fn has_base(&self, lane: usize) -> bool {
        self.base.get(lane).max_element() > 0.0
    }

    /// The surface of a lane only mirrors: a smooth coat without a base.
    pub fn is_mirror(&self, lane: usize) -> bool {
        let has_coat = self.coats.has(CoatedBase::HAS_COAT, lane);
        has_coat && self.coats.alpha[lane] == 0.0 && !self.has_base(lane)
    }

    /// The surface of a lane whose coat may be metal.
    pub(in crate::scene) fn glossy(&self, lane: usize) -> Glossy {
        let (albedo, metallic) = (self.albedo.get(lane), self.metals.metallic[lane]);
        Glossy::with_normal(albedo, metallic, self.coats.eta[lane], self.coats.alpha[lane])
    }

    /// Unit vectors toward the viewers.
    #[inline(always)]
    pub fn wo(&self) -> &Vec3s {
        &self.wo
    }

    /// Unit shading normal of a lane.
    #[inline(always)]
    pub fn normal(&self, lane: usize) -> Vec3 {
        self.normal.get(lane)
    }

    /// Probability that samples pass through; see [`Bsdf::pass_prob`](super::Bsdf::pass_prob).
    #[inline(always)]
    pub fn pass_prob(&self, lane: usize) -> f32 {
        let is_seen = self.is_narrow(lane) & (self.cos[lane] > 0.0);
        if is_seen { self.coat_prob[lane] } else { 0.0 }
    }

    /// Share of the incident light of equal radiance from everywhere that the base of a lane sends
    /// to the viewer. `None` if the base is no lobe of its own, or not seen.
    #[inline]
    pub fn base_albedo(&self, lane: usize) -> Option<Rgb> {
        let has_coat = self.coats.has(CoatedBase::HAS_COAT, lane);
        let is_apart = !has_coat | (self.is_narrow(lane) & (self.cos[lane] > 0.0));
        let share = PI * self.enters[lane] * self.coats.mean_transmittance[lane];
        is_apart.then(|| self.base.get(lane) * share)
    }

    /// Surfaces whose coat is rough, but narrow: its lobe is of a class of its own.
    #[inline(always)]
    fn is_narrow(&self, lane: usize) -> bool {
        self.coats.alpha[lane] < DIFFUSE_ALPHA
    }

    /// Probability that the coat of a lane, where it is sampled, scatters light between its facets.
    #[inline(always)]
    fn again(&self, lane: usize) -> f32 {
        self.metals.metallic[lane] * self.lost[lane]
    }

    /// Value of the coat of a lane, 1/sr.
    #[inline(always)]
    fn coat_value(&self, lane: usize, scales: &LobeScales) -> Rgb {
        if !METAL {
            return self.coats.tint.get(lane) * scales.coat[lane];
        }
        // theory.md (26), (32)
        let mixed = self.metals.mixed.get(lane);
        let reflected = mixed + (Rgb::ONE - mixed) * scales.grazing[lane];
        reflected * scales.coat[lane] + self.metals.multiple.get(lane) * scales.lost[lane]
    }

    #[inline(always)]
    fn scales(&self, wi: &Vec3s) -> LobeScales {
        let mut scales = LobeScales::default();
        let mut cos = [0.0; LANES];
        for (lane, cos) in cos.iter_mut().enumerate() {
            *cos = self.normal.get(lane).dot(wi.get(lane));
        }
        let shares = self.coats.shares::<METAL>(&self.metals, &cos);
        for (lane, cos_i) in cos.into_iter().enumerate() {
            let (normal, wo, wi) = (self.normal.get(lane), self.wo.get(lane), wi.get(lane));
            let cos_o = self.cos[lane];
            let has_coat = self.coats.has(CoatedBase::HAS_COAT, lane);
            // A Lambertian surface does not depend on the direction that it is seen from. It has no
            // lobe where it is black: paths end at backs that do not reflect.
            let reflects = self.has_base(lane);
            let is_seen = (has_coat & (cos_o > 0.0)) | (!has_coat & reflects);
            let is_above = (cos_i > 0.0) & is_seen;
            let above = if is_above { 1.0 } else { 0.0 };
            let prob = self.coat_prob[lane];
            let leaves = shares.enters[lane];
            // Below the surface, Fresnel's formulas have a pole.
            scales.base[lane] = if is_above { self.enters[lane] * leaves } else { 0.0 };
            scales.base_pdf_w[lane] = above * (1.0 - prob) * cos_i.max(0.0) * FRAC_1_PI;
            // theory.md (31a), (97)
            let sum = wo + wi;
            let m = sum * sum.length_squared().max(1e-20).sqrt().recip();
            let cos_m = m.dot(normal);
            let density = self.coats.density(lane, cos_m, across2(m, normal, cos_m));
            let lambda_o = self.coats.lambda(lane, cos_o, across2(wo, normal, cos_o));
            let lambda_i = self.coats.lambda(lane, cos_i, across2(wi, normal, cos_i));
            let apart = (1.0 + lambda_o) * (1.0 + lambda_i);
            let is_correlated = self.coats.has(CoatedBase::IS_CORRELATED, lane);
            let g2 = if is_correlated { 1.0 + lambda_o + lambda_i } else { apart }.recip();
            let d = density / (4.0 * cos_o);
            let is_lobe = is_above & has_coat & (self.coats.alpha[lane] > 0.0);
            let once = d * g2 / cos_i;
            let pdf_w = d / (1.0 + lambda_o);
            if METAL {
                let again = self.again(lane);
                let pdf_w = (1.0 - again) * pdf_w + again * cos_i * FRAC_1_PI;
                scales.coat[lane] = if is_lobe { once } else { 0.0 };
                scales.coat_pdf_w[lane] = if is_lobe { prob * pdf_w } else { 0.0 };
                scales.grazing[lane] = grazing(wo.dot(m));
                let lost = self.lost[lane] * shares.lost[lane];
                scales.lost[lane] = if is_lobe { lost } else { 0.0 };
                continue;
            }
            let coat = self.coats.reflectance(lane, wo.dot(m)) * once;
            let pdf_w = prob * pdf_w;
            scales.coat[lane] = if is_lobe { coat } else { 0.0 };
            scales.coat_pdf_w[lane] = if is_lobe { pdf_w } else { 0.0 };
        }
        scales
    }

    /// Values and densities of the lobes that merge, and of rough ones; those of
    /// [`Bsdf::lobes`](super::Bsdf::lobes).
    #[inline(always)]
    pub fn lobes(&self, wi: &Vec3s) -> (LobeValues, LobeValues) {
        let scales = self.scales(wi);
        let (mut wide, mut rough) = <(LobeValues, LobeValues)>::default();
        for lane in 0..LANES {
            let base = self.base.get(lane) * scales.base[lane];
            let coat = self.coat_value(lane, &scales);
            let joins = if self.is_narrow(lane) { 0.0 } else { 1.0 };
            let (base_pdf_w, coat_pdf_w) = (scales.base_pdf_w[lane], scales.coat_pdf_w[lane]);
            wide.value.set(lane, base + coat * joins);
            wide.pdf_w[lane] = base_pdf_w + coat_pdf_w * joins;
            rough.value.set(lane, coat * (1.0 - joins));
            rough.pdf_w[lane] = coat_pdf_w * (1.0 - joins);
        }
        (wide, rough)
    }

    /// Samples directions from three uniform numbers each; see
    /// [`Bsdf::sample`](super::Bsdf::sample).
    #[inline(always)]
    pub fn sample(&self, u: &[[f32; LANES]; 3]) -> CoatSamples {
        let mut samples = CoatSamples::default();
        let mut takes_facets = Mask::default();
        for lane in 0..LANES {
            let prob = self.coat_prob[lane];
            let takes_coat = (prob >= 1.0) | (u[0][lane] < prob);
            let is_smooth = self.coats.alpha[lane] == 0.0;
            let (normal, wo) = (self.normal.get(lane), self.wo.get(lane));
            let diffuse = cosine_hemisphere(normal, [u[1][lane], u[2][lane]]);
            let mirrored = normal * (2.0 * self.cos[lane]) - wo;
            samples.is_delta[lane] = takes_coat & is_smooth;
            takes_facets[lane] = takes_coat & !is_smooth & (self.cos[lane] > 0.0);
            samples.passes_through[lane] = takes_coat & self.is_narrow(lane);
            samples.wi.set(lane, if samples.is_delta[lane] { mirrored } else { diffuse });
            if METAL {
                // The number that chose the coat is uniform below its probability.
                let scatters_again = takes_facets[lane] & (u[0][lane] < prob * self.again(lane));
                takes_facets[lane] &= !scatters_again;
                samples.wi.set(lane, if scatters_again { diffuse } else { samples.wi.get(lane) });
            }
        }
        self.sample_facets(bits(&takes_facets), u, &mut samples.wi);
        let scales = self.scales(&samples.wi);
        for lane in 0..LANES {
            let prob = self.coat_prob[lane];
            let wi = samples.wi.get(lane);
            let cos_i = self.normal.get(lane).dot(wi);
            let is_delta = samples.is_delta[lane];
            let (base, coat) =
                (self.base.get(lane) * scales.base[lane], self.coat_value(lane, &scales));
            // A class of two lobes has one density. The other classes have one lobe.
            let joins = !self.is_narrow(lane);
            let takes_base = joins | !samples.passes_through[lane];
            let takes_coat = joins | samples.passes_through[lane];
            let base_share = if takes_base { 1.0 } else { 0.0 };
            let coat_share = if takes_coat { 1.0 } else { 0.0 };
            let value = base * base_share + coat * coat_share;
            let pdf_w = scales.base_pdf_w[lane] * base_share + scales.coat_pdf_w[lane] * coat_share;
            let mirrored = self.mirrored(lane) / prob;
            let weight = if is_delta { mirrored } else { value * (cos_i / pdf_w) };
            let has_coat = self.coats.has(CoatedBase::HAS_COAT, lane);
            let is_seen = (self.cos[lane] > 0.0) | !has_coat;
            samples.is_some[lane] = is_seen & ((pdf_w > 0.0) | is_delta) & (cos_i > 0.0);
            samples.weight.set(lane, weight);
            samples.pdf_w[lane] = if is_delta { 0.0 } else { pdf_w };
            samples.value[lane] = value.max_element();
        }
        samples
    }

    /// Reflectance of a smooth coat.
    #[inline(always)]
    fn mirrored(&self, lane: usize) -> Rgb {
        if METAL {
            return fresnel::schlick(self.cos[lane], self.metals.mixed.get(lane));
        }
        self.coats.tint.get(lane) * self.coats.reflectance(lane, self.cos[lane])
    }

    /// Directions that the facets of `lanes` reflect.
    #[inline(never)] // few
    fn sample_facets(&self, lanes: u32, u: &[[f32; LANES]; 3], directions: &mut Vec3s) {
        for lane in lanes_of(lanes) {
            let model = match self.coats.flags[lane] {
                flags if flags & CoatedBase::IS_BECKMANN != 0 => FacetModel::Beckmann,
                _ => FacetModel::Ggx, // correlated or not, the same normals are visible
            };
            let facets = Facets { model, alpha: self.coats.alpha[lane] };
            let frame = Frame::new(self.normal.get(lane));
            let wo = frame.to_local(self.wo.get(lane));
            let m = facets.sample_visible(wo, [u[1][lane], u[2][lane]]);
            directions.set(lane, frame.to_world(reflect(wo, m)));
        }
    }
}

#[cfg(test)]
mod tests;
