//! Scenes with all kinds of surfaces, whose camera paths end at a cache of light.

use super::klems::uneven;
use super::{
    Estimate, accel, camera, furnished_box, gray, mean_luminance, scene, settings, square,
};
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
pub fn gathering(side: u32) -> Settings {
    let strategy = Strategy::Gather;
    let own = Settings { strategy, merge_vertex: 2, light_paths: 4000, ..settings(side, side) };
    Settings { camera_paths: 8, radius: 0.1, ..own }
}

/// A box whose walls are of this kind, and of gray.
pub fn box_of(bsdf: Bsdf) -> Arc<Scene> {
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
pub fn coat(alpha: f32) -> Bsdf {
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

/// Name and scene.
pub type Case = (&'static str, Arc<Scene>);

/// Number of the scenes that `make test` renders. `make check` renders the others.
pub const SHORT: usize = 5;

/// Scenes with all kinds of surfaces.
pub fn scenes() -> Vec<Case> {
    let sheet = DiffuseTransmission::new(Vec3::splat(0.5), Vec3::splat(0.2));
    let glossy = Glossy::new(Vec3::splat(0.7), 0.3, 1.5, 0.2);
    let walls = [
        ("narrow coats", coat(0.15)),
        ("narrow principled surfaces", principled(0.4, 0.3)),
        ("sheets that transmit", Bsdf::DiffuseTransmission(sheet)),
        ("smooth coats", coat(0.0)),
        ("wide coats", coat(0.5)),
        ("wide principled surfaces", principled(0.8, 0.0)),
        ("glossy surfaces", Bsdf::Glossy(glossy)),
        ("blinds", uneven(0.9, Vec3::Z)),
    ];
    let walls = walls.map(|(name, bsdf)| (name, box_of(bsdf)));
    let diffuse = [("diffuse walls", furnished_box()), ("thin bodies", divided_box())];
    diffuse.into_iter().chain(walls).collect()
}

/// Cells of this size change the mean by less than 2 %: records and look-ups of all kinds of
/// surfaces agree with full paths.
#[track_caller]
pub fn assert_cached_light(scenes: &[Case]) {
    for (name, scene) in scenes {
        let accel = accel(scene);
        let path = Settings { strategy: Strategy::Path, camera_paths: 32, ..gathering(16) };
        let full = mean_luminance(scene, &accel, path, 60);
        let short = mean_luminance(scene, &accel, gathering(16), 150);
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
#[track_caller]
pub fn assert_suffix_paths(scenes: &[Case]) {
    for (name, scene) in scenes {
        let accel = accel(scene);
        let path = Settings { strategy: Strategy::Path, camera_paths: 32, ..gathering(16) };
        let full = mean_luminance(scene, &accel, path, 100);
        // The shortest segment that ends at a cache is shorter than most.
        let bad = Settings { radius: 0.18, light_paths: 8000, ..gathering(16) };
        let [mean, bias] = mean_and_bias(scene, bad, 100);
        println!("{name}: {full:?}, cached {mean:?}, added {bias:?}");
        let error = full.error.hypot(mean.error).hypot(bias.error);
        Estimate { mean: mean.mean - bias.mean, error }.assert_is(full.mean, 0.0);
    }
}
