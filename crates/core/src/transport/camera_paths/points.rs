//! Camera paths from Sobol points: the paths of a pixel, over all iterations, fill pixel, light
//! sources and directions evenly. theory.md, section 11b.

use super::CameraPaths;
use crate::base::rng::{Stream, StreamKey};
use crate::film::folds::DENOISE_FOLDS;
use crate::scene::{LightSamples, Lights, Receivers};
use crate::settings::Settings;
use crate::simd::draw::{KNOWN, KnownFirst, OneKnownFirst, numbers_of};
use crate::simd::sobol::{MAX_POINTS, POINT_DIMENSIONS, SobolPoint};
use crate::simd::{LANES, Rngs};
use crate::transport::path_state::{PathState, PathStates};

/// Sets of points of a pixel. Iterations take points of the sets in turn, so that iterations of
/// different halves or folds are independent.
const SETS: u64 = DENOISE_FOLDS as u64;

/// Numbers of a first vertex, in the order in which they are drawn: those of the light source, then
/// those of the lobe and the direction. The first dimensions are the most evenly distributed
/// together: they are the position in the pixel, the point on the light source and the direction.
const OF_LIGHT: [usize; KNOWN] = [7, 2, 3, 4];
const OF_DIRECTION: [usize; 3] = [8, 5, 6];

/// Numbers of one camera path after its position in the pixel.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct FirstVertex {
    light: [u32; KNOWN],
    direction: [u32; 3],
}

/// The points that the camera paths of an iteration start from.
#[derive(Clone, Copy, Debug)]
pub struct CameraPoints {
    /// Random streams of the pixels' sets.
    key: StreamKey,
    point: SobolPoint,
}

impl CameraPoints {
    /// Tests whether camera paths start from points. Those of strategies with photons of all light
    /// do not: pixels share most of their noise, so that the image would not tell how much less
    /// noise it has.
    pub fn are_used(settings: &Settings) -> bool {
        !settings.has_photons() || settings.strategy.has_only_caustics()
    }

    /// The points of an iteration, if its paths start from points.
    pub fn of(settings: &Settings, iteration: u64) -> Option<Self> {
        Self::are_used(settings).then(|| Self::new(settings, iteration))
    }

    /// theory.md (44f)
    fn new(settings: &Settings, iteration: u64) -> Self {
        let (set, index) = (iteration % SETS, iteration / SETS);
        let most = u64::from(MAX_POINTS);
        let set = index / most * SETS + set;
        let key = StreamKey::new(settings.seed, Stream::CameraPathSet, set);
        Self { key, point: SobolPoint::new((index % most) as u32) }
    }

    /// The points of sixteen paths with these indices in their stream.
    #[inline(always)] // part of the loop over camera paths
    fn of_paths(&self, indices: &[u64; LANES]) -> [[u32; LANES]; POINT_DIMENSIONS] {
        let mut rngs = Rngs::default();
        for (lane, index) in indices.iter().enumerate() {
            rngs.set(lane, self.key.rng(*index));
        }
        self.point.scrambled(&mut rngs)
    }
}

impl CameraPaths {
    /// Numbers of the new paths with these indices: returns those of the positions in their pixels.
    #[inline(always)] // vectorized, as the functions below
    pub(super) fn start_points(
        &mut self,
        points: &CameraPoints,
        indices: &[u64; LANES],
        count: usize,
    ) -> [[u32; LANES]; 2] {
        let words = points.of_paths(indices);
        self.points.extend((0..count).map(|lane| FirstVertex {
            light: OF_LIGHT.map(|dimension| words[dimension][lane]),
            direction: OF_DIRECTION.map(|dimension| words[dimension][lane]),
        }));
        [words[0], words[1]]
    }

    /// All paths are at their first segment, and have points.
    #[inline(always)]
    pub(super) fn starts_from_points(&self) -> bool {
        !self.points.is_empty()
    }

    /// Connects vertices with light sources.
    #[inline(always)]
    pub(super) fn light_samples(
        &self,
        lights: &Lights,
        at: &Receivers,
        states: &mut PathStates,
    ) -> LightSamples {
        if !self.starts_from_points() {
            return lights.connect_all(at, &mut states.rng);
        }
        let mut words = [[0; LANES]; KNOWN];
        for (lane, path) in states.path.iter().enumerate() {
            // Lanes without a path have an arbitrary number.
            let Some(point) = self.points.get(self.number_in_batch(*path)) else { continue };
            for (words, word) in words.iter_mut().zip(point.light) {
                words[lane] = word;
            }
        }
        let mut numbers = KnownFirst::new(states.rng, words);
        let samples = lights.connect_all(at, &mut numbers);
        states.rng = numbers.rngs;
        samples
    }

    /// Numbers that choose directions.
    #[inline(always)]
    pub(super) fn direction_numbers(&self, states: &mut PathStates) -> [[f32; LANES]; 2] {
        let mut numbers = states.rng.next_pair();
        if self.starts_from_points() {
            let [_, u, v] = self.known_directions(states);
            numbers = [u, v];
        }
        numbers
    }

    /// Numbers that choose lobes and directions.
    #[inline(always)]
    pub(super) fn lobe_numbers(&self, states: &mut PathStates) -> [[f32; LANES]; 3] {
        let numbers = [states.rng.next_1d(), states.rng.next_1d(), states.rng.next_1d()];
        if self.starts_from_points() { self.known_directions(states) } else { numbers }
    }

    #[inline(always)]
    fn known_directions(&self, states: &PathStates) -> [[f32; LANES]; 3] {
        let mut words = [[0; LANES]; 3];
        for (lane, path) in states.path.iter().enumerate() {
            let Some(point) = self.points.get(self.number_in_batch(*path)) else { continue };
            for (words, word) in words.iter_mut().zip(point.direction) {
                words[lane] = word;
            }
        }
        [numbers_of(&words[0]), numbers_of(&words[1]), numbers_of(&words[2])]
    }

    /// Number of a path among those of the batch; any number if there is no path.
    #[inline(always)]
    fn number_in_batch(&self, path: u32) -> usize {
        (path as usize).wrapping_sub(self.first_path)
    }

    /// Numbers that choose a light source at the first vertex of one path.
    pub(super) fn one_light(&self, state: &PathState) -> OneKnownFirst {
        let point = &self.points[self.number_in_batch(state.path)];
        OneKnownFirst::new(state.rng, point.light)
    }
}
