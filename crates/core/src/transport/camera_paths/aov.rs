//! Arbitrary output variables (AOVs) of camera paths: the first surface, and the parts of the light
//! that are emission, light of one bounce or caustics. Recording them draws no random numbers.

use super::{CameraPass, CameraPaths};
use crate::base::math::Rgb;
use crate::scene::bsdf::coats::CoatSamples;
use crate::scene::coated_hits::CoatedVertices;
use crate::scene::diffuse::DiffuseVertices;
use crate::scene::{Optics, Surface};
use crate::simd::{LANES, Mask};
use crate::transport::path_state::{History, PathState, PathStates};
use glam::Vec3;

/// AOVs of one camera path.
#[derive(Clone, Copy, Debug, Default)]
pub struct PathAov {
    /// Part of `D_j`: emission seen directly, or only by mirrors and clear glass, W/(m^2 sr).
    pub emission: Rgb,
    /// Part of `D_j`: light connected at the first vertex, and emission hit after a rough lobe,
    /// W/(m^2 sr).
    pub direct: Rgb,
    /// Part of `D_j`: light of one diffuse bounce that reached the surface through other surfaces,
    /// W/(m^2 sr).
    pub caustics: Rgb,
    /// Albedo of the first surface that is no mirror and no clear glass, tinted by the surfaces
    /// before it.
    pub albedo: Rgb,
    /// Unit shading normal of the surface of `albedo`, on the side that is seen.
    pub normal: Vec3,
    /// Position of the first surface of any kind, scene units.
    pub position: Vec3,
    /// Distance of `position` along the axis of the camera, or from a panorama or fisheye camera,
    /// scene units.
    pub depth: f32,
    /// The path hits a surface.
    pub hits: bool,
    /// `albedo` and `normal` are set.
    has_surface: bool,
    /// The path took a rough lobe before any diffuse vertex.
    is_after_rough: bool,
    /// Number of the current diffuse vertex.
    vertex: u32,
    /// Vertices passed through before the first diffuse vertex.
    passed: u32,
}

impl CameraPaths {
    /// Sets whether the camera paths that are traced next record [`Self::aovs`].
    pub fn record_aovs(&mut self, records: bool) {
        self.records_aovs = records;
    }

    /// Adds empty AOVs for the new paths.
    pub(super) fn start_aovs(&mut self) {
        // Entries from the first new path on belong to paths that were cleared.
        self.aovs.truncate(self.first_path);
        self.aovs.resize(self.direct.len(), PathAov::default());
    }

    /// Records the surfaces at Lambertian vertices, before paths scatter.
    #[inline(never)] // rare
    pub(super) fn record_diffuse(
        &mut self,
        pass: &CameraPass,
        at: &DiffuseVertices,
        states: &PathStates,
    ) {
        for lane in (0..LANES).filter(|&lane| at.active[lane]) {
            let surface = Some([at.albedo.get(lane), at.normal.get(lane)]);
            self.record_surface(pass, states, lane, at.position.get(lane), surface);
        }
    }

    /// Records any other surface, whose shading normal is `normal`.
    #[inline(never)] // rare
    pub(super) fn record_other(
        &mut self,
        pass: &CameraPass,
        surface: &Surface,
        state: &PathState,
        normal: Vec3,
    ) {
        let aov = &mut self.aovs[state.path as usize];
        aov.vertex = state.history.diffuse() + 1;
        if state.history.diffuse() == 0 {
            aov.passed = state.history.passed();
            aov.set_first_hit(pass, state.history, surface.position);
            if surface.bsdf.spread().is_some() {
                let tint = state.weight * state.inverse_start;
                // Smooth normals may raise an albedo above 1: theory.md (33a).
                let color = surface.bsdf.color(surface.front).min(Rgb::ONE);
                aov.set_surface(tint * color, normal);
            }
        }
    }

    /// Records the surfaces at bases and coats, before paths scatter.
    #[inline(never)] // rare
    pub(super) fn record_coated<const METAL: bool>(
        &mut self,
        pass: &CameraPass,
        at: &CoatedVertices<METAL>,
        states: &PathStates,
    ) {
        for lane in (0..LANES).filter(|&lane| at.active[lane]) {
            // Smooth normals may raise an albedo above 1: theory.md (33a).
            let albedo = at.bsdf.albedo.get(lane).min(Rgb::ONE);
            let surface = [albedo, at.shading_normal.get(lane)];
            let surface = Some(surface).filter(|_| !at.bsdf.is_mirror(lane));
            self.record_surface(pass, states, lane, at.position.get(lane), surface);
        }
    }

    /// Records that paths before any diffuse vertex take rough lobes.
    #[inline(never)] // rare
    pub(super) fn record_rough_samples(
        &mut self,
        active: &Mask,
        samples: &CoatSamples,
        states: &PathStates,
    ) {
        for lane in (0..LANES).filter(|&lane| active[lane]) {
            let is_rough = samples.passes_through[lane] & !samples.is_delta[lane];
            if samples.is_some[lane] && is_rough && states.history[lane].diffuse() == 0 {
                self.record_rough(states.path[lane]);
            }
        }
    }

    /// Records a surface of this albedo and normal, before the path in a lane scatters. Mirrors
    /// have neither.
    fn record_surface(
        &mut self,
        pass: &CameraPass,
        states: &PathStates,
        lane: usize,
        position: Vec3,
        surface: Option<[Vec3; 2]>,
    ) {
        let history = states.history[lane];
        let aov = &mut self.aovs[states.path[lane] as usize];
        aov.vertex = history.diffuse() + 1;
        if history.diffuse() == 0 {
            aov.passed = history.passed();
            aov.set_first_hit(pass, history, position);
            if let Some([albedo, normal]) = surface {
                let tint = states.weight.get(lane) * states.inverse_start[lane];
                aov.set_surface(tint * albedo, normal);
            }
        }
    }

    /// Records that lights are connected on the way to the next vertex.
    pub(super) fn record_segment(&mut self, state: &PathState) {
        self.aovs[state.path as usize].vertex = state.history.diffuse() + 1;
    }

    /// Records a point in a medium, before the path scatters.
    pub(super) fn record_medium(&mut self, pass: &CameraPass, state: &PathState, position: Vec3) {
        let aov = &mut self.aovs[state.path as usize];
        aov.vertex = state.history.diffuse() + 1;
        if state.history.diffuse() == 0 {
            aov.passed = state.history.passed();
            aov.set_first_hit(pass, state.history, position);
        }
    }

    /// Adds a light source that a path of this history hit.
    #[inline(never)] // rare
    pub(super) fn record_hit(&mut self, path: u32, history: History, light: Rgb) {
        let aov = &mut self.aovs[path as usize];
        match history.diffuse() {
            0 if aov.is_after_rough => aov.direct += light,
            0 => aov.emission += light,
            1 if aov.passed == history.passed() => aov.direct += light,
            1 => aov.caustics += light,
            _ => {}
        }
    }

    /// Records that a path takes a rough lobe before any diffuse vertex.
    pub(super) fn record_rough(&mut self, path: u32) {
        self.aovs[path as usize].is_after_rough = true;
    }
}

impl PathAov {
    /// Adds light that is connected at the current vertex.
    pub(super) fn add_connection(&mut self, light: Rgb, is_caustic: bool) {
        if is_caustic {
            self.caustics += light;
        } else if self.vertex == 1 {
            self.direct += light;
        }
    }

    fn set_first_hit(&mut self, pass: &CameraPass, history: History, position: Vec3) {
        if history.is_start() {
            let camera = &pass.scene.camera;
            self.position = position;
            let across = position - camera.position();
            self.depth = match camera.optics() {
                Optics::Panorama | Optics::Fisheye { .. } => across.length(),
                _ => across.dot(camera.direction()),
            };
            self.hits = true;
        }
    }

    fn set_surface(&mut self, albedo: Rgb, normal: Vec3) {
        if !self.has_surface {
            (self.albedo, self.normal, self.has_surface) = (albedo, normal, true);
        }
    }
}
