//! Scattering by shading normals: interpolated, or bent by a map.

use super::Surface;
use crate::base::math::uniform_disc;
use crate::base::rng::Rng;
use crate::scene::bsdf::{Bsdf, BsdfSample, Lobe, LobeSet, Transport, Vertex};
use glam::Vec3;
use std::f32::consts::PI;

/// Minimum cosine between a shading normal and the direction that it is seen from.
pub(super) const GRAZING: f32 = 1e-3;

/// Minimum cosine between the normals at the corners of a triangle and its own, 15 degrees, for
/// which they stand for a smooth surface. Wider angles are the edges of coarse meshes: there images
/// remain those of other renderers.
pub(super) const SMOOTH_COSINE: f32 = 0.966;

/// The BSDF where the normal `interpolated` between those of a triangle's corners shades a smooth
/// surface. Paths lose the directions between both horizons. A Lambertian surface gets the factor
/// that restores this light: it then reflects its albedo of uniform light, by camera paths and by
/// light paths. theory.md (33a)
#[inline]
pub(super) fn with_lost_light(
    bsdf: Bsdf,
    corners: &[Vec3; 3],
    triangle: Vec3,
    interpolated: Option<Vec3>,
) -> Bsdf {
    match (bsdf, interpolated) {
        (Bsdf::Lambertian { albedo, two_sided }, Some(normal)) if is_smooth(corners, triangle) => {
            let albedo = albedo * (2.0 / (1.0 + normal.dot(triangle)));
            Bsdf::Lambertian { albedo, two_sided }
        }
        _ => bsdf,
    }
}

/// Returns true if the normals of a triangle's corners stand for a smooth surface.
#[inline]
pub(super) fn is_smooth(corners: &[Vec3; 3], triangle: Vec3) -> bool {
    corners.iter().all(|corner| corner.dot(triangle) >= SMOOTH_COSINE)
}

/// The normal by which a surface scatters, seen from `wo`, given its interpolated normal and the
/// triangle's.
#[inline(never)] // keeps the common case short
pub(crate) fn shading_normal(
    bsdf: &Bsdf,
    interpolated: Vec3,
    triangle: Vec3,
    wo: Vec3,
    transport: Transport,
) -> Vec3 {
    match (bsdf, transport) {
        // The value does not depend on the viewing direction, even below the horizon of the normal.
        // Flux leaves by the cosine of the triangle; see `adjoint_correction`.
        (constant, Transport::Radiance) if constant.is_constant() => interpolated,
        (constant, Transport::Flux) if constant.is_constant() => triangle,
        // A normal that faces away is bent until it is visible; its surface would be black.
        // theory.md (33)
        _ => (interpolated + (GRAZING - interpolated.dot(wo)).max(0.0) * wo).normalize(),
    }
}

impl Surface<'_> {
    pub(super) fn shading_normal(&self, normal: Vec3, transport: Transport) -> Vec3 {
        shading_normal(&self.bsdf, normal, self.normal, self.wo, transport)
    }

    /// [`Self::scatter_flux`] by a shading normal.
    #[inline(never)] // keeps the common case short
    pub(super) fn scatter_flux_by(
        &self,
        normal: Vec3,
        at: &Vertex,
        rng: &mut Rng,
    ) -> Option<BsdfSample> {
        let hidden = self.hidden_share(normal);
        if hidden > 0.0 && rng.next_1d() < hidden {
            return Some(self.scatter_below(normal, rng));
        }
        let sample = self.bsdf.sample(at, Transport::Flux, LobeSet::All, rng)?;
        let scale = self.adjoint_correction(normal, at, sample.wi) / (1.0 - hidden);
        let agrees = self.agrees(at, sample.wi);
        agrees.then_some(BsdfSample { weight: sample.weight * scale, ..sample })
    }

    /// Factor of a light path's flux where it continues from `at` toward `wi`: shading normals make
    /// scattering asymmetric (Veach 1997, Section 5.3). theory.md (34), (35).
    fn adjoint_correction(&self, normal: Vec3, at: &Vertex, wi: Vec3) -> f32 {
        let arriving = |normal: Vec3| normal.dot(self.wo) / self.normal.dot(self.wo);
        if self.bsdf.is_constant() {
            return arriving(normal).max(0.0);
        }
        arriving(at.normal) * (self.normal.dot(wi) / at.normal.dot(wi)).abs()
    }

    /// Share of the light that a diffuse surface would send above the triangle and below the
    /// horizon of `normal`. Camera paths from there see wide facets by a normal bent toward them,
    /// while a BSDF sends nothing there. Narrow lobes get no such share: hits of their peaks would
    /// be rare and bright. Light paths lose that light: 1 % of the light that a floor with bumps of
    /// 37 degrees sends to a wall. theory.md (36).
    fn hidden_share(&self, normal: Vec3) -> f32 {
        let bsdf = &self.bsdf;
        let wide = bsdf.merges() && !bsdf.passes_through();
        let bent = wide && !bsdf.is_constant();
        if bent { 0.5 * (1.0 - normal.dot(self.normal)).max(0.0) } else { 0.0 }
    }

    /// Samples a direction above the triangle and below the horizon of `normal`, with the density
    /// of diffuse light times the probability of this case.
    fn scatter_below(&self, normal: Vec3, rng: &mut Rng) -> BsdfSample {
        let cos = normal.dot(self.normal);
        let toward = normal.reject_from_normalized(self.normal).normalize_or_zero();
        // Seen from above, the region lies between a half circle and half an ellipse of the axes 1
        // and `cos`: a half disc, squeezed.
        let [x, y] = uniform_disc(rng.next_2d());
        let half = (1.0 - y * y).max(0.0).sqrt();
        let away = cos * half + (1.0 - cos) * x.abs();
        let up = (1.0 - away * away - y * y).max(0.0).sqrt();
        let wi = up * self.normal - away * toward + y * self.normal.cross(toward);
        // Evaluate it as seen by a camera there: scattering from the light, which is at `wo`,
        // toward `wi`.
        let seen = Surface { wo: wi, ..*self };
        let normal = seen.shading_normal(normal, Transport::Radiance);
        let at = Vertex { normal, wo: wi, front: self.front, tangent: self.tangent };
        let areas = normal.dot(self.wo) / self.normal.dot(self.wo);
        // theory.md (36)
        let weight = self.bsdf.eval_lobe(Lobe::Wide, &at, self.wo) * (PI * areas.max(0.0));
        BsdfSample { wi, weight, lobe: Lobe::Wide }
    }
}

#[cfg(test)]
mod tests;
