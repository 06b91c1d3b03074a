//! Berry's distribution of microfacet normals, GTR with the exponent 1, which the coat of Burley
//! 2012 has.

use crate::base::math::sin_cos_turns;
use glam::Vec3;
use std::f32::consts::PI;

/// Facets with a long tail of steep slopes. Directions are local: the surface's normal is z.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Gtr1 {
    /// Width, above 0 and below 1.
    pub alpha: f32,
}

impl Gtr1 {
    /// Density of normals `m` over the surface, 1/sr.
    /// theory.md (32c), like the next functions.
    #[inline]
    pub fn d(&self, m: Vec3) -> f32 {
        let alpha2 = self.alpha * self.alpha;
        let sin2 = m.x * m.x + m.y * m.y;
        (1.0 - alpha2) / (-PI * alpha2.ln() * (sin2 + alpha2 * m.z * m.z))
    }

    /// Density of [`Self::sample`], 1/sr.
    #[inline]
    pub fn pdf_w(&self, m: Vec3) -> f32 {
        m.z.max(0.0) * self.d(m)
    }

    /// A normal with the density `D cos(theta)`.
    #[inline]
    pub fn sample(&self, [u, v]: [f32; 2]) -> Vec3 {
        let alpha2 = self.alpha * self.alpha;
        let cos2 = ((1.0 - alpha2.powf(1.0 - u)) / (1.0 - alpha2)).clamp(0.0, 1.0);
        let (sin, cos) = sin_cos_turns(v);
        let ring = (1.0 - cos2).sqrt();
        Vec3::new(ring * cos, ring * sin, cos2.sqrt())
    }
}
