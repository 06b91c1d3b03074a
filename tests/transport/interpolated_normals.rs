//! Interpolated normals: the same light by every strategy, none through a surface, and no black
//! edges.

use crate::common::*;
use bdpm::Settings;
use bdpm::scene::bsdf::{Bsdf, Coated, DiffuseTransmission, Glossy};
use bdpm::scene::{Material, Mesh, Scene};
use bdpm::settings::Direct;
use glam::{Vec2, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

const BOTH: [Direct; 2] = [Direct::Connect, Direct::PhotonMap];
/// Interpolated normal of the floor z = 0: far off its geometric normal.
const TILTED: Vec3 = Vec3::new(0.6, 0.0, 0.8);

fn tilted_floor() -> Mesh {
    Mesh { normals: vec![TILTED; 4], ..square(Vec3::ZERO, Vec3::Z, 4.0, 0) }
}

#[test]
fn direct_light_goes_by_the_interpolated_normal() {
    let (from, to) = (Vec3::new(3.0, 0.5, 1.5), Vec3::new(0.7, 0.2, 0.0));
    let position = Vec3::new(0.0, 0.0, 2.0);
    let light = point_light(position, 10.0);
    let scene =
        scene(vec![tilted_floor()], vec![gray(0.6, 0.0)], vec![light], camera(from, to, 2.0));
    let to_light = position - to;
    let cos = f64::from(TILTED.dot(to_light.normalize()));
    let expected = 10.0 * cos / f64::from(to_light.length_squared()) * 0.6 / PI;
    for direct in BOTH {
        let settings = Settings {
            direct,
            light_paths: 20_000,
            radius: 0.04,
            caustic_radius: 0.04,
            ..settings(4, 4)
        };
        let iterations = if direct == Direct::Connect { 50 } else { 400 };
        mean_luminance(&scene, &accel(&scene), settings, iterations).assert_is(expected, 3e-3);
    }
}

#[test]
fn light_paths_and_camera_paths_agree_on_every_bounce() {
    // Seen is a wall that the floor lights; the lamp lights both.
    for bsdf in [
        Bsdf::diffuse(Vec3::splat(0.9)),
        Bsdf::DiffuseTransmission(DiffuseTransmission::new(Vec3::splat(0.6), Vec3::splat(0.3))),
        Bsdf::Coated(Coated::new(Vec3::splat(0.9), 1.5)),
        Bsdf::Glossy(Glossy::new(Vec3::splat(0.9), 0.2, 1.5, 0.0)),
        Bsdf::Glossy(Glossy::new(Vec3::splat(0.9), 0.2, 1.5, 0.4)),
        Bsdf::Glossy(Glossy::new(Vec3::splat(0.9), 1.0, 1.5, 0.8)),
    ] {
        let floor = Material::new("floor", bsdf);
        let wall = square(Vec3::new(-2.0, 0.0, 0.0), Vec3::X, 4.0, 1);
        let camera = camera(Vec3::new(2.0, 0.3, 1.2), Vec3::new(-2.0, 0.0, 1.2), 20.0);
        let lights = vec![point_light(Vec3::new(-0.5, 0.5, 1.5), 10.0)];
        let materials = vec![floor, gray(0.7, 0.0)];
        let scene = scene(vec![tilted_floor(), wall], materials, lights, camera);
        let accel = accel(&scene);
        let mean = |direct, merge_vertex| {
            let settings = by_way(Settings {
                direct,
                merge_vertex,
                light_paths: 10_000,
                camera_paths: 8,
                radius: 0.1,
                caustic_radius: 0.1,
                seed: u64::from(merge_vertex),
                ..settings(8, 8)
            });
            mean_luminance(&scene, &accel, settings, 150)
        };
        let reference = mean(Direct::Connect, 2);
        for (direct, merge_vertex) in [
            (Direct::Connect, 1),
            (Direct::Connect, 3),
            (Direct::PhotonMap, 1),
            (Direct::PhotonMap, 2),
            (Direct::Connect, MIS),
        ] {
            let other = mean(direct, merge_vertex);
            let error = other.error.hypot(reference.error);
            assert!(error < 4e-3 * reference.mean, "{error} of {}", reference.mean);
            let off = other.mean - reference.mean;
            assert!(
                off.abs() < 4.0 * error + 1e-3 * reference.mean,
                "{bsdf:?} {direct:?} {merge_vertex}: {other:?}, not {reference:?}"
            );
        }
    }
}

/// A ball of 80 triangles that looks round.
fn coarse_ball(material: u32) -> Mesh {
    let mesh = sphere(Vec3::ZERO, 1.0, 1, false, material);
    Mesh { normals: mesh.positions.clone(), ..mesh }
}

fn ball_scene(light: Vec3) -> Arc<Scene> {
    let camera = camera(Vec3::new(0.0, 0.0, 8.0), Vec3::ZERO, 18.0);
    let lights = vec![point_light(light, 50.0)];
    scene(vec![coarse_ball(0)], vec![gray(0.8, 0.0)], lights, camera)
}

#[test]
fn no_edge_is_black_and_no_light_leaks() {
    // Lit from the camera's side each pixel on the ball is lit, also where normals look away.
    let lit = ball_scene(Vec3::new(0.0, 0.0, 20.0));
    let settings = Settings { camera_paths: 64, ..settings(24, 24) };
    let values = |scene: &Arc<Scene>| pixel_samples(scene, &accel(scene), settings.clone(), 1);
    let (mut on_ball, mut rim) = (0, 0);
    for (pixel, samples) in values(&lit).iter().enumerate() {
        let at = Vec2::new((pixel % 24) as f32, (pixel / 24) as f32) - 11.5;
        // The ball's outline lies at 9.4 pixels or, at its edges, a little inside.
        if at.length() < 8.5 {
            assert!(samples[0] > 0.0, "{at}");
            on_ball += 1;
            rim += usize::from(at.length() > 7.5);
        }
    }
    assert!(on_ball > 200 && rim > 30, "{on_ball} {rim}");
    // From straight behind it nothing is.
    let dark = ball_scene(Vec3::new(0.0, 0.0, -20.0));
    assert!(values(&dark).iter().all(|samples| samples[0] == 0.0));
}
