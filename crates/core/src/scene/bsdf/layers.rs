//! Sampling of a coat over a diffuse base.

use super::mirror::mirrored;
use super::model::{Describe, Lobes, Local, LocalModel};
use super::{BsdfSample, DIFFUSE_ALPHA, Lobe, LobeSet, LobeValue, Transport};
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
        _ => Lobe::Wide,
    }
}

/// A surface of two lobes: a coat, which merges or passes through by the width of its facets, over
/// a diffuse base. If the coat is narrow or smooth, paths merge by the base and pass through by the
/// coat. Directions are local.
pub(super) trait CoatOverBase: Describe {
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

    /// Classes of the coat and of the base.
    #[inline]
    fn coat_and_base(&self) -> Lobes {
        let coat = Lobes::of(self.coat_lobe());
        Lobes { diffuse: coat.diffuse || self.has_base(), ..coat }
    }
}

impl<C: CoatOverBase> LocalModel for C {
    fn eval(&self, lobe: Option<Lobe>, Local { wo, .. }: Local, wi: Vec3) -> Rgb {
        if wi.z <= 0.0 {
            return Rgb::ZERO;
        }
        let (coat_lobe, wanted) = (self.coat_lobe(), |own| lobe.is_none_or(|lobe| lobe == own));
        let has_coat = coat_lobe != Lobe::Delta && wanted(coat_lobe);
        let coat = if has_coat { self.eval_coat(wo, wi) } else { Rgb::ZERO };
        let base = if wanted(Lobe::Wide) { self.eval_base(wo, wi) } else { Rgb::ZERO };
        coat + base
    }

    fn values(&self, Local { wo, .. }: Local, wi: Vec3) -> Option<[LobeValue; 2]> {
        if wi.z <= 0.0 {
            return Some(Default::default());
        }
        let prob = self.coat_prob(wo);
        let base = LobeValue {
            value: self.eval_base(wo, wi),
            pdf_w: (1.0 - prob) * cosine_hemisphere_pdf_w(wi.z),
        };
        let coat_lobe = self.coat_lobe();
        if coat_lobe == Lobe::Delta {
            return Some([base, LobeValue::default()]);
        }
        let (value, pdf_w) = self.coat(wo, wi);
        let coat = LobeValue { value, pdf_w: prob * pdf_w };
        if coat_lobe == Lobe::Rough {
            return Some([base, coat]);
        }
        let both = LobeValue { value: base.value + coat.value, pdf_w: base.pdf_w + coat.pdf_w };
        Some([both, LobeValue::default()])
    }

    fn pdf_w(&self, lobe: Lobe, Local { wo, .. }: Local, wi: Vec3) -> f32 {
        if wi.z <= 0.0 {
            return 0.0;
        }
        let prob = self.coat_prob(wo);
        let has_coat = self.coat_lobe() == lobe;
        let coat = if has_coat { prob * self.coat_pdf_w(wo, wi) } else { 0.0 };
        let base = if lobe == Lobe::Wide { cosine_hemisphere_pdf_w(wi.z) } else { 0.0 };
        coat + (1.0 - prob) * base
    }

    #[inline]
    fn pass_prob(&self, Local { wo, .. }: Local) -> f32 {
        if self.coat_lobe().passes_through() { self.coat_prob(wo) } else { 0.0 }
    }

    /// The weight is 0 if the direction is below the surface, toward another facet.
    fn sample(
        &self,
        at: Local,
        _transport: Transport,
        wanted: LobeSet,
        rng: &mut Rng,
    ) -> Option<BsdfSample> {
        let (wo, lobe) = (at.wo, self.coat_lobe());
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
            return Some(BsdfSample::lost(if is_coat { lobe } else { Lobe::Wide }));
        }
        if lobe == Lobe::Wide {
            // Both lobes have this class: one density for both.
            let pdf = self.pdf_w(lobe, at, wi);
            let weight = self.eval(Some(lobe), at, wi) * (wi.z / pdf);
            return (pdf > 0.0).then_some(BsdfSample { wi, weight, lobe });
        }
        if is_coat {
            let pdf = prob * self.coat_pdf_w(wo, wi);
            let weight = self.eval_coat(wo, wi) * (wi.z / pdf);
            return (pdf > 0.0).then_some(BsdfSample { wi, weight, lobe });
        }
        let weight = self.eval_base(wo, wi) * (PI / (1.0 - prob));
        Some(BsdfSample { wi, weight, lobe: Lobe::Wide })
    }
}
