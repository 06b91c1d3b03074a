//! Camera paths that leave the scene, or hit surfaces that are not only diffuse: one at a time.

use super::meter::pane_before_meter;
use super::role::CameraRole;
use super::{CameraPass, CameraPaths, Connections};
use crate::accel::HitPacket;
use crate::base::math::Rgb;
use crate::base::rng::Rng;
use crate::scene::bsdf::{Lobe, LobeValue, Transport};
use crate::scene::diffuse::DiffuseVertices;
use crate::scene::{LightSample, Receiver, Scene, Surface};
use crate::simd::draw::{KNOWN, OneKnownFirst};
use crate::simd::{LANES, lanes_of};
use crate::transport::path_state::{PathState, PathStates, other_surface};
use crate::transport::step::{PathVertex, Segment, step_at_pane, step_at_surface};
use crate::transport::suffix_cache::CellLight;

/// A camera path at a surface that is not only diffuse.
pub(super) struct ScalarVertex<'a> {
    pub surface: Surface<'a>,
    pub state: PathState,
    /// Length of the segment to it, scene units.
    pub distance: f32,
    /// Light that a cache knows for the lobes that merge. Their paths end.
    pub cached: Option<CellLight>,
}

/// The lobes that connect with one light source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Connected {
    diffuse: bool,
    rough: bool,
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

    /// Handles the hits of `lanes`. Surfaces that are Lambertian there set their lane of `at`. At
    /// the others, paths connect, gather and continue: first all of one kind of work, so that they
    /// wait for memory together.
    #[inline(never)] // keeps the loop over Lambertian vertices short
    pub(super) fn scatter_others<'a>(
        &mut self,
        pass: &CameraPass<'a>,
        states: &PathStates,
        hits: &HitPacket,
        lanes: u32,
        at: &mut DiffuseVertices,
        others: &mut Vec<ScalarVertex<'a>>,
    ) {
        others.clear();
        pass.scene.read_ahead(hits, lanes);
        for lane in lanes_of(lanes) {
            let ((ray, mut state), hit) = (states.get(lane), hits.get(lane));
            if let Some(surface) = other_surface(pass.scene, &ray, &hit, at, lane, &mut state) {
                let distance = (surface.position - ray.origin).length();
                let mut other = ScalarVertex { surface, state, distance, cached: None };
                other.cached = pass.cached_light(&other);
                others.push(other);
            }
        }
        self.connect_others(pass, others);
        for other in others {
            if let Some((ray, state)) = self.scatter_other(pass, other) {
                self.next.push_state(&ray, &state);
            }
        }
    }

    /// Handles a hit of a surface that is not only diffuse, but for its connections. Returns the
    /// next segment unless the path ends.
    fn scatter_other(&mut self, pass: &CameraPass, other: &ScalarVertex) -> Option<Segment> {
        let ScalarVertex { surface, state, .. } = other;
        let state = *state;
        let diffuse = state.history.diffuse();
        if self.counts_surface(pass, state.path, state.history) {
            let mut emission = surface.emission();
            if emission != Rgb::ZERO {
                let segment = [surface.position, -surface.wo];
                emission *=
                    self.emission_weight(pass.scene, state.path, diffuse, surface.facet, segment);
                self.add_hit(state.path, state.history, state.weight * emission);
            }
        }
        let at = surface.vertex(Transport::Radiance);
        if self.records_aovs {
            self.record_other(pass, surface, &state, at.normal);
        }
        if let Some(pane) = pane_before_meter(pass, surface, &state) {
            return step_at_pane(&pane, surface, state);
        }
        let mut role = CameraRole::at_surface(self, pass, other);
        step_at_surface(&mut role, pass.scene, surface, &at, state)
    }

    /// Connects all vertices. Both lobes of a vertex share a light source, and most of them a
    /// shadow ray: sums of both are unbiased, too, and half as much work.
    fn connect_others(&mut self, pass: &CameraPass, others: &mut [ScalarVertex]) {
        let mut receivers = [Receiver::default(); LANES];
        let mut rngs = [Rng::default(); LANES];
        let mut lobes = [(0, Connected::default()); LANES];
        let mut count = 0;
        for (number, ScalarVertex { surface, state, cached, .. }) in others.iter().enumerate() {
            let diffuse = surface.bsdf.merges() && pass.connects() && cached.is_none();
            // Without MIS, photons contribute light of rough lobes after a diffuse vertex.
            let is_sampled = self.mis.is_some() || state.history.diffuse() == 0;
            let rough = surface.bsdf.has_rough() && is_sampled;
            debug_assert!(!rough || self.hit_weights.is_some(), "lights are hit as well");
            let connected = Connected { diffuse, rough };
            if connected != Connected::default() {
                receivers[count] = surface.receiver();
                rngs[count] = state.rng;
                lobes[count] = (number, connected);
                count += 1;
            }
        }
        let lights = pass.scene.lights();
        let mut samples = [None; LANES];
        if self.starts_from_points() {
            let mut known = [OneKnownFirst::new(Rng::default(), [0; KNOWN]); LANES];
            for (known, &(number, _)) in known.iter_mut().zip(&lobes[..count]) {
                *known = self.one_light(&others[number].state);
            }
            lights.connect_each(&receivers[..count], &mut known[..count], &mut samples[..count]);
            for (rng, known) in rngs.iter_mut().zip(known) {
                *rng = known.rng;
            }
        } else {
            lights.connect_each(&receivers[..count], &mut rngs[..count], &mut samples[..count]);
        }
        for (i, &(number, connected)) in lobes[..count].iter().enumerate() {
            let ScalarVertex { surface, state, .. } = &mut others[number];
            state.rng = rngs[i];
            self.connect_lobes(pass.scene, surface, state, connected, samples[i]);
        }
    }

    /// Connects these lobes with a light source, if one was sampled.
    fn connect_lobes(
        &mut self,
        scene: &Scene,
        surface: &Surface,
        state: &PathState,
        connected: Connected,
        light: Option<LightSample>,
    ) {
        let at = surface.vertex(Transport::Radiance);
        let Some(light) = light else { return };
        if !surface.agrees(&at, light.wi) {
            return;
        }
        let vertex = PathVertex { surface, at: &at, state };
        let [diffuse, rough] = surface.bsdf.lobes(&at, light.wi);
        let of = |lobe: Lobe, values: &LobeValue, is_connected: bool| {
            if is_connected && values.value != Rgb::ZERO {
                self.connection(scene, &vertex, (lobe, values), &light)
            } else {
                Rgb::ZERO
            }
        };
        let mut sum = of(Lobe::Wide, &diffuse, connected.diffuse);
        let rough = of(Lobe::Rough, &rough, connected.rough);
        let start = surface.start(light.wi);
        let media = state.history.leaving(scene, surface, light.wi).media();
        let path = Connections::path_in(state.path, media);
        if state.history.diffuse() == 1 || self.suffixes.is_some() {
            // Apart from the other lobe: part of a caustic, and of no suffix.
            self.queue_shadow_ray(path | Connections::CAUSTIC, rough, light.target, start);
        } else {
            sum += rough;
        }
        self.queue_shadow_ray(path, sum, light.target, start);
    }

    /// The contribution of lobes of one class that are connected with a light source, if nothing
    /// blocks it. theory.md (42), third and fourth line
    fn connection(
        &self,
        scene: &Scene,
        vertex: &PathVertex,
        (lobe, values): (Lobe, &LobeValue),
        light: &LightSample,
    ) -> Rgb {
        let PathVertex { at, state, .. } = *vertex;
        let cos_theta = light.wi.dot(at.normal).abs();
        let contribution = state.weight * values.value * light.irradiance * cos_theta;
        contribution * self.connection_weight(scene.lights(), vertex, (lobe, values), light)
    }
}
