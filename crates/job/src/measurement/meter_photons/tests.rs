//! Photons at a meter that a mirror lights.

use super::*;
use bdpm_core::scene::backend::{self, Backend};
use bdpm_core::scene::bsdf::Bsdf;
use bdpm_core::scene::{Camera, Emitter, FieldOfView, Material, Mesh};
use glam::Vec3;

/// A point light of 1 W/sr at (0, 0, 1) beside a mirror in the plane x = 1.
fn scene() -> Scene {
    let corners = [[-2.0, -2.0], [-2.0, 2.0], [2.0, 2.0], [2.0, -2.0]];
    let mirror = Mesh {
        positions: corners.map(|[y, z]| Vec3::new(1.0, y, z)).into(),
        triangles: vec![[0, 1, 2], [0, 2, 3]],
        ..Mesh::default()
    };
    let silver = Material::new("silver", Bsdf::Mirror { reflectance: Rgb::splat(0.9) });
    let lamp = Emitter::Point { position: Vec3::Z, intensity: Rgb::ONE };
    let camera = Camera::look(Vec3::ZERO, Vec3::X, Vec3::Z, FieldOfView::X(60.0)).unwrap();
    Scene::new("mirror".into(), vec![mirror], vec![silver], vec![lamp], camera, vec![]).unwrap()
}

/// Iterations of any number of paths have one mean, that of the image of the lamp.
#[test]
fn irradiance_does_not_depend_on_the_time() {
    let scene = scene();
    let accel = backend::build(Backend::Bvh, &scene).unwrap();
    let meters = [Meter::irradiance(Vec3::ZERO, Vec3::Z).unwrap()];
    let expected = 0.9 / 5f64.powf(1.5);
    for (time, paths, iterations) in
        [(Duration::ZERO, LEAST_BATCHES * BATCH, 64), (Duration::from_secs(86_400), PATHS, 8)]
    {
        let mut photons = MeterPhotons::new(&scene, &*accel, &meters, 0.1, 3, None).unwrap();
        photons.fit(24, time);
        assert_eq!(photons.paths(), paths);
        let values: Vec<f64> = (0..iterations).map(|_| photons.iterate()[0][0]).collect();
        let n = f64::from(iterations);
        let mean = values.iter().sum::<f64>() / n;
        let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
        let error = (squares / (n * (n - 1.0))).sqrt();
        // The mean over the disc is off by less than .3 %.
        let off = (mean - expected).abs();
        assert!(off < 4.0 * error + 3e-3 * expected, "{mean} {error} {expected}");
        assert!(error < 0.05 * expected, "{error}");
    }
}
