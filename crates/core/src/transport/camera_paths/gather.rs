//! Gather points at surfaces that are not only diffuse: one for each side on which photons merge.

use super::CameraPaths;
use crate::base::math::Rgb;
use crate::scene::Surface;
use crate::scene::bsdf::{Bsdf, Vertex};
use crate::transport::gather::{GatherPoint, GatherView};
use crate::transport::mis::densities::Directions;
use crate::transport::path_state::PathState;

impl CameraPaths {
    /// Stores the gather points of a path that arrives at `surface`, with the arguments `at` of its
    /// BSDF: for photons on the side of the path and, where the surface transmits diffusely, for
    /// those on the other side. Each has the normal and the side of its photons, so that areas and
    /// the tests of photons are those of that side. theory.md (46a)
    pub(super) fn gather(&mut self, surface: &Surface, at: &Vertex, state: &PathState) {
        self.gather_on_side(surface, at, state, false);
        if surface.bsdf.transmits_diffusely() {
            self.gather_on_side(surface, at, state, true);
        }
    }

    /// Stores a gather point for photons on the side of the path or, if `transmits`, on the other
    /// side, unless nothing is scattered from there. Sheets without shading normals have one value
    /// per side: their photons merge without a view, eight at once.
    fn gather_on_side(
        &mut self,
        surface: &Surface,
        at: &Vertex,
        state: &PathState,
        transmits: bool,
    ) {
        let Surface { position, facet, normal, interpolated, bsdf, .. } = *surface;
        let PathState { path, weight, history, .. } = *state;
        let (normal, facet) = if transmits { (-normal, facet.opposite()) } else { (normal, facet) };
        let value = match bsdf {
            Bsdf::DiffuseTransmission(sheet) => Some(sheet.value(transmits)),
            _ => None,
        };
        if value == Some(Rgb::ZERO) {
            return;
        }
        let value = value.filter(|_| interpolated.is_none());
        let view = if value.is_some() {
            GatherPoint::NO_VIEW
        } else {
            self.views.push(GatherView { bsdf, at: *at, interpolated, transmits });
            self.views.len() as u32 - 1
        };
        let (vertex, wavelength) = (history.diffuse() + 1, history.wavelength());
        self.gather_points.push(&GatherPoint {
            position,
            path,
            weight: weight * value.unwrap_or(Rgb::ONE),
            vertex,
            wavelength,
            normal,
            facet,
            view,
        });
        let Some(mis) = self.mis else { return };
        let earlier = self.arriving_merges(&mis, path);
        if value.is_none() {
            self.gather_points.set_earlier_merges(earlier);
            return;
        }
        // The densities are those of any direction on the side of the photons.
        let directions = Directions { camera: surface.wo, light: normal };
        let camera = directions.camera_diffuse(surface, mis.camera_survival(vertex));
        let earlier = earlier * directions.light_diffuse(surface);
        self.gather_points.set_point_partials(mis.balance.gather(vertex, earlier, camera));
    }
}
