//! Learns the guide of directions by camera paths that are not part of the image. theory.md,
//! section 11a.

use super::Renderer;
use crate::accel::Intersect;
use crate::base::rng::{Stream, StreamKey};
use crate::scene::Scene;
use crate::settings::{Direct, Settings, Strategy};
use crate::transport::camera_paths::{
    CameraPass, CameraPathId, CameraPaths, DirectionRecorder, RecordedDirection,
};
use crate::transport::direction_guide::{DirectionGuide, DirectionSample};
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// Seed of the camera paths. Renders with different seeds share the guide, so that they have the
/// same distribution.
const SEED: u64 = 0x6d1e_77a3_90c5_1b2f;

/// Rounds: each has twice as many paths as the one before, whose guide it uses.
const ROUNDS: u32 = 3;

/// Parts along each side of the image whose mean luminance weighs the contributions.
const PARTS: u32 = 32;

/// Share of the squared mean luminance that is added to those of the parts, as in relative errors.
const DARK: f64 = 0.01;

/// The guide of all renderers of one scene whose settings ask for equal ones. It is learned when
/// the first of them needs it.
pub(super) type LearnedDirections = Arc<OnceLock<Option<DirectionGuide>>>;

impl Renderer {
    /// Learns the guide of directions, unless photons make it useless.
    pub(super) fn with_learned_directions(self) -> Self {
        if !self.settings.has_photons() {
            self.learn_directions();
        }
        self
    }

    /// Learns the guide of directions that the settings ask for, for all renderers that are made
    /// from this one. Its time then is not part of theirs.
    pub fn learn_directions(&self) {
        self.directions.get_or_init(|| learned(&self.scene, &*self.accel, &self.settings));
    }

    /// Whether the guide of directions is that of another renderer of the same scene.
    pub(super) fn learns_directions_of(&self, other: &Self) -> bool {
        let of = |own: &Self| (own.settings.direction_guide, own.settings.light_visibility);
        of(self) == of(other)
    }

    /// The guide of the directions of camera paths. Weights of photons do not know it.
    pub(super) fn directions(&self) -> Option<&DirectionGuide> {
        let learned = self.directions.get().filter(|_| !self.settings.has_photons());
        learned.and_then(Option::as_ref)
    }
}

/// The guide that the settings ask for; `None` if they ask for none, and for meters. It depends on
/// no other settings but the visibility of the lights, and not on the number of threads.
pub(super) fn learned(
    scene: &Scene,
    accel: &dyn Intersect,
    settings: &Settings,
) -> Option<DirectionGuide> {
    let paths = settings.direction_guide;
    if paths == 0 || scene.meters().is_some() {
        return None;
    }
    let (mut guide, mut recorded) = (None, Vec::new());
    for round in 0..ROUNDS {
        let share = f64::from(1 << round) / f64::from((1 << ROUNDS) - 1);
        let count = share * f64::from(paths);
        recorded.extend(record(scene, accel, settings, guide.as_ref(), (round, count)));
        guide = Some(DirectionGuide::learn(&relative(&recorded)));
    }
    guide
}

/// Traces about `count` paths over the whole image.
fn record(
    scene: &Scene,
    accel: &dyn Intersect,
    settings: &Settings,
    directions: Option<&DirectionGuide>,
    (round, count): (u32, f64),
) -> Vec<Recorded> {
    let side = count.sqrt().ceil().max(1.0) as u32;
    let settings = Settings {
        width: side,
        height: side,
        strategy: Strategy::Path,
        merge_vertex: 2,
        direct: Direct::Connect,
        ..settings.clone()
    };
    let pass = CameraPass {
        scene,
        // The full image even if a window is rendered: both then have one guide
        view: scene.camera.view(side, side),
        accel,
        settings: &settings,
        key: StreamKey::new(SEED, Stream::CameraPath, u64::from(round)),
        gather_early: false,
        hides_lights: false,
        points: None,
        directions,
        cache: None,
        light_edges: None,
    };
    let rows = (CameraPaths::BATCH as u32).div_ceil(side);
    let batches = (0..side.div_ceil(rows)).into_par_iter().flat_map_iter(|batch| {
        let mut paths = CameraPaths::default();
        paths.recorder = Some(DirectionRecorder::default());
        let first = batch * rows;
        let pixels = (first..(first + rows).min(side)).flat_map(|y| (0..side).map(move |x| (x, y)));
        paths.trace(&pass, pixels.map(|(x, y)| CameraPathId { x, y, index: 0 }));
        let recorded = paths.recorder.take().unwrap_or_default().directions;
        recorded.into_iter().map(move |RecordedDirection { mut sample, total }| {
            let [x, y] = [sample.path % side, first + sample.path / side];
            sample.path = y * side + x;
            Recorded { sample, total, part: y * PARTS / side * PARTS + x * PARTS / side }
        })
    });
    batches.collect()
}

/// A direction with its place in the image.
#[derive(Clone, Copy, Debug)]
struct Recorded {
    sample: DirectionSample,
    /// Luminance of the path.
    total: f32,
    part: u32,
}

/// The directions, with contributions relative to the luminance of their parts of the image.
fn relative(recorded: &[Recorded]) -> Vec<DirectionSample> {
    let mut sums = vec![[0.0; 2]; (PARTS * PARTS) as usize];
    for Recorded { total, part, .. } in recorded {
        if total.is_finite() {
            let sum = &mut sums[*part as usize];
            (sum[0], sum[1]) = (sum[0] + f64::from(*total), sum[1] + 1.0);
        }
    }
    let mean = |[sum, count]: [f64; 2]| if count > 0.0 { sum / count } else { 0.0 };
    let all = mean(sums.iter().fold([0.0; 2], |all, sum| [all[0] + sum[0], all[1] + sum[1]]));
    let weight = |sum: &[f64; 2]| {
        let square = mean(*sum).powi(2) + DARK * all * all;
        if square > 0.0 { square.sqrt().recip() as f32 } else { 0.0 }
    };
    let weights: Vec<f32> = sums.iter().map(weight).collect();
    let relative = |Recorded { sample, part, .. }: &Recorded| DirectionSample {
        contribution: sample.contribution * weights[*part as usize],
        ..*sample
    };
    recorded.iter().map(relative).collect()
}
