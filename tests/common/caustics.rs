//! A ball and a mirror in a box, whose caustics are merged alone.

use super::far_counts::Subject;
use super::{
    Estimate, accel, camera, gray, mean_luminance, point_light, scene, settings, sphere, square,
};
use bdpm::scene::bsdf::{
    Bsdf, Dielectric, FacetModel, Facets, Plastic, RoughDielectric, ThinDielectric,
};
use bdpm::scene::{Emitter, Material};
use bdpm::settings::{Kernel, MisScales, Strategy};
use bdpm::{Scene, Settings};
use glam::Vec3;
use std::sync::Arc;

/// Settings of photons of caustics, with cells of a cache that have .2 of the width of the box.
pub fn caustics(strategy: Strategy, side: u32) -> Settings {
    let own = Settings { strategy, merge_vertex: 2, light_paths: 8000, ..settings(side, side) };
    Settings { kernel: Kernel::Area, camera_paths: 8, radius: 0.1, caustic_radius: 0.05, ..own }
}

/// A gray box with a ball, under a panel and a point light of this power.
pub fn box_with(ball: Bsdf, point: f32, panel: f32) -> Arc<Scene> {
    let mut meshes = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 0));
    }
    meshes.push(square(Vec3::new(0.0, 0.0, 0.95), -Vec3::Z, 0.3, 1));
    meshes.push(sphere(Vec3::new(0.2, 0.1, -0.4), 0.4, 3, false, 2));
    // A mirror beside a wall passes light on to later vertices, too.
    meshes.push(square(Vec3::new(-0.95, 0.0, 0.0), Vec3::X, 0.5, 3));
    let mirror = Material::new("mirror", Bsdf::Mirror { reflectance: Vec3::splat(0.9) });
    let materials = vec![gray(0.6, 0.0), gray(0.0, panel), Material::new("ball", ball), mirror];
    let lights: Vec<Emitter> = match point > 0.0 {
        true => vec![point_light(Vec3::new(-0.5, -0.4, 0.6), point)],
        false => vec![],
    };
    let camera = camera(Vec3::new(-0.85, -0.9, 0.3), Vec3::new(0.3, 0.2, -0.5), 80.0);
    scene(meshes, materials, lights, camera)
}

/// Name and material of a ball.
pub type Ball = (&'static str, Bsdf);

/// Smooth glass, rough glass and a coat.
pub fn balls() -> [Ball; 3] {
    let facets = Facets { model: FacetModel::Ggx, alpha: 0.1 };
    [
        ("glass", Bsdf::Dielectric(Dielectric::new(1.5))),
        ("rough glass", Bsdf::RoughDielectric(RoughDielectric::new(1.5, 0.1))),
        ("coat", Bsdf::Plastic(Plastic::new(Vec3::new(0.7, 0.4, 0.2), 1.5, facets, true))),
    ]
}

/// Where camera paths find all light, path tracing has the same mean, without any photon. The bias
/// of merges is what is left of caustics at edges, that of the cache less than 2 %.
#[track_caller]
pub fn assert_light_of_panels(balls: &[Ball]) {
    for &(name, ball) in balls {
        let scene = box_with(ball, 0.0, 4.0);
        let accel = accel(&scene);
        let path = Settings { camera_paths: 64, ..caustics(Strategy::Path, 16) };
        let full = mean_luminance(&scene, &accel, path, 150);
        for (strategy, bias) in [(Strategy::PathCaustics, 5e-3), (Strategy::GatherCaustics, 0.02)] {
            let own = mean_luminance(&scene, &accel, caustics(strategy, 16), 150);
            println!("{name} {strategy:?}: {own:?}, path {full:?}");
            let error = full.error.hypot(own.error);
            assert!(error < 0.01 * full.mean, "{name}: {error} says little");
            Estimate { error, ..own }.assert_is(full.mean, bias);
        }
    }
}

/// Light of points comes through glass by photons alone. Photons of all kinds, which are merged at
/// the second vertex, have the same mean.
#[track_caller]
pub fn assert_light_of_points(balls: &[Ball]) {
    for &(name, ball) in balls {
        let scene = box_with(ball, 3.0, 0.0);
        let accel = accel(&scene);
        let single = Settings { light_paths: 40_000, ..caustics(Strategy::Single, 16) };
        let all = mean_luminance(&scene, &accel, single, 150);
        let without = caustics(Strategy::Path, 16);
        let without = mean_luminance(&scene, &accel, without, 50);
        for (strategy, bias) in [(Strategy::PathCaustics, 5e-3), (Strategy::GatherCaustics, 0.02)] {
            let own = mean_luminance(&scene, &accel, caustics(strategy, 16), 150);
            println!("{name} {strategy:?}: {own:?}, all {all:?}, none {without:?}");
            let error = all.error.hypot(own.error);
            Estimate { error, ..own }.assert_is(all.mean, bias);
            let seen = own.mean - without.mean;
            assert!(seen > 5.0 * own.error.hypot(without.error), "{name}: there are caustics");
        }
    }
}

/// Coefficients that were measured at few paths predict the noise at many. Photons that reach the
/// cache are shared by both of its halves: what they add is not seen, and less than the tolerance.
pub fn assert_far_counts(strategy: Strategy) {
    // Light through a thin shell has no focus, whose noise would have heavy tails.
    let scene = &box_with(Bsdf::ThinDielectric(ThinDielectric::new(1.5)), 3.0, 0.0);
    // The law holds for fixed weights.
    let mis_scales = Some(MisScales::new(10_000, 8));
    let settings = Settings { radius: 0.2, caustic_radius: 0.3, ..caustics(strategy, 8) };
    let settings = Settings { mis_scales, ..settings };
    let name = format!("{strategy:?}");
    Subject { name, scene, settings, few: 3000, iterations: 2500, quiet: 0.8, most: 0.03 }
        .assert_far_counts(&[(20_000, 4, 400), (3000, 40, 600)]);
}
