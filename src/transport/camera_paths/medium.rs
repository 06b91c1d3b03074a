//! Vertices of camera paths in media.

use super::mis::LastVertex;
use super::{CameraPass, CameraPaths, Connections};
use crate::accel::{HitPacket, Ray};
use crate::base::math::Rgb;
use crate::base::spectrum::Wavelength;
use crate::scene::{Media, Receiver};
use crate::transport::free_flight::{MediumVertex, Passed, travel, travel_all};
use crate::transport::light_paths::survival;
use crate::transport::path_state::{PathState, PathStates};
use crate::transport::room::Room;
use glam::Vec3;

/// A vertex of a camera path in a medium, at which photons are merged.
#[derive(Clone, Copy, Debug)]
pub struct MediumPoint {
    /// Position, scene units.
    pub position: Vec3,
    /// Index of its camera path among those that are merged together.
    pub path: u32,
    /// Throughput of the path with the scattering coefficient: the factor of a photon's flux per volume of the merge
    /// kernel, times the phase function.
    pub weight: Rgb,
    /// Number of the diffuse vertex, as of [`GatherPoint`](crate::transport::gather::GatherPoint).
    pub vertex: u32,
    /// Unit direction along which the camera path arrives.
    pub direction: Vec3,
    /// Asymmetry parameter of the medium's phase function.
    pub asymmetry: f32,
    /// Wavelength of the path; `None` for all wavelengths.
    pub wavelength: Option<Wavelength>,
    /// Surfaces that cut the ball of the kernel.
    pub room: Room,
}

impl CameraPaths {
    /// Takes the first `count` paths through the media around them. Those that do not arrive at a surface that scatters
    /// go on, and their hits become misses; returns their bits.
    #[inline(never)] // media are rare
    pub(super) fn travel(
        &mut self,
        pass: &CameraPass,
        media: &Media,
        states: &mut PathStates,
        hits: &mut HitPacket,
        count: usize,
    ) -> u32 {
        travel_all(states, hits, count, |ray, hit, state| {
            let medium = media.medium(state.history.media());
            let angles =
                medium.and_then(|medium| self.connect_along(pass, medium, (ray, hit.t), state));
            let before = state.weight;
            let passed = travel(pass.scene, media, ray, hit, state);
            let share = |vertex: &MediumVertex| {
                // theory.md (37l): the technique that draws distances of flights
                angles.map_or(1.0, |angles| {
                    let flight = vertex.medium.flight_density(vertex.distance, before);
                    flight / (flight + angles.density(vertex.distance))
                })
            };
            passed.map(|passed| self.pass(pass, *state, passed, share)).is_none()
        })
    }

    /// Continues a path that met no surface that scatters. `share` is the weight of connections from a vertex.
    fn pass(
        &mut self,
        pass: &CameraPass,
        state: PathState,
        passed: Passed,
        share: impl Fn(&MediumVertex) -> f32,
    ) {
        match passed {
            Passed::Boundary(ray) => self.next.push_state(&ray, &state),
            Passed::Scattered(vertex) => {
                let share = share(&vertex);
                if let Some((ray, state)) = self.scatter_in_medium(pass, &vertex, share, state) {
                    self.next.push_state(&ray, &state);
                }
            }
        }
    }

    /// Connects and gathers where a medium scatters a path. Returns the next segment unless the path ends.
    fn scatter_in_medium(
        &mut self,
        pass: &CameraPass,
        vertex: &MediumVertex,
        share: f32,
        mut state: PathState,
    ) -> Option<(Ray, PathState)> {
        let MediumVertex { medium, position, direction, weight, .. } = *vertex;
        let scattered = weight * medium.scattering;
        state.weight *= scattered;
        let number = state.history.diffuse() + 1;
        if self.records_aovs {
            self.record_medium(pass, &state, position);
        }
        let lights = pass.scene.lights();
        let receiver = Receiver { position, normal: None };
        if pass.connects()
            && let Some(light) = lights.connect(receiver, &mut state.rng)
        {
            let phase = medium.phase(direction, light.wi);
            // theory.md (37h)
            let mut contribution = state.weight * light.irradiance * (phase * share);
            if let Some(mis) = &self.mis {
                // Connections and hits of light sources sample the same paths.
                contribution *=
                    mis.balance.connection_weight(0.0, 0.0, phase * light.inverse_pdf_w);
            }
            let path = Connections::path_in(state.path, state.history.media());
            self.queue_shadow_ray(path, contribution, light.target, position);
        }
        if pass.gathers_at(number) {
            let (path, weight, asymmetry) = (state.path, state.weight, medium.asymmetry);
            let (vertex, wavelength) = (number, state.history.wavelength());
            let radius = pass.settings.reach() * pass.settings.medium_scale as f32;
            let room = Room::around(pass.scene, pass.accel, position, radius);
            self.medium_points.push(MediumPoint {
                position,
                path,
                weight,
                vertex,
                direction,
                asymmetry,
                wavelength,
                room,
            });
        }
        if !pass.goes_on_from(number) {
            return None;
        }
        state.history = state.history.scattered();
        if number > 1 && self.mis.is_some() {
            let survival = survival(scattered);
            if state.rng.next_1d() >= survival {
                return None;
            }
            state.weight /= survival;
        }
        let next = medium.scatter(direction, &mut state.rng);
        if self.mis.is_some() {
            let density = medium.phase(direction, next);
            self.last_vertices[state.path as usize] =
                LastVertex::in_medium(receiver, next, density);
        }
        Some((Ray::new(position, next), state))
    }
}
