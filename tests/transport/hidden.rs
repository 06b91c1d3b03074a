//! Lamps hidden from the camera still show in mirrors and light the scene.

use crate::common::*;
use bdpm::Settings;
use bdpm::scene::bsdf::Bsdf;
use bdpm::scene::{Camera, FieldOfView, Material, Mesh};
use bdpm::settings::Strategy;
use bdpm::transport::reference::PathTracer;
use glam::Vec3;

const RADIANCE: f32 = 3.0;

fn lamp(hidden: bool) -> Material {
    Material { hidden_from_camera: hidden, ..gray(0.0, RADIANCE) }
}

fn looking_down() -> Camera {
    Camera::look(Vec3::Z * 4.0, -Vec3::Z, Vec3::Y, FieldOfView::X(40.0)).unwrap()
}

/// Means of the renderer's pixels by both strategies, and of the path tracer's.
fn images(meshes: &[Mesh], materials: &[Material]) -> Vec<Vec<f64>> {
    let scene = scene(meshes.to_vec(), materials.to_vec(), vec![], looking_down());
    let of = |strategy| {
        let (merge_vertex, camera_paths) = (2, 4);
        let settings = Settings { strategy, merge_vertex, camera_paths, ..settings(8, 8) };
        pixel_means(&scene, settings, 4).into_iter().map(|[mean, _]| mean).collect()
    };
    let accel = accel(&scene);
    let mut tracer = PathTracer::new(&scene, &*accel, &settings(8, 8));
    tracer.iterate(4);
    let traced = tracer.film().mean().iter().map(|pixel| f64::from(pixel.y)).collect();
    vec![of(Strategy::Single), of(Strategy::Mis), traced]
}

#[test]
fn camera_sees_through_hidden_meshes() {
    // A lamp that faces the camera, and a black wall.
    let wall = square(Vec3::ZERO, Vec3::Z, 50.0, 0);
    let meshes = [wall, square(Vec3::Z * 2.0, Vec3::Z, 50.0, 1)];
    for (hidden, expected) in [(false, f64::from(RADIANCE)), (true, 0.0)] {
        for image in images(&meshes, &[gray(0.0, 0.0), lamp(hidden)]) {
            assert!(image.iter().all(|mean| (mean - expected).abs() < 1e-5), "{hidden}: {image:?}");
        }
    }
}

#[test]
fn mirrors_show_hidden_meshes() {
    let mirror = Material::new("mirror", Bsdf::Mirror { reflectance: Vec3::ONE });
    let meshes = [square(Vec3::ZERO, Vec3::Z, 50.0, 0), square(Vec3::Z * 6.0, -Vec3::Z, 500.0, 1)];
    for image in images(&meshes, &[mirror, lamp(true)]) {
        let expected = f64::from(RADIANCE);
        assert!(image.iter().all(|mean| (mean - expected).abs() < 1e-4), "{image:?}");
    }
}
