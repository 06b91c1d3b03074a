//! Images of cameras in scenes with known answers.

use crate::common::*;
use bdpm::scene::{Camera, Emitter, Extent, FieldOfView, FisheyeProjection, Optics};
use bdpm::settings::Direct;
use glam::Vec3;
use std::f64::consts::PI;

/// Mean of each pixel, row by row, with the standard error.
fn image(camera: Camera, emitter: bdpm::scene::Mesh, side: u32, iterations: u64) -> Vec<[f64; 2]> {
    let scene = scene(vec![emitter], vec![gray(0.0, 3.0)], vec![], camera);
    let settings = bdpm::Settings { camera_paths: 16, light_paths: 2, ..settings(side, side) };
    pixel_means(&scene, settings, iterations)
}

/// A small square emitter off the sharp plane: its image is a disc of the radius of the circle of
/// confusion, `A |z - f| / f` in the plane at `f` seen from `z`, of the same energy.
#[test]
fn a_thin_lens_blurs_a_point_to_the_circle_of_confusion() {
    let (aperture_radius, focus_distance, degrees, side) = (0.5, 4.0, 30.0_f32, 48);
    for z in [2.5_f32, 4.0, 9.0] {
        let half = 0.02 * z;
        let emitter = square(Vec3::new(0.0, 0.0, z), -Vec3::Z, half, 0);
        let field_of_view = FieldOfView::X(degrees);
        let optics = Optics::ThinLens { field_of_view, aperture_radius, focus_distance };
        let camera = Camera::with_optics(Vec3::ZERO, Vec3::Z, Vec3::Y, optics).unwrap();
        let found = image(camera, emitter, side, 200);

        // In tangents of angles from the lens' center.
        let pixel = 2.0 * f64::from((0.5 * degrees).to_radians().tan()) / f64::from(side);
        let (mut energy, mut energy_variance, mut moment, mut moment_variance) =
            (0.0, 0.0, 0.0, 0.0);
        for (index, [mean, error]) in found.iter().enumerate() {
            let place = |i: u32| pixel * (f64::from(i) + 0.5 - 0.5 * f64::from(side));
            let (x, y) = (place(index as u32 % side), place(index as u32 / side));
            let r2 = x * x + y * y;
            energy += mean * pixel * pixel;
            energy_variance += (error * pixel * pixel).powi(2);
            moment += r2 * mean * pixel * pixel;
            moment_variance += (r2 * error * pixel * pixel).powi(2);
        }
        let z = f64::from(z);
        let size = f64::from(2.0 * half) / z;
        // Radiance times the square of the emitter's angular size, however blurred.
        Estimate { mean: energy, error: energy_variance.sqrt() }.assert_is(3.0 * size * size, 0.0);

        // Second moments add: a disc of radius c has c^2/2, a square of side s has s^2/6, and
        // pixels are squares as well (Sheppard's correction; sharp edges leave a little of it).
        let confusion =
            f64::from(aperture_radius) * (1.0 / z - 1.0 / f64::from(focus_distance)).abs();
        let expected = 0.5 * confusion.powi(2) + (size.powi(2) + pixel.powi(2)) / 6.0;
        let spread = moment / energy;
        let error = moment_variance.sqrt() / energy;
        println!("z = {z}: {spread} +- {error}, {expected}");
        assert!((spread - expected).abs() < 4.0 * error + 0.01 * expected, "{z}");
        assert!(error < 0.05 * expected, "{error}");
    }
}

/// A sensor behind nothing but a disc that light of one radiance comes through.
#[test]
fn a_sensors_pixels_have_the_irradiance_of_a_disc() {
    let (width, disc_distance, disc_radius, exposure) = (2.0, 1.5, 0.8, 0.25);
    let optics = Optics::Sensor { width, disc_distance, disc_radius, exposure };
    let position = Vec3::new(1.0, 2.0, 3.0);
    let camera = Camera::with_optics(position, Vec3::X, Vec3::Y, optics).unwrap();
    let wall = square(position + Vec3::new(2.0, 0.0, 0.0), -Vec3::X, 50.0, 0);
    let side = 8;
    let found = image(camera, wall, side, 400);
    let (d2, r2) = (f64::from(disc_distance).powi(2), f64::from(disc_radius).powi(2));
    for (index, [mean, error]) in found.into_iter().enumerate() {
        // The mean over the pixel by 16 x 16 midpoints of the closed form for a point at the
        // distance rho from the axis: pi L/2 (1 - (d^2 + rho^2 - R^2) / sqrt(...)).
        let mut expected = 0.0;
        for sub in 0..256 {
            let place = |i: u32, sub: u32| {
                let pixels = f64::from(i) + (f64::from(sub) + 0.5) / 16.0;
                f64::from(width) * (pixels / f64::from(side) - 0.5)
            };
            let (x, y) =
                (place(index as u32 % side, sub % 16), place(index as u32 / side, sub / 16));
            let rho2 = x * x + y * y;
            let sum = d2 + rho2 + r2;
            let root = (sum * sum - 4.0 * r2 * rho2).sqrt();
            expected += 0.5 * PI * 3.0 * (1.0 - (d2 + rho2 - r2) / root) / 256.0;
        }
        let expected = expected * f64::from(exposure);
        assert!((mean - expected).abs() < 5.0 * error, "{index}: {mean} +- {error}, {expected}");
        assert!(error < 0.01 * expected, "{index}: {error}");
    }
}

/// Parallel rays see a lamp of the area A as A / (pixel area) pixels of its radiance, at any
/// distance.
#[test]
fn an_orthographic_camera_shows_a_lamp_by_its_area() {
    let (side, across, half) = (32, 8.0_f32, 0.7_f32);
    for z in [1.0, 50.0] {
        let optics = Optics::Orthographic(Extent::X(across));
        let camera = Camera::with_optics(Vec3::ZERO, Vec3::Z, Vec3::Y, optics).unwrap();
        let lamp = square(Vec3::new(0.4, -0.3, z), -Vec3::Z, half, 0);
        let pixel = f64::from(across) / f64::from(side);
        let (mut power, mut variance) = (0.0, 0.0);
        for [mean, error] in image(camera, lamp, side, 64) {
            power += mean * pixel * pixel;
            variance += (error * pixel * pixel).powi(2);
        }
        let expected = 3.0 * f64::from(2.0 * half).powi(2);
        Estimate { mean: power, error: variance.sqrt() }.assert_is(expected, 0.0);
    }
}

/// A lamp of one radiance all around: every pixel within the field of view has it, and pixels
/// outside the image circle of a fisheye are black.
#[test]
fn panoramas_and_fisheyes_inside_a_lamp_show_its_radiance() {
    let side = 24;
    let circle = |projection| Optics::Fisheye { projection, field_of_view: 220.0 };
    for optics in [
        Optics::Panorama,
        circle(FisheyeProjection::Equidistant),
        circle(FisheyeProjection::Equisolid),
    ] {
        let camera = Camera::with_optics(Vec3::ZERO, Vec3::X, Vec3::Y, optics).unwrap();
        let sides = [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z];
        let walls = sides.map(|normal| square(2.0 * normal, -normal, 2.001, 0));
        let scene = scene(walls.to_vec(), vec![gray(0.0, 3.0)], vec![], camera);
        let settings = bdpm::Settings { camera_paths: 4, light_paths: 2, ..settings(side, side) };
        for (index, [mean, _]) in pixel_means(&scene, settings, 4).into_iter().enumerate() {
            let place = |i: u32| f64::from(i) + 0.5 - 0.5 * f64::from(side);
            let (x, y) = (place(index as u32 % side), place(index as u32 / side));
            let radius = x.hypot(y) / (0.5 * f64::from(side));
            let half_diagonal = 2.0_f64.sqrt() / f64::from(side);
            if optics == Optics::Panorama || radius < 1.0 - half_diagonal {
                assert!((mean - 3.0).abs() < 1e-4, "{optics:?} {index}: {mean}");
            } else if radius > 1.0 + half_diagonal {
                assert_eq!(mean, 0.0, "{optics:?} {index}");
            }
        }
    }
}

/// Photon maps serve all cameras: the radiance of a diffuse floor under a point light is the same
/// as seen by a pinhole.
#[test]
fn all_cameras_merge_the_same_photons() {
    let floor = square(Vec3::ZERO, Vec3::Y, 4.0, 0);
    let light = Emitter::Point { position: Vec3::new(0.0, 2.0, 0.0), intensity: Vec3::splat(8.0) };
    let (intensity, height, albedo) = (8.0, 2.0, 0.6);
    // The floor straight below the light: albedo / pi times the irradiance I / h^2.
    let expected = albedo / PI * intensity / (height * height);
    let narrow = |projection| Optics::Fisheye { projection, field_of_view: 1.0 };
    for optics in [
        Optics::Pinhole(FieldOfView::X(1.0)),
        Optics::Orthographic(Extent::X(0.02)),
        narrow(FisheyeProjection::Equidistant),
        narrow(FisheyeProjection::Equisolid),
    ] {
        let camera =
            Camera::with_optics(Vec3::new(0.0, 1.0, 0.0), -Vec3::Y, Vec3::X, optics).unwrap();
        let scene =
            scene(vec![floor.clone()], vec![gray(albedo as f32, 0.0)], vec![light.clone()], camera);
        let settings = bdpm::Settings {
            light_paths: 40_000,
            radius: 0.05,
            direct: Direct::PhotonMap,
            ..settings(1, 1)
        };
        let [mean, error] = pixel_means(&scene, settings, 100)[0];
        let share = match optics {
            Optics::Fisheye { .. } => PI / 4.0, // of the square pixel is within the circle
            _ => 1.0,
        };
        let expected = expected * share;
        println!("{optics:?}: {mean} +- {error}, {expected}");
        assert!((mean - expected).abs() < 4.0 * error + 2e-3 * expected, "{optics:?}");
        assert!(error < 0.04 * expected, "{optics:?}: {error}");
    }
}

/// Paths outside the image circle of a fisheye have no segment: layers and MIS weights of the
/// others stay in place.
#[test]
fn layers_of_a_fisheye_are_those_of_its_pixels() {
    let optics =
        Optics::Fisheye { projection: FisheyeProjection::Equidistant, field_of_view: 120.0 };
    let camera = Camera::with_optics(Vec3::ZERO, Vec3::Z, Vec3::Y, optics).unwrap();
    let wall = square(Vec3::new(0.0, 0.0, 2.0), -Vec3::Z, 50.0, 0);
    let scene = scene(vec![wall], vec![gray(0.5, 1.0)], vec![], camera);
    let side = 16;
    let settings = settings(side, side);
    let view = scene.camera.view(side, side);
    let mut paths = bdpm::transport::camera_paths::CameraPaths::default();
    paths.record_aovs(true);
    let accel = accel(&scene);
    let pass = bdpm::transport::camera_paths::CameraPass {
        scene: &scene,
        view,
        accel: &*accel,
        settings: &settings,
        key: bdpm::base::rng::StreamKey::new(1, bdpm::base::rng::Stream::CameraPath, 0),
        gather_early: true,
        hides_lights: false,
        points: None,
        cache: None,
        light_edges: None,
    };
    let ids = (0..side * side).map(|i| bdpm::transport::camera_paths::CameraPathId {
        x: i % side,
        y: i / side,
        index: 0,
    });
    // Twice, so that entries of the first time are left where the second has no segment.
    for _ in 0..2 {
        paths.clear();
        paths.trace(&pass, ids.clone());
        for (index, aov) in paths.aovs.iter().enumerate() {
            let place = |i: u32| f64::from(i) + 0.5 - 0.5 * f64::from(side);
            let (x, y) = (place(index as u32 % side), place(index as u32 / side));
            let radius = x.hypot(y) / (0.5 * f64::from(side));
            if radius > 1.1 {
                assert!(!aov.hits, "{index}");
            } else if radius < 0.9 {
                assert!(aov.hits, "{index}");
                // The distance of the wall, within that of the corners of the pixel.
                let depth = |radius: f64| 2.0 / (radius * PI / 3.0).cos();
                let found = f64::from(aov.depth);
                assert!(
                    depth(radius - 0.1) - 1e-3 < found && found < depth(radius + 0.1),
                    "{index}"
                );
            }
        }
    }
}
