//! MIS weights of photons, as the loop over photons applies them.

use super::QUAD;
use crate::transport::kernel::ByClass;
use glam::{BVec4A, Vec4};

/// MIS partials of the photons of a quad, for merges at first and at second vertices.
pub(crate) type QuadPartials = [[f32; QUAD]; 2];

/// MIS weights of the photons that one query finds.
pub(crate) trait PhotonWeights {
    /// Photons of all classes count at all vertices.
    const ALL_CLASSES: bool;

    /// One weight for each photon class; `None` if both are 1.
    fn by_class(&self) -> Option<ByClass<f32>>;

    /// Further weights of the photons of a quad, from their MIS partials; `None` if all are 1. `is_caustic` finds the
    /// caustic photons.
    fn of_quad(
        &self,
        mis_partials: &[QuadPartials],
        quad: usize,
        is_caustic: impl FnOnce() -> BVec4A,
    ) -> Option<Vec4>;
}

/// Weights of 1 for all photons.
pub(crate) struct Unweighted;

impl PhotonWeights for Unweighted {
    const ALL_CLASSES: bool = false;

    #[inline(always)] // part of the loop over photons, as the functions below
    fn by_class(&self) -> Option<ByClass<f32>> {
        None
    }

    #[inline(always)]
    fn of_quad(&self, _: &[QuadPartials], _: usize, _: impl FnOnce() -> BVec4A) -> Option<Vec4> {
        None
    }
}
