//! Scattering at surfaces: the closed set of BSDFs.
//!
//! Directions are unit vectors that point away from the surface. In photon mapping a path either
//! *merges* at a vertex or *passes through*. This is a property of the lobe ([`Lobe`]), not of the
//! surface: a coat over a diffuse base has lobes of both kinds. At such a vertex photons merge
//! with, and lights connect to, the diffuse lobe alone.

mod anisotropic_ggx;
mod beckmann;
mod coated;
pub(in crate::scene) mod coated_base;
pub mod coats;
mod conductor;
mod dielectric;
mod diffuse_transmission;
mod facets;
pub mod fresnel;
pub mod ggx;
mod glossy;
mod gtr1;
mod klems;
mod layers;
mod plastic;
mod principled;
mod rough_dielectric;
mod sample;

pub use coated::Coated;
pub use conductor::{Conductor, Reflectance};
pub use dielectric::{Dielectric, ThinDielectric};
pub use diffuse_transmission::DiffuseTransmission;
pub use facets::{FacetModel, Facets};
pub use glossy::Glossy;
pub use klems::{AngleBand, AngleBasis, Klems, KlemsMatrices, MAX_PATCHES, SideValues};
pub use plastic::Plastic;
pub use principled::{Principled, PrincipledParameters};
pub use rough_dielectric::RoughDielectric;
pub use sample::{BsdfSample, LobeSet, LobeValue};

use crate::base::math::{Frame, Rgb, cosine_hemisphere, cosine_hemisphere_pdf_w};
use crate::base::rng::Rng;
use glam::Vec3;
use layers::CoatOverBase;
use serde::Serialize;
use std::f32::consts::FRAC_1_PI;

/// Minimum GGX width of lobes that merge and connect like diffuse surfaces. Narrower lobes pass
/// through: merged or connected directions would seldom carry light.
pub const DIFFUSE_ALPHA: f32 = 0.3;

/// Minimum GGX width of rough surfaces; smaller widths are perfectly smooth.
pub const SMOOTH_ALPHA: f32 = 1e-3;

/// Class of a lobe: the behavior of paths that it scatters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lobe {
    /// Wide: a numbered vertex, at which photons are merged and lights connected.
    Diffuse,
    /// Narrow, of finite density: passed through, but lights that cannot be hit are connected.
    Rough,
    /// A single direction: passed through.
    Delta,
}

impl Lobe {
    /// Returns true if vertices of this lobe are not numbered.
    #[inline]
    pub fn passes_through(self) -> bool {
        self != Self::Diffuse
    }
}

/// Quantity that a path carries. Radiance changes with the square of the refractive index, flux
/// does not.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// Camera paths: `wo` points back along the path, and light comes from the sampled direction.
    Radiance,
    /// Light paths: light comes from `wo`, and leaves along the sampled direction.
    Flux,
}

/// A point of a surface as seen from a direction.
#[derive(Clone, Copy, Debug)]
pub struct Vertex {
    /// Unit normal on the side of `wo`.
    pub normal: Vec3,
    /// Unit vector back along the path.
    pub wo: Vec3,
    /// True if that side is the front.
    pub front: bool,
    /// Direction along the surface, of any length, for BSDFs that depend on it; see
    /// [`Bsdf::is_anisotropic`].
    pub tangent: Option<Vec3>,
}

impl Vertex {
    /// The frame of local directions.
    #[inline]
    fn frame(&self) -> Frame {
        match self.tangent {
            None => Frame::new(self.normal),
            Some(tangent) => Frame::with_tangent(self.normal, tangent),
        }
    }
}

/// A bidirectional scattering distribution function.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub enum Bsdf {
    /// Ideal diffuse reflection.
    Lambertian {
        /// Reflected share of the incident flux, in [0, 1].
        albedo: Rgb,
        /// If true, the back reflects as well; otherwise it is black.
        two_sided: bool,
    },
    /// A perfect mirror on both sides.
    Mirror {
        /// Reflected share of the incident flux, in [0, 1].
        reflectance: Rgb,
    },
    /// A smooth interface between two dielectrics.
    Dielectric(Dielectric),
    /// A smooth sheet of negligible thickness.
    ThinDielectric(ThinDielectric),
    /// A metal, smooth or rough.
    Conductor(Conductor),
    /// A rough interface between two dielectrics.
    RoughDielectric(RoughDielectric),
    /// A diffuse base under a smooth dielectric coat.
    Coated(Coated),
    /// Facets over a diffuse base, a mixture of dielectric and metal.
    Glossy(Glossy),
    /// A diffuse base under a smooth or rough dielectric coat, as Mitsuba's plastics.
    Plastic(Plastic),
    /// Diffuse base, facets of dielectric, metal and glass, sheen and clear coat, as Mitsuba's
    /// `principled`.
    Principled(Principled),
    /// A thin sheet that scatters diffusely to both sides.
    DiffuseTransmission(DiffuseTransmission),
    /// A sheet that scatters by measured or simulated matrices.
    Klems(Klems),
}

impl Bsdf {
    /// Reflects the share `albedo` diffusely from both sides.
    pub const fn diffuse(albedo: Rgb) -> Self {
        Self::Lambertian { albedo, two_sided: true }
    }

    /// Class of the widest lobe; `None` if all are single directions.
    #[inline]
    pub fn spread(&self) -> Option<Lobe> {
        match self {
            Self::Glossy(_) | Self::Plastic(_) | Self::Principled(_) => {
                [Lobe::Diffuse, Lobe::Rough].into_iter().find(|lobe| self.has_one_of(*lobe))
            }
            Self::Lambertian { .. }
            | Self::Coated(_)
            | Self::DiffuseTransmission(_)
            | Self::Klems(_) => Some(Lobe::Diffuse),
            Self::Conductor(conductor) => conductor.spread(),
            Self::RoughDielectric(_) => Some(Lobe::Rough),
            Self::Mirror { .. } | Self::Dielectric(_) | Self::ThinDielectric(_) => None,
        }
    }

    /// Returns true if a BSDF of several lobes has one of this class; false for others.
    #[inline]
    fn has_one_of(&self, lobe: Lobe) -> bool {
        match self {
            Self::Coated(coated) => coated.has(lobe),
            Self::Glossy(glossy) => glossy.has(lobe),
            Self::Plastic(plastic) => plastic.has(lobe),
            Self::Principled(principled) => principled.has(lobe),
            _ => false,
        }
    }

    /// Returns true if the BSDF depends on [`Vertex::tangent`].
    #[inline]
    pub fn is_anisotropic(&self) -> bool {
        matches!(self, Self::Principled(principled) if principled.is_anisotropic())
    }

    /// Returns true if any lobe is diffuse.
    #[inline]
    pub fn merges(&self) -> bool {
        self.spread() == Some(Lobe::Diffuse)
    }

    /// Returns true if any lobe passes through.
    #[inline]
    pub fn passes_through(&self) -> bool {
        match self {
            Self::Coated(_) => true,
            Self::Glossy(glossy) => glossy.coat_lobe().passes_through(),
            Self::Plastic(plastic) => plastic.coat_lobe().passes_through(),
            Self::Principled(principled) => principled.has(Lobe::Rough),
            _ => !self.merges(),
        }
    }

    /// Returns true if any lobe is [`Lobe::Rough`].
    #[inline]
    pub fn has_rough(&self) -> bool {
        match self {
            Self::Glossy(_) | Self::Plastic(_) | Self::Principled(_) => {
                self.has_one_of(Lobe::Rough)
            }
            _ => self.spread() == Some(Lobe::Rough),
        }
    }

    /// Returns true if any lobe transmits light to the other side.
    #[inline]
    pub fn transmits(&self) -> bool {
        match self {
            Self::Dielectric(_) | Self::ThinDielectric(_) | Self::RoughDielectric(_) => true,
            Self::Principled(principled) => principled.transmits(),
            _ => self.transmits_diffusely(),
        }
    }

    /// Returns true if a lobe that merges transmits light: photons on both sides merge.
    #[inline]
    pub fn transmits_diffusely(&self) -> bool {
        matches!(self, Self::DiffuseTransmission(_) | Self::Klems(_))
    }

    /// Returns true if the value depends only on the sides of both directions: Lambertian
    /// reflection and transmission.
    #[inline]
    pub fn is_constant(&self) -> bool {
        matches!(self, Self::Lambertian { .. } | Self::DiffuseTransmission(_))
    }

    /// Returns true if all light goes straight on: the refractive indices on both sides are equal.
    pub fn is_index_matched(&self) -> bool {
        match *self {
            Self::Dielectric(Dielectric { eta, transmittance }) => {
                eta == 1.0 && transmittance == Rgb::ONE
            }
            Self::ThinDielectric(sheet) => sheet == ThinDielectric::new(1.0),
            _ => false,
        }
    }

    /// Albedo of the front or the back of a Lambertian surface; `None` for others.
    #[inline]
    pub fn diffuse_albedo(&self, front: bool) -> Option<Rgb> {
        match *self {
            Self::Lambertian { albedo, two_sided } => {
                Some(if front || two_sided { albedo } else { Rgb::ZERO })
            }
            _ => None,
        }
    }

    /// The value of all lobes but single directions, 1/sr, for light that arrives from `wi` and
    /// leaves toward `wo` ([`Transport::Radiance`]).
    #[inline]
    pub fn eval(&self, at: &Vertex, wi: Vec3) -> Rgb {
        if let Some(albedo) = self.diffuse_albedo(at.front) {
            return if wi.dot(at.normal) > 0.0 { albedo * FRAC_1_PI } else { Rgb::ZERO };
        }
        if let Self::DiffuseTransmission(sheet) = self {
            return sheet.eval(wi.dot(at.normal));
        }
        if let Self::Klems(sheet) = self {
            return sheet.eval(at, wi);
        }
        self.eval_locally(at, wi, None)
    }

    /// [`Self::eval`] for the lobes of one class.
    #[inline]
    pub fn eval_lobe(&self, lobe: Lobe, at: &Vertex, wi: Vec3) -> Rgb {
        match self {
            Self::Glossy(_) | Self::Plastic(_) | Self::Principled(_) => {
                self.eval_locally(at, wi, Some(lobe))
            }
            _ if self.spread() == Some(lobe) => self.eval(at, wi),
            _ => Rgb::ZERO,
        }
    }

    /// Values and densities of the lobes that merge, and of rough ones.
    pub fn lobes(&self, at: &Vertex, wi: Vec3) -> [LobeValue; 2] {
        let frame = at.frame();
        let local = |layers: &dyn Fn(Vec3, Vec3) -> [LobeValue; 2]| {
            let wo = frame.to_local(at.wo);
            if wo.z > 0.0 { layers(wo, frame.to_local(wi)) } else { Default::default() }
        };
        match self {
            Self::Plastic(plastic) => local(&|wo, wi| plastic.lobes(wo, wi)),
            Self::Coated(coated) => local(&|wo, wi| coated.lobes(wo, wi)),
            Self::Glossy(glossy) => local(&|wo, wi| glossy.lobes(wo, wi)),
            _ => [Lobe::Diffuse, Lobe::Rough].map(|lobe| {
                let value = self.eval_lobe(lobe, at, wi);
                LobeValue { value, pdf_w: self.pdf_w(lobe, at, wi) }
            }),
        }
    }

    /// The value of BSDFs that are not Lambertian, in the frame of the normal: of the lobes of one
    /// class, or of all.
    fn eval_locally(&self, at: &Vertex, wi: Vec3, lobe: Option<Lobe>) -> Rgb {
        let frame = at.frame();
        let (wo, wi) = (frame.to_local(at.wo), frame.to_local(wi));
        if wo.z <= 0.0 {
            return Rgb::ZERO;
        }
        match self {
            Self::Conductor(conductor) => conductor.eval(wo, wi),
            Self::RoughDielectric(interface) => interface.eval(wo, wi, at.front),
            Self::Coated(coated) => coated.eval(lobe, wo, wi),
            Self::Glossy(glossy) => glossy.eval(lobe, wo, wi),
            Self::Plastic(plastic) => plastic.eval(lobe, wo, wi),
            Self::Principled(principled) => principled.eval(lobe, wo, wi, at.front),
            _ => Rgb::ZERO,
        }
    }

    /// Density in solid angle, 1/sr, of [`Self::sample`] over the lobes of one class other than
    /// single directions. Its integral is less than 1 if there are other classes.
    pub fn pdf_w(&self, lobe: Lobe, at: &Vertex, wi: Vec3) -> f32 {
        if self.spread() != Some(lobe) && !self.has_one_of(lobe) {
            return 0.0;
        }
        if let Self::Lambertian { two_sided, .. } = self {
            // Like the value, also where `wo` is below the horizon of a shading normal.
            let reflects = at.front || *two_sided;
            return if reflects { cosine_hemisphere_pdf_w(wi.dot(at.normal)) } else { 0.0 };
        }
        if let Self::DiffuseTransmission(sheet) = self {
            return sheet.pdf_w(wi.dot(at.normal));
        }
        if let Self::Klems(sheet) = self {
            return sheet.pdf_w(at, wi);
        }
        let frame = at.frame();
        let (wo, wi) = (frame.to_local(at.wo), frame.to_local(wi));
        if wo.z <= 0.0 {
            return 0.0;
        }
        match self {
            Self::Conductor(conductor) => conductor.pdf_w(wo, wi),
            Self::RoughDielectric(interface) => interface.pdf_w(wo, wi, at.front),
            Self::Coated(coated) => coated.pdf_w(lobe, wo, wi),
            Self::Glossy(glossy) => glossy.pdf_w(lobe, wo, wi),
            Self::Plastic(plastic) => plastic.pdf_w(lobe, wo, wi),
            Self::Principled(principled) => principled.pdf_w(lobe, wo, wi, at.front),
            _ => 0.0,
        }
    }

    /// Probability that [`Self::sample`] passes through, consistent with [`Self::pdf_w`].
    pub fn pass_prob(&self, at: &Vertex) -> f32 {
        let wo = Frame::new(at.normal).to_local(at.wo);
        match self {
            Self::Coated(coated) if wo.z > 0.0 => coated.coat_prob(wo),
            Self::Glossy(glossy) if self.passes_through() && wo.z > 0.0 => glossy.coat_prob(wo),
            Self::Plastic(plastic) if self.passes_through() && wo.z > 0.0 => plastic.coat_prob(wo),
            Self::Principled(principled) if wo.z > 0.0 => principled.pass_prob(wo, at.front),
            _ if self.passes_through() => 1.0,
            _ => 0.0,
        }
    }

    /// Refractive index behind the surface over that in front, as seen from the front or the back;
    /// 1 for BSDFs that do not refract.
    pub fn relative_index(&self, front: bool) -> f32 {
        match self {
            Self::Dielectric(interface) => dielectric::relative(interface.eta, front),
            _ => 1.0,
        }
    }

    /// The BSDF of an interface with another index behind it over that in front; others do not
    /// change.
    #[must_use]
    pub(crate) fn with_index(self, eta: f32) -> Self {
        match self {
            Self::Dielectric(interface) => Self::Dielectric(Dielectric { eta, ..interface }),
            Self::RoughDielectric(interface) => Self::RoughDielectric(interface.with_index(eta)),
            other => other,
        }
    }

    /// Samples the direction of the next segment; `None` where all is absorbed, or lost on another
    /// facet.
    #[inline]
    pub fn sample(
        &self,
        at: &Vertex,
        transport: Transport,
        wanted: LobeSet,
        rng: &mut Rng,
    ) -> Option<BsdfSample> {
        let sample = self.sample_lobe(at, transport, wanted, rng);
        sample.filter(|sample| sample.weight != Rgb::ZERO)
    }

    /// [`Self::sample`] that tells the lobe where light is lost on another facet: its weight is 0
    /// then, and its direction of no use. `None` where no lobe was sampled.
    pub fn sample_lobe(
        &self,
        at: &Vertex,
        transport: Transport,
        wanted: LobeSet,
        rng: &mut Rng,
    ) -> Option<BsdfSample> {
        if let Self::Lambertian { albedo, two_sided } = *self {
            let sampled = wanted == LobeSet::All && (at.front || two_sided);
            return sampled.then(|| {
                let wi = cosine_hemisphere(at.normal, rng.next_2d());
                BsdfSample { wi, weight: albedo, lobe: Lobe::Diffuse }
            });
        }
        if let Self::DiffuseTransmission(sheet) = self {
            return if wanted == LobeSet::All { sheet.sample(at.normal, rng) } else { None };
        }
        if let Self::Klems(sheet) = self {
            return if wanted == LobeSet::All { sheet.sample(at, transport, rng) } else { None };
        }
        self.sample_locally(at, transport, wanted, rng)
    }

    /// [`Self::sample`] for BSDFs that are not Lambertian, in the frame of the normal.
    fn sample_locally(
        &self,
        at: &Vertex,
        transport: Transport,
        wanted: LobeSet,
        rng: &mut Rng,
    ) -> Option<BsdfSample> {
        if wanted == LobeSet::PassThrough && !self.passes_through() {
            return None;
        }
        let frame = at.frame();
        let wo = frame.to_local(at.wo);
        if wo.z <= 0.0 {
            return None;
        }
        let sample = match self {
            Self::Lambertian { .. } | Self::DiffuseTransmission(_) | Self::Klems(_) => None,
            Self::Mirror { reflectance } => Some(mirrored(wo, *reflectance)),
            Self::Dielectric(interface) => Some(interface.sample(wo, at.front, transport, rng)),
            Self::ThinDielectric(sheet) => Some(sheet.sample(wo, rng)),
            Self::Conductor(conductor) => conductor.sample(wo, rng),
            Self::RoughDielectric(interface) => interface.sample(wo, at.front, transport, rng),
            Self::Coated(coated) => coated.sample(wo, wanted, rng),
            Self::Glossy(glossy) => glossy.sample(wo, wanted, rng),
            Self::Plastic(plastic) => plastic.sample(wo, wanted, rng),
            Self::Principled(principled) => principled.sample(wo, at.front, transport, wanted, rng),
        }?;
        Some(BsdfSample { wi: frame.to_world(sample.wi), ..sample })
    }

    /// The albedo feature for denoisers. Surfaces with a base have its color, metals their
    /// reflectance at normal incidence, rough glass its transmittance. Mirrors and clear glass are
    /// white.
    pub fn color(&self, front: bool) -> Rgb {
        match self {
            Self::Lambertian { albedo, two_sided } if front || *two_sided => *albedo,
            Self::Lambertian { .. } => Rgb::ZERO,
            Self::Coated(coated) => coated.albedo(),
            Self::Glossy(glossy) => glossy.albedo(),
            Self::Plastic(plastic) => plastic.albedo(),
            Self::Principled(principled) => principled.parameters().base_color,
            Self::DiffuseTransmission(sheet) => sheet.albedo(),
            Self::Klems(sheet) => Rgb::splat(sheet.diffuse_shares(front).iter().sum()),
            Self::Conductor(conductor) => conductor.normal_reflectance(),
            Self::RoughDielectric(interface) => interface.transmittance(),
            Self::Mirror { .. } | Self::Dielectric(_) | Self::ThinDielectric(_) => Rgb::ONE,
        }
    }

    /// An upper bound of the scattered share of the incident flux, per channel; exact for
    /// Lambertian surfaces, mirrors and thin sheets that scatter diffusely.
    #[inline]
    pub fn albedo(&self) -> Rgb {
        match self {
            Self::Lambertian { albedo, .. } => *albedo,
            Self::Mirror { reflectance } => *reflectance,
            Self::DiffuseTransmission(sheet) => sheet.albedo(),
            _ => Rgb::ONE,
        }
    }
}

/// The reflection of the local direction `wo` in the surface.
fn mirrored(wo: Vec3, weight: Rgb) -> BsdfSample {
    BsdfSample { wi: Vec3::new(-wo.x, -wo.y, wo.z), weight, lobe: Lobe::Delta }
}
