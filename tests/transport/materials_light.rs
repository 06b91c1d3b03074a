//! Light that materials send on: the caustic of a glass ball against optics by hand and by every
//! strategy, a lamp in rough metal, and the noise of each material against its prediction.

use crate::common::material_noise::assert_predicted;
use crate::common::*;
use bdpm::Settings;
use bdpm::base::math::luminance;
use bdpm::scene::bsdf::{Bsdf, Conductor, Dielectric, Reflectance};
use bdpm::scene::{Material, Scene};
use bdpm::settings::{Direct, Strategy};
use bdpm::transport::light_paths::LightPaths;
use glam::{DVec2, Vec3};
use std::f64::consts::PI;
use std::sync::Arc;

fn dark(bsdf: Bsdf) -> Material {
    Material::new("dark", bsdf)
}

const GLASS: Bsdf = Bsdf::Dielectric(Dielectric::new(1.5));
/// A glass ball of radius 1 around the origin: the light is above it, the floor below.
const LIGHT: f64 = 3.0;
const FLOOR: f64 = -1.5;
const INTENSITY: f64 = 5.0;

fn glass_ball(floor_albedo: f32) -> Arc<Scene> {
    let meshes = vec![
        sphere(Vec3::ZERO, 1.0, 5, false, 1),
        square(Vec3::new(0.0, 0.0, FLOOR as f32), Vec3::Z, 40.0, 0),
    ];
    let light = point_light(Vec3::new(0.0, 0.0, LIGHT as f32), INTENSITY as f32);
    let camera = camera(Vec3::new(3.0, 0.0, -1.0), Vec3::new(0.0, 0.0, FLOOR as f32), 14.0);
    scene(meshes, vec![gray(floor_albedo, 0.0), dark(GLASS)], vec![light], camera)
}

/// Flux that reaches the floor within `radius` of the axis, W, by way of the ball: rays in a plane
/// through the axis, split at each of its surfaces by Fresnel's formula.
fn caustic_flux(radius: f64) -> f64 {
    let n = 20_000;
    let edge = (1.0 / LIGHT).asin();
    let mut flux = 0.0;
    for i in 0..n {
        let angle = edge * (f64::from(i) + 0.5) / f64::from(n);
        let ring = 2.0 * PI * angle.sin() * edge / f64::from(n) * INTENSITY;
        let eye = DVec2::new(0.0, LIGHT);
        let mut direction = DVec2::new(angle.sin(), -angle.cos());
        let along = -eye.dot(direction);
        let mut point = eye + direction * (along - (1.0 - LIGHT * LIGHT + along * along).sqrt());
        let (mut share, mut inside) = (1.0, false);
        while share > 1e-6 {
            let normal = if inside { -point } else { point };
            let cos = -direction.dot(normal);
            let eta: f64 = if inside { 1.0 / 1.5 } else { 1.5 };
            let cos_t = (1.0 - (1.0 - cos * cos) / (eta * eta)).max(0.0).sqrt();
            let s = (cos - eta * cos_t) / (cos + eta * cos_t);
            let p = (eta * cos - cos_t) / (eta * cos + cos_t);
            let reflected = 0.5 * (s * s + p * p);
            let mirror = direction + 2.0 * cos * normal;
            let through = direction / eta + (cos / eta - cos_t) * normal;
            // Light that leaves the ball, and light that goes on inside it.
            let (out, out_share, inner, inner_share) = if inside {
                (through, 1.0 - reflected, mirror, reflected)
            } else {
                (mirror, reflected, through, 1.0 - reflected)
            };
            if out.y < 0.0 {
                let hit = point + out * ((FLOOR - point.y) / out.y);
                if hit.x.abs() < radius {
                    flux += ring * share * out_share;
                }
            }
            share *= inner_share;
            // Rounding would grow from bounce to bounce.
            direction = inner.normalize();
            point = (point - 2.0 * point.dot(direction) * direction).normalize();
            inside = true;
        }
    }
    flux
}

#[test]
fn a_glass_ball_focuses_the_flux_that_optics_says() {
    let scene = glass_ball(0.0);
    let accel = accel(&scene);
    for radius in [0.3, 0.6, 3.0] {
        let mut samples = Vec::new();
        for iteration in 0..60 {
            // With connections, the photons are those of the caustic alone.
            let settings = Settings { direct: Direct::Connect, ..settings(1, 1) };
            let mut paths = LightPaths::default();
            paths.trace(&scene, &*accel, &settings, 20_000, iteration);
            let on_floor = paths
                .photons()
                .flatten()
                .filter(|photon| f64::from(photon.position.truncate().length()) < radius);
            let flux: f64 = on_floor.map(|photon| f64::from(luminance(photon.flux))).sum();
            samples.push(flux / 20_000.0);
        }
        // The ball's 20480 facets are inclined to the sphere by up to 0.7 degrees.
        Estimate::from_samples(&samples).assert_is(caustic_flux(radius), 5e-3);
    }
}

#[test]
fn the_caustic_is_the_same_by_every_strategy() {
    let scene = glass_ball(0.5);
    let accel = accel(&scene);
    // Extrapolated to radius 0, the bias being in proportion to its square.
    let extrapolated = |direct, merge_vertex| {
        let at = |radius: f32| {
            let settings = Settings {
                direct,
                merge_vertex,
                radius,
                light_paths: 20_000,
                seed: 1000 + u64::from(merge_vertex) + (1000.0 * radius) as u64,
                ..settings(8, 8)
            };
            mean_luminance(&scene, &accel, settings, 280)
        };
        let (wide, narrow) = (at(0.2), at(0.1));
        Estimate {
            mean: (4.0 * narrow.mean - wide.mean) / 3.0,
            error: (4.0 * narrow.error).hypot(wide.error) / 3.0,
        }
    };
    let reference = extrapolated(Direct::Connect, 2);
    for (direct, merge_vertex) in
        [(Direct::Connect, 1), (Direct::PhotonMap, 1), (Direct::PhotonMap, 2), (Direct::Connect, 3)]
    {
        let other = extrapolated(direct, merge_vertex);
        let error = other.error.hypot(reference.error);
        println!("{direct:?} {merge_vertex}: {other:?}, {reference:?}");
        assert!(error < 0.02 * reference.mean, "{error} of {}", reference.mean);
        assert!(
            (other.mean - reference.mean).abs() < 4.0 * error,
            "{direct:?} {merge_vertex}: {other:?}, not {reference:?}"
        );
    }
}

/// Paths that end at a lamp in rough metal are connected, hit, and weighted by every strategy. No
/// photon has a part in them, so that all images are those of `mis` to the last bit.
#[test]
fn a_small_lamp_in_rough_metal_is_sampled_alike_by_every_strategy() {
    let silver = Reflectance::Artist { normal: Vec3::new(0.9, 0.8, 0.6) };
    let metal = dark(Bsdf::Conductor(Conductor::new(silver, 0.15)));
    let meshes = vec![
        square(Vec3::ZERO, Vec3::Z, 4.0, 0),
        square(Vec3::new(0.0, 2.0, 2.0), Vec3::new(0.0, -1.0, -1.0).normalize(), 0.03, 1),
    ];
    let camera = camera(Vec3::new(0.0, -2.0, 2.0), Vec3::ZERO, 40.0);
    let scene = scene(meshes, vec![metal, gray(0.0, 100.0)], vec![], camera);
    let accel = accel(&scene);
    let samples = |strategy, direct, merge_vertex| {
        let settings = Settings { strategy, direct, merge_vertex, seed: 5, ..settings(16, 16) };
        pixel_samples(&scene, &accel, settings, 100)
    };
    let expected = samples(Strategy::CutMis, Direct::Connect, 2);
    for (strategy, direct, merge_vertex) in [
        (Strategy::Single, Direct::Connect, 1),
        (Strategy::Single, Direct::Connect, 2),
        (Strategy::Single, Direct::PhotonMap, 1),
    ] {
        let found = samples(strategy, direct, merge_vertex);
        assert!(found == expected, "{strategy:?} {direct:?} {merge_vertex}");
    }
    // Paths that go on are shaded in packets, and take other numbers.
    let mean = |samples: &[Vec<f64>]| {
        let image = |iteration: usize| samples.iter().map(|own| own[iteration]).sum::<f64>();
        Estimate::from_samples(&(0..100).map(image).collect::<Vec<_>>())
    };
    let expected = mean(&expected);
    assert!(expected.error < 0.005 * expected.mean, "says little: {expected:?}");
    for strategy in [Strategy::Mis, Strategy::Path] {
        let own = mean(&samples(strategy, Direct::Connect, 2));
        Estimate { error: expected.error.hypot(own.error), ..expected }.assert_is(own.mean, 0.0);
    }
}

#[test]
fn the_noise_of_glass_and_gloss_is_predicted() {
    for name in ["glass", "gloss"] {
        assert_predicted(name);
    }
}
