//! Learns from which regions of space the lights are visible: shadow rays that are not part of the
//! image test clusters of lights at the vertices of some camera paths. theory.md (17a).

use crate::accel::{Coherence, Intersect, Ray};
use crate::base::rng::{Rng, Stream, StreamKey};
use crate::scene::lights::visibility::{Visibility, VisibilityTest};
use crate::scene::{Receiver, Scene};
use crate::settings::{Direct, Settings, Strategy};
use crate::simd::LANES;
use crate::transport::camera_paths::{CameraPass, CameraPathId, CameraPaths};
use rayon::prelude::*;
use std::sync::Arc;

/// Diffuse vertices of a camera path that learning traces.
const VERTICES: u32 = 3;

/// Shadow rays of a vertex: half of them test the tree as a whole and distant lights, half any
/// cluster.
const TESTS: usize = 4;

/// Vertices whose shadow rays are traced together.
const BATCH: usize = 1024;

/// Length of shadow rays, relative: they end shortly before the vertex.
const SHADOW_RAY_END: f32 = 1.0 - 1e-3;

/// Seed of the camera paths and the tests. Renders with different seeds share the visibility, so
/// that they have the same distribution.
const SEED: u64 = 0x5ee1_6b75_0f1a_3b0d;

/// The scene with the visibility that the settings ask for; without one if there is no choice among
/// lights. It depends on no other setting, and not on the number of threads.
pub(super) fn learned(
    scene: &Arc<Scene>,
    accel: &dyn Intersect,
    settings: &Settings,
) -> Arc<Scene> {
    let (rays, slots) = (settings.light_visibility, scene.lights().visibility_slots());
    if rays == 0 || !scene.lights().has_choice() {
        return Arc::clone(scene);
    }
    let receivers = receivers(scene, accel, rays / TESTS as u32, settings);
    let key = StreamKey::new(SEED, Stream::Visibility, 0);
    let batches = receivers.par_chunks(BATCH).enumerate();
    let tests: Vec<_> = batches
        .flat_map_iter(|(batch, at)| test(scene, accel, &slots, at, key, batch * BATCH))
        .collect();
    let visibility = Visibility::learn(scene.lights(), &receivers, &tests);
    Arc::new(scene.with_visibility(Some(Arc::new(visibility))))
}

/// At least `count` vertices of camera paths, unless paths miss the scene.
fn receivers(
    scene: &Scene,
    accel: &dyn Intersect,
    count: u32,
    settings: &Settings,
) -> Vec<Receiver> {
    let side = f64::from(count / VERTICES).sqrt().ceil().max(1.0) as u32;
    let settings = Settings {
        width: side,
        height: side,
        merge_vertex: VERTICES,
        strategy: Strategy::Single,
        // The paths need no connections
        direct: Direct::PhotonMap,
        ..settings.clone()
    };
    let pass = CameraPass {
        scene,
        // The full image even if a window is rendered: both then have one visibility
        view: scene.camera.view(side, side),
        accel,
        settings: &settings,
        key: StreamKey::new(SEED, Stream::CameraPath, 0),
        gather_early: true,
        hides_lights: false,
        points: None,
        cache: None,
        light_edges: None,
    };
    let rows = (0..side).into_par_iter().flat_map_iter(|y| {
        let mut paths = CameraPaths::default();
        paths.trace(&pass, (0..side).map(|x| CameraPathId { x, y, index: 0 }));
        let points = paths.gather_points.iter();
        points
            .map(|at| Receiver { position: at.position, normal: Some(at.normal) })
            .collect::<Vec<_>>()
    });
    rows.collect()
}

/// Tests the visibility of lights from each vertex. `first` is the number of the first one.
fn test(
    scene: &Scene,
    accel: &dyn Intersect,
    slots: &[u8],
    receivers: &[Receiver],
    key: StreamKey,
    first: usize,
) -> Vec<(VisibilityTest, bool)> {
    let lights = scene.lights();
    let outermost = lights.outermost_visibility_slots();
    let mut tests = Vec::with_capacity(receivers.len() * TESTS);
    for (number, receivers) in receivers.chunks(LANES / TESTS).enumerate() {
        let mut rngs = [Rng::default(); LANES];
        let mut places = [(0, Receiver::default()); LANES];
        for (lane, (place, rng)) in places.iter_mut().zip(&mut rngs).enumerate() {
            let Some(&at) = receivers.get(lane / TESTS) else { continue };
            *rng = key.rng((first * TESTS + number * LANES + lane) as u64);
            let slots = if lane % 2 == 0 { &outermost } else { slots };
            *place = (slots[(rng.next_f64() * slots.len() as f64) as usize], at);
        }
        let count = receivers.len() * TESTS;
        lights.add_visibility_tests(&places[..count], &mut rngs[..count], &mut tests);
    }
    let ray = |test: &VisibilityTest| Ray {
        t_far: SHADOW_RAY_END,
        ..Ray::segment(test.light.target, test.at.position)
    };
    let rays: Vec<Ray> = tests.iter().map(ray).collect();
    let mut occluded = vec![false; rays.len()];
    accel.occlusions(&rays, &mut occluded, Coherence::Incoherent);
    tests.into_iter().zip(occluded).map(|(test, occluded)| (test, !occluded)).collect()
}
