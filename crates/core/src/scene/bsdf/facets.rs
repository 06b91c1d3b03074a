//! Models of microfacets: the renderer's own, and those of Walter et al. 2007 that Mitsuba uses.

use super::beckmann::Beckmann;
use super::ggx::Ggx;
use glam::Vec3;
use serde::Serialize;

/// Distribution of microfacets, and their masking and shadowing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub enum FacetModel {
    /// GGX, with the heights of neighbors correlated (Heitz 2014).
    #[default]
    Correlated,
    /// GGX, with independent masking and shadowing (Walter et al. 2007).
    Ggx,
    /// Beckmann, with independent masking and shadowing.
    Beckmann,
}

/// Microfacets of a model and a width.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Facets {
    /// Model of the facets.
    pub model: FacetModel,
    /// Width, above 0 up to 1.
    pub alpha: f32,
}

impl Facets {
    /// The GGX distribution of this width.
    #[inline]
    pub(super) fn ggx(&self) -> Ggx {
        Ggx { alpha: self.alpha }
    }

    #[inline]
    fn beckmann(&self) -> Beckmann {
        Beckmann { alpha: self.alpha }
    }

    /// Density of normals over the surface, 1/sr.
    #[inline]
    pub fn d(&self, m: Vec3) -> f32 {
        match self.model {
            FacetModel::Beckmann => self.beckmann().d(m),
            FacetModel::Ggx | FacetModel::Correlated => self.ggx().d(m),
        }
    }

    /// Share of the facets that is visible from `w`.
    #[inline]
    pub fn g1(&self, w: Vec3) -> f32 {
        match self.model {
            FacetModel::Beckmann => self.beckmann().g1(w),
            FacetModel::Ggx | FacetModel::Correlated => self.ggx().g1(w),
        }
    }

    /// Share of the facets that is visible from both directions.
    /// theory.md (25), (97).
    #[inline]
    pub fn g2(&self, wo: Vec3, wi: Vec3) -> f32 {
        match self.model {
            FacetModel::Correlated => self.ggx().g2(wo, wi),
            FacetModel::Beckmann | FacetModel::Ggx => self.g1(wo) * self.g1(wi),
        }
    }

    /// Density of [`Self::sample_visible`], 1/sr: the normals as `wo` sees them.
    #[inline]
    pub fn visible_pdf_w(&self, wo: Vec3, m: Vec3) -> f32 {
        self.g1(wo) * wo.dot(m).max(0.0) * self.d(m) / wo.z
    }

    /// A normal as seen from `wo`.
    #[inline]
    pub fn sample_visible(&self, wo: Vec3, u: [f32; 2]) -> Vec3 {
        match self.model {
            FacetModel::Beckmann => self.beckmann().sample_visible(wo, u),
            FacetModel::Ggx | FacetModel::Correlated => self.ggx().sample_visible(wo, u),
        }
    }
}
