//! Camera paths that end at a cache of light.

use crate::common::far_counts::Subject;
use crate::common::klems::uneven;
use crate::common::*;
use bdpm::film::radiance::luminance;
use bdpm::noise::Measure;
use bdpm::scene::Material;
use bdpm::scene::bsdf::{
    Bsdf, DiffuseTransmission, FacetModel, Facets, Glossy, Plastic, Principled,
    PrincipledParameters,
};
use bdpm::settings::{Bias, Strategy};
use bdpm::transport::photon::PhotonClass;
use bdpm::{Renderer, Scene, Settings};
use glam::Vec3;
use std::sync::Arc;

/// Settings of a cache whose cells have .2 of the width of the box.
fn gathering(side: u32) -> Settings {
    let strategy = Strategy::Gather;
    let own = Settings { strategy, merge_vertex: 2, light_paths: 4000, ..settings(side, side) };
    Settings { camera_paths: 8, radius: 0.1, ..own }
}

/// A box whose walls are of this kind, and of gray.
fn box_of(bsdf: Bsdf) -> Arc<Scene> {
    let mut meshes = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 1));
    }
    meshes.push(square(Vec3::new(0.0, 0.0, 0.95), -Vec3::Z, 0.3, 2));
    let own = Material { bsdf, ..gray(0.5, 0.0) };
    let camera = camera(Vec3::new(-0.9, -0.85, 0.2), Vec3::new(0.3, 0.2, -0.5), 80.0);
    scene(meshes, vec![own, gray(0.7, 0.0), gray(0.0, 4.0)], vec![], camera)
}

/// A box that a thin body of cloth divides, the lamp above it and the camera below. The inside of
/// its lower face and the outside of its upper one have the same place and normal.
fn divided_box() -> Arc<Scene> {
    let mut meshes = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.extend([axis, -axis].map(|side| square(side, -side, 1.0, 0)));
    }
    meshes.push(square(Vec3::new(0.0, 0.0, 0.95), -Vec3::Z, 0.3, 1));
    for (height, normal) in [(0.5, -Vec3::Z), (0.501, Vec3::Z)] {
        meshes.push(square(Vec3::new(0.0, 0.0, height), normal, 1.0, 2));
    }
    let cloth = Material { opacity: Some(0.5), ..gray(0.95, 0.0) };
    let camera = camera(Vec3::new(-0.9, -0.85, 0.2), Vec3::new(0.3, 0.2, -0.5), 80.0);
    scene(meshes, vec![gray(0.6, 0.0), gray(0.0, 40.0), cloth], vec![], camera)
}

/// A coat of this width over a colored base.
fn coat(alpha: f32) -> Bsdf {
    let facets = Facets { model: FacetModel::Ggx, alpha };
    Bsdf::Plastic(Plastic::new(Vec3::new(0.8, 0.5, 0.2), 1.5, facets, true))
}

fn principled(roughness: f32, metallic: f32) -> Bsdf {
    let base_color = Vec3::new(0.8, 0.5, 0.2);
    let own = PrincipledParameters {
        base_color,
        roughness,
        metallic,
        clearcoat: 0.5,
        ..Default::default()
    };
    Bsdf::Principled(Principled::new(own))
}

fn scenes() -> Vec<(&'static str, Arc<Scene>)> {
    let sheet = DiffuseTransmission::new(Vec3::splat(0.5), Vec3::splat(0.2));
    let glossy = Glossy::new(Vec3::splat(0.7), 0.3, 1.5, 0.2);
    let walls = [
        ("smooth coats", coat(0.0)),
        ("narrow coats", coat(0.15)),
        ("wide coats", coat(0.5)),
        ("wide principled surfaces", principled(0.8, 0.0)),
        ("narrow principled surfaces", principled(0.4, 0.3)),
        ("glossy surfaces", Bsdf::Glossy(glossy)),
        ("blinds", uneven(0.9, Vec3::Z)),
        ("sheets that transmit", Bsdf::DiffuseTransmission(sheet)),
    ];
    let walls = walls.map(|(name, bsdf)| (name, box_of(bsdf)));
    let diffuse = [("diffuse walls", furnished_box()), ("thin bodies", divided_box())];
    diffuse.into_iter().chain(walls).collect()
}

/// Cells of this size change the mean by less than 2 %: records and look-ups of all kinds of
/// surfaces agree with full paths.
#[test]
fn cached_light_is_that_of_full_paths() {
    for (name, scene) in scenes() {
        let accel = accel(&scene);
        let path = Settings { strategy: Strategy::Path, camera_paths: 32, ..gathering(16) };
        let full = mean_luminance(&scene, &accel, path, 60);
        let short = mean_luminance(&scene, &accel, gathering(16), 150);
        println!("{name}: {full:?}, cached {short:?}");
        let error = full.error.hypot(short.error);
        Estimate { error, ..short }.assert_is(full.mean, 0.02);
    }
}

/// Mean luminance of an image, and what it says that its cache adds.
fn mean_and_bias(scene: &Arc<Scene>, settings: Settings, iterations: u64) -> [Estimate; 2] {
    let accel = accel(scene);
    let settings = Settings { bias: Bias::Reduce, ..settings };
    let (mut means, mut biases) = (Vec::new(), Vec::new());
    for seed in 0..iterations {
        let own = Settings { seed, ..settings.clone() };
        let mut renderer = Renderer::new(scene, &accel, own).unwrap();
        renderer.iterate(Measure::Off);
        means.push(renderer.film().mean_luminance());
        let annulus = renderer.block().statistics.annulus.as_ref().unwrap();
        let sums = annulus.folds().iter().map(|fold| {
            let rows = fold.map_rows(|own| {
                luminance(own.classes[PhotonClass::Diffuse as usize].sum.as_dvec3())
            });
            rows.iter().sum::<f64>()
        });
        biases.push(sums.sum::<f64>() / renderer.settings().pixels() as f64);
    }
    [means, biases].map(|samples| Estimate::from_samples(&samples))
}

/// Cells as wide as a third of the box are a planted fault: the image is wrong by many standard
/// errors, and the suffix paths say by how much.
#[test]
fn suffix_paths_tell_what_a_bad_cache_adds() {
    for (name, scene) in scenes() {
        let accel = accel(&scene);
        let path = Settings { strategy: Strategy::Path, camera_paths: 32, ..gathering(16) };
        let full = mean_luminance(&scene, &accel, path, 100);
        // The shortest segment that ends at a cache is shorter than most.
        let bad = Settings { radius: 0.18, light_paths: 8000, ..gathering(16) };
        let [mean, bias] = mean_and_bias(&scene, bad, 100);
        println!("{name}: {full:?}, cached {mean:?}, added {bias:?}");
        let error = full.error.hypot(mean.error).hypot(bias.error);
        Estimate { mean: mean.mean - bias.mean, error }.assert_is(full.mean, 0.0);
    }
}

/// Coefficients that were measured at few paths predict the noise at many, as with photons, once
/// the paths fill the cache.
#[test]
fn noise_of_a_cache_is_predicted_at_far_counts() {
    let settings = Settings { radius: 0.2, ..gathering(12) };
    let (name, scene) = ("cache".into(), &furnished_box());
    Subject { name, scene, settings, few: 3000, iterations: 2500, quiet: 1.0, most: 0.05 }
        .assert_far_counts(&[(30_000, 4, 130), (3000, 100, 500), (10_000, 25, 250)]);
}

/// The cache is filled by batches of a fixed size, and its cells are sums in a fixed order.
#[test]
fn images_do_not_depend_on_the_number_of_threads() {
    let scene = box_of(coat(0.15));
    let render = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let own = Settings { bias: Bias::Reduce, ..gathering(40) };
            let mut renderer = Renderer::new(&scene, &accel(&scene), own).unwrap();
            (0..4).for_each(|_| drop(renderer.iterate(Measure::Pairs)));
            renderer.block().clone()
        })
    };
    let (one, three) = (render(1), render(3));
    assert!(one.film == three.film && one.statistics == three.statistics);
}
