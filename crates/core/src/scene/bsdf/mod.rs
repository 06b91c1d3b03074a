//! Scattering at surfaces: the closed set of BSDFs.
//!
//! Each model is a file with an implementation of `Model`, a variant of [`Bsdf`] and a line of
//! `with_model`. All else that depends on the model is a reader or a writer of scenes, or the list
//! of those with wide kernels (`CoatedBase::of`).
//!
//! Directions are unit vectors that point away from the surface. In photon mapping a path either
//! *merges* at a vertex or *passes through*. This is a property of the lobe ([`Lobe`]), not of the
//! surface: a coat over a diffuse base has lobes of both kinds. At such a vertex photons merge
//! with, and lights connect to, the diffuse lobe alone.

mod anisotropic_ggx;
mod beckmann;
pub(in crate::scene) mod coat_columns;
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
mod lambertian;
mod layers;
mod mirror;
mod model;
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

use crate::base::math::{Frame, Rgb};
use crate::base::rng::Rng;
use glam::Vec3;
use lambertian::Lambertian;
use mirror::Mirror;
pub(in crate::scene) use model::TextureValues;
use model::{Describe, Lobes, Model, Traits, Transmission};
use serde::Serialize;

/// Minimum GGX width of lobes that merge and connect like diffuse surfaces. Narrower lobes pass
/// through: merged or connected directions would seldom carry light.
pub const DIFFUSE_ALPHA: f32 = 0.3;

/// Minimum GGX width of rough surfaces; smaller widths are perfectly smooth.
pub const SMOOTH_ALPHA: f32 = 1e-3;

/// Class of a lobe: the behavior of paths that it scatters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lobe {
    /// Wide: a numbered vertex, at which photons are merged and lights connected.
    Wide,
    /// Narrow, of finite density: passed through, but lights that cannot be hit are connected.
    Rough,
    /// A single direction: passed through.
    Delta,
}

impl Lobe {
    /// Returns true if vertices of this lobe are not numbered.
    #[inline]
    pub fn passes_through(self) -> bool {
        self != Self::Wide
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

/// Computes an expression with the [`Model`] of a BSDF: the list of all models.
macro_rules! with_model {
    ($bsdf:expr, $model:ident => $value:expr) => {
        match $bsdf {
            Bsdf::Lambertian { albedo, two_sided } => {
                let $model = &Lambertian { albedo: *albedo, two_sided: *two_sided };
                $value
            }
            Bsdf::Mirror { reflectance } => {
                let $model = &Mirror { reflectance: *reflectance };
                $value
            }
            Bsdf::Dielectric($model) => $value,
            Bsdf::ThinDielectric($model) => $value,
            Bsdf::Conductor($model) => $value,
            Bsdf::RoughDielectric($model) => $value,
            Bsdf::Coated($model) => $value,
            Bsdf::Glossy($model) => $value,
            Bsdf::Plastic($model) => $value,
            Bsdf::Principled($model) => $value,
            Bsdf::DiffuseTransmission($model) => $value,
            Bsdf::Klems($model) => $value,
        }
    };
}

impl Bsdf {
    /// Reflects the share `albedo` diffusely from both sides.
    pub const fn diffuse(albedo: Rgb) -> Self {
        Self::Lambertian { albedo, two_sided: true }
    }

    #[inline]
    fn traits(&self) -> Traits {
        with_model!(self, model => model.traits())
    }

    /// Class of the widest lobe; `None` if all are single directions.
    #[inline]
    pub fn spread(&self) -> Option<Lobe> {
        let classes = self.traits().classes;
        [Lobe::Wide, Lobe::Rough].into_iter().find(|lobe| classes.has(*lobe))
    }

    /// Returns true if the BSDF depends on [`Vertex::tangent`].
    #[inline]
    pub fn is_anisotropic(&self) -> bool {
        self.traits().depends_on_tangent
    }

    /// The BSDF where textures have these values; `None` if they do not change it.
    pub(in crate::scene) fn textured(&self, texture: &TextureValues) -> Option<Self> {
        with_model!(self, model => model.textured(texture))
    }

    /// Returns true if any lobe is diffuse.
    #[inline]
    pub fn merges(&self) -> bool {
        self.traits().classes.diffuse
    }

    /// Returns true if any lobe passes through.
    #[inline]
    pub fn passes_through(&self) -> bool {
        let Lobes { rough, delta, .. } = self.traits().classes;
        rough || delta
    }

    /// Returns true if any lobe is [`Lobe::Rough`].
    #[inline]
    pub fn has_rough(&self) -> bool {
        self.traits().classes.rough
    }

    /// Returns true if any lobe transmits light to the other side.
    #[inline]
    pub fn transmits(&self) -> bool {
        self.traits().transmission != Transmission::None
    }

    /// Returns true if a lobe that merges transmits light: photons on both sides merge.
    #[inline]
    pub fn transmits_diffusely(&self) -> bool {
        self.traits().transmission == Transmission::Diffuse
    }

    /// Returns true if the value depends only on the sides of both directions: Lambertian
    /// reflection and transmission.
    #[inline]
    pub fn is_constant(&self) -> bool {
        matches!(self, Self::Lambertian { .. } | Self::DiffuseTransmission(_))
    }

    /// Returns true if all light goes straight on: the refractive indices on both sides are equal.
    pub fn is_index_matched(&self) -> bool {
        if let Self::ThinDielectric(sheet) = self {
            return *sheet == ThinDielectric::new(1.0);
        }
        matches!(self, Self::Dielectric(interface) if *interface == Dielectric::new(1.0))
    }

    /// Albedo of the front or the back of a Lambertian surface; `None` for others.
    #[inline]
    pub fn diffuse_albedo(&self, front: bool) -> Option<Rgb> {
        let Self::Lambertian { albedo, two_sided } = *self else { return None };
        Some(Lambertian { albedo, two_sided }.of_side(front))
    }

    /// The value of all lobes but single directions, 1/sr, for light that arrives from `wi` and
    /// leaves toward `wo` ([`Transport::Radiance`]).
    #[inline]
    pub fn eval(&self, at: &Vertex, wi: Vec3) -> Rgb {
        with_model!(self, model => Model::eval(model, None, at, wi))
    }

    /// [`Self::eval`] for the lobes of one class.
    #[inline]
    pub fn eval_lobe(&self, lobe: Lobe, at: &Vertex, wi: Vec3) -> Rgb {
        if lobe == Lobe::Delta || !self.traits().classes.has(lobe) {
            return Rgb::ZERO;
        }
        with_model!(self, model => Model::eval(model, Some(lobe), at, wi))
    }

    /// Values and densities of the lobes that merge, and of rough ones.
    pub fn lobes(&self, at: &Vertex, wi: Vec3) -> [LobeValue; 2] {
        with_model!(self, model => Model::values(model, at, wi))
    }

    /// Density in solid angle, 1/sr, of [`Self::sample`] over the lobes of one class other than
    /// single directions. Its integral is less than 1 if there are other classes.
    pub fn pdf_w(&self, lobe: Lobe, at: &Vertex, wi: Vec3) -> f32 {
        if lobe == Lobe::Delta || !self.traits().classes.has(lobe) {
            return 0.0;
        }
        with_model!(self, model => Model::pdf_w(model, lobe, at, wi))
    }

    /// Probability that [`Self::sample`] passes through, consistent with [`Self::pdf_w`].
    pub fn pass_prob(&self, at: &Vertex) -> f32 {
        with_model!(self, model => Model::pass_prob(model, at))
    }

    /// Refractive index behind a smooth interface over that in front, as seen from the front or the
    /// back; 1 for others.
    pub fn relative_index(&self, front: bool) -> f32 {
        let Self::Dielectric(interface) = self else { return 1.0 };
        dielectric::relative(interface.eta, front)
    }

    /// The BSDF of an interface with another index behind it over that in front; others do not
    /// change.
    #[must_use]
    pub(crate) fn with_index(self, eta: f32) -> Self {
        if let Self::Dielectric(interface) = self {
            return Self::Dielectric(Dielectric { eta, ..interface });
        }
        let Self::RoughDielectric(interface) = self else { return self };
        Self::RoughDielectric(interface.with_index(eta))
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
        if wanted == LobeSet::PassThrough && !self.passes_through() {
            return None;
        }
        with_model!(self, model => Model::sample(model, at, transport, wanted, rng))
    }

    /// The albedo feature for denoisers. Surfaces with a base have its color, metals their
    /// reflectance at normal incidence, rough glass its transmittance. Mirrors and clear glass are
    /// white.
    pub fn color(&self, front: bool) -> Rgb {
        with_model!(self, model => model.color(front))
    }

    /// An upper bound of the scattered share of the incident flux, per channel; exact for
    /// Lambertian surfaces, mirrors and thin sheets that scatter diffusely.
    #[inline]
    pub fn albedo(&self) -> Rgb {
        self.traits().albedo_bound
    }
}
