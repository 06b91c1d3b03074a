//! Camera paths do not depend on how many of them are traced at a time.
#![cfg(feature = "embree")]

use bdpm::base::rng::{Stream, StreamKey};
use bdpm::load::load;
use bdpm::scene::backend::{Backend, build};
use bdpm::transport::camera_paths::{CameraPass, CameraPathId, CameraPaths};
use bdpm::transport::gather::GatherPoint;
use bdpm::{Scene, Settings};
use std::path::Path;
use std::sync::Arc;

const SIDE: u32 = 40;

fn load_scene(name: &str) -> (Arc<Scene>, Settings) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    let loaded = load(&path).unwrap();
    let settings =
        Settings::resolve(&Default::default(), &loaded.defaults, loaded.scene.size()).unwrap();
    (loaded.scene, Settings { width: SIDE, height: SIDE, ..settings })
}

#[test]
fn batches_merged_together_equal_one_batch() {
    // Diffuse walls alone, all kinds of surfaces, and weights of the camera's rays.
    for (name, views) in [("cornell-box", false), ("materials", true), ("objective", true)] {
        let (scene, settings) = load_scene(name);
        let accel = build(Backend::Embree, &scene).unwrap();
        let pass = CameraPass {
            scene: &scene,
            view: scene.camera.view(SIDE, SIDE),
            accel: &*accel,
            settings: &settings,
            key: StreamKey::new(1, Stream::CameraPath, 0),
            gather_early: true,
            hides_lights: false,
            points: None,
            cache: None,
            light_edges: None,
        };
        let ids: Vec<CameraPathId> = (0..SIDE * SIDE)
            .map(|pixel| CameraPathId { x: pixel % SIDE, y: pixel / SIDE, index: 3 })
            .collect();
        let trace = |sizes: &[usize]| {
            let mut paths = CameraPaths::default();
            // Paths traced before leave nothing behind.
            paths.trace(&pass, ids[100..700].iter().copied());
            paths.clear();
            let mut rest = &ids[..];
            for size in sizes {
                let (batch, others) = rest.split_at(*size);
                paths.trace(&pass, batch.iter().copied());
                rest = others;
            }
            assert!(rest.is_empty());
            paths
        };
        let one = trace(&[1600]);
        assert!(one.gather_points.iter().count() > 500, "{name}");
        assert_eq!(!one.views.is_empty(), views, "{name}");
        let points = |paths: &CameraPaths| -> Vec<_> {
            let told = |point: GatherPoint| {
                let GatherPoint { position, path, weight, vertex, normal, view, .. } = point;
                let view = paths.views.get(view as usize).map(|view| view.at.wo);
                (position, path, weight, vertex, normal, view)
            };
            let mut points: Vec<_> = paths.gather_points.iter().map(told).collect();
            points.sort_by_key(|(_, path, ..)| *path);
            points
        };
        for sizes in [&[1, 15, 1584][..], &[700, 3, 500, 397]] {
            let batches = trace(sizes);
            assert_eq!(batches.direct, one.direct, "{name}");
            assert_eq!(points(&batches), points(&one), "{name}");
        }
    }
}
