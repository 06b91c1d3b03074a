//! Camera paths that leave the scene, or hit surfaces that are not only diffuse: one at a time.

use super::{CameraPass, CameraPaths, Connections};
use crate::accel::Ray;
use crate::base::math::Rgb;
use crate::scene::bsdf::{Lobe, Transport, Vertex, Wanted};
use crate::scene::{LightSample, Lights, Surface};
use crate::settings::Direct;
use crate::simd::{LANES, Vec3s, lanes_of};
use crate::transport::gather::{GatherPoint, GatherView};
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
    /// Adds environment radiance to the paths that left the scene before their first diffuse vertex. Connections and
    /// photons contribute the environment that paths hit later.
    #[inline(never)] // keeps the loop over Lambertian vertices short
    pub(super) fn add_environment(&mut self, pass: &CameraPass, states: &PathStates, missed: u32) {
        for lane in lanes_of(missed).filter(|&lane| states.depth[lane].diffuse() == 0) {
            let direction = states.direction.get(lane);
            let mut radiance = pass.scene.lights().beyond(direction);
            if self.mis.is_some() {
                radiance *= self.environment_weight(pass.scene, states.path[lane], direction);
            }
            // theory.md (42), second line
            let seen = states.weight.get(lane) * radiance;
            self.direct[states.path[lane] as usize] += seen;
            if self.records_aovs {
                self.record_emission(states.path[lane], seen);
            }
        }
    }

    /// Handles a hit of a surface that is not only diffuse. Returns the next segment unless the path ends.
    pub(super) fn scatter_other(
        &mut self,
        pass: &CameraPass,
        surface: &Surface,
        mut state: PathState,
    ) -> Option<(Ray, PathState)> {
        // Connections and photons contribute the emission that is hit later.
        if state.depth.diffuse() == 0 && surface.front {
            // theory.md (42), first line
            let mut emission = surface.emission();
            if self.mis.is_some() && emission != Rgb::ZERO {
                let Surface { facet, position, .. } = *surface;
                emission *= self.emission_weight(pass.scene, state.path, facet, position);
            }
            self.direct[state.path as usize] += state.weight * emission;
            if self.records_aovs {
                self.record_emission(state.path, state.weight * emission);
            }
        }
        let vertex = state.depth.diffuse() + 1;
        let at = surface.vertex(Transport::Radiance);
        if self.records_aovs {
            self.record_other(pass, surface, &state, at.normal);
        }
        let merges = self.at_other_vertex(pass, surface, &mut state);
        // A path that is cut here still takes lobes that pass through.
        let cut = merges && vertex == pass.settings.merge_vertex;
        let wanted = if cut { Wanted::PassThrough } else { Wanted::All };
        let sample = surface.bsdf.sample(&at, Transport::Radiance, wanted, &mut state.rng)?;
        if !surface.agrees(&at, sample.wi) {
            return None;
        }
        self.update_partial(&PathVertex { surface, at: &at, state: &state }, &sample);
        if self.records_aovs && sample.lobe == Lobe::Rough && state.depth.diffuse() == 0 {
            self.record_rough(state.path);
        }
        // theory.md (41)
        state.weight *= sample.weight;
        if sample.lobe.passes_through() {
            let ray = Ray::new(surface.start(sample.wi), sample.wi);
            return survives_passing(&mut state).then_some((ray, state));
        }
        state.depth = state.depth.scattered();
        Some((Ray::new(surface.off_surface, sample.wi), state))
    }

    /// Connects and gathers at a surface that is not only diffuse. Returns whether photons are merged there.
    fn at_other_vertex(
        &mut self,
        pass: &CameraPass,
        surface: &Surface,
        state: &mut PathState,
    ) -> bool {
        let lights = pass.scene.lights();
        let bsdf = &surface.bsdf;
        let merges = bsdf.merges();
        let lit_side = surface.lit_side();
        let at = surface.vertex(Transport::Radiance);
        if merges && pass.settings.direct == Direct::Connect {
            let light = lights.connect(surface.position, lit_side, &mut state.rng);
            let vertex = PathVertex { surface, at: &at, state };
            self.connect_lobe(lights, &vertex, Lobe::Diffuse, light);
        }
        if bsdf.has_rough() && state.depth.diffuse() == 0 {
            // Delta lights cannot be hit. With MIS, connections share the other lights with hits. After a diffuse vertex,
            // photons contribute these paths.
            let light = if self.mis.is_some() {
                lights.connect(surface.position, lit_side, &mut state.rng)
            } else {
                lights.connect_delta(surface.position, lit_side, &mut state.rng)
            };
            let vertex = PathVertex { surface, at: &at, state };
            self.connect_lobe(lights, &vertex, Lobe::Rough, light);
        }
        if merges {
            self.views.push(GatherView { bsdf: *bsdf, at, interpolated: surface.interpolated });
            let view = self.views.len() as u32 - 1;
            self.gather(pass, surface, state, view);
        }
        merges
    }

    /// Connects the lobes of one class with a light source, if one was sampled.
    fn connect_lobe(
        &mut self,
        lights: &Lights,
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
                contribution *= self.connection_weight(lights, vertex, lobe, &light);
            }
            let start = surface.start(light.wi);
            self.queue_shadow_ray(state.path, contribution, light.target, start);
        }
    }

    /// Stores a gather point with the BSDF in one of `views`.
    fn gather(&mut self, pass: &CameraPass, surface: &Surface, state: &PathState, view: u32) {
        let vertex = state.depth.diffuse() + 1;
        if vertex < pass.settings.merge_vertex && !pass.gather_early {
            return;
        }
        let Surface { position, facet, normal, .. } = *surface;
        let (path, weight) = (state.path, state.weight);
        let point = GatherPoint { position, path, weight, vertex, normal, facet, view };
        self.gather_points.push(&point);
        if self.mis.is_some() {
            self.gather_points.set_mis_partial(self.mis_partials[path as usize]);
        }
    }

    /// Queues one shadow ray as [`Self::queue_shadow_rays`] does.
    fn queue_shadow_ray(&mut self, path: u32, contribution: Rgb, target: Vec3, off_surface: Vec3) {
        self.shadow_rays.push(&Connections {
            origin: Vec3s::splat(target),
            direction: Vec3s::splat(off_surface - target),
            path: [path; LANES],
            contribution: Vec3s::splat(contribution),
        });
    }
}

/// Share of the initial weight below which paths that pass through a vertex may end: theory.md (44).
const WEIGHT_FLOOR: f32 = 1.0 / 16.0;

/// Number of vertices passed through from which on a path ends with the probability [`LONG_CHAIN_END`] at each of
/// them: mirrors may trap light.
const LONG_CHAIN: u32 = 16;
const LONG_CHAIN_END: f32 = 0.1;

/// Plays roulette where a path passes through a vertex, and returns whether it survives.
fn survives_passing(state: &mut PathState) -> bool {
    state.depth = state.depth.passed_through();
    let share = state.weight.max_element() * state.inverse_start;
    // theory.md (44)
    let mut survival = (share / WEIGHT_FLOOR).min(1.0);
    if state.depth.passed() >= LONG_CHAIN {
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
