//! Vertices of camera paths in media.

use super::role::CameraRole;
use super::{CameraPass, CameraPaths, Connections};
use crate::accel::{HitPacket, Ray};
use crate::base::math::Rgb;
use crate::base::spectrum::Wavelength;
use crate::scene::{Flight, Media, Medium, Receiver};
use crate::settings::MediumQuery;
use crate::transport::free_flight::{MediumVertex, Passed, cross, travel, travel_all};
use crate::transport::path_state::{PathState, PathStates};
use crate::transport::photon_tree::Segment;
use crate::transport::roulette::WEIGHT_FLOOR;
use crate::transport::step::step_in_medium;
use glam::Vec3;

/// A vertex of a camera path in a medium, at which photons are merged.
#[derive(Clone, Copy, Debug)]
pub struct MediumPoint {
    /// Position, scene units.
    pub position: Vec3,
    /// Index of its camera path among those that are merged together.
    pub path: u32,
    /// Throughput of the path with the scattering coefficient: the factor of a photon's flux per
    /// volume of the merge kernel, times the phase function.
    pub weight: Rgb,
    /// Number of the diffuse vertex, as of [`GatherPoint`](crate::transport::gather::GatherPoint).
    pub vertex: u32,
    /// Unit direction along which the camera path arrives.
    pub direction: Vec3,
    /// Asymmetry parameter of the medium's phase function.
    pub asymmetry: f32,
    /// Wavelength of the path; `None` for all wavelengths.
    pub wavelength: Option<Wavelength>,
}

/// A segment of a camera path in a medium, along which photons are merged: theory.md (37m).
#[derive(Clone, Copy, Debug)]
pub struct MediumBeam {
    /// The segment.
    pub segment: Segment,
    /// Index of its camera path among those that are merged together.
    pub path: u32,
    /// Throughput at the start with the scattering coefficient: the factor of a photon's flux per
    /// area of the merge kernel, times the transmittance to it and the phase function.
    pub weight: Rgb,
    /// Number of the diffuse vertex, as of [`GatherPoint`](crate::transport::gather::GatherPoint).
    pub vertex: u32,
    /// Extinction coefficient, 1/scene unit.
    pub extinction: Rgb,
    /// Asymmetry parameter of the medium's phase function.
    pub asymmetry: f32,
    /// Wavelength of the path; `None` for all wavelengths.
    pub wavelength: Option<Wavelength>,
}

impl CameraPass<'_> {
    /// Photons are merged along the segments that end at the diffuse vertex of this number or are
    /// scattered before.
    fn merges_along(&self, vertex: u32) -> bool {
        self.settings.medium_query == MediumQuery::Beams && self.gathers_at(vertex)
    }

    /// Paths that a medium scatters are sampled by one technique: merges and connections at the
    /// first vertex. theory.md (47p)
    pub(super) fn ends_in_media(&self) -> bool {
        self.settings.strategy.weighs_merges()
    }

    /// Weight of a merge in a medium; `None` if it is left out. theory.md (37o)
    fn merge_weight(&self, state: &PathState) -> Option<f32> {
        let share = self.settings.medium_share as f32;
        // A copy draws the number, so that the path is the same at each share.
        (share == 1.0 || state.rng.clone().next_1d() < share).then(|| share.recip())
    }
}

impl CameraPaths {
    /// Takes the first `count` paths through the media around them. Those that do not arrive at a
    /// surface that scatters go on, and their hits become misses; returns their bits.
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
            if let Some(medium) = medium.filter(|own| own.scatters())
                && pass.ends_in_media()
                && state.history.diffuse() > 0
            {
                // The first vertex merged with photons that the medium scattered.
                let arrives = attenuate(medium, hit.t, state);
                let passed = if arrives { cross(pass.scene, media, ray, hit, state) } else { None };
                let goes_on = arrives && passed.is_none();
                if let Some(Passed::Boundary(ray)) = passed {
                    self.next.push_state(&ray, state);
                }
                return goes_on;
            }
            let angles =
                medium.and_then(|medium| self.connect_along(pass, medium, (ray, hit.t), state));
            let before = state.weight;
            let share = |vertex: &MediumVertex| {
                // theory.md (37l): the technique that draws distances of flights
                angles.map_or(1.0, |angles| {
                    let flight = vertex.medium.flight_density(vertex.distance, before);
                    flight / (flight + angles.density(vertex.distance))
                })
            };
            let vertex = state.history.diffuse() + 1;
            let passed = match medium.filter(|own| own.scatters() && pass.merges_along(vertex)) {
                None => travel(pass.scene, media, ray, hit, state),
                Some(medium) => {
                    self.merge_along(pass, medium, (ray, hit.t), state);
                    if pass.goes_on_from(vertex) && !pass.ends_in_media() {
                        travel(pass.scene, media, ray, hit, state)
                    } else if self.end_in_medium(pass, medium, (ray, hit.t), share, state) {
                        cross(pass.scene, media, ray, hit, state)
                    } else {
                        return false;
                    }
                }
            };
            passed.map(|passed| self.pass(pass, *state, passed, share)).is_none()
        })
    }

    /// Stores the segment of a ray to this distance, along which photons are merged.
    fn merge_along(
        &mut self,
        pass: &CameraPass,
        medium: &Medium,
        (ray, length): (&Ray, f32),
        state: &PathState,
    ) {
        let Some(weight) = pass.merge_weight(state) else { return };
        self.beams.push(MediumBeam {
            segment: Segment { origin: ray.origin, direction: ray.direction, length },
            path: state.path,
            weight: state.weight * medium.scattering * weight,
            vertex: state.history.diffuse() + 1,
            extinction: medium.extinction(),
            asymmetry: medium.asymmetry,
            wavelength: state.history.wavelength(),
        });
    }

    /// Connects a vertex on a segment whose merges end the paths that scatter there, and takes the
    /// path to the end of the segment. Returns whether it survives.
    fn end_in_medium(
        &mut self,
        pass: &CameraPass,
        medium: &Medium,
        (ray, length): (&Ray, f32),
        share: impl Fn(&MediumVertex) -> f32,
        state: &mut PathState,
    ) -> bool {
        if pass.connects()
            && let Flight::Scatters { distance, weight } =
                medium.travel(length, state.weight, &mut state.rng)
        {
            let vertex = &MediumVertex::on(ray, medium, distance, weight);
            let scattered = state.weight * weight * medium.scattering;
            let mut path = PathState { weight: scattered, ..*state };
            self.connect_in_medium(pass, vertex, share(vertex), &mut path);
            state.rng = path.rng;
        }
        if self.records_aovs {
            self.record_segment(state);
        }
        attenuate(medium, length, state)
    }

    /// Continues a path that met no surface that scatters. `share` is the weight of connections
    /// from a vertex.
    fn pass(
        &mut self,
        pass: &CameraPass,
        state: PathState,
        passed: Passed,
        share: impl Fn(&MediumVertex) -> f32,
    ) {
        let gone_on = match passed {
            Passed::Boundary(ray) => Some((ray, state)),
            Passed::Scattered(vertex) => {
                let mut role = CameraRole::in_medium(self, pass, share(&vertex));
                step_in_medium(&mut role, &vertex, state)
            }
        };
        if let Some((ray, state)) = gone_on {
            self.next.push_state(&ray, &state);
        }
    }

    /// Stores a point at which photons are merged, if any are at this vertex. The path's weight
    /// includes the scattering coefficient.
    pub(super) fn merge_in_medium(
        &mut self,
        pass: &CameraPass,
        vertex: &MediumVertex,
        state: &PathState,
    ) {
        let number = state.history.diffuse() + 1;
        if !pass.gathers_at(number) || pass.merges_along(number) {
            return;
        }
        let Some(factor) = pass.merge_weight(state) else { return };
        self.medium_points.push(MediumPoint {
            position: vertex.position,
            path: state.path,
            weight: state.weight * factor,
            vertex: number,
            direction: vertex.direction,
            asymmetry: vertex.medium.asymmetry,
            wavelength: state.history.wavelength(),
        });
    }

    /// Connects a vertex with a light source. The path's weight includes the scattering
    /// coefficient, and `share` is the weight of the technique.
    pub(super) fn connect_in_medium(
        &mut self,
        pass: &CameraPass,
        vertex: &MediumVertex,
        share: f32,
        state: &mut PathState,
    ) {
        let MediumVertex { medium, position, direction, .. } = *vertex;
        let receiver = Receiver { position, normal: None };
        let Some(light) = pass.scene.lights().connect(receiver, &mut state.rng) else { return };
        let phase = medium.phase(direction, light.wi);
        // theory.md (37h)
        let mut contribution = state.weight * light.irradiance * (phase * share);
        contribution *= self.connection_weight_in_medium(phase * light.inverse_pdf_w);
        let path = Connections::path_in(state.path, state.history.media());
        self.queue_shadow_ray(path, contribution, light.target, position);
    }

    /// Weight of a connection in a medium. `hit` is the density of hitting the light source over
    /// that of the connection.
    pub(super) fn connection_weight_in_medium(&self, hit: f32) -> f32 {
        match &self.mis {
            // Connections and hits of light sources sample the same paths, unless they end.
            Some(mis) if !mis.balance.weighs_merges() => {
                mis.balance.connection_weight(0.0, 0.0, hit)
            }
            Some(_) | None => 1.0,
        }
    }
}

/// Takes a path to the end of a segment of this length in a medium, by the share of the light that
/// arrives there. Returns whether it survives.
fn attenuate(medium: &Medium, length: f32, state: &mut PathState) -> bool {
    // theory.md (37b), and (44): what is left of it may not be worth following.
    let left = medium.transmittance(length);
    let survival = (left.max_element() / WEIGHT_FLOOR).min(1.0);
    state.weight *= left / survival;
    survival > 0.0 && (survival == 1.0 || state.rng.next_1d() < survival)
}
