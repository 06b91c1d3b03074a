//! Cameras and lamps across the face of a medium: each ray starts in the medium around its origin.

use crate::common::fog::{block, gray_medium, index_matched};
use crate::common::*;
use bdpm::Settings;
use bdpm::noise::Measure;
use bdpm::scene::lights::environment::Environment;
use bdpm::scene::{Camera, FieldOfView};
use bdpm::scene::{Extent, Optics};
use bdpm::settings::{Direct, Strategy};
use glam::Vec3;
use std::sync::Arc;

/// A cube of side 2 around the origin that absorbs, under an even sky.
fn absorbing_cube(camera: Camera) -> Arc<bdpm::Scene> {
    let cube = block(Vec3::ZERO, 1.0, 0);
    let material = index_matched(&gray_medium(1.0, 0.0, 0.0));
    let scene = scene(vec![cube], vec![material], vec![], camera);
    let sky = Environment::new(1, 1, vec![Vec3::ONE], 0.0);
    Arc::new(Arc::unwrap_or_clone(scene).with_environment(sky))
}

fn path(width: u32, height: u32) -> Settings {
    Settings { strategy: Strategy::Path, merge_vertex: 2, ..settings(width, height) }
}

#[test]
fn plane_of_an_orthographic_camera_is_partly_in_a_medium() {
    // The plane cuts the middle of the cube, whose far face is one unit away.
    let optics = Optics::Orthographic(Extent::X(4.0));
    let camera =
        Camera::with_optics(Vec3::new(0.003, 0.002, 0.0), -Vec3::Z, Vec3::Y, optics).unwrap();
    let scene = absorbing_cube(camera);
    let own = Settings { camera_paths: 1, ..path(64, 64) };
    let mut renderer = bdpm::Renderer::new(&scene, &accel(&scene), own).unwrap();
    renderer.iterate(Measure::Off);
    let mean = renderer.film().mean();
    for (x, y, expected) in [(32, 32, (-1f32).exp()), (20, 40, (-1f32).exp()), (2, 32, 1.0)] {
        let value = mean[64 * y + x].x;
        assert!((value - expected).abs() < 1e-4, "({x}, {y}): {value}, not {expected}");
    }
}

#[test]
fn lens_of_a_camera_is_partly_in_a_medium() {
    // Half of the lens, a disc of radius 0.5, is in the cube. Rays through it travel nearly one
    // unit.
    let optics = Optics::ThinLens {
        field_of_view: FieldOfView::X(0.01),
        aperture_radius: 0.5,
        focus_distance: 1e4,
    };
    let camera = Camera::with_optics(Vec3::X, -Vec3::Z, Vec3::Y, optics).unwrap();
    let scene = absorbing_cube(camera);
    let own = Settings { camera_paths: 64, ..path(8, 8) };
    let found = mean_luminance(&scene, &accel(&scene), own, 16);
    found.assert_is(0.5 * (1.0 + (-1f64).exp()), 1e-3);
}

#[test]
fn lamp_across_a_face_shines_from_both_media() {
    let lamp = square(Vec3::new(1.0, 0.5, 0.0), -Vec3::Y, 0.1, 1);
    let floor = square(Vec3::new(1.0, -0.5, 0.0), Vec3::Y, 0.5, 2);
    let materials =
        vec![index_matched(&gray_medium(2.0, 0.0, 0.0)), gray(0.0, 10.0), gray(0.5, 0.0)];
    let eye = camera(Vec3::new(1.3, 0.3, 0.1), Vec3::new(0.8, -0.5, 0.0), 40.0);
    let scene = scene(vec![block(Vec3::ZERO, 1.0, 0), lamp, floor], materials, vec![], eye);
    let accel = accel(&scene);
    let paths = mean_luminance(&scene, &accel, Settings { camera_paths: 16, ..path(16, 16) }, 16);
    let photons = Settings {
        direct: Direct::PhotonMap,
        light_paths: 100_000,
        radius: 0.03,
        caustic_radius: 0.03,
        ..settings(16, 16)
    };
    let photons = mean_luminance(&scene, &accel, photons, 32);
    let error = paths.error.hypot(photons.error);
    println!("{paths:?} {photons:?}");
    assert!((paths.mean - photons.mean).abs() < 4.0 * error, "{paths:?} {photons:?}");
    assert!(error < 0.01 * paths.mean);
}
