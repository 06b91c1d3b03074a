//! The functions of a model of scattering.
//!
//! Everything that a [`Bsdf`](super::Bsdf) does is a function of [`Model`] that no model may leave
//! out. Models whose formulas know only directions in the frame of the normal are [`LocalModel`]s.

use super::{Bsdf, BsdfSample, Lobe, LobeSet, LobeValue, Transport, Vertex};
use crate::base::math::{Frame, Rgb};
use crate::base::rng::Rng;
use glam::Vec3;

/// Classes of lobes that a surface has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Lobes {
    /// Any lobe is [`Lobe::Wide`].
    pub(super) diffuse: bool,
    /// Any lobe is [`Lobe::Rough`].
    pub(super) rough: bool,
    /// Any lobe is [`Lobe::Delta`].
    pub(super) delta: bool,
}

impl Lobes {
    /// A single class.
    #[inline]
    pub(super) const fn of(lobe: Lobe) -> Self {
        Self {
            diffuse: matches!(lobe, Lobe::Wide),
            rough: matches!(lobe, Lobe::Rough),
            delta: matches!(lobe, Lobe::Delta),
        }
    }

    #[inline]
    pub(super) fn has(self, lobe: Lobe) -> bool {
        match lobe {
            Lobe::Wide => self.diffuse,
            Lobe::Rough => self.rough,
            Lobe::Delta => self.delta,
        }
    }
}

/// How light reaches the other side of a surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Transmission {
    /// It does not.
    None,
    /// By lobes that pass through.
    Passing,
    /// By lobes that merge: photons on both sides count.
    Diffuse,
}

/// A surface for paths, whatever their directions.
#[derive(Clone, Copy, Debug)]
pub(super) struct Traits {
    /// Classes of its lobes.
    pub(super) classes: Lobes,
    /// How light reaches the other side.
    pub(super) transmission: Transmission,
    /// The value depends on [`Vertex::tangent`].
    pub(super) depends_on_tangent: bool,
    /// An upper bound of the scattered share of the incident flux.
    pub(super) albedo_bound: Rgb,
}

/// Values of the textures of a material at a point, as factors of its parameters: 1 where there is
/// no texture.
#[derive(Clone, Copy, Debug)]
pub(in crate::scene) struct TextureValues {
    /// Factor of the albedo or the base color.
    pub(in crate::scene) color: Rgb,
    /// Factor of diffusely transmitted light.
    pub(in crate::scene) transmitted: Rgb,
    pub(in crate::scene) metallic: f32,
    pub(in crate::scene) roughness: f32,
}

/// A surface, whatever the directions.
pub(super) trait Describe {
    /// What it is for paths.
    fn traits(&self) -> Traits;

    /// The surface where textures have these values; `None` if they do not change it.
    fn textured(&self, texture: &TextureValues) -> Option<Bsdf>;

    /// Color of the front or the back as a feature for denoisers.
    fn color(&self, front: bool) -> Rgb;
}

/// The direction back along the path in the frame of the normal, and its side of the surface. Its
/// `z` is positive.
#[derive(Clone, Copy, Debug)]
pub(super) struct Local {
    pub(super) wo: Vec3,
    pub(super) front: bool,
}

/// A model of scattering. Functions that take a class are only called for classes that it has, and
/// not for single directions.
pub(super) trait Model: Describe {
    /// The value of the lobes of one class, or of all but single directions, 1/sr.
    fn eval(&self, lobe: Option<Lobe>, at: &Vertex, wi: Vec3) -> Rgb;

    /// Density of sampling the lobes of one class, 1/sr.
    fn pdf_w(&self, lobe: Lobe, at: &Vertex, wi: Vec3) -> f32;

    /// [`Self::eval`] and [`Self::pdf_w`] of the lobes that merge, and of rough ones.
    fn values(&self, at: &Vertex, wi: Vec3) -> [LobeValue; 2];

    /// Probability that a sampled lobe passes through.
    fn pass_prob(&self, at: &Vertex) -> f32;

    /// Samples a direction. Models that have no lobe that passes through are only asked for all.
    fn sample(
        &self,
        at: &Vertex,
        transport: Transport,
        wanted: LobeSet,
        rng: &mut Rng,
    ) -> Option<BsdfSample>;
}

/// [`Model::values`] by the functions of each class.
pub(super) fn values_by_class(model: &impl Model, at: &Vertex, wi: Vec3) -> [LobeValue; 2] {
    [Lobe::Wide, Lobe::Rough].map(|lobe| {
        if !model.traits().classes.has(lobe) {
            return LobeValue::default();
        }
        LobeValue { value: model.eval(Some(lobe), at, wi), pdf_w: model.pdf_w(lobe, at, wi) }
    })
}

/// A [`Model`] in the frame of the normal. Nothing is seen from below a shading normal.
pub(super) trait LocalModel: Describe {
    /// [`Model::eval`]
    fn eval(&self, lobe: Option<Lobe>, at: Local, wi: Vec3) -> Rgb;

    /// [`Model::pdf_w`]
    fn pdf_w(&self, lobe: Lobe, at: Local, wi: Vec3) -> f32;

    /// [`Model::values`], if there is a shorter way than by class.
    fn values(&self, at: Local, wi: Vec3) -> Option<[LobeValue; 2]>;

    /// [`Model::pass_prob`]
    fn pass_prob(&self, at: Local) -> f32;

    /// [`Model::sample`]
    fn sample(
        &self,
        at: Local,
        transport: Transport,
        wanted: LobeSet,
        rng: &mut Rng,
    ) -> Option<BsdfSample>;
}

impl<M: LocalModel> Model for M {
    #[inline]
    fn eval(&self, lobe: Option<Lobe>, at: &Vertex, wi: Vec3) -> Rgb {
        let frame = at.frame();
        let own = Local { wo: frame.to_local(at.wo), front: at.front };
        if own.wo.z <= 0.0 {
            return Rgb::ZERO;
        }
        LocalModel::eval(self, lobe, own, frame.to_local(wi))
    }

    #[inline]
    fn pdf_w(&self, lobe: Lobe, at: &Vertex, wi: Vec3) -> f32 {
        let frame = at.frame();
        let own = Local { wo: frame.to_local(at.wo), front: at.front };
        if own.wo.z <= 0.0 {
            return 0.0;
        }
        LocalModel::pdf_w(self, lobe, own, frame.to_local(wi))
    }

    #[inline]
    fn values(&self, at: &Vertex, wi: Vec3) -> [LobeValue; 2] {
        let frame = at.frame();
        let own = Local { wo: frame.to_local(at.wo), front: at.front };
        if own.wo.z <= 0.0 {
            return Default::default();
        }
        let values = LocalModel::values(self, own, frame.to_local(wi));
        values.unwrap_or_else(|| values_by_class(self, at, wi))
    }

    #[inline]
    fn pass_prob(&self, at: &Vertex) -> f32 {
        let wo = Frame::new(at.normal).to_local(at.wo);
        if wo.z <= 0.0 {
            let Lobes { rough, delta, .. } = self.traits().classes;
            return if rough || delta { 1.0 } else { 0.0 };
        }
        LocalModel::pass_prob(self, Local { wo, front: at.front })
    }

    #[inline]
    fn sample(
        &self,
        at: &Vertex,
        transport: Transport,
        wanted: LobeSet,
        rng: &mut Rng,
    ) -> Option<BsdfSample> {
        let frame = at.frame();
        let own = Local { wo: frame.to_local(at.wo), front: at.front };
        if own.wo.z <= 0.0 {
            return None;
        }
        let sample = LocalModel::sample(self, own, transport, wanted, rng)?;
        Some(BsdfSample { wi: frame.to_world(sample.wi), ..sample })
    }
}

/// The functions of a [`LocalModel`] whose lobes are all of single directions: it has no value and
/// no density, and all paths pass through.
macro_rules! only_single_directions {
    () => {
        #[inline]
        fn eval(&self, _lobe: Option<Lobe>, _at: Local, _wi: Vec3) -> Rgb {
            Rgb::ZERO
        }

        #[inline]
        fn pdf_w(&self, _lobe: Lobe, _at: Local, _wi: Vec3) -> f32 {
            0.0
        }

        #[inline]
        fn values(&self, _at: Local, _wi: Vec3) -> Option<[LobeValue; 2]> {
            Some(Default::default())
        }

        #[inline]
        fn pass_prob(&self, _at: Local) -> f32 {
            1.0
        }
    };
}
pub(super) use only_single_directions;
