//! How photons are weighted against other ways to find their paths.

use super::QUAD;
use crate::transport::kernel::ByClass;
use glam::Vec4;

/// Weights of the photons that one look-up finds.
pub(crate) trait Weighing {
    /// Whether photons of all classes count at all vertices.
    const ALL: bool;

    /// Those of each class; `None` if they are 1.
    fn by_class(&self) -> Option<ByClass<f32>>;

    /// Those of a quad's photons besides, given what all photons carry; `None` if they are 1.
    fn weights(&self, parts: &[f32], quad: usize) -> Option<Vec4>;
}

/// All weights are 1.
pub(crate) struct Unweighted;

impl Weighing for Unweighted {
    const ALL: bool = false;

    #[inline(always)] // as the next: parts of the loop over ranges
    fn by_class(&self) -> Option<ByClass<f32>> {
        None
    }

    #[inline(always)]
    fn weights(&self, _: &[f32], _: usize) -> Option<Vec4> {
        None
    }
}

/// What the photons of a quad carry.
#[inline(always)]
pub(crate) fn of_quad(parts: &[f32], quad: usize) -> Vec4 {
    Vec4::from_slice(&parts[quad * QUAD..][..QUAD])
}
