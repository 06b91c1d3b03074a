//! Paths on their way through media to the surfaces that they hit.

use super::path_state::{History, PathState, PathStates};
use crate::accel::{Hit, HitPacket, Ray};
use crate::base::math::Rgb;
use crate::scene::{Flight, Media, Medium, Scene, Surface};
use crate::simd::LANES;
use glam::Vec3;

/// A point where a medium scatters a path.
#[derive(Clone, Copy, Debug)]
pub struct MediumVertex<'a> {
    /// The medium.
    pub medium: &'a Medium,
    /// Length of the way, scene units.
    pub distance: f32,
    /// Position, scene units.
    pub position: Vec3,
    /// Unit direction along which the path arrives.
    pub direction: Vec3,
    /// Transmittance on the way over the density of the distance, scene units. It is the factor of
    /// a light path's flux in its photon there, and together with the scattering coefficient the
    /// factor of a path that goes on.
    pub weight: Rgb,
}

impl<'a> MediumVertex<'a> {
    /// The vertex at a distance along a ray.
    pub fn on(ray: &Ray, medium: &'a Medium, distance: f32, weight: Rgb) -> Self {
        let (position, direction) = (ray.origin + distance * ray.direction, ray.direction);
        Self { medium, distance, position, direction, weight }
    }

    /// Factor of the weight of a path that goes on.
    pub fn factor(&self) -> Rgb {
        self.weight * self.medium.scattering
    }
}

/// Where a path is when it meets no surface that scatters.
pub(super) enum Passed<'a> {
    /// It goes on beyond a boundary of media.
    Boundary(Ray),
    /// A medium scatters it.
    Scattered(MediumVertex<'a>),
}

/// Takes a path through the medium around it. Returns `None` if it arrives at a surface that
/// scatters, or leaves the scene: its weight then includes the transmittance. theory.md (37c),
/// (37d)
#[inline(never)] // media are rare
pub(super) fn travel<'a>(
    scene: &Scene,
    media: &'a Media,
    ray: &Ray,
    hit: &Hit,
    state: &mut PathState,
) -> Option<Passed<'a>> {
    let within = state.history.media();
    if let Some(medium) = media.medium(within) {
        match medium.travel(hit.t, state.weight, &mut state.rng) {
            Flight::Arrives { weight } => state.weight *= weight,
            Flight::Scatters { distance, weight } => {
                return Some(Passed::Scattered(MediumVertex::on(ray, medium, distance, weight)));
            }
        }
    }
    cross(scene, media, ray, hit, state)
}

/// Takes a path that has reached the end of a segment through a boundary of media, if it ends at
/// one.
pub(super) fn cross<'a>(
    scene: &Scene,
    media: &Media,
    ray: &Ray,
    hit: &Hit,
    state: &mut PathState,
) -> Option<Passed<'a>> {
    let within = state.history.media();
    media.is_index_matched(hit.mesh).then(|| {
        let surface = scene.surface(ray, hit);
        state.history = state.history.within(media.cross(within, hit.mesh, surface.front));
        Passed::Boundary(Ray::new(surface.start(ray.direction), ray.direction))
    })
}

/// Takes each of the first `count` paths through media by `arrives`, which tests whether it arrives
/// at its hit. The hits of the others become misses; returns their bits.
pub(super) fn travel_all(
    states: &mut PathStates,
    hits: &mut HitPacket,
    count: usize,
    mut arrives: impl FnMut(&Ray, &Hit, &mut PathState) -> bool,
) -> u32 {
    let mut gone = 0;
    for lane in 0..count.min(LANES) {
        let (ray, mut state) = states.get(lane);
        let arrives = arrives(&ray, &hits.get(lane), &mut state);
        states.set(lane, &ray, &state);
        if !arrives {
            gone |= 1 << lane;
            hits.set(lane, &Hit::MISS);
        }
    }
    gone
}

impl History {
    /// The media around a path that leaves a surface along `direction`.
    #[inline]
    #[must_use]
    pub fn leaving(self, scene: &Scene, surface: &Surface, direction: Vec3) -> Self {
        match scene.media() {
            None => self,
            Some(media) => self.within(media.after(self.media(), surface, direction)),
        }
    }
}
