//! Paths that are found in several ways: the weights add up to 1, whatever they are. More furnaces
//! are in `tests/check/mis.rs`.

use crate::common::several_ways::*;
use crate::common::*;
use bdpm::noise::Measure;
use bdpm::scene::bsdf::{Bsdf, Glossy};
use bdpm::scene::{Camera, Emitter, Environment, FieldOfView, Material, Scene, Spot};
use bdpm::settings::{Kernel, Strategy};
use bdpm::{Renderer, Settings};
use glam::Vec3;
use std::sync::Arc;

#[test]
fn diffuse_walls_in_a_furnace_have_its_radiance() {
    let scene = furnace(&[Bsdf::diffuse(Vec3::ONE)], false);
    assert_furnace("walls", &scene, 0.0, (40, 3e-3), (&WAYS[1..], &WEIGHTINGS[..2]));
}

#[test]
fn smooth_objects_in_a_furnace_have_its_radiance() {
    let some = (&WAYS[1..2], &WEIGHTINGS[1..2]);
    assert_furnace("smooth", &smooth_things(), 0.0, (40, 3e-3), some);
}

/// A room that is open above, with a mirror ball, under lights that no ray can hit.
fn room_under_small_lights() -> Arc<Scene> {
    room(Vec3::ZERO, Bsdf::Mirror { reflectance: Vec3::splat(0.8) })
}

/// The room with a glossy ball under lights of all kinds.
fn room_under_all_lights() -> Arc<Scene> {
    let gloss = Bsdf::Glossy(Glossy::new(Vec3::new(0.7, 0.4, 0.3), 0.3, 1.5, 0.5));
    let map = vec![Vec3::splat(0.5), Vec3::new(0.2, 0.4, 2.0)];
    Arc::unwrap_or_clone(room(Vec3::splat(4.0), gloss))
        .with_environment(Environment::new(2, 1, map, 30.0))
        .into()
}

/// The room with a panel of this radiance and a ball.
fn room(panel: Vec3, ball: Bsdf) -> Arc<Scene> {
    let mut meshes = vec![square(-Vec3::Z, Vec3::Z, 1.0, 0)];
    for axis in [Vec3::X, Vec3::Y] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 0));
    }
    meshes.push(square(Vec3::new(-0.5, 0.5, 0.9), -Vec3::Z, 0.2, 1));
    meshes.push(sphere(Vec3::new(0.3, 0.3, -0.6), 0.3, 3, false, 2));
    let spot = Spot {
        position: Vec3::new(0.7, -0.6, 0.8),
        direction: Vec3::new(-0.4, 0.5, -1.0).normalize(),
        intensity: Vec3::new(1.5, 1.0, 0.5),
        cos_inner: 0.95,
        cos_outer: 0.7,
        falloff: bdpm::scene::Falloff::default(),
    };
    let direction = Vec3::new(0.3, 0.2, -1.0).normalize();
    let sun = bdpm::scene::Directional::new(direction, Vec3::splat(1.0));
    let lights = vec![
        Emitter::Spot(spot),
        Emitter::Directional(sun),
        point_light(Vec3::new(-0.5, -0.4, 0.5), 0.4),
    ];
    let eye = Vec3::new(-0.8, -0.85, 0.7);
    let camera = Camera::look(eye, Vec3::new(1.0, 1.0, -1.0), Vec3::Z, FieldOfView::X(75.0));
    let panel = Material { emission: panel, ..gray(0.0, 0.0) };
    let materials = vec![gray(0.6, 0.0), panel, Material::new("ball", ball)];
    scene(meshes, materials, lights, camera.unwrap())
}

#[test]
fn every_weighting_has_the_same_mean_under_all_lights() {
    let scene = room_under_all_lights();
    let settings = Settings {
        kernel: Kernel::Area,
        light_paths: 20_000,
        camera_paths: 8,
        radius: 0.05,
        caustic_radius: 0.03,
        seed: 6,
        ..settings(SIDE, SIDE)
    };
    let iterations = 120;
    let single = tiles(&scene, Settings { merge_vertex: 2, ..settings.clone() }, iterations);
    let value = single.iter().flatten().sum::<f64>() / (TILES * iterations) as f64;
    for weighting in WEIGHTINGS {
        let several = tiles(&scene, weighted(&settings, weighting), iterations);
        let differences: Vec<Vec<f64>> = several
            .iter()
            .zip(&single)
            .map(|(several, single)| several.iter().zip(single).map(|(a, b)| a - b).collect())
            .collect();
        // The resolution limits the standard error alone. Uncut paths and path tracing hardly share
        // samples with `k = 2`, so that noise does not cancel in the differences. With a relative
        // standard deviation of two per path, 120 * 8 * 256 paths have 2/sqrt(245760) = 4e-3.
        // Systematic: the bias of the kernel is not the same at both vertices.
        assert_zero(&format!("{weighting:?}"), &differences, value, 5e-3, 2e-3);
    }
}

/// Images of one iteration, and their greatest relative deviation.
fn deviation(scene: &Arc<Scene>, one: Settings, other: Settings) -> f64 {
    let accel = accel(scene);
    let [one, other] = [one, other].map(|settings| {
        let mut renderer = Renderer::new(scene, &accel, settings).unwrap();
        renderer.iterate(Measure::Off);
        renderer.film().mean()
    });
    let off = one.iter().zip(&other).map(|(a, b)| f64::from((*a - *b).length()));
    let mean = other.iter().map(|b| f64::from(b.length())).sum::<f64>() / other.len() as f64;
    off.fold(0.0, f64::max) / mean
}

#[test]
fn weights_of_one_technique_give_the_images_of_that_strategy() {
    // Light sources that camera paths hit would be one more technique.
    let scene = room_under_small_lights();
    let settings = Settings { light_paths: 20_000, caustic_radius: 0.05, ..settings(SIDE, SIDE) };
    let own = weighted(&settings, (Strategy::CutMis, [0.0, 1.0], 1.0));
    let settings = Settings { splitting: own.splitting, ..settings };
    let second = Settings { merge_vertex: 2, ..settings.clone() };
    let off = deviation(&scene, own, second);
    assert!(off < 1e-5, "k = 2: {off}");
    for strategy in [Strategy::CutMis, Strategy::Mis] {
        let first = weighted(&settings, (strategy, [1e9, 0.0], 1e5));
        let off = deviation(&scene, first, Settings { merge_vertex: 1, ..settings.clone() });
        assert!(off < 1e-3, "k = 1: {off}");
    }
}
