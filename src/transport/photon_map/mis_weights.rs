//! MIS weights of photons, as the loop over photons applies them.

use super::QUAD;
use crate::transport::kernel::ByClass;
use glam::Vec4;

/// MIS weights of the photons that one query finds.
pub(crate) trait PhotonWeights {
    /// Photons of all classes count at all vertices.
    const ALL_CLASSES: bool;

    /// One weight for each photon class; `None` if both are 1.
    fn by_class(&self) -> Option<ByClass<f32>>;

    /// Further weights of the photons of a quad, from their MIS partials; `None` if all are 1.
    fn of_quad(&self, mis_partials: &[f32], quad: usize) -> Option<Vec4>;
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
    fn of_quad(&self, _: &[f32], _: usize) -> Option<Vec4> {
        None
    }
}

/// The MIS partials of the photons of a quad.
#[inline(always)]
pub(crate) fn quad_partials(mis_partials: &[f32], quad: usize) -> Vec4 {
    Vec4::from_slice(&mis_partials[quad * QUAD..][..QUAD])
}
