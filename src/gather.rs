//! Where camera paths gather photons.

use crate::bsdf::{Bsdf, Lobe, Vertex};
use crate::math::Rgb;
use crate::photon::Photon;
use glam::Vec3;

/// A vertex of a camera path at which photons are merged.
#[derive(Clone, Copy, Debug)]
pub struct GatherPoint {
    /// Where it is, scene units.
    pub position: Vec3,
    /// Its camera path: index within the batch.
    pub path: u32,
    /// Throughput of the path times the BSDF toward the camera, 1/sr: what a photon's flux per
    /// area (of the merge kernel) is multiplied with. The throughput alone if there is a `view`.
    pub weight: Rgb,
    /// Number of the diffuse vertex, `1..=k`: all photons are merged at `k`; before, only those that
    /// come from a light without a diffuse bounce.
    pub vertex: u32,
    /// Unit normal on the side that the camera path sees.
    pub normal: Vec3,
    /// Index in [`CameraPaths::views`](crate::camera_paths::CameraPaths::views), or [`GatherPoint::NO_VIEW`] if the BSDF is the same for all
    /// photons.
    pub view: u32,
}

impl GatherPoint {
    /// The BSDF does not depend on where photons come from.
    pub const NO_VIEW: u32 = u32::MAX;
}

/// A surface whose BSDF depends on where photons come from, as a camera path sees it.
#[derive(Clone, Copy, Debug)]
pub struct GatherView {
    /// How it scatters.
    pub bsdf: Bsdf,
    /// Whence it is seen.
    pub at: Vertex,
}

impl GatherView {
    /// The BSDF's value for a photon that is merged at `point`, 1/sr. Photons count by the area of
    /// the triangles, light by that of the interpolated surface.
    pub fn value(&self, photon: &Photon, point: &GatherPoint) -> Rgb {
        let wi = photon.from_as_at(point.normal);
        let areas = wi.dot(self.at.normal) / wi.dot(point.normal);
        if areas > 0.0 {
            self.bsdf.eval_lobe(Lobe::Diffuse, &self.at, wi) * areas
        } else {
            Rgb::ZERO
        }
    }
}
