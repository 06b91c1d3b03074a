//! Diffuse reflection and transmission by thin sheets: paper, fabric, lampshades, leaves.

use super::model::{Describe, Lobes, Model, TextureValues, Traits, Transmission, values_by_class};
use super::{Bsdf, BsdfSample, Lobe, LobeSet, LobeValue, Transport, Vertex};
use crate::base::math::{Rgb, cosine_hemisphere, cosine_hemisphere_pdf_w};
use crate::base::rng::Rng;
use glam::Vec3;
use serde::Serialize;
use std::f32::consts::FRAC_1_PI;

/// A thin sheet that scatters light evenly to both of its sides, as pbrt's `diffusetransmission`.
/// Both sides are alike, and both lobes merge: theory.md (27a).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct DiffuseTransmission {
    reflectance: Rgb,
    transmittance: Rgb,
    /// Factor of both, in each channel: their sum is at most 1.
    #[serde(skip)]
    scale: Rgb,
}

impl DiffuseTransmission {
    /// A sheet that reflects and transmits these shares of the incident flux, both in [0, 1].
    /// Channels whose sum exceeds 1 are scaled to the sum 1.
    pub fn new(reflectance: Rgb, transmittance: Rgb) -> Self {
        let scale = (reflectance + transmittance).max(Rgb::ONE).recip();
        Self { reflectance, transmittance, scale }
    }

    /// This sheet with its shares multiplied by colors, as [`Self::new`] got them: textures may
    /// leave a sum below 1 where that of their factors is not.
    #[must_use]
    pub fn scaled(&self, reflected: Rgb, transmitted: Rgb) -> Self {
        Self::new(self.reflectance * reflected, self.transmittance * transmitted)
    }

    /// Reflected share of the incident flux, as [`Self::new`] got it.
    pub fn reflectance(&self) -> Rgb {
        self.reflectance
    }

    /// Transmitted share of the incident flux, as [`Self::new`] got it.
    pub fn transmittance(&self) -> Rgb {
        self.transmittance
    }

    /// Reflected and transmitted shares of the incident flux, whose sum is at most 1 but for
    /// rounding.
    pub fn shares(&self) -> [Rgb; 2] {
        [self.share(false), self.share(true)]
    }

    /// Scattered share of the incident flux, at most 1 but for rounding.
    pub fn albedo(&self) -> Rgb {
        self.share(false) + self.share(true)
    }

    /// Share of the incident flux that is scattered to one side: transmitted or reflected.
    fn share(&self, transmits: bool) -> Rgb {
        self.scale * if transmits { self.transmittance } else { self.reflectance }
    }

    /// Value between two directions on opposite sides, or on one side; 1/sr. theory.md (27a)
    #[inline]
    pub fn value(&self, transmits: bool) -> Rgb {
        self.share(transmits) * FRAC_1_PI
    }

    /// Value for light from a direction of the cosine `cos` with the normal on the side of `wo`,
    /// 1/sr.
    #[inline]
    pub fn eval(&self, cos: f32) -> Rgb {
        if cos == 0.0 { Rgb::ZERO } else { self.value(cos < 0.0) }
    }

    /// Probabilities of sampling reflection and transmission, in proportion to the largest channel
    /// of each; `None` where all is absorbed. theory.md (27b)
    fn probs(&self) -> Option<[f32; 2]> {
        let shares = [false, true].map(|transmits| self.share(transmits).max_element());
        let sum = shares[0] + shares[1];
        (sum > 0.0).then(|| shares.map(|share| share / sum))
    }

    /// Density of sampling a direction of this cosine with the normal, 1/sr. theory.md (27b)
    pub fn pdf_w(&self, cos: f32) -> f32 {
        let Some([reflected, transmitted]) = self.probs() else { return 0.0 };
        let prob = if cos > 0.0 { reflected } else { transmitted };
        prob * cosine_hemisphere_pdf_w(cos.abs())
    }

    /// Samples a direction on either side of a surface, whose normal on the side of `wo` is
    /// `normal`.
    pub fn sample(&self, normal: Vec3, rng: &mut Rng) -> Option<BsdfSample> {
        let [reflected, transmitted] = self.probs()?;
        let transmits = rng.next_1d() >= reflected;
        let (side, prob) = if transmits { (-normal, transmitted) } else { (normal, reflected) };
        // theory.md (27b)
        let weight = self.share(transmits) / prob;
        let wi = cosine_hemisphere(side, rng.next_2d());
        Some(BsdfSample { wi, weight, lobe: Lobe::Wide })
    }
}

impl Describe for DiffuseTransmission {
    #[inline]
    fn traits(&self) -> Traits {
        Traits {
            classes: Lobes::of(Lobe::Wide),
            transmission: Transmission::Diffuse,
            depends_on_tangent: false,
            albedo_bound: self.albedo(),
        }
    }

    fn textured(&self, texture: &TextureValues) -> Option<Bsdf> {
        Some(Bsdf::DiffuseTransmission(self.scaled(texture.color, texture.transmitted)))
    }

    fn color(&self, _front: bool) -> Rgb {
        self.albedo()
    }
}

/// Without a frame: the cosines with the normal suffice.
impl Model for DiffuseTransmission {
    #[inline]
    fn eval(&self, _lobe: Option<Lobe>, at: &Vertex, wi: Vec3) -> Rgb {
        self.eval(wi.dot(at.normal))
    }

    fn pdf_w(&self, _lobe: Lobe, at: &Vertex, wi: Vec3) -> f32 {
        self.pdf_w(wi.dot(at.normal))
    }

    fn values(&self, at: &Vertex, wi: Vec3) -> [LobeValue; 2] {
        values_by_class(self, at, wi)
    }

    #[inline]
    fn pass_prob(&self, _at: &Vertex) -> f32 {
        0.0
    }

    fn sample(
        &self,
        at: &Vertex,
        _transport: Transport,
        _wanted: LobeSet,
        rng: &mut Rng,
    ) -> Option<BsdfSample> {
        self.sample(at.normal, rng)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Stream, StreamKey};
    use std::f64::consts::PI;

    const REFLECTED: Rgb = Rgb::new(0.5, 0.2, 0.0);
    const TRANSMITTED: Rgb = Rgb::new(0.1, 0.6, 0.3);

    /// Irradiance 1 from a cone around the normal leaves the reflected share on the side of the
    /// light and the transmitted share on the other, evenly: the flux by the cosine of the
    /// direction.
    #[test]
    fn both_sides_get_their_share_of_the_flux_by_the_cosine() {
        let sheet = DiffuseTransmission::new(REFLECTED, TRANSMITTED);
        let normal = Vec3::new(0.6, -0.48, 0.64);
        let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
        // Four rings of equal flux on each side.
        let (n, mut rings) = (200_000, [[Rgb::ZERO; 4]; 2]);
        for _ in 0..n {
            let BsdfSample { wi, weight, lobe } = sheet.sample(normal, &mut rng).unwrap();
            let cos = wi.dot(normal);
            let expected = sheet.eval(cos) * cos.abs() / sheet.pdf_w(cos);
            assert!((weight - expected).abs().max_element() < 1e-4, "{weight} {expected}");
            assert_eq!(lobe, Lobe::Wide);
            let ring = ((cos * cos * 4.0) as usize).min(3);
            rings[usize::from(cos < 0.0)][ring] += weight / n as f32;
        }
        for (rings, share) in rings.iter().zip([REFLECTED, TRANSMITTED]) {
            for ring in rings {
                // Each is the mean of a fraction p < 1/4 of the samples of weight below 1.1.
                let off = (*ring - share / 4.0).abs().max_element();
                assert!(off < 4.0 * 1.1 * (0.25 / f32::sqrt(n as f32)), "{ring} {share}");
            }
        }
    }

    #[test]
    fn density_integrates_to_one_over_both_sides() {
        for (reflected, transmitted) in
            [(REFLECTED, TRANSMITTED), (Rgb::ZERO, Rgb::ONE), (Rgb::splat(0.3), Rgb::ZERO)]
        {
            let sheet = DiffuseTransmission::new(reflected, transmitted);
            let rows = 10_000;
            let density = |row: i32| {
                let cos = (2.0 * (f64::from(row) + 0.5) / f64::from(rows) - 1.0) as f32;
                f64::from(sheet.pdf_w(cos)) * 4.0 * PI / f64::from(rows)
            };
            let sum: f64 = (0..rows).map(density).sum();
            assert!((sum - 1.0).abs() < 1e-4, "{sum}");
        }
        let black = DiffuseTransmission::new(Rgb::ZERO, Rgb::ZERO);
        let mut rng = StreamKey::new(4, Stream::Test, 0).rng(0);
        assert!(black.pdf_w(0.5) == 0.0 && black.sample(Vec3::Z, &mut rng).is_none());
    }

    #[test]
    fn sheets_never_scatter_more_than_arrives() {
        let sheet = DiffuseTransmission::new(Rgb::new(1.0, 0.4, 0.5), Rgb::new(1.0, 0.4, 0.75));
        assert_eq!(sheet.albedo(), Rgb::new(1.0, 0.8, 1.0));
        assert_eq!(sheet.value(true), Rgb::new(0.5, 0.4, 0.6) * FRAC_1_PI);
        // A texture leaves the sum of both within 1.
        let dark = sheet.scaled(Rgb::splat(0.5), Rgb::splat(0.25));
        assert_eq!(
            dark,
            DiffuseTransmission::new(Rgb::new(0.5, 0.2, 0.25), Rgb::new(0.25, 0.1, 0.1875))
        );
        assert_eq!(dark.albedo(), Rgb::new(0.75, 0.3, 0.4375));
    }
}
