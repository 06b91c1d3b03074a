//! A diffuse base under a smooth or rough dielectric coat, as the plugins `plastic` and
//! `roughplastic` of Mitsuba 3 have it.

use super::facets::{FacetModel, Facets};
use super::ggx::reflect;
use super::layers::{CoatOverBase, facets_lobe};
use super::model::{Describe, TextureValues, Traits, Transmission};
use super::{Bsdf, Lobe, SMOOTH_ALPHA, fresnel};
use crate::base::math::Rgb;
use crate::base::rng::Rng;
use glam::Vec3;
use serde::Serialize;
use std::f32::consts::{FRAC_1_PI, PI};

/// A coat of facets that reflect by the Fresnel formula, over a diffuse base, on both sides of the
/// surface.
///
/// It has two lobes. The lobe of the *coat* scatters once, `F D G / (4 cos_o cos_i)`. The *base* is
/// diffuse: `f = albedo / (1 - A F_in) * T(wo) T(wi) / (pi eta^2)`, where `T` is the share of light
/// that enters and `F_in` the diffuse reflectance of the coat from inside. `A` is the albedo where
/// reflections between base and coat are saturated (`nonlinear`), else 1.
///
/// Reciprocal. A smooth nonlinear coat over a white base is lossless; facets lose what they would
/// scatter again.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Plastic {
    albedo: Rgb,
    /// Factor of the light that the coat reflects.
    tint: Rgb,
    eta: f32,
    facets: Facets,
    is_nonlinear: bool,
    /// Value of the base over both transmittances, 1/sr.
    #[serde(skip)]
    base: Rgb,
    #[serde(skip)]
    coat: CoatMeans,
}

/// Number of coefficients of the transmittance. A Chebyshev series of them reproduces it within
/// 1e-3.
pub(super) const COEFFICIENTS: usize = 12;
/// Cosines at which the transmittance is integrated, in the steps of Mitsuba's tables.
const COSINES: usize = 64;
/// Facets across and down of the integral from outside and from inside, where total reflection has
/// an edge.
const FACETS_OUTSIDE: u16 = 32;
const FACETS_INSIDE: u16 = 64;

/// Integrals over the facets of a coat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CoatMeans {
    /// Coefficients of the powers of `2 cos - 1` in the transmittance from outside. Unused if the
    /// coat is smooth.
    pub transmittance: [f32; COEFFICIENTS],
    /// Mean transmittance of diffuse light from outside.
    pub mean_transmittance: f32,
    /// Mean reflectance of diffuse light from inside.
    pub inside: f32,
}

impl CoatMeans {
    fn smooth(eta: f32) -> Self {
        let outside = fresnel::diffuse_mean(|cos| Rgb::splat(fresnel::dielectric(cos, eta).0)).x;
        let mean_transmittance = 1.0 - outside;
        // The transmitted fluxes are in balance: (1 - F_in) eta^2 = 1 - F_out.
        let inside = 1.0 - mean_transmittance / (eta * eta);
        Self { transmittance: [0.0; COEFFICIENTS], mean_transmittance, inside }
    }

    fn rough(eta: f32, facets: &Facets) -> Self {
        let transmittance =
            std::array::from_fn(|i| scattered_share(facets, cosine(i), eta, FACETS_OUTSIDE, true));
        let mean = |values: [f32; COSINES]| {
            let sum: f64 = (0..COSINES).map(|i| f64::from(values[i] * cosine(i))).sum();
            // Mitsuba's mean over the steps.
            (2.0 * sum / COSINES as f64) as f32
        };
        let reflectance = std::array::from_fn(|i| {
            scattered_share(facets, cosine(i), 1.0 / eta, FACETS_INSIDE, false)
        });
        Self {
            transmittance: powers(&chebyshev(&transmittance)),
            mean_transmittance: mean(transmittance),
            inside: mean(reflectance),
        }
    }
}

/// The cosine of a place of the tables.
fn cosine(place: usize) -> f32 {
    (place as f32 / (COSINES - 1) as f32).max(1e-6)
}

/// [`CoatMeans::transmittance`] of a coat of which light from a cosine enters this share.
pub(super) fn coefficients(enters: impl Fn(f32) -> f32) -> [f32; COEFFICIENTS] {
    powers(&chebyshev(&std::array::from_fn(|place| enters(cosine(place)))))
}

/// Share of the light from a cosine that facets reflect or transmit and neighbors do not shadow: a
/// mean over the facets that are visible from there. `eta` is the refractive index beyond over the
/// one before. theory.md (31a).
fn scattered_share(facets: &Facets, cos: f32, eta: f32, steps: u16, transmits: bool) -> f32 {
    let wo = Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
    let middle = |i: u16| (f32::from(i) + 0.5) / f32::from(steps);
    let mut sum = 0.0;
    for i in 0..steps {
        for j in 0..steps {
            let m = facets.sample_visible(wo, [middle(i), middle(j)]);
            let cos_facet = wo.dot(m);
            let (reflected, cos_inside) = fresnel::dielectric(cos_facet, eta);
            let share = if transmits {
                let toward = m * (cos_facet / eta - cos_inside) - wo / eta;
                // Facets are symmetric: the masking of a direction below is that of its negative.
                if toward.z < 0.0 { (1.0 - reflected) * facets.g1(-toward) } else { 0.0 }
            } else {
                let toward = reflect(wo, m);
                if toward.z > 0.0 { reflected * facets.g1(toward) } else { 0.0 }
            };
            sum += f64::from(share);
        }
    }
    (sum / f64::from(steps).powi(2)) as f32
}

/// Coefficients of the Chebyshev series in `2 x - 1` that interpolates equidistant values of [0, 1]
/// linearly.
fn chebyshev(values: &[f32; COSINES]) -> [f64; COEFFICIENTS] {
    /// Nodes of the transform.
    const NODES: usize = 256;
    let angle = |node: usize| std::f64::consts::PI * (node as f64 + 0.5) / NODES as f64;
    let at = |node: usize| {
        let x = 0.5 * (angle(node).cos() + 1.0) * (COSINES - 1) as f64;
        let low = (x as usize).min(COSINES - 2);
        let share = x - low as f64;
        f64::from(values[low]) * (1.0 - share) + f64::from(values[low + 1]) * share
    };
    std::array::from_fn(|k| {
        let sum: f64 = (0..NODES).map(|node| at(node) * (k as f64 * angle(node)).cos()).sum();
        let halved = if k == 0 { 1.0 } else { 2.0 };
        halved * sum / NODES as f64
    })
}

/// Coefficients of the powers of `x` in a Chebyshev series. They are at most some hundred times as
/// large, so that single precision keeps five digits.
fn powers(series: &[f64; COEFFICIENTS]) -> [f32; COEFFICIENTS] {
    let mut sum = [0.0; COEFFICIENTS];
    let (mut before, mut own) = ([0.0; COEFFICIENTS], [0.0; COEFFICIENTS]);
    (before[1], own[0]) = (1.0, 1.0); // T_-1 = T_1, T_0
    for coefficient in series {
        for (sum, power) in sum.iter_mut().zip(own) {
            *sum += coefficient * power;
        }
        // T_(k+1) = 2 x T_k - T_(k-1)
        let next = std::array::from_fn(|k| match k {
            0 => -before[0],
            _ => 2.0 * own[k - 1] - before[k],
        });
        (before, own) = (own, next);
    }
    sum.map(|coefficient| coefficient as f32)
}

impl Plastic {
    /// A base that reflects `albedo` under a coat of refractive index `eta` over its surroundings.
    /// The coat is smooth if the width of the facets is below [`SMOOTH_ALPHA`].
    pub fn new(albedo: Rgb, eta: f32, facets: Facets, is_nonlinear: bool) -> Self {
        let is_smooth = facets.alpha < SMOOTH_ALPHA;
        let alpha = if is_smooth { 0.0 } else { facets.alpha.min(1.0) };
        // Smooth coats have no facets, and the model has no effect.
        let model = if is_smooth { FacetModel::Ggx } else { facets.model };
        let facets = Facets { model, alpha };
        let coat = if is_smooth { CoatMeans::smooth(eta) } else { CoatMeans::rough(eta, &facets) };
        let (tint, base) = (Rgb::ONE, Rgb::ZERO);
        Self { albedo, tint, eta, facets, is_nonlinear, base, coat }.with_albedo(albedo)
    }

    /// This coat over another base.
    #[must_use]
    pub fn with_albedo(&self, albedo: Rgb) -> Self {
        let again = if self.is_nonlinear { albedo } else { Rgb::ONE };
        let saturation = (Rgb::ONE - again * self.coat.inside).max(Rgb::splat(1e-6));
        let base = albedo * FRAC_1_PI / (self.eta * self.eta * saturation);
        Self { albedo, base, ..*self }
    }

    /// The surface with a factor on the light that the coat reflects.
    #[must_use]
    pub fn tinted(&self, tint: Rgb) -> Self {
        Self { tint, ..*self }
    }

    /// Albedo of the base.
    pub fn albedo(&self) -> Rgb {
        self.albedo
    }

    /// Factor of the light that the coat reflects.
    pub fn tint(&self) -> Rgb {
        self.tint
    }

    /// Refractive index of the coat over that of its surroundings.
    pub fn eta(&self) -> f32 {
        self.eta
    }

    /// Model and width of the facets; the width is 0 if the coat is smooth.
    pub fn facets(&self) -> Facets {
        self.facets
    }

    /// Returns true if colors saturate by reflections between base and coat.
    pub fn is_nonlinear(&self) -> bool {
        self.is_nonlinear
    }

    /// Integrals over the facets of the coat.
    pub(super) fn means(&self) -> &CoatMeans {
        &self.coat
    }

    /// Share of the light from the cosine `cos` that enters the coat.
    #[inline]
    fn transmittance(&self, cos: f32) -> f32 {
        if self.facets.alpha == 0.0 {
            return 1.0 - fresnel::dielectric(cos, self.eta).0;
        }
        // Estrin's scheme: most terms do not wait for each other.
        let [a, b, c, d, e, f, g, h, i, j, k, l] = self.coat.transmittance;
        let x = 2.0 * cos - 1.0;
        let x2 = x * x;
        let x4 = x2 * x2;
        let low = (a + b * x) + (c + d * x) * x2;
        let middle = (e + f * x) + (g + h * x) * x2;
        let high = (i + j * x) + (k + l * x) * x2;
        (low + (middle + high * x4) * x4).clamp(0.0, 1.0)
    }
}

impl Describe for Plastic {
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
        Some(Bsdf::Plastic(self.with_albedo(self.albedo * texture.color)))
    }

    fn color(&self, _front: bool) -> Rgb {
        self.albedo
    }
}

impl CoatOverBase for Plastic {
    #[inline]
    fn coat_lobe(&self) -> Lobe {
        facets_lobe(self.facets.alpha)
    }

    #[inline]
    fn has_base(&self) -> bool {
        self.base.max_element() > 0.0
    }

    fn coat_prob(&self, wo: Vec3) -> f32 {
        let enters = self.transmittance(wo.z);
        let coat = (1.0 - enters) * self.tint.max_element();
        let base = PI * self.base.max_element() * enters * self.coat.mean_transmittance;
        if base > 0.0 { (coat / (coat + base)).min(1.0 - 1e-3) } else { 1.0 }
    }

    fn mirrored_share(&self, cos: f32) -> Rgb {
        self.tint * fresnel::dielectric(cos, self.eta).0
    }

    fn eval_coat(&self, wo: Vec3, wi: Vec3) -> Rgb {
        self.coat(wo, wi).0
    }

    fn coat_pdf_w(&self, wo: Vec3, wi: Vec3) -> f32 {
        let m = (wo + wi).normalize();
        self.facets.g1(wo) * self.facets.d(m) / (4.0 * wo.z)
    }

    /// theory.md (31a), (97).
    fn coat(&self, wo: Vec3, wi: Vec3) -> (Rgb, f32) {
        let m = (wo + wi).normalize();
        let d = self.facets.d(m) / (4.0 * wo.z);
        let value = fresnel::dielectric(wo.dot(m), self.eta).0 * d * self.facets.g2(wo, wi) / wi.z;
        (self.tint * value, self.facets.g1(wo) * d)
    }

    fn sample_coat(&self, wo: Vec3, rng: &mut Rng) -> Vec3 {
        reflect(wo, self.facets.sample_visible(wo, rng.next_2d()))
    }

    /// theory.md (31a).
    fn eval_base(&self, wo: Vec3, wi: Vec3) -> Rgb {
        self.base * (self.transmittance(wo.z) * self.transmittance(wi.z))
    }
}
