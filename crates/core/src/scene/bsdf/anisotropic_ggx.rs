//! The GGX distribution of microfacet normals with different widths along two axes, and independent
//! masking and shadowing.
//!
//! Directions are local: the surface's normal is z, the tangent x. Burley 2012 (distribution),
//! Walter et al. 2007 (masking), Dupuy and Benyoub 2023 (sampling).

use crate::base::math::sin_cos_turns;
use glam::Vec3;
use std::f32::consts::PI;

/// Microfacets whose slopes deviate by `x / sqrt(2)` along the tangent and `y / sqrt(2)` across it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct AnisotropicGgx {
    /// Width along the tangent, above 0.
    pub x: f32,
    /// Width across the tangent, above 0.
    pub y: f32,
}

impl AnisotropicGgx {
    /// Density of normals `m` over the surface, 1/sr.
    /// theory.md (25a), like the next functions.
    #[inline]
    pub fn d(&self, m: Vec3) -> f32 {
        let stretched = (m.x / self.x).powi(2) + (m.y / self.y).powi(2) + m.z * m.z;
        (PI * self.x * self.y * stretched * stretched).recip()
    }

    /// Share of the facets that is visible from `w`.
    #[inline]
    pub fn g1(&self, w: Vec3) -> f32 {
        let tan2 = ((self.x * w.x).powi(2) + (self.y * w.y).powi(2)) / (w.z * w.z);
        2.0 / (1.0 + (1.0 + tan2).sqrt())
    }

    /// Density of [`Self::sample_visible`], 1/sr.
    #[inline]
    pub fn visible_pdf_w(&self, wo: Vec3, m: Vec3) -> f32 {
        self.g1(wo) * wo.dot(m).max(0.0) * self.d(m) / wo.z
    }

    /// A visible normal as seen from `wo`, as
    /// [`Ggx::sample_visible`](super::ggx::Ggx::sample_visible).
    #[inline]
    pub fn sample_visible(&self, wo: Vec3, [u, v]: [f32; 2]) -> Vec3 {
        let squeeze = |w: Vec3| Vec3::new(self.x * w.x, self.y * w.y, w.z).normalize();
        let beam = squeeze(wo);
        let z = (1.0 - u) * (1.0 + beam.z) - beam.z;
        let ring = (1.0 - z * z).max(0.0).sqrt();
        let (sin, cos) = sin_cos_turns(v);
        squeeze(Vec3::new(ring * cos, ring * sin, z) + beam)
    }
}
