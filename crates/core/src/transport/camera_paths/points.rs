//! Camera paths from Sobol points: the paths of a pixel, over all iterations, fill pixel, light
//! sources and directions evenly. theory.md, section 11b.

use super::CameraPaths;
use crate::base::rng::{Stream, StreamKey};
use crate::scene::Scene;
use crate::settings::Settings;
use crate::simd::draw::{KNOWN, KnownFirst, OneKnownFirst};
use crate::simd::sobol::{MAX_POINTS, POINT_DIMENSIONS, SobolPoint};
use crate::simd::{LANES, Rngs};
use crate::transport::path_state::{PathState, PathStates};

/// Sets of points of a pixel. Iterations take points of the sets in turn, so that iterations of
/// different halves or folds are independent.
const SETS: u64 = 8;

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
    /// Tests whether camera paths start from points. Those of strategies with photons do not: all
    /// pixels share the noise of light paths, so that the image would not tell how much less noise
    /// it has.
    pub fn are_used(settings: &Settings) -> bool {
        !settings.has_photons()
    }

    /// The points of an iteration, if its paths start from points. Meters are no pixels.
    pub fn of(scene: &Scene, settings: &Settings, iteration: u64) -> Option<Self> {
        let is_used = Self::are_used(settings) && scene.meters().is_none();
        is_used.then(|| Self::new(settings, iteration))
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

    /// Numbers that choose light sources at the first vertices.
    #[inline(always)]
    pub(super) fn light_numbers(&self, states: &PathStates) -> KnownFirst<KNOWN> {
        let mut words = [[0; LANES]; KNOWN];
        for lane in 0..LANES {
            // Lanes without a path have any number.
            let own = (states.path[lane] as usize).wrapping_sub(self.first_path);
            let Some(point) = self.points.get(own) else { continue };
            for (words, word) in words.iter_mut().zip(point.light) {
                words[lane] = word;
            }
        }
        KnownFirst::new(states.rng, words)
    }

    /// Numbers that choose the lobes and directions at the first vertices.
    #[inline(always)]
    pub(super) fn direction_numbers(&self, states: &PathStates) -> [[u32; LANES]; 3] {
        let mut words = [[0; LANES]; 3];
        for lane in 0..LANES {
            let own = (states.path[lane] as usize).wrapping_sub(self.first_path);
            let Some(point) = self.points.get(own) else { continue };
            for (words, word) in words.iter_mut().zip(point.direction) {
                words[lane] = word;
            }
        }
        words
    }

    /// [`Self::light_numbers`] of one path.
    pub(super) fn one_light(&self, state: &PathState) -> OneKnownFirst<KNOWN> {
        let point = &self.points[state.path as usize - self.first_path];
        OneKnownFirst::new(state.rng, point.light)
    }
}
