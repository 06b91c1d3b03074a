//! Diffuse bases under coats in the layout that hits read.

use super::plastic::{COEFFICIENTS, coefficients};
use super::{Bsdf, FacetModel, Facets, Glossy, Plastic};
use crate::base::math::Rgb;
use bytemuck::{Pod, Zeroable};

/// A base and its coat, as hits read them.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(16))]
pub(in crate::scene) struct CoatedBase {
    albedo: Rgb,
    /// Properties, one bit each; without [`Self::IS_BASE`] the rest means nothing.
    pub flags: u32,
    /// Factor of the light that the coat reflects.
    tint: Rgb,
    /// Refractive index; with [`Self::IS_SCHLICK`] the reflectance at normal incidence.
    eta: f32,
    /// Width of the facets; 0 if the coat is smooth, 1 without a coat.
    alpha: f32,
    mean_transmittance: f32,
    /// Mean reflectance of diffuse light from inside; 0 without a coat. With
    /// [`Self::IS_SCHLICK`], of diffuse light from outside.
    inside: f32,
    /// 1 if reflections between base and coat take on the color of the base, else 0.
    saturates: f32,
    /// See [`Plastic`]; 1 for all cosines without a coat.
    transmittance: [f32; COEFFICIENTS],
}

impl CoatedBase {
    /// The BSDF is a base under a coat, or without one.
    pub const IS_BASE: u32 = 1;
    pub(super) const HAS_COAT: u32 = 2;
    pub(super) const TWO_SIDED: u32 = 4;
    pub(super) const IS_BECKMANN: u32 = 8;
    pub(super) const IS_CORRELATED: u32 = 16;
    /// The coat reflects by Schlick's approximation: [`Glossy`].
    pub(super) const IS_SCHLICK: u32 = 32;

    /// The base of a BSDF; without [`Self::IS_BASE`] if it is of another kind.
    pub fn of(bsdf: &Bsdf) -> Self {
        match bsdf {
            Bsdf::Lambertian { albedo, two_sided } => Self::without_coat(*albedo, *two_sided),
            Bsdf::Plastic(plastic) => Self::of_plastic(plastic),
            Bsdf::Coated(coated) => {
                let smooth = Facets { model: FacetModel::Ggx, alpha: 0.0 };
                Self::of_plastic(&Plastic::new(coated.albedo(), coated.eta(), smooth, true))
            }
            Bsdf::Glossy(glossy) if glossy.metallic() == 0.0 => Self::of_glossy(glossy),
            Bsdf::Glossy(_)
            | Bsdf::Mirror { .. }
            | Bsdf::Dielectric(_)
            | Bsdf::ThinDielectric(_)
            | Bsdf::Conductor(_)
            | Bsdf::RoughDielectric(_)
            | Bsdf::Principled(_)
            | Bsdf::DiffuseTransmission(_)
            | Bsdf::Klems(_) => Self::default(),
        }
    }

    fn without_coat(albedo: Rgb, two_sided: bool) -> Self {
        let mut transmittance = [0.0; COEFFICIENTS];
        transmittance[0] = 1.0;
        let flags = Self::IS_BASE | if two_sided { Self::TWO_SIDED } else { 0 };
        let (eta, alpha, mean_transmittance) = (1.0, 1.0, 1.0);
        Self { albedo, flags, eta, alpha, mean_transmittance, transmittance, ..Self::default() }
    }

    fn of_plastic(plastic: &Plastic) -> Self {
        let Facets { model, alpha } = plastic.facets();
        let model = match model {
            FacetModel::Beckmann => Self::IS_BECKMANN,
            FacetModel::Correlated => Self::IS_CORRELATED,
            FacetModel::Ggx => 0,
        };
        let means = plastic.means();
        Self {
            albedo: plastic.albedo(),
            flags: Self::IS_BASE | Self::HAS_COAT | Self::TWO_SIDED | model,
            tint: plastic.tint(),
            eta: plastic.eta(),
            alpha,
            mean_transmittance: means.mean_transmittance,
            inside: means.inside,
            saturates: f32::from(u8::from(plastic.is_nonlinear())),
            transmittance: means.transmittance,
        }
    }

    /// A glossy surface without metal.
    fn of_glossy(glossy: &Glossy) -> Self {
        let flags = Self::IS_BASE | Self::HAS_COAT | Self::TWO_SIDED;
        let mean_transmittance = glossy.mean_enters();
        Self {
            albedo: glossy.albedo(),
            flags: flags | Self::IS_CORRELATED | Self::IS_SCHLICK,
            tint: Rgb::ONE,
            eta: glossy.normal_reflectance(),
            alpha: glossy.alpha(),
            mean_transmittance,
            inside: 1.0 - mean_transmittance,
            saturates: 0.0,
            transmittance: coefficients(|cos| glossy.enters(cos)),
        }
    }
}
