//! Learned visibility of lights: equal means, less noise, and an image that does not depend on the
//! machine.

use crate::common::boxes;
use crate::common::*;
use bdpm::noise::Measure;
use bdpm::settings::{Settings, Strategy};
use bdpm::{Renderer, Scene};
use glam::Vec3;
use std::sync::Arc;

/// A floor below two equal point lights, one of them in a closed black box.
fn boxed_lamp() -> Arc<Scene> {
    let [lit, hidden] = [-0.8, 0.8].map(|x| Vec3::new(x, 0.0, 1.0));
    let mut meshes = vec![square(Vec3::ZERO, Vec3::Z, 2.0, 0)];
    for side in [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z] {
        meshes.push(square(hidden + 0.2 * side, side, 0.2, 1));
    }
    let camera = camera(Vec3::new(0.0, -3.0, 1.5), Vec3::ZERO, 10.0);
    let lamps = [lit, hidden].map(|position| point_light(position, 3.0));
    scene(meshes, vec![gray(0.5, 0.0), gray(0.0, 0.0)], lamps.to_vec(), camera)
}

/// Settings of images of direct light with one connection per path.
fn direct_light(light_visibility: u32) -> Settings {
    let strategy = Strategy::Path;
    Settings { strategy, merge_vertex: 2, camera_paths: 1, light_visibility, ..settings(16, 16) }
}

/// With `e` and `e'` the irradiance from the visible and the hidden lamp, and `p = e/(e + c e')`,
/// the variance is `e^2 (1/p - 1) = c e e'`. The factor `c` is 1 without learning, and the minimum
/// factor with it.
#[test]
fn variance_falls_by_the_factor_of_hidden_lamps_and_the_mean_stays() {
    let (scene, iterations) = (&boxed_lamp(), 200);
    let accel = &accel(scene);
    let measure = |rays| {
        let pixels = pixel_samples(scene, accel, direct_light(rays), iterations);
        let estimates: Vec<_> = pixels.iter().map(|own| Estimate::from_samples(own)).collect();
        let mean = estimates.iter().map(|own| own.mean).sum::<f64>();
        let variance = estimates.iter().map(|own| own.error.powi(2)).sum::<f64>();
        (mean, variance)
    };
    let ((mean, variance), (learned_mean, learned_variance)) = (measure(0), measure(20_000));
    let ratio = learned_variance / variance;
    println!("variance over that without learning: {ratio}");
    // A tenth, in units of 1/255
    let expected = 26.0 / 255.0;
    // The visible lamp is chosen with a probability of about p = 0.91. The relative variance of the
    // sample variance of `n` such choices is (1/(p (1 - p)) - 4)/n.
    let count = (iterations * 256) as f64;
    let error = ((1.0 / (0.91 * 0.09) - 4.0) / count).sqrt();
    assert!((ratio / expected - 1.0).abs() < 4.0 * error + 5e-3, "{ratio} {expected} {error}");
    let off = (learned_mean - mean).abs();
    assert!(off < 4.0 * (variance + learned_variance).sqrt(), "{mean} {learned_mean}");
}

/// All kinds of lights, and surfaces that see some of them only.
#[test]
fn room_under_all_lights_is_the_same_with_learned_visibility() {
    let scene = &boxes::named("all-lights");
    let accel = &accel(scene);
    for strategy in [Strategy::Single, Strategy::Mis, Strategy::Path] {
        let mean = |light_visibility, seed| {
            let own = Settings {
                strategy,
                merge_vertex: if strategy == Strategy::Single { 1 } else { 2 },
                light_paths: 3000,
                light_visibility,
                seed,
                ..settings(12, 12)
            };
            mean_luminance(scene, accel, own, 200)
        };
        let (plain, learned) = (mean(0, 1), mean(30_000, 2));
        let error = plain.error.hypot(learned.error);
        let off = (plain.mean - learned.mean) / error;
        println!("{strategy:?}: {} {}, {off} standard errors", plain.mean, learned.mean);
        assert!(off.abs() < 4.0 && error < 0.01 * plain.mean, "{off} {error}");
    }
}

#[test]
fn learned_visibility_depends_neither_on_threads_nor_on_the_renderer_before() {
    let scene = &boxes::named("all-lights");
    let accel = accel(scene);
    let own = Settings { light_visibility: 20_000, ..settings(12, 12) };
    let image = |renderer: &mut Renderer| {
        renderer.iterate(Measure::Off);
        renderer.film().mean()
    };
    let rendered = |threads, own: &Settings| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| image(&mut Renderer::new(scene, &accel, own.clone()).unwrap()))
    };
    let one = rendered(1, &own);
    assert_eq!(one, rendered(3, &own));
    let without = Settings { light_visibility: 0, ..own.clone() };
    let mut plain = Renderer::new(scene, &accel, without.clone()).unwrap();
    let mut learned = plain.with_settings(own).unwrap();
    assert_eq!(one, image(&mut learned));
    let other = image(&mut plain);
    assert_ne!(one, other);
    assert_eq!(other, image(&mut learned.with_settings(without).unwrap()));
}

#[test]
fn single_lamp_has_nothing_to_learn() {
    let floor = square(Vec3::ZERO, Vec3::Z, 2.0, 0);
    let camera = camera(Vec3::new(0.0, -3.0, 1.5), Vec3::ZERO, 10.0);
    let lamp = point_light(Vec3::Z, 3.0);
    let scene = &scene(vec![floor], vec![gray(0.5, 0.0)], vec![lamp], camera);
    let samples = |rays| pixel_samples(scene, &accel(scene), direct_light(rays), 2);
    assert_eq!(samples(0), samples(20_000));
}
