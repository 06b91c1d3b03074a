//! Camera paths that leave the scene, or hit surfaces that are not only diffuse: one at a time.

use super::meter::{at_pane, pane_before_meter};
use super::{CameraPass, CameraPaths, Connections};
use crate::accel::Ray;
use crate::base::math::Rgb;
use crate::scene::bsdf::{Lobe, LobeSet, Transport, Vertex};
use crate::scene::{LightSample, Scene, Surface};
use crate::simd::{LANES, Vec3s, lanes_of};
use crate::transport::gather::{GatherPoint, GatherView};
use crate::transport::light_paths::survival;
use crate::transport::path_state::{PathState, PathStates};
use glam::Vec3;

/// A vertex of a camera path.
pub(super) struct PathVertex<'a> {
    pub surface: &'a Surface<'a>,
    /// Shading normal and direction toward the camera.
    pub at: &'a Vertex,
    /// State of the path as it arrives.
    pub state: &'a PathState,
}

impl CameraPaths {
    /// Adds environment radiance to the paths that left the scene.
    #[inline(never)] // keeps the loop over Lambertian vertices short
    pub(super) fn add_environment(&mut self, pass: &CameraPass, states: &PathStates, missed: u32) {
        let lights = pass.scene.lights();
        for lane in lanes_of(missed) {
            let (path, history) = (states.path[lane], states.history[lane]);
            if !self.counts_environment(pass, history) {
                continue;
            }
            let direction = states.direction.get(lane);
            let radiance = self.environment_hit(lights, path, history.diffuse(), direction);
            self.add_hit(path, history, states.weight.get(lane) * radiance);
        }
    }

    /// Handles a hit of a surface that is not only diffuse. Returns the next segment unless the
    /// path ends.
    pub(super) fn scatter_other(
        &mut self,
        pass: &CameraPass,
        surface: &Surface,
        mut state: PathState,
    ) -> Option<(Ray, PathState)> {
        let diffuse = state.history.diffuse();
        if self.counts_hit(pass, state.history) {
            let mut emission = surface.emission();
            if emission != Rgb::ZERO {
                let segment = [surface.position, -surface.wo];
                emission *=
                    self.emission_weight(pass.scene, state.path, diffuse, surface.facet, segment);
                self.add_hit(state.path, state.history, state.weight * emission);
            }
        }
        let vertex = state.history.diffuse() + 1;
        let at = surface.vertex(Transport::Radiance);
        if self.records_aovs {
            self.record_other(pass, surface, &state, at.normal);
        }
        if let Some(pane) = pane_before_meter(pass, surface, &state) {
            return at_pane(&pane, surface, state);
        }
        let merges = self.at_other_vertex(pass, surface, &mut state);
        // A path that is cut here still takes lobes that pass through.
        let cut = merges && !pass.goes_on_from(vertex);
        let wanted = if cut { LobeSet::PassThrough } else { LobeSet::All };
        let sample = surface.bsdf.sample(&at, Transport::Radiance, wanted, &mut state.rng)?;
        if !surface.agrees(&at, sample.wi) {
            return None;
        }
        self.update_partial(&PathVertex { surface, at: &at, state: &state }, &sample);
        if self.records_aovs && sample.lobe == Lobe::Rough && state.history.diffuse() == 0 {
            self.record_rough(state.path);
        }
        // theory.md (41)
        state.weight *= sample.weight;
        state.history = state.history.leaving(pass.scene, surface, sample.wi);
        if sample.lobe.passes_through() {
            let ray = Ray::new(surface.start(sample.wi), sample.wi);
            return survives_passing(&mut state).then_some((ray, state));
        }
        state.history = state.history.scattered();
        if vertex > 1 && self.mis.is_some() {
            let survival = survival(sample.weight);
            if state.rng.next_1d() >= survival {
                return None;
            }
            state.weight /= survival;
        }
        Some((Ray::new(surface.off_surface, sample.wi), state))
    }

    /// Connects and gathers at a surface that is not only diffuse. Returns whether photons are
    /// merged there.
    fn at_other_vertex(
        &mut self,
        pass: &CameraPass,
        surface: &Surface,
        state: &mut PathState,
    ) -> bool {
        let lights = pass.scene.lights();
        let bsdf = &surface.bsdf;
        let merges = bsdf.merges();
        let at = surface.vertex(Transport::Radiance);
        if merges && pass.connects() {
            let light = lights.connect(surface.receiver(), &mut state.rng);
            let vertex = PathVertex { surface, at: &at, state };
            self.connect_lobe(pass.scene, &vertex, Lobe::Diffuse, light);
        }
        if bsdf.has_rough() && (state.history.diffuse() == 0 || self.mis.is_some()) {
            // Delta lights cannot be hit. With MIS, connections share the other lights with hits.
            // Without, photons contribute these paths after a diffuse vertex.
            let light = if self.mis.is_some() {
                lights.connect(surface.receiver(), &mut state.rng)
            } else {
                lights.connect_delta(surface.receiver(), &mut state.rng)
            };
            let vertex = PathVertex { surface, at: &at, state };
            self.connect_lobe(pass.scene, &vertex, Lobe::Rough, light);
        }
        if merges && pass.gathers_at(state.history.diffuse() + 1) {
            self.views.push(GatherView { bsdf: *bsdf, at, interpolated: surface.interpolated });
            let view = self.views.len() as u32 - 1;
            self.gather(surface, state, view);
        }
        merges
    }

    /// Connects the lobes of one class with a light source, if one was sampled.
    fn connect_lobe(
        &mut self,
        scene: &Scene,
        vertex: &PathVertex,
        lobe: Lobe,
        light: Option<LightSample>,
    ) {
        let PathVertex { surface, at, state } = *vertex;
        if let Some(light) = light
            && surface.agrees(at, light.wi)
        {
            let value = surface.bsdf.eval_lobe(lobe, at, light.wi);
            let cos_theta = light.wi.dot(at.normal).abs();
            // theory.md (42), third and fourth line
            let mut contribution = state.weight * value * light.irradiance * cos_theta;
            if self.mis.is_some() {
                contribution *= self.connection_weight(scene.lights(), vertex, lobe, &light);
            }
            let start = surface.start(light.wi);
            let is_caustic = lobe == Lobe::Rough && state.history.diffuse() == 1;
            let mark = if is_caustic { Connections::CAUSTIC } else { 0 };
            let media = state.history.leaving(scene, surface, light.wi).media();
            let path = Connections::path_in(state.path, media) | mark;
            self.queue_shadow_ray(path, contribution, light.target, start);
        }
    }

    /// Stores a gather point with the BSDF in one of `views`.
    fn gather(&mut self, surface: &Surface, state: &PathState, view: u32) {
        let Surface { position, facet, normal, .. } = *surface;
        let PathState { path, weight, history, .. } = *state;
        let (vertex, wavelength) = (history.diffuse() + 1, history.wavelength());
        self.gather_points.push(&GatherPoint {
            position,
            path,
            weight,
            vertex,
            wavelength,
            normal,
            facet,
            view,
        });
        if self.mis.is_some() {
            self.gather_points.set_earlier_merges(self.arriving_merges(path));
        }
    }

    /// Queues one shadow ray as [`Self::queue_shadow_rays`] does.
    pub(super) fn queue_shadow_ray(
        &mut self,
        path: u32,
        contribution: Rgb,
        target: Vec3,
        off_surface: Vec3,
    ) {
        self.shadow_rays.push(&Connections {
            origin: Vec3s::splat(target),
            direction: Vec3s::splat(off_surface - target),
            path: [path; LANES],
            contribution: Vec3s::splat(contribution),
        });
    }
}

/// Share of the initial weight below which paths that pass through a vertex may end: theory.md
/// (44).
pub(super) const WEIGHT_FLOOR: f32 = 1.0 / 16.0;

/// Number of vertices passed through from which on a path ends with the probability
/// [`LONG_CHAIN_END`] at each of them: mirrors may trap light.
const LONG_CHAIN: u32 = 16;
const LONG_CHAIN_END: f32 = 0.1;

/// Plays roulette where a path passes through a vertex, and returns whether it survives.
pub(in crate::transport) fn survives_passing(state: &mut PathState) -> bool {
    state.history = state.history.passed_through();
    // Channels of a path with a wavelength may be negative.
    let share = state.weight.abs().max_element() * state.inverse_start;
    // theory.md (44)
    let mut survival = (share / WEIGHT_FLOOR).min(1.0);
    if state.history.passed() >= LONG_CHAIN {
        survival = survival.min(1.0 - LONG_CHAIN_END);
    }
    if survival < 1.0 {
        if state.rng.next_1d() >= survival {
            return false;
        }
        state.weight /= survival;
    }
    true
}
