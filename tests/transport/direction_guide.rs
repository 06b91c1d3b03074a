//! Guided directions of camera paths: equal means, less noise, and an image that does not depend on
//! the machine.

use crate::common::boxes;
use crate::common::images::Subject;
use crate::common::*;
use bdpm::noise::Measure;
use bdpm::scene::Material;
use bdpm::scene::bsdf::{Bsdf, FacetModel, Facets, Plastic};
use bdpm::settings::{Settings, Strategy};
use bdpm::{Renderer, Scene};
use glam::Vec3;
use std::sync::Arc;

fn guided(direction_guide: u32) -> Settings {
    let strategy = Strategy::Path;
    Settings { strategy, merge_vertex: 2, camera_paths: 4, direction_guide, ..settings(12, 12) }
}

/// A room with varnished walls whose lamp shines at the wall behind it: all other light is
/// indirect.
fn varnished_room() -> Arc<Scene> {
    let mut meshes = Vec::new();
    for (number, axis) in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().enumerate() {
        meshes.push(square(axis, -axis, 1.0, number as u32));
        meshes.push(square(-axis, axis, 1.0, number as u32));
    }
    meshes.push(square(Vec3::new(0.0, 0.8, 0.5), Vec3::Y, 0.15, 3));
    let varnish = |alpha| {
        let facets = Facets { model: FacetModel::Ggx, alpha };
        let plastic = Plastic::new(Vec3::new(0.6, 0.5, 0.4), 1.5, facets, false);
        Material::new("varnish", Bsdf::Plastic(plastic))
    };
    let materials = vec![varnish(0.1), varnish(0.5), gray(0.6, 0.0), gray(0.0, 20.0)];
    let camera = camera(Vec3::new(-0.8, -0.8, 0.3), Vec3::new(0.3, 0.2, -0.3), 70.0);
    scene(meshes, materials, vec![], camera)
}

/// The reference path tracer shares only the scene.
#[test]
fn guided_paths_have_the_mean_of_the_reference() {
    let scenes = [("varnished", varnished_room()), ("pictures", boxes::named("pictures"))];
    for (name, scene) in &scenes {
        let accel = &accel(scene);
        let settings = &guided(20_000);
        let subject = Subject { scene, accel, settings, region: &[] };
        let sum = |pixels: &[f64]| pixels.iter().sum::<f64>();
        let expected = subject.traced(16_384);
        let found = subject.rendered(settings.clone(), 1600);
        let error = (found.variance_of_sum + expected.variance_of_sum).sqrt();
        let off = (sum(&found.mean) - sum(&expected.mean)) / error;
        println!("{name}: {off} standard errors of {:e}", error / sum(&expected.mean));
        assert!(off.abs() < 4.0 && error < 0.01 * sum(&expected.mean), "{name}: {off}");
    }
}

#[test]
fn guide_lowers_the_variance_where_most_light_comes_from_one_wall() {
    let scene = &varnished_room();
    let accel = &accel(scene);
    let variance = |paths| {
        let pixels = pixel_samples(scene, accel, guided(paths), 200);
        pixels.iter().map(|own| Estimate::from_samples(own).error.powi(2)).sum::<f64>()
    };
    let ratio = variance(40_000) / variance(0);
    println!("variance with the guide over that without: {ratio}");
    assert!(ratio < 0.9, "{ratio}");
}

#[test]
fn guide_depends_neither_on_threads_nor_on_the_renderer_before() {
    let scene = &varnished_room();
    let accel = accel(scene);
    let own = guided(10_000);
    let image = |renderer: &mut Renderer| {
        renderer.iterate(Measure::Off);
        renderer.film().mean()
    };
    let rendered = |threads, own: &Settings| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| image(&mut Renderer::new(scene, &accel, own.clone()).unwrap()))
    };
    let one = rendered(1, &own);
    assert_eq!(one, rendered(2, &own));
    let without = Settings { direction_guide: 0, ..own.clone() };
    let mut plain = Renderer::new(scene, &accel, without.clone()).unwrap();
    let mut guided = plain.with_settings(own.clone()).unwrap();
    assert_eq!(one, image(&mut guided));
    let other = image(&mut plain);
    assert_ne!(one, other);
    assert_eq!(other, image(&mut guided.with_settings(without).unwrap()));
    // A renderer with photons leaves the guide to those that are made from it.
    let merging = Settings { strategy: Strategy::Mis, light_paths: 1000, ..own.clone() };
    let merging = Renderer::new(scene, &accel, merging).unwrap();
    merging.learn_directions();
    assert_eq!(one, image(&mut merging.with_settings(own).unwrap()));
}

#[test]
fn paths_among_photons_have_no_guide() {
    let scene = &varnished_room();
    let own = |direction_guide| Settings {
        strategy: Strategy::Mis,
        light_paths: 1000,
        ..guided(direction_guide)
    };
    let samples = |paths| pixel_samples(scene, &accel(scene), own(paths), 2);
    assert_eq!(samples(0), samples(10_000));
}
