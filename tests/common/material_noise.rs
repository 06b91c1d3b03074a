//! Whether the noise in a room with a ball of some material is what formula (1) predicts from other
//! counts.

use crate::common::klems::uneven;
use crate::common::*;
use bdpm::noise::Measure;
use bdpm::render::RenderConfig;
use bdpm::scene::bsdf::{
    Bsdf, Coated, Conductor, Dielectric, DiffuseTransmission, Glossy, Reflectance, RoughDielectric,
    ThinDielectric,
};
use bdpm::scene::{Material, Scene};
use bdpm::{Renderer, Settings};
use glam::Vec3;
use std::sync::Arc;

/// All materials, by name.
pub fn materials() -> Vec<(&'static str, Bsdf)> {
    let rough_gold = |alpha| Conductor::new(Reflectance::named("gold").unwrap(), alpha);
    vec![
        ("mirror", Bsdf::Mirror { reflectance: Vec3::splat(0.9) }),
        ("glass", Bsdf::Dielectric(Dielectric::new(1.5))),
        ("thin glass", Bsdf::ThinDielectric(ThinDielectric::new(1.5))),
        ("narrow gold", Bsdf::Conductor(rough_gold(0.15))),
        ("wide gold", Bsdf::Conductor(rough_gold(0.5))),
        // At a roughness of .2, connections of narrow lobes with the point are so rare and bright
        // that a minute of paths leaves an error of 4 % in the noise.
        ("rough glass", Bsdf::RoughDielectric(RoughDielectric::new(1.5, 0.5))),
        (
            "sheet",
            Bsdf::DiffuseTransmission(DiffuseTransmission::new(
                Vec3::new(0.3, 0.2, 0.1),
                Vec3::new(0.4, 0.5, 0.6),
            )),
        ),
        ("blinds", uneven(0.9, Vec3::Z)),
        ("coat", Bsdf::Coated(Coated::new(Vec3::new(0.7, 0.3, 0.2), 1.5))),
        ("gloss", Bsdf::Glossy(Glossy::new(Vec3::new(0.7, 0.3, 0.2), 0.3, 1.5, 0.15))),
    ]
}

/// A closed box with a ball of `bsdf` in it, lit by a panel as wide as the ceiling and a point.
fn room(bsdf: Bsdf) -> Arc<Scene> {
    let mut meshes = vec![sphere(Vec3::new(0.1, 0.2, -0.5), 0.45, 4, false, 1)];
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 0));
    }
    meshes.push(square(Vec3::new(0.0, 0.0, 0.95), -Vec3::Z, 0.8, 2));
    let materials = vec![gray(0.5, 0.0), Material::new("dark", bsdf), gray(0.0, 4.0)];
    let lights = vec![point_light(Vec3::new(-0.6, -0.3, 0.5), 0.2)];
    scene(
        meshes,
        materials,
        lights,
        camera(Vec3::new(-0.9, -0.8, 0.2), Vec3::new(0.1, 0.2, -0.6), 70.0),
    )
}

/// Asserts it of one material.
pub fn assert_predicted(name: &str) {
    let bsdf = materials().into_iter().find(|(other, _)| *other == name);
    let scene = room(bsdf.unwrap_or_else(|| panic!("no material {name}")).1);
    let accel = accel(&scene);
    let measure = |light_paths, camera_paths, seed, iterations| {
        let settings = Settings {
            merge_vertex: 2,
            light_paths,
            camera_paths,
            radius: 0.25,
            caustic_radius: 0.25,
            seed,
            ..settings(8, 8)
        };
        let renderer = Renderer::new(&scene, &accel, settings).unwrap();
        let mut renderer = renderer.configure(RenderConfig::with_pixel_batches()).unwrap();
        for _ in 0..iterations {
            renderer.iterate(Measure::Pairs);
        }
        renderer.block().noise_image().unwrap()
    };
    let region: Vec<usize> = (0..64).collect();
    // The mean over pixels: one path into the caustic of a ball may be a tenth of the pooled
    // variance.
    let predicted = measure(500, 8, 1, 1200).mean_rms(&region, 3000.0, 20.0);
    let sampled = measure(3000, 20, 2, 1000).sampled_mean_rms(&region);
    let error = predicted.error.hypot(sampled.error) / sampled.value;
    let off = predicted.value / sampled.value - 1.0;
    println!("{name}: {:.4}, {off:+.4} +- {error:.4}", sampled.value);
    assert!(2.0 * error < 0.03, "{name}: two standard errors are {:.4}", 2.0 * error);
    assert!(off.abs() < 0.03, "{name}: off by {off:+.4} +- {error:.4}");
}
