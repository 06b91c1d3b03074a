//! Diffuse bases under coats in the layout that hits read.

use super::plastic::{COEFFICIENTS, coefficients};
use super::{Bsdf, Conductor, FacetModel, Facets, Glossy, Plastic, Reflectance};
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
    /// The coat may be a metal, and parameters may vary over the surface: they are those of
    /// [`metal_of`], and follow in [`MetalRow`]s.
    pub const IS_METAL: u32 = 64;
    /// Flags of all [`Glossy`] surfaces.
    const GLOSSY: u32 =
        Self::IS_BASE | Self::HAS_COAT | Self::TWO_SIDED | Self::IS_CORRELATED | Self::IS_SCHLICK;

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
            Bsdf::Glossy(_) | Bsdf::Conductor(_) => Self::of_metal(bsdf),
            Bsdf::Mirror { .. }
            | Bsdf::Dielectric(_)
            | Bsdf::ThinDielectric(_)
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
        let transmittance = coefficients(|cos| glossy.enters(cos));
        Self { flags: Self::GLOSSY, transmittance, ..Self::of_facets(glossy) }
    }

    /// A surface whose facets may be metal; without [`Self::IS_BASE`] if [`metal_of`] has none.
    pub fn of_metal(bsdf: &Bsdf) -> Self {
        match metal_of(bsdf) {
            Some(glossy) => Self::of_facets(&glossy),
            None => Self::default(),
        }
    }

    /// A glossy surface; what enters its base is looked up.
    pub fn of_facets(glossy: &Glossy) -> Self {
        let mean_transmittance = glossy.mean_enters();
        Self {
            albedo: glossy.albedo(),
            flags: Self::GLOSSY | Self::IS_METAL,
            tint: Rgb::ONE,
            eta: glossy.normal_reflectance(),
            alpha: glossy.alpha(),
            mean_transmittance,
            inside: 1.0 - mean_transmittance,
            saturates: 0.0,
            transmittance: [0.0; COEFFICIENTS],
        }
    }
}

/// A surface of [`CoatedBase::of`] that is no metal, with a base of this albedo; others as they
/// are.
pub(in crate::scene) fn with_base_albedo(bsdf: &Bsdf, albedo: Rgb) -> Bsdf {
    match *bsdf {
        Bsdf::Lambertian { two_sided, .. } => Bsdf::Lambertian { albedo, two_sided },
        Bsdf::Plastic(plastic) => Bsdf::Plastic(plastic.with_albedo(albedo)),
        Bsdf::Coated(coated) => Bsdf::Coated(coated.with_albedo(albedo)),
        Bsdf::Glossy(glossy) => Bsdf::Glossy(glossy.with_albedo(albedo)),
        Bsdf::Mirror { .. }
        | Bsdf::Conductor(_)
        | Bsdf::Dielectric(_)
        | Bsdf::ThinDielectric(_)
        | Bsdf::RoughDielectric(_)
        | Bsdf::Principled(_)
        | Bsdf::DiffuseTransmission(_)
        | Bsdf::Klems(_) => *bsdf,
    }
}

/// A surface as facets over a base, if it is glossy or a metal that reflects by Schlick's
/// approximation and scatters light between its facets.
pub(in crate::scene) fn metal_of(bsdf: &Bsdf) -> Option<Glossy> {
    match bsdf {
        Bsdf::Glossy(glossy) => Some(*glossy),
        Bsdf::Conductor(conductor) => of_conductor(conductor),
        Bsdf::Lambertian { .. }
        | Bsdf::Mirror { .. }
        | Bsdf::Dielectric(_)
        | Bsdf::ThinDielectric(_)
        | Bsdf::RoughDielectric(_)
        | Bsdf::Coated(_)
        | Bsdf::Plastic(_)
        | Bsdf::Principled(_)
        | Bsdf::DiffuseTransmission(_)
        | Bsdf::Klems(_) => None,
    }
}

fn of_conductor(conductor: &Conductor) -> Option<Glossy> {
    match (conductor.reflectance(), conductor.single()) {
        (Reflectance::Artist { normal }, None) => {
            Some(Glossy::new(normal, 1.0, 1.0, conductor.alpha()))
        }
        (Reflectance::Measured { .. }, _) | (_, Some(_)) => None,
    }
}

/// What facets that may be metal have beyond a [`CoatedBase`].
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(16))]
pub(in crate::scene) struct MetalRow {
    /// Reflectance of the mixture at normal incidence.
    mixed: Rgb,
    /// Share of the metal.
    metallic: f32,
    /// Multiple scattering of the metal over both shares that are lost, 1/sr.
    multiple: Rgb,
    unused: f32,
}

impl MetalRow {
    pub fn of(glossy: &Glossy) -> Self {
        let (mixed, multiple) = (glossy.mixed_normal(), glossy.multiple());
        Self { mixed, metallic: glossy.metallic(), multiple, unused: 0.0 }
    }
}
