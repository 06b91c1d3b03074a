//! Metals: smooth, rough by GGX with multiple scattering, or rough with single scattering (Walter
//! et al. 2007).

use super::ggx::{Ggx, reflect};
use super::layers::facets_lobe;
use super::mirror::mirrored;
use super::model::{Describe, Lobes, Local, LocalModel, TextureValues, Traits, Transmission};
use super::{
    Bsdf, BsdfSample, FacetModel, Facets, Lobe, LobeSet, LobeValue, SMOOTH_ALPHA, Transport,
    fresnel,
};
use crate::base::math::{Rgb, cosine_hemisphere, cosine_hemisphere_pdf_w};
use crate::base::rng::Rng;
use glam::Vec3;
use serde::Serialize;
use std::f32::consts::FRAC_1_PI;

/// The reflectance of a metal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub enum Reflectance {
    /// From a measured complex refractive index, relative to the medium in front.
    Measured {
        /// Real part.
        eta: Rgb,
        /// Imaginary part.
        k: Rgb,
    },
    /// From the color at normal incidence; white at grazing incidence (Schlick 1994).
    Artist {
        /// Reflectance at normal incidence, in [0, 1].
        normal: Rgb,
    },
}

impl Reflectance {
    /// Names of the built-in metals.
    pub const NAMES: [&str; 4] = ["aluminum", "copper", "gold", "silver"];

    /// The metal called `name`: index at wavelengths of about 650, 550 and 450 nm, from the tables
    /// of Johnson and Christy 1972 (copper, gold, silver) and Rakic 1995 (aluminum).
    pub fn named(name: &str) -> Option<Self> {
        let measured = |eta: [f32; 3], k: [f32; 3]| Self::Measured { eta: eta.into(), k: k.into() };
        Some(match name {
            "aluminum" => measured([1.50, 0.96, 0.62], [7.80, 6.70, 5.50]),
            "copper" => measured([0.22, 1.02, 1.24], [3.75, 2.58, 2.40]),
            "gold" => measured([0.14, 0.43, 1.38], [3.70, 2.46, 1.91]),
            "silver" => measured([0.05, 0.06, 0.04], [4.48, 3.59, 2.66]),
            _ => return None,
        })
    }

    /// Mean reflectance under diffuse light.
    fn mean(&self) -> Rgb {
        match *self {
            Self::Measured { eta, k } => {
                fresnel::diffuse_mean(|cos| fresnel::conductor(cos, eta, k))
            }
            Self::Artist { normal } => fresnel::schlick_mean(normal),
        }
    }

    #[inline]
    fn at(&self, cos: f32) -> Rgb {
        match *self {
            Self::Measured { eta, k } => fresnel::conductor(cos, eta, k),
            Self::Artist { normal } => fresnel::schlick(cos, normal),
        }
    }
}

/// Multiple scattering of facets with the mean reflectance `mean`, over the two directions' losses,
/// 1/sr (Kulla and Conty 2017). theory.md (26), `M/(pi (1 - e_m))`.
pub(super) fn multiple_scattering(facets: &Ggx, mean: Rgb) -> Rgb {
    let once = facets.mean_single_albedo();
    // At each reflection the share `once` of the remaining light leaves.
    let share = mean * mean * once / (Rgb::ONE - mean * (1.0 - once));
    share * FRAC_1_PI / (1.0 - once).max(1e-6)
}

/// A metal. Its rough lobe is reciprocal, and lossless if the reflectance is 1: a wide lobe returns
/// the light that single scattering loses (Kulla and Conty 2017). [`Self::once`] makes a metal
/// without that lobe.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Conductor {
    reflectance: Reflectance,
    facets: Facets,
    scattering: Scattering,
}

/// Treatment of light that facets reflect into each other.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
enum Scattering {
    /// Multiple scattering: the share of that light that leaves in the end, over pi and the mean
    /// loss, 1/sr.
    All {
        #[serde(skip)]
        multiple: Rgb,
    },
    /// Single scattering: that light is lost; a tint multiplies the rest.
    Once { tint: Rgb },
}

impl Conductor {
    /// A metal of GGX width `alpha` in [0, 1]; below [`SMOOTH_ALPHA`] a perfect surface.
    pub fn new(reflectance: Reflectance, alpha: f32) -> Self {
        let facets = Facets { model: FacetModel::Correlated, alpha: width(alpha) };
        let multiple = multiple_scattering(&facets.ggx(), reflectance.mean());
        Self { reflectance, facets, scattering: Scattering::All { multiple } }
    }

    /// A metal of single scattering, like Mitsuba's: rougher metals are darker. `tint`, in [0, 1],
    /// multiplies the reflected light. Smooth below [`SMOOTH_ALPHA`]. Masking and shadowing are
    /// independent for all models.
    pub fn once(reflectance: Reflectance, facets: Facets, tint: Rgb) -> Self {
        let model = match facets.model {
            FacetModel::Beckmann => FacetModel::Beckmann,
            FacetModel::Ggx | FacetModel::Correlated => FacetModel::Ggx,
        };
        let facets = Facets { model, alpha: width(facets.alpha) };
        Self { reflectance, facets, scattering: Scattering::Once { tint } }
    }

    /// Reflectance of the metal.
    pub fn reflectance(&self) -> Reflectance {
        self.reflectance
    }

    /// Reflectance at normal incidence.
    pub fn normal_reflectance(&self) -> Rgb {
        self.reflectance.at(1.0)
    }

    /// Width of the facets' distribution; 0 if the metal is smooth.
    pub fn alpha(&self) -> f32 {
        self.facets.alpha
    }

    /// Model of the facets and tint of a metal of single scattering; `None` for others.
    pub fn single(&self) -> Option<(FacetModel, Rgb)> {
        match self.scattering {
            Scattering::All { .. } => None,
            Scattering::Once { tint } => Some((self.facets.model, tint)),
        }
    }

    /// Share of the light from the cosine `cos` that single scattering loses and the wide lobe
    /// returns.
    #[inline]
    fn loss(&self, cos: f32) -> f32 {
        match self.scattering {
            Scattering::All { .. } => (1.0 - self.facets.ggx().single_albedo(cos)).max(0.0),
            Scattering::Once { .. } => 0.0,
        }
    }
}

impl Describe for Conductor {
    #[inline]
    fn traits(&self) -> Traits {
        Traits {
            classes: Lobes::of(facets_lobe(self.facets.alpha)),
            transmission: Transmission::None,
            depends_on_tangent: false,
            albedo_bound: Rgb::ONE,
        }
    }

    fn textured(&self, _texture: &TextureValues) -> Option<Bsdf> {
        None
    }

    fn color(&self, _front: bool) -> Rgb {
        self.normal_reflectance()
    }
}

impl LocalModel for Conductor {
    /// theory.md (26), (28), (97).
    fn eval(&self, _lobe: Option<Lobe>, Local { wo, .. }: Local, wi: Vec3) -> Rgb {
        if wi.z <= 0.0 || self.facets.alpha == 0.0 {
            return Rgb::ZERO;
        }
        let m = (wo + wi).normalize();
        let once = self.facets.d(m) * self.facets.g2(wo, wi) / (4.0 * wo.z * wi.z);
        let once = self.reflectance.at(wo.dot(m)) * once;
        match self.scattering {
            Scattering::All { multiple } => once + multiple * (self.loss(wo.z) * self.loss(wi.z)),
            Scattering::Once { tint } => tint * once,
        }
    }

    /// theory.md (25), (28), (97).
    fn pdf_w(&self, _lobe: Lobe, Local { wo, .. }: Local, wi: Vec3) -> f32 {
        if wi.z <= 0.0 || self.facets.alpha == 0.0 {
            return 0.0;
        }
        let m = (wo + wi).normalize();
        // Jacobian of the mirror: 1/(4 wo.m), which cancels in the density of visible normals.
        let once = self.facets.g1(wo) * self.facets.d(m) / (4.0 * wo.z);
        let again = self.loss(wo.z);
        (1.0 - again) * once + again * cosine_hemisphere_pdf_w(wi.z)
    }

    fn values(&self, _at: Local, _wi: Vec3) -> Option<[LobeValue; 2]> {
        None
    }

    #[inline]
    fn pass_prob(&self, _at: Local) -> f32 {
        if facets_lobe(self.facets.alpha).passes_through() { 1.0 } else { 0.0 }
    }

    fn sample(
        &self,
        at: Local,
        _transport: Transport,
        _wanted: LobeSet,
        rng: &mut Rng,
    ) -> Option<BsdfSample> {
        let (wo, lobe) = (at.wo, facets_lobe(self.facets.alpha));
        if lobe == Lobe::Delta {
            let reflected = self.reflectance.at(wo.z);
            let weight = match self.scattering {
                Scattering::All { .. } => reflected,
                Scattering::Once { tint } => tint * reflected,
            };
            return Some(mirrored(wo, weight));
        }
        let loss = self.loss(wo.z);
        let wi = if rng.next_1d() < loss {
            cosine_hemisphere(Vec3::Z, rng.next_2d())
        } else {
            reflect(wo, self.facets.sample_visible(wo, rng.next_2d()))
        };
        let pdf = self.pdf_w(lobe, at, wi);
        if pdf <= 0.0 {
            return Some(BsdfSample::lost(lobe));
        }
        Some(BsdfSample { wi, weight: self.eval(Some(lobe), at, wi) * (wi.z / pdf), lobe })
    }
}

/// The stored width: 0 if the metal is smooth.
fn width(alpha: f32) -> f32 {
    if alpha < SMOOTH_ALPHA { 0.0 } else { alpha.min(1.0) }
}
