//! States of paths that are being traced, of either kind: sixteen side by side, or one.

use super::path_queue::{Columns, PathQueue};
use crate::accel::{Hit, Ray};
use crate::base::math::Rgb;
use crate::base::rng::Rng;
use crate::base::spectrum::Wavelength;
use crate::scene::diffuse::DiffuseVertices;
use crate::scene::{MediumState, Scene, Surface};
use crate::simd::{LANES, Rngs, Vec3s};
use bytemuck::{Pod, Zeroable};

/// States of sixteen paths.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C, align(64))]
pub(super) struct PathStates {
    /// Origins of the next rays.
    pub origin: Vec3s,
    /// Unit directions of the next rays.
    pub direction: Vec3s,
    pub rng: Rngs,
    /// Flux of light paths, W, or throughput of camera paths.
    pub weight: Vec3s,
    /// Reciprocals of the largest channel of the weight at the start, for camera paths.
    pub inverse_start: [f32; LANES],
    /// Numbers of the paths.
    pub path: [u32; LANES],
    /// Numbers of vertices so far, and wavelengths.
    pub history: [History; LANES],
}

impl Columns<16> for PathStates {
    const T_FAR: f32 = f32::INFINITY;
}

/// What a path has met so far, in one word. From the lowest bit:
///
/// | bits | content |
/// |---|---|
/// | 9 | number of vertices at which it scattered diffusely |
/// | 1 | a medium scattered it |
/// | 5 | number of vertices through which it passed, at most 31 |
/// | 1 | it went straight through a slab |
/// | 6 | the media around it, a [`MediumState`] |
/// | 10 | index of its wavelength, 0 for none |
///
/// Paths end by roulette long before 511 diffuse vertices, the most that are counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct History(u32);

impl History {
    /// Bits for the diffuse vertices.
    const DIFFUSE: u32 = (1 << 9) - 1;
    /// Set if a medium scattered the path.
    const IN_MEDIUM: u32 = 1 << 9;
    /// Start and largest number of the vertices that the path passed through.
    const PASSED_AT: u32 = 10;
    const PASSED: u32 = (1 << 5) - 1;
    /// Set if the path went straight through a slab between parallel faces.
    const SLAB: u32 = 1 << 15;
    /// Start of the media.
    const MEDIA_AT: u32 = 16;
    const MEDIA: u32 = MediumState::COUNT as u32 - 1;
    /// Start of the wavelength.
    const WAVELENGTH_AT: u32 = 22;
    /// Bits of both numbers and of the slab.
    const VERTICES: u32 = (1 << Self::MEDIA_AT) - 1;

    /// A path of this wavelength at its diffuse vertex of this number, at most 511.
    pub fn at_vertex(vertex: u32, wavelength: Option<Wavelength>) -> Self {
        Self(vertex.min(Self::DIFFUSE)).with_wavelength(wavelength)
    }

    /// Vertices at which the path scattered diffusely, in media or at surfaces.
    #[inline(always)] // part of vector loops, as the functions below
    pub fn diffuse(self) -> u32 {
        self.0 & Self::DIFFUSE
    }

    /// Vertices through which the path passed, at most 31.
    #[inline(always)]
    pub fn passed(self) -> u32 {
        self.0 >> Self::PASSED_AT & Self::PASSED
    }

    /// Adds a diffuse vertex.
    #[inline(always)]
    #[must_use]
    pub fn scattered(self) -> Self {
        Self(self.0 + u32::from(self.diffuse() < Self::DIFFUSE))
    }

    /// Adds a vertex in a medium.
    #[must_use]
    pub fn scattered_in_medium(self) -> Self {
        Self(self.scattered().0 | Self::IN_MEDIUM)
    }

    /// Returns true if a medium scattered the path.
    #[inline(always)]
    pub fn was_in_medium(self) -> bool {
        self.0 & Self::IN_MEDIUM != 0
    }

    /// Adds a vertex passed through.
    #[inline(always)]
    #[must_use]
    pub fn passed_through(self) -> Self {
        Self(self.0 + (u32::from(self.passed() < Self::PASSED) << Self::PASSED_AT))
    }

    /// Returns true if there is no vertex of either kind. Sheets that the path went straight
    /// through do not count.
    #[inline(always)]
    pub fn is_start(self) -> bool {
        self.0 & Self::VERTICES == 0
    }

    /// Returns true if the path has only gone straight through panes, or through nothing.
    #[inline(always)]
    pub fn is_straight(self) -> bool {
        self.0 & (Self::VERTICES & !Self::SLAB) == 0
    }

    /// Records that the path goes straight through a slab.
    #[must_use]
    pub fn through_slab(self) -> Self {
        Self(self.0 | Self::SLAB)
    }

    /// The media around the path.
    #[inline(always)]
    pub fn media(self) -> MediumState {
        MediumState((self.0 >> Self::MEDIA_AT & Self::MEDIA) as u8)
    }

    /// Replaces the media around the path.
    #[must_use]
    pub fn within(self, media: MediumState) -> Self {
        let others = self.0 & !(Self::MEDIA << Self::MEDIA_AT);
        Self(others | u32::from(media.0) << Self::MEDIA_AT)
    }

    /// Index of the wavelength; 0 for none.
    #[inline(always)]
    pub fn wavelength_index(self) -> u32 {
        self.0 >> Self::WAVELENGTH_AT
    }

    /// The wavelength; `None` for paths of all wavelengths.
    pub fn wavelength(self) -> Option<Wavelength> {
        Wavelength::from_index(self.wavelength_index())
    }

    /// Sets the wavelength.
    #[must_use]
    pub fn with_wavelength(self, wavelength: Option<Wavelength>) -> Self {
        let index = wavelength.map_or(0, Wavelength::index);
        let others = self.0 & ((1 << Self::WAVELENGTH_AT) - 1);
        Self(others | index << Self::WAVELENGTH_AT)
    }
}

/// State of one path without its ray.
#[derive(Clone, Copy, Debug)]
pub struct PathState {
    /// Its random numbers.
    pub rng: Rng,
    /// Flux of a light path, W, or throughput of a camera path.
    pub weight: Rgb,
    /// Reciprocal of the largest channel of the weight at the start.
    pub inverse_start: f32,
    /// Its number.
    pub path: u32,
    /// What it has met so far.
    pub history: History,
}

impl PathStates {
    pub fn get(&self, lane: usize) -> (Ray, PathState) {
        let ray = Ray::new(self.origin.get(lane), self.direction.get(lane));
        let state = PathState {
            rng: self.rng.get(lane),
            weight: self.weight.get(lane),
            inverse_start: self.inverse_start[lane],
            path: self.path[lane],
            history: self.history[lane],
        };
        (ray, state)
    }

    pub fn set(&mut self, lane: usize, ray: &Ray, state: &PathState) {
        self.origin.set(lane, ray.origin);
        self.direction.set(lane, ray.direction);
        self.rng.set(lane, state.rng);
        self.weight.set(lane, state.weight);
        self.inverse_start[lane] = state.inverse_start;
        self.path[lane] = state.path;
        self.history[lane] = state.history;
    }
}

impl PathQueue<PathStates, 16> {
    /// Adds one path.
    pub fn push_state(&mut self, ray: &Ray, state: &PathState) {
        let mut one = PathStates::default();
        one.set(0, ray, state);
        self.push(&one);
    }
}

/// Handles a hit that [`Scene::lambertian`] leaves out. A surface that is Lambertian here sets its
/// lane of `at`. Any other surface is returned; a dispersive one gives the path a wavelength.
#[inline(never)] // keeps the loops over Lambertian vertices short
pub(super) fn other_surface<'a>(
    scene: &'a Scene,
    ray: &Ray,
    hit: &Hit,
    at: &mut DiffuseVertices,
    lane: usize,
    state: &mut PathState,
) -> Option<Surface<'a>> {
    let mut surface = scene.surface(ray, hit);
    if let Some(point) = surface.diffuse() {
        at.set(lane, &point);
        return None;
    }
    disperse(&mut surface, state);
    Some(surface)
}

/// Gives a path that has none a wavelength, and the surface its index, where it is dispersive.
#[inline]
pub(super) fn disperse(surface: &mut Surface, state: &mut PathState) {
    if surface.material.dispersion.is_some() {
        let mut wavelength = state.history.wavelength();
        state.weight *= surface.disperse(&mut wavelength, &mut state.rng);
        state.history = state.history.with_wavelength(wavelength);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn history_counts_both_kinds_of_vertices_and_keeps_the_media() {
        let mut history = History::default().within(MediumState(41));
        assert!(history.is_start());
        for _ in 0..300 {
            history = history.scattered();
        }
        let history = history.passed_through().passed_through();
        assert_eq!((history.diffuse(), history.passed(), history.is_start()), (300, 2, false));
        assert_eq!(history.media(), MediumState(41));
        assert_eq!(history.within(MediumState(63)).media(), MediumState(63));
        assert_eq!(history.within(MediumState(63)).diffuse(), 300);
        assert!(!history.was_in_medium());
        let history = history.scattered_in_medium();
        assert!(history.was_in_medium() && history.passed_through().was_in_medium());
        assert_eq!((history.diffuse(), history.passed()), (301, 2));
    }

    #[test]
    fn slabs_leave_paths_straight_but_not_at_their_start() {
        let history = History::default().through_slab();
        assert!(history.is_straight() && !history.is_start());
        assert_eq!((history.diffuse(), history.passed()), (0, 0));
        assert!(!history.passed_through().is_straight() && !history.scattered().is_straight());
    }

    #[test]
    fn full_counts_stay() {
        let mut history = History::default().within(MediumState(9));
        for _ in 0..2000 {
            history = history.scattered().passed_through();
        }
        assert_eq!(
            (history.diffuse(), history.passed(), history.media()),
            (511, 31, MediumState(9))
        );
    }

    #[test]
    fn parts_of_a_history_do_not_touch_each_other() {
        let wavelength = Wavelength::from_index(1023);
        let mut history = History::default().with_wavelength(wavelength);
        assert!(history.is_start());
        for _ in 0..2000 {
            history = history.scattered().passed_through();
        }
        assert_eq!((history.diffuse(), history.passed()), (511, 31));
        assert_eq!(history.wavelength(), wavelength);
        let other = history.with_wavelength(Wavelength::from_index(1));
        assert_eq!((other.diffuse(), other.passed(), other.wavelength_index()), (511, 31, 1));
        assert_eq!(other.with_wavelength(None).wavelength(), None);
    }
}
