//! Smooth dielectrics: an interface between two media, and a thin sheet.

use super::fresnel::PolarizedShares;
use super::{BsdfSample, Lobe, Transport, fresnel, mirrored};
use crate::base::math::Rgb;
use crate::base::rng::Rng;
use glam::Vec3;
use serde::Serialize;

/// A smooth interface between two dielectrics. Media nest by interfaces: each has the ratio of the
/// indices on its two sides.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Dielectric {
    /// Refractive index behind the surface over that in front.
    pub eta: f32,
    /// Factor of light that crosses the surface, in [0, 1].
    pub transmittance: Rgb,
}

impl Dielectric {
    /// Without color.
    pub const fn new(eta: f32) -> Self {
        Self { eta, transmittance: Rgb::ONE }
    }

    pub(super) fn sample(
        &self,
        wo: Vec3,
        front: bool,
        transport: Transport,
        rng: &mut Rng,
    ) -> BsdfSample {
        let eta = relative(self.eta, front);
        let (reflected, cos_t) = fresnel::dielectric(wo.z, eta);
        if rng.next_1d() < reflected {
            return mirrored(wo, Rgb::ONE);
        }
        let wi = Vec3::new(-wo.x / eta, -wo.y / eta, -cos_t);
        let weight = self.transmittance * transmission_scale(transport, eta);
        BsdfSample { wi, weight, lobe: Lobe::Delta }
    }
}

/// Index beyond the surface over that on the side of `wo`.
#[inline]
pub(super) fn relative(eta: f32, front: bool) -> f32 {
    if front { eta } else { eta.recip() }
}

/// Factor of the carried quantity across an interface: radiance spreads over a solid angle that
/// changes as `1/n^2`, and the camera's side is that of `wo`. theory.md (21).
#[inline]
pub(super) fn transmission_scale(transport: Transport, eta: f32) -> f32 {
    match transport {
        Transport::Radiance => (eta * eta).recip(),
        Transport::Flux => 1.0,
    }
}

/// A plane-parallel sheet without thickness: light goes straight on or is mirrored, all orders of
/// reflection inside included.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ThinDielectric {
    /// Refractive index of the sheet over that of its surroundings.
    pub eta: f32,
    /// Factor of light that goes straight on, in [0, 1].
    pub transmittance: Rgb,
}

impl ThinDielectric {
    /// Without color.
    pub const fn new(eta: f32) -> Self {
        Self { eta, transmittance: Rgb::ONE }
    }

    /// Shares of the light that goes straight on and that is mirrored, at this cosine with the
    /// normal. theory.md (30)
    pub fn shares(&self, cos: f32) -> [Rgb; 2] {
        let [transmitted, reflected] = fresnel::slab(cos, self.eta, Rgb::ONE);
        [transmitted * self.transmittance, reflected]
    }

    /// Shares of the light that goes straight on, by polarization, at this cosine with the normal.
    pub fn polarized_shares(&self, cos: f32) -> PolarizedShares {
        PolarizedShares::of_slab(cos, self.eta, Rgb::ONE).scaled(self.transmittance)
    }

    pub(super) fn sample(&self, wo: Vec3, rng: &mut Rng) -> BsdfSample {
        let [_, reflected] = fresnel::slab(wo.z, self.eta, Rgb::ONE);
        if rng.next_1d() < reflected.x {
            return mirrored(wo, Rgb::ONE);
        }
        BsdfSample { wi: -wo, weight: self.transmittance, lobe: Lobe::Delta }
    }
}
