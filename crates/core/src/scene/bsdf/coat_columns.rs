//! Parameters of sixteen coats over bases side by side, and the functions of one cosine or normal
//! that both directions of light share.

use super::coated_base::CoatedBase;
use super::fresnel;
use super::ggx::{Ggx, by_schlick};
use super::plastic::COEFFICIENTS;
use crate::base::math::exp_minus;
use crate::simd::{LANES, Vec3s};
use bytemuck::{Pod, Zeroable};
use glam::Vec3;
use std::f32::consts::PI;

/// Sixteen [`CoatedBase`]s, column by column.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub(in crate::scene) struct CoatedBases {
    pub(super) albedo: Vec3s,
    pub(super) flags: [u32; LANES],
    pub(super) tint: Vec3s,
    pub(super) eta: [f32; LANES],
    pub(super) alpha: [f32; LANES],
    pub(super) mean_transmittance: [f32; LANES],
    pub(super) inside: [f32; LANES],
    pub(super) saturates: [f32; LANES],
    transmittance: [[f32; LANES]; COEFFICIENTS],
}

/// Sixteen [`MetalRow`](super::coated_base::MetalRow)s, column by column.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub(in crate::scene) struct Metals {
    pub(super) mixed: Vec3s,
    pub(super) metallic: [f32; LANES],
    pub(super) multiple: Vec3s,
    unused: [f32; LANES],
}

/// Shares of light by the cosines of its directions.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Shares {
    /// What enters the coat.
    pub(super) enters: [f32; LANES],
    /// What the facets reflect, in the largest channel.
    pub(super) reflected: [f32; LANES],
    /// What single scattering of a white metal loses; 0 of coats that are no metal.
    pub(super) lost: [f32; LANES],
}

impl CoatedBases {
    /// 1 if the surface of a lane has a coat, else 0.
    #[inline(always)] // as all functions here: parts of the loop over vertices
    pub fn has_coat(&self, lane: usize) -> f32 {
        if self.has(CoatedBase::HAS_COAT, lane) { 1.0 } else { 0.0 }
    }

    #[inline(always)]
    pub(super) fn has(&self, flag: u32, lane: usize) -> bool {
        self.flags[lane] & flag != 0
    }

    /// Reflected share of a facet that is seen at this cosine.
    #[inline(always)]
    pub(super) fn reflectance(&self, lane: usize, cos: f32) -> f32 {
        let eta = self.eta[lane];
        let schlick = eta + (1.0 - eta) * grazing(cos);
        let dielectric = fresnel::dielectric(cos, eta).0;
        if self.has(CoatedBase::IS_SCHLICK, lane) { schlick } else { dielectric }
    }

    /// Shares of the light from these cosines.
    #[inline(always)]
    pub(super) fn shares<const METAL: bool>(&self, metals: &Metals, cos: &[f32; LANES]) -> Shares {
        let mut shares = Shares::default();
        if METAL {
            // Look-ups of tables are no vector instructions: they are apart from other loops.
            for (lane, cos) in cos.iter().enumerate() {
                let albedos = Ggx { alpha: self.alpha[lane] }.albedos(*cos);
                shares.enters[lane] = (1.0 - by_schlick(albedos, self.eta[lane])).max(0.0);
                let mixed = metals.mixed.get(lane).max_element();
                shares.reflected[lane] = by_schlick(albedos, mixed);
                shares.lost[lane] = (1.0 - albedos.x).max(0.0);
            }
            return shares;
        }
        for (lane, cos) in cos.iter().enumerate() {
            let enters = self.transmittance(lane, *cos);
            shares.enters[lane] = enters;
            shares.reflected[lane] = (1.0 - enters) * self.tint.get(lane).max_element();
        }
        shares
    }

    /// Share of the light from the cosine `cos` that enters the coat, which is no metal.
    #[inline(always)]
    fn transmittance(&self, lane: usize, cos: f32) -> f32 {
        let smooth = 1.0 - self.reflectance(lane, cos);
        let t = &self.transmittance;
        let x = 2.0 * cos - 1.0;
        let x2 = x * x;
        let x4 = x2 * x2;
        let low = (t[0][lane] + t[1][lane] * x) + (t[2][lane] + t[3][lane] * x) * x2;
        let middle = (t[4][lane] + t[5][lane] * x) + (t[6][lane] + t[7][lane] * x) * x2;
        let high = (t[8][lane] + t[9][lane] * x) + (t[10][lane] + t[11][lane] * x) * x2;
        let rough = (low + (middle + high * x4) * x4).clamp(0.0, 1.0);
        if self.alpha[lane] == 0.0 { smooth } else { rough }
    }

    /// The facets' hidden over visible share from a direction of this cosine, whose distance from
    /// the normal has this square.
    #[inline(always)]
    pub(super) fn lambda(&self, lane: usize, cos: f32, across2: f32) -> f32 {
        let alpha = self.alpha[lane];
        let tan2 = across2 / (cos * cos);
        let ggx = 0.5 * ((1.0 + alpha * alpha * tan2).sqrt() - 1.0);
        // Slope of the direction over the width; the lambda is 0 within rounding from 10 on.
        let a = (cos.abs() / (alpha * across2.sqrt()).max(1e-30)).clamp(1e-6, 10.0);
        // The error function as in `beckmann.rs`, which has its source.
        let t = (1.0 + 0.327_591_1 * a).recip();
        let series = ((((1.061_405_4 * t - 1.453_152) * t + 1.421_413_7) * t - 0.284_496_74) * t
            + 0.254_829_6)
            * t;
        let root = PI.sqrt();
        let beckmann = (0.5 * exp_minus(a * a) * ((a * root).recip() - series)).max(0.0);
        if self.has(CoatedBase::IS_BECKMANN, lane) { beckmann } else { ggx }
    }

    /// Density of the facets' normals of this cosine over the surface, 1/sr.
    #[inline(always)]
    pub(super) fn density(&self, lane: usize, cos: f32, across2: f32) -> f32 {
        let alpha2 = self.alpha[lane] * self.alpha[lane];
        let cos2 = cos * cos;
        let stretched = across2 / alpha2 + cos2;
        let ggx = (PI * alpha2 * stretched * stretched).recip();
        let beckmann = exp_minus(across2 / (cos2 * alpha2)) / (PI * alpha2 * cos2 * cos2);
        let beckmann = if cos > 0.0 { beckmann } else { 0.0 };
        if self.has(CoatedBase::IS_BECKMANN, lane) { beckmann } else { ggx }
    }
}

/// The weight `(1 - cos)^5` of Schlick's approximation.
#[inline(always)]
pub(super) fn grazing(cos: f32) -> f32 {
    let away = (1.0 - cos).max(0.0);
    let away2 = away * away;
    away2 * away2 * away
}

/// Square of the distance of a unit vector from a normal to which it has this cosine.
#[inline(always)]
pub(super) fn across2(w: Vec3, normal: Vec3, cos: f32) -> f32 {
    (w - normal * cos).length_squared()
}
