//! Sampling of a coat over a diffuse base.

use super::{BsdfSample, DIFFUSE_ALPHA, Lobe, LobeSet, LobeValue, mirrored};
use crate::base::math::{Rgb, cosine_hemisphere, cosine_hemisphere_pdf_w};
use crate::base::rng::Rng;
use glam::Vec3;
use std::f32::consts::PI;

/// Class of the lobe of facets of this width, which is 0 if they are smooth.
#[inline]
pub(super) fn facets_lobe(alpha: f32) -> Lobe {
    match alpha {
        0.0 => Lobe::Delta,
        alpha if alpha < DIFFUSE_ALPHA => Lobe::Rough,
        _ => Lobe::Diffuse,
    }
}

/// A surface of two lobes: a coat, which merges or passes through by the width of its facets, over
/// a diffuse base. If the coat is narrow or smooth, paths merge by the base and pass through by the
/// coat. Directions are local.
pub(super) trait CoatOverBase {
    /// Class of the coat's lobe.
    fn coat_lobe(&self) -> Lobe;

    /// Returns true if the base reflects any light.
    fn has_base(&self) -> bool;

    /// Probability of the coat's lobe, about its share of the reflected light. It is 1 if there is
    /// no base, and less than 1 if there is one.
    fn coat_prob(&self, wo: Vec3) -> f32;

    /// Reflected share of a smooth coat.
    fn mirrored_share(&self, cos: f32) -> Rgb;

    /// Value of the coat, 1/sr, for two directions above the surface. Not called for a smooth coat.
    fn eval_coat(&self, wo: Vec3, wi: Vec3) -> Rgb;

    /// Density of [`Self::sample_coat`], 1/sr. Not called for a smooth coat.
    fn coat_pdf_w(&self, wo: Vec3, wi: Vec3) -> f32;

    /// [`Self::eval_coat`] and [`Self::coat_pdf_w`], which have much in common.
    fn coat(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        (self.eval_coat(wo, wi), self.coat_pdf_w(wo, wi))
    }

    /// A direction from the coat, possibly below the surface. Not called for a smooth coat.
    fn sample_coat(&self, wo: Vec3, rng: &mut Rng) -> Vec3;

    /// Value of the base, 1/sr, for two directions above the surface.
    fn eval_base(&self, wo: Vec3, wi: Vec3) -> Rgb;

    /// Returns true if the surface has a lobe of this class.
    #[inline]
    fn has(&self, lobe: Lobe) -> bool {
        self.coat_lobe() == lobe || (lobe == Lobe::Diffuse && self.has_base())
    }

    /// The value of the lobes of one class, or of all but single directions, 1/sr.
    fn eval(&self, lobe: Option<Lobe>, wo: Vec3, wi: Vec3) -> Rgb {
        if wi.z <= 0.0 {
            return Rgb::ZERO;
        }
        let (coat_lobe, wanted) = (self.coat_lobe(), |own| lobe.is_none_or(|lobe| lobe == own));
        let has_coat = coat_lobe != Lobe::Delta && wanted(coat_lobe);
        let coat = if has_coat { self.eval_coat(wo, wi) } else { Rgb::ZERO };
        let base = if wanted(Lobe::Diffuse) { self.eval_base(wo, wi) } else { Rgb::ZERO };
        coat + base
    }

    /// Values and densities of the lobes that merge, and of rough ones.
    fn lobes(&self, wo: Vec3, wi: Vec3) -> [LobeValue; 2] {
        if wi.z <= 0.0 {
            return <[LobeValue; 2]>::default();
        }
        let prob = self.coat_prob(wo);
        let base = LobeValue {
            value: self.eval_base(wo, wi),
            pdf_w: (1.0 - prob) * cosine_hemisphere_pdf_w(wi.z),
        };
        let coat_lobe = self.coat_lobe();
        if coat_lobe == Lobe::Delta {
            return [base, LobeValue::default()];
        }
        let (value, pdf_w) = self.coat(wo, wi);
        let coat = LobeValue { value, pdf_w: prob * pdf_w };
        if coat_lobe == Lobe::Rough {
            return [base, coat];
        }
        let both = LobeValue { value: base.value + coat.value, pdf_w: base.pdf_w + coat.pdf_w };
        [both, LobeValue::default()]
    }

    /// Density of sampling the lobes of one class, 1/sr; its integral is less than 1 if there are
    /// other classes.
    fn pdf_w(&self, lobe: Lobe, wo: Vec3, wi: Vec3) -> f32 {
        if wi.z <= 0.0 || lobe == Lobe::Delta {
            return 0.0;
        }
        let prob = self.coat_prob(wo);
        let has_coat = self.coat_lobe() == lobe;
        let coat = if has_coat { prob * self.coat_pdf_w(wo, wi) } else { 0.0 };
        let base = if lobe == Lobe::Diffuse { cosine_hemisphere_pdf_w(wi.z) } else { 0.0 };
        coat + (1.0 - prob) * base
    }

    /// Samples a direction. The weight is 0 if it is below the surface, toward another facet.
    fn sample(&self, wo: Vec3, wanted: LobeSet, rng: &mut Rng) -> Option<BsdfSample> {
        let lobe = self.coat_lobe();
        let prob = if wanted == LobeSet::All { self.coat_prob(wo) } else { 1.0 };
        let is_coat = prob >= 1.0 || rng.next_1d() < prob;
        if is_coat && lobe == Lobe::Delta {
            return Some(mirrored(wo, self.mirrored_share(wo.z) / prob));
        }
        let wi = if is_coat {
            self.sample_coat(wo, rng)
        } else {
            cosine_hemisphere(Vec3::Z, rng.next_2d())
        };
        if wi.z <= 0.0 {
            return Some(BsdfSample::lost(if is_coat { lobe } else { Lobe::Diffuse }));
        }
        if lobe == Lobe::Diffuse {
            // Both lobes have this class: one density for both.
            let pdf = self.pdf_w(lobe, wo, wi);
            let weight = self.eval(Some(lobe), wo, wi) * (wi.z / pdf);
            return (pdf > 0.0).then_some(BsdfSample { wi, weight, lobe });
        }
        if is_coat {
            let pdf = prob * self.coat_pdf_w(wo, wi);
            let weight = self.eval_coat(wo, wi) * (wi.z / pdf);
            return (pdf > 0.0).then_some(BsdfSample { wi, weight, lobe });
        }
        let weight = self.eval_base(wo, wi) * (PI / (1.0 - prob));
        Some(BsdfSample { wi, weight, lobe: Lobe::Diffuse })
    }
}
