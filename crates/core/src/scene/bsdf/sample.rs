//! What sampling and evaluating lobes give.

use super::Lobe;
use crate::base::math::Rgb;
use glam::Vec3;

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSample {
    /// Sampled direction.
    pub wi: Vec3,
    /// `f |cos(theta)| / pdf_w`, of a delta lobe its limit.
    /// theory.md (20).
    pub weight: Rgb,
    /// Class of the sampled lobe.
    pub lobe: Lobe,
}

impl BsdfSample {
    /// A sample of this lobe whose light is lost on another facet.
    pub(super) fn lost(lobe: Lobe) -> Self {
        Self { wi: Vec3::Z, weight: Rgb::ZERO, lobe }
    }
}

/// The lobes of one class in one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LobeValue {
    /// Value, 1/sr; see [`Bsdf::eval_lobe`](super::Bsdf::eval_lobe).
    pub value: Rgb,
    /// Density of sampling it, 1/sr; see [`Bsdf::pdf_w`](super::Bsdf::pdf_w).
    pub pdf_w: f32,
}

/// The lobes to sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LobeSet {
    /// All lobes.
    All,
    /// Lobes that pass through.
    PassThrough,
}
