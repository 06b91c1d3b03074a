//! MIS weights of photons, as the loop over photons applies them.

use super::OCTET;
use crate::simd::f32x8::F32x8;
use crate::transport::kernel::ByClass;

/// MIS partials of the photons of an octet, for merges at first and at second vertices.
pub(crate) type OctetPartials = [[f32; OCTET]; 2];

/// MIS weights of the photons that one query finds.
pub(crate) trait PhotonWeights {
    /// Photons of all classes count at all vertices.
    const ALL_CLASSES: bool;

    /// One weight for each photon class; `None` if both are 1.
    fn by_class(&self) -> Option<ByClass<f32>>;

    /// Further weights of the photons of an octet, from their MIS partials; `None` if all are 1.
    /// `is_caustic` selects the caustic photons.
    fn of_octet<E: F32x8>(
        &self,
        eight: E,
        mis_partials: &[OctetPartials],
        octet: usize,
        is_caustic: E::Mask,
    ) -> Option<E::Floats>;
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
    fn of_octet<E: F32x8>(
        &self,
        _: E,
        _: &[OctetPartials],
        _: usize,
        _: E::Mask,
    ) -> Option<E::Floats> {
        None
    }
}
