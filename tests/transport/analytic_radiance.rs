//! The integrator against closed-form answers, each within its own standard error.

use crate::common::*;
use bdpm::base::math::luminance;
use bdpm::base::rng::{Stream, StreamKey};
use bdpm::noise::Measure;
use bdpm::settings::Direct;
use bdpm::transport::camera_paths::{CameraPass, CameraPathId, CameraPaths};
use bdpm::transport::light_paths::LightPaths;
use bdpm::{Renderer, Scene, Settings};
use glam::Vec3;
use std::f64::consts::PI;
use std::sync::Arc;

const BOTH: [Direct; 2] = [Direct::Connect, Direct::PhotonMap];

/// A point light 2 above a plane, seen from the side over a small angle.
fn lit_plane() -> (Arc<Scene>, f64) {
    let plane = square(Vec3::ZERO, Vec3::Z, 4.0, 0);
    let (from, to) = (Vec3::new(3.0, 0.5, 1.5), Vec3::new(0.7, 0.2, 0.0));
    let light = point_light(Vec3::new(0.0, 0.0, 2.0), 10.0);
    let scene = scene(vec![plane], vec![gray(0.6, 0.0)], vec![light], camera(from, to, 2.0));
    // I cos / r^2 * albedo / pi, cos = 2 / r.
    let r2 = f64::from(to.length_squared()) + 4.0;
    (scene, 10.0 * 2.0 / r2.powf(1.5) * 0.6 / PI)
}

#[test]
fn point_light_over_a_plane() {
    let (scene, expected) = lit_plane();
    for direct in BOTH {
        let settings = Settings {
            direct,
            light_paths: 20_000,
            // The kernel's bias is r^2/8 times the Laplacian of the irradiance over its value,
            // which is at most 9/h^2 here (h = 2): 0.03 % at this radius.
            radius: 0.03,
            caustic_radius: 0.03,
            ..settings(4, 4)
        };
        let iterations = if direct == Direct::Connect { 50 } else { 600 };
        let mean = mean_luminance(&scene, &accel(&scene), settings, iterations);
        // The field of view spans 2 degrees: the mean over it differs from the center's radiance
        // in second order only.
        mean.assert_is(expected, 1.5e-3);
    }
}

/// [`lit_plane`] away from the origin, with a second plane at this height above it, turned away if
/// it is negative.
fn lit_layers(height: f32) -> (Arc<Scene>, f64) {
    let origin = Vec3::new(5.0, -7.0, 3.0);
    let layers = vec![
        square(origin, Vec3::Z, 4.0, 0),
        square(origin + height * Vec3::Z, Vec3::Z * height.signum(), 4.0, 0),
    ];
    let (from, to) = (Vec3::new(3.0, 0.5, 1.5), Vec3::new(0.7, 0.2, 0.0));
    let light = point_light(origin + Vec3::new(0.0, 0.0, 2.0), 10.0);
    let camera = camera(origin + from, origin + to, 2.0);
    let (_, expected) = lit_plane();
    (scene(layers, vec![gray(0.6, 0.0)], vec![light], camera), expected)
}

#[test]
fn coincident_layers_do_not_shade_each_other() {
    // Published models have the same face twice, or faces that differ by the rounding of their
    // file. Which of them a camera ray meets is a matter of rounding: a shadow ray must start
    // beyond both. One unit in the last place of the coordinates is 5e-7, and rays start 32 units
    // off.
    for height in [0.0, -0.0, 5e-7, -5e-7, 2e-6, -2e-6, 1e-5, -1e-5] {
        let (scene, expected) = lit_layers(height);
        let settings = Settings { direct: Direct::Connect, ..settings(16, 16) };
        let mean = mean_luminance(&scene, &accel(&scene), settings, 20);
        mean.assert_is(expected, 1.5e-3);
    }
}

const SPHERE_ALBEDO: f32 = 0.5;

/// A point light in the center of a sphere, seen from off the center.
fn integrating_sphere() -> (Arc<Scene>, f64) {
    let wall = sphere(Vec3::new(1.0, 2.0, 3.0), 2.0, 4, true, 0);
    let area = area(&wall);
    let center = Vec3::new(1.0, 2.0, 3.0);
    let eye = center + Vec3::new(0.3, -0.5, 0.2);
    let camera = camera(eye, center + Vec3::new(-1.0, 0.4, 0.1), 100.0);
    let light = point_light(center, 5.0);
    let scene = scene(vec![wall], vec![gray(SPHERE_ALBEDO, 0.0)], vec![light], camera);
    // I / (pi R^2), with the tessellated sphere's area in place of 4 pi R^2: the flux that reaches
    // the walls is exactly 4 pi I in the first place, and albedo times that of the bounce before.
    (scene, 4.0 * 5.0 / area)
}

#[test]
fn integrating_sphere_with_all_bounces() {
    let (scene, unit) = integrating_sphere();
    let albedo = f64::from(SPHERE_ALBEDO);
    for direct in BOTH {
        for merge_vertex in 1..=3 {
            let settings = Settings {
                direct,
                merge_vertex,
                light_paths: 2000,
                camera_paths: 2,
                radius: 0.2,
                caustic_radius: 0.2,
                ..settings(16, 16)
            };
            let mean = mean_luminance(&scene, &accel(&scene), settings, 100);
            // Facets of 2 degrees: their edges widen the kernel's area by less than 1e-3.
            mean.assert_is(albedo / (1.0 - albedo) * unit, 2e-3);
        }
    }
}

#[test]
fn integrating_sphere_bounce_by_bounce_from_the_camera() {
    // Connections at vertex m carry the m-th bounce alone: D(k) - D(k-1) = albedo^k I/(pi R^2).
    let (scene, unit) = integrating_sphere();
    let accel = accel(&scene);
    let direct_light = |merge_vertex: u32| {
        let settings = Settings { merge_vertex, ..settings(64, 64) };
        let pass = CameraPass {
            scene: &scene,
            view: scene.camera.view(64, 64),
            accel: &*accel,
            settings: &settings,
            key: StreamKey::new(1, Stream::CameraPath, 0),
            gather_early: false,
            hides_lights: false,
            points: None,
            cache: None,
            light_edges: None,
        };
        let mut paths = CameraPaths::default();
        let id = |i: u32| CameraPathId { x: i % 64, y: i / 64, index: 0 };
        paths.trace(&pass, (0..64 * 64).map(id));
        paths.direct.iter().map(|d| f64::from(luminance(*d))).collect::<Vec<_>>()
    };
    let mut before = vec![0.0; 64 * 64];
    for bounce in 1..=4 {
        let sums = direct_light(bounce);
        let alone: Vec<f64> = sums.iter().zip(&before).map(|(a, b)| a - b).collect();
        let expected = f64::from(SPHERE_ALBEDO).powi(bounce as i32) * unit;
        Estimate::from_samples(&alone).assert_is(expected, 1e-3);
        before = sums;
    }
}

#[test]
fn integrating_sphere_bounce_by_bounce_from_the_light() {
    // The photons at vertex m carry the flux 4 pi I albedo^(m-1) together.
    let (scene, _) = integrating_sphere();
    let accel = accel(&scene);
    let power = 4.0 * PI * 5.0;
    let mut flux = vec![Vec::new(); 5];
    for iteration in 0..40 {
        let settings = Settings { direct: Direct::PhotonMap, light_paths: 3000, ..settings(1, 1) };
        let mut paths = LightPaths::default();
        paths.trace(&scene, &*accel, &settings, settings.light_paths, iteration);
        let mut sums = [0.0; 5];
        let (mut path, mut vertex) = (u32::MAX, 0);
        let mut photons: Vec<_> = paths.photons().flatten().collect();
        photons.sort_by_key(|photon| photon.path); // stable: vertices stay in order
        for photon in photons {
            vertex = if photon.path == path { vertex + 1 } else { 0 };
            path = photon.path;
            if vertex < sums.len() {
                sums[vertex] += f64::from(luminance(photon.flux)) / 3000.0;
            }
        }
        flux.iter_mut().zip(sums).for_each(|(samples, sum)| samples.push(sum));
    }
    for (vertex, samples) in flux.iter().enumerate() {
        let expected = power * f64::from(SPHERE_ALBEDO).powi(vertex as i32);
        Estimate::from_samples(samples).assert_is(expected, 1e-5);
    }
}

#[test]
fn furnace_with_a_white_ball() {
    // Emitting walls of albedo 0.4 around a ball that absorbs nothing: Le / (1 - albedo) in every
    // pixel, on the ball as on the walls.
    let wall = sphere(Vec3::ZERO, 2.0, 4, true, 0);
    let ball = sphere(Vec3::new(0.4, 0.3, 0.0), 0.6, 4, false, 1);
    let camera = camera(Vec3::new(-1.2, 0.2, 0.4), Vec3::new(0.4, 0.3, 0.0), 60.0);
    let materials = vec![gray(0.4, 3.0), gray(1.0, 0.0)];
    let scene = scene(vec![wall, ball], materials, vec![], camera);
    let expected = 3.0 / (1.0 - 0.4);
    let accel = accel(&scene);
    for direct in BOTH {
        for merge_vertex in 1..=3 {
            let settings = Settings {
                direct,
                merge_vertex,
                light_paths: 10_000,
                camera_paths: 12,
                // On a sphere the kernel has no bias at any radius.
                radius: 0.3,
                caustic_radius: 0.3,
                ..settings(4, 4)
            };
            for samples in pixel_samples(&scene, &accel, settings, 130) {
                Estimate::from_samples(&samples).assert_is(expected, 2e-3);
            }
        }
    }
}

#[test]
fn spherical_light_seen_from_outside() {
    // A sphere of radiance Le and radius R at distance d lights a facing plane with the irradiance
    // pi Le (R/d)^2, wherever the horizon does not cut it.
    let light = sphere(Vec3::new(0.0, 0.0, 3.0), 1.0, 5, false, 0);
    let floor = square(Vec3::ZERO, Vec3::Z, 6.0, 1);
    let camera = camera(Vec3::new(4.0, 0.0, 1.5), Vec3::ZERO, 1.0);
    let scene = scene(vec![light, floor], vec![gray(0.0, 7.0), gray(0.3, 0.0)], vec![], camera);
    let expected = 0.3 * 7.0 / 9.0;
    let accel = accel(&scene);
    for direct in BOTH {
        let (iterations, camera_paths) =
            if direct == Direct::Connect { (200, 32) } else { (700, 4) };
        let settings = Settings {
            direct,
            camera_paths,
            light_paths: 10_000,
            radius: 0.08,
            caustic_radius: 0.08,
            ..settings(4, 4)
        };
        let mean = mean_luminance(&scene, &accel, settings, iterations);
        mean.assert_is(expected, 2e-3);
    }
}

#[test]
fn emission_is_seen_once_from_the_front_only() {
    // A black emitter fills the image: its radiance in every mode; nothing from behind.
    for (normal, expected) in [(Vec3::Z, 2.5), (-Vec3::Z, 0.0)] {
        let panel = square(Vec3::ZERO, normal, 1.0, 0);
        let camera = camera(Vec3::new(0.0, 0.0, 1.0), Vec3::ZERO, 20.0);
        let scene = scene(vec![panel], vec![gray(0.0, 2.5)], vec![], camera);
        let accel = accel(&scene);
        for direct in BOTH {
            for merge_vertex in 1..=3 {
                let settings = Settings { direct, merge_vertex, ..settings(2, 2) };
                let mut renderer = Renderer::new(&scene, &accel, settings).unwrap();
                renderer.iterate(Measure::Off);
                let image = renderer.film().mean();
                assert!(image.iter().all(|c| (c - Vec3::splat(expected)).length() < 1e-6));
            }
        }
    }
}

#[test]
fn every_strategy_gives_the_same_image_up_to_a_bias_that_shrinks_with_the_radius() {
    let scene = furnished_box();
    let accel = accel(&scene);
    let render = |direct, merge_vertex, radius: f32, iterations| {
        let settings = Settings {
            direct,
            merge_vertex,
            radius,
            caustic_radius: radius,
            light_paths: 3000,
            ..settings(16, 16)
        };
        mean_luminance(&scene, &accel, settings, iterations)
    };
    // Late merging at a small radius: all but the third bounce of the image is unbiased.
    let reference = render(Direct::Connect, 3, 0.02, 800);
    for direct in BOTH {
        for merge_vertex in 1..=3 {
            // The kernel loses what lies around the corner: a bias in proportion to the radius.
            let wide = render(direct, merge_vertex, 0.16, 100);
            let narrow = render(direct, merge_vertex, 0.04, 300);
            let (wide_bias, narrow_bias) =
                (wide.mean - reference.mean, narrow.mean - reference.mean);
            let error = 4.0 * (wide.error.hypot(narrow.error).hypot(reference.error));
            assert!(error < 0.02 * reference.mean, "{error} of {}", reference.mean);
            assert!(
                narrow_bias.abs() < 0.35 * wide_bias.abs() + error,
                "{direct:?} {merge_vertex}: {wide_bias} at four times the radius, {narrow_bias}, \
                 +- {error} (4 standard errors)"
            );
            assert!(
                narrow_bias.abs() < 0.03 * reference.mean + error,
                "{direct:?} {merge_vertex}: {narrow_bias} of {}",
                reference.mean
            );
        }
    }
}
