//! Smooth dielectrics: an interface between two media, and a thin sheet.

use super::fresnel::PolarizedShares;
use super::mirror::mirrored;
use super::model::{
    Describe, Lobes, Local, LocalModel, TextureValues, Traits, Transmission, only_single_directions,
};
use super::{Bsdf, BsdfSample, Lobe, LobeSet, LobeValue, Transport, fresnel};
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
}

impl Describe for Dielectric {
    #[inline]
    fn traits(&self) -> Traits {
        Traits {
            classes: Lobes::of(Lobe::Delta),
            transmission: Transmission::Passing,
            depends_on_tangent: false,
            albedo_bound: Rgb::ONE,
        }
    }

    fn textured(&self, _texture: &TextureValues) -> Option<Bsdf> {
        None
    }

    /// White: denoisers see what the glass shows.
    fn color(&self, _front: bool) -> Rgb {
        Rgb::ONE
    }
}

impl LocalModel for Dielectric {
    only_single_directions!();

    #[inline]
    fn sample(
        &self,
        Local { wo, front }: Local,
        transport: Transport,
        _wanted: LobeSet,
        rng: &mut Rng,
    ) -> Option<BsdfSample> {
        let eta = relative(self.eta, front);
        let (reflected, cos_t) = fresnel::dielectric(wo.z, eta);
        if rng.next_1d() < reflected {
            return Some(mirrored(wo, Rgb::ONE));
        }
        let wi = Vec3::new(-wo.x / eta, -wo.y / eta, -cos_t);
        let weight = self.transmittance * transmission_scale(transport, eta);
        Some(BsdfSample { wi, weight, lobe: Lobe::Delta })
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
    /// Share of light that is left after crossing the sheet at normal incidence, in [0, 1], without
    /// reflections: light aslant has a longer way. Only where the sheet absorbs is it part of the
    /// fingerprint, so that other scenes keep theirs.
    #[serde(skip_serializing_if = "is_clear")]
    pub internal: Rgb,
}

fn is_clear(internal: &Rgb) -> bool {
    *internal == Rgb::ONE
}

impl ThinDielectric {
    /// Without color.
    pub const fn new(eta: f32) -> Self {
        Self { eta, transmittance: Rgb::ONE, internal: Rgb::ONE }
    }

    /// Share of light that is left after one crossing, at this cosine with the normal outside.
    /// theory.md (30f)
    fn once(&self, cos: f32) -> Rgb {
        if is_clear(&self.internal) {
            return Rgb::ONE;
        }
        let cos_t = (1.0 - (1.0 - cos * cos) / (self.eta * self.eta)).max(1e-4).sqrt();
        self.internal.map(|own| own.powf(cos_t.recip()))
    }

    /// Shares of the light that goes straight on and that is mirrored, at this cosine with the
    /// normal. theory.md (30)
    pub fn shares(&self, cos: f32) -> [Rgb; 2] {
        let [transmitted, reflected] = fresnel::slab(cos, self.eta, self.once(cos));
        [transmitted * self.transmittance, reflected]
    }

    /// Shares of the light that goes straight on, by polarization, at this cosine with the normal.
    pub fn polarized_shares(&self, cos: f32) -> PolarizedShares {
        PolarizedShares::of_slab(cos, self.eta, self.once(cos)).scaled(self.transmittance)
    }
}

impl Describe for ThinDielectric {
    #[inline]
    fn traits(&self) -> Traits {
        Traits {
            classes: Lobes::of(Lobe::Delta),
            transmission: Transmission::Passing,
            depends_on_tangent: false,
            albedo_bound: Rgb::ONE,
        }
    }

    fn textured(&self, _texture: &TextureValues) -> Option<Bsdf> {
        None
    }

    /// White: denoisers see what the sheet shows.
    fn color(&self, _front: bool) -> Rgb {
        Rgb::ONE
    }
}

impl LocalModel for ThinDielectric {
    only_single_directions!();

    #[inline]
    fn sample(
        &self,
        Local { wo, .. }: Local,
        _transport: Transport,
        _wanted: LobeSet,
        rng: &mut Rng,
    ) -> Option<BsdfSample> {
        let [transmitted, reflected] = fresnel::slab(wo.z, self.eta, self.once(wo.z));
        let (prob, shares) = if is_clear(&self.internal) {
            (reflected.x, [Rgb::ONE; 2])
        } else {
            let [passes, returns] = [transmitted, reflected].map(|own| own.max_element());
            let prob = returns / (passes + returns);
            (prob, [transmitted / (1.0 - prob), reflected / prob])
        };
        if rng.next_1d() < prob {
            return Some(mirrored(wo, shares[1]));
        }
        let weight = shares[0] * self.transmittance;
        Some(BsdfSample { wi: -wo, weight, lobe: Lobe::Delta })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Stream, StreamKey};

    /// Glass that absorbs: Beer's law along the refracted way, all reflections, and samples that
    /// carry both shares.
    #[test]
    fn absorbing_sheets_sample_their_shares() {
        let internal = Rgb::new(0.65, 0.9, 1.0);
        let sheet = ThinDielectric { internal, ..ThinDielectric::new(1.52) };
        let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
        for cos in [1.0, 0.6, 0.2] {
            let wo = Vec3::new((1.0f32 - cos * cos).sqrt(), 0.0, cos);
            let [transmitted, reflected] = sheet.shares(cos);
            let cos_t = (1.0 - (1.0 - cos * cos) / (1.52 * 1.52)).sqrt();
            let once = internal.map(|own| own.powf(1.0 / cos_t));
            assert!((transmitted - fresnel::slab(cos, 1.52, once)[0]).length() < 1e-6);
            let clear = ThinDielectric::new(1.52).shares(cos);
            assert!((transmitted.z - clear[0].z).abs() < 1e-6 && transmitted.x < clear[0].x);
            let n = 40_000;
            let mut sums = [Rgb::ZERO; 2];
            for _ in 0..n {
                let at = Local { wo, front: true };
                let sample = sheet.sample(at, Transport::Flux, LobeSet::All, &mut rng);
                let BsdfSample { wi, weight, .. } = sample.unwrap();
                sums[usize::from(wi.z > 0.0)] += weight / n as f32;
            }
            for (sum, share) in sums.iter().zip([transmitted, reflected]) {
                // Weights are at most 1, so that a share has less than this standard error.
                let error = 0.5 / f32::sqrt(n as f32);
                assert!((*sum - share).abs().max_element() < 4.0 * error, "{cos} {sum} {share}");
            }
        }
        let polarized = sheet.polarized_shares(0.6);
        let mean = 0.5 * (polarized.s + polarized.p);
        assert!((mean - sheet.shares(0.6)[0]).length() < 1e-6);
    }
}
