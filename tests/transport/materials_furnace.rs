//! The decisive test of materials: in a closed sphere whose walls emit `Le` and reflect the share
//! `rho`, holding only lossless things, the radiance in the air is `Le/(1 - rho)` wherever one
//! looks. Light counted twice, lost emission and errors of the refractive index all show.

use crate::common::*;
use bdpm::Settings;
use bdpm::scene::bsdf::{
    Bsdf, Coated, Conductor, Dielectric, DiffuseTransmission, Glossy, Reflectance, RoughDielectric,
    ThinDielectric,
};
use bdpm::scene::{Material, Mesh, Scene};
use bdpm::settings::{Direct, Kernel};
use glam::Vec3;
use std::sync::Arc;

const EMISSION: f32 = 3.0;
const ALBEDO: f32 = 0.4;
const EXPECTED: f64 = 5.0;

fn white(bsdf: Bsdf) -> Material {
    Material::new("white", bsdf)
}

fn metal(alpha: f32) -> Bsdf {
    Bsdf::Conductor(Conductor::new(Reflectance::Artist { normal: Vec3::ONE }, alpha))
}

fn glass(eta: f32) -> Bsdf {
    Bsdf::Dielectric(Dielectric::new(eta))
}

fn glossy(metallic: f32, alpha: f32) -> Bsdf {
    Bsdf::Glossy(Glossy::new(Vec3::ONE, metallic, 1.5, alpha))
}

fn ball(center: Vec3, radius: f32, material: u32) -> Mesh {
    sphere(center, radius, 4, false, material)
}

/// The sphere with `things` of `bsdfs` (materials 1, 2, ...) in it, seen from within.
fn furnace(things: Vec<Mesh>, bsdfs: &[Bsdf]) -> Arc<Scene> {
    let mut meshes = vec![sphere(Vec3::ZERO, 2.0, 4, true, 0)];
    meshes.extend(things);
    let mut materials = vec![gray(ALBEDO, EMISSION)];
    materials.extend(bsdfs.iter().map(|bsdf| white(*bsdf)));
    let camera = camera(Vec3::new(0.0, -1.6, 0.3), Vec3::ZERO, 62.0);
    scene(meshes, materials, vec![], camera)
}

/// A row of balls at `x = -0.75, 0, 0.75` and one of three above it.
fn place(column: i32, row: i32) -> Vec3 {
    Vec3::new(0.75 * column as f32, 0.0, 0.75 * row as f32)
}

/// Whether all pixels see `EXPECTED` less at most `loss` of it, by every strategy.
fn assert_invisible(scene: &Arc<Scene>, loss: f64, iterations: usize) {
    assert_invisible_by(Kernel::Disc, scene, loss, iterations);
}

fn assert_invisible_by(kernel: Kernel, scene: &Arc<Scene>, loss: f64, iterations: usize) {
    let accel = accel(scene);
    for direct in [Direct::Connect, Direct::PhotonMap] {
        for merge_vertex in [1, 2, 3, MIS] {
            let settings = by_way(Settings {
                direct,
                merge_vertex,
                light_paths: 5000,
                camera_paths: 12,
                radius: 0.15,
                caustic_radius: 0.15,
                seed: 2,
                kernel,
                ..settings(6, 6)
            });
            let all = pixel_samples(scene, &accel, settings, iterations);
            let mut image = Estimate { mean: 0.0, error: 0.0 };
            for (pixel, samples) in all.iter().enumerate() {
                let Estimate { mean, error } = Estimate::from_samples(samples);
                let (off, error) = (mean / EXPECTED - 1.0, error / EXPECTED);
                assert!(error < 0.03, "{direct:?} {merge_vertex} {pixel}: {error}");
                assert!(
                    -loss - 4.5 * error < off && off < 1e-3 + 4.5 * error,
                    "{direct:?}, k = {merge_vertex}, pixel {pixel}: off by {off} +- {error}"
                );
                image.mean += off / 36.0;
                image.error = image.error.hypot(error / 36.0);
            }
            // Pixels share light paths: their errors add up in part.
            let Estimate { mean, error } = image;
            assert!(
                -0.5 * loss - 8.0 * error < mean && mean < 8.0 * error,
                "{direct:?}, k = {merge_vertex}: off by {mean} +- {error}"
            );
        }
    }
}

#[test]
fn smooth_surfaces_in_a_furnace_keep_its_radiance() {
    let bsdfs = [
        Bsdf::Mirror { reflectance: Vec3::ONE },
        glass(1.5),
        Bsdf::diffuse(Vec3::ONE),
        Bsdf::Coated(Coated::new(Vec3::ONE, 1.5)),
        Bsdf::ThinDielectric(ThinDielectric::new(1.5)),
        // Water behind the glass, given at the interface.
        glass(1.33 / 1.5),
    ];
    let things = vec![
        ball(place(-1, 0), 0.35, 1),
        ball(place(0, 0), 0.35, 2),
        ball(place(0, 0), 0.2, 3), // in glass
        ball(place(1, 0), 0.35, 3),
        ball(place(-1, 1), 0.35, 4),
        square(place(0, 1), Vec3::new(0.3, 1.0, 0.2), 0.3, 5),
        ball(place(1, 1), 0.35, 2),
        ball(place(1, 1), 0.25, 6), // a drop of water
        ball(place(0, -1), 0.35, 2),
        ball(place(0, -1), 0.2, 4), // a coat in glass
    ];
    // Merging at curved coats takes their transmittance under slightly wrong angles.
    assert_invisible(&furnace(things, &bsdfs), 6e-3, 120);
}

#[test]
fn sheets_in_a_furnace_keep_its_radiance() {
    let sheet = |transmitted: f32| {
        let shares = [1.0 - transmitted, transmitted].map(Vec3::splat);
        Bsdf::DiffuseTransmission(DiffuseTransmission::new(shares[0], shares[1]))
    };
    let things = vec![
        ball(place(-1, 0), 0.35, 1),
        ball(place(0, 0), 0.35, 2),
        square(place(1, 0), Vec3::new(0.3, 1.0, 0.2), 0.3, 3),
        square(place(0, 1), Vec3::new(-0.4, -1.0, 0.5), 0.3, 1),
    ];
    // Discs have a bias at the edges of sheets.
    let scene = furnace(things, &[sheet(0.4), sheet(1.0), sheet(0.8)]);
    assert_invisible_by(Kernel::Area, &scene, 0.0, 1000);
}

#[test]
fn rough_glass_loses_little() {
    // Twice or more 0.9 % of diffuse light, more where it grazes; see `RoughDielectric`.
    let glass = |alpha| Bsdf::RoughDielectric(RoughDielectric::new(1.5, alpha));
    let things = vec![ball(place(0, 0), 0.5, 1), ball(place(1, 1), 0.4, 2)];
    assert_invisible(&furnace(things, &[glass(0.1), glass(0.02)]), 0.12, 70);
}

#[test]
fn rough_metals_in_a_furnace_keep_its_radiance() {
    let things = vec![
        ball(place(-1, 0), 0.35, 1),
        ball(place(0, 0), 0.35, 2),
        ball(place(1, 0), 0.35, 3),
        ball(place(0, 1), 0.35, 4),
    ];
    let bsdfs = [metal(0.0), metal(0.1), metal(0.29), metal(0.8)];
    assert_invisible(&furnace(things, &bsdfs), 1e-2, 100);
}

#[test]
fn glossy_surfaces_in_a_furnace_keep_its_radiance() {
    // Smooth and narrow facets pass through where the base merges; wide ones merge as well.
    let bsdfs = [
        glossy(0.0, 0.0),
        glossy(0.0, 0.1),
        glossy(0.0, 0.29),
        glossy(0.0, 0.5),
        glossy(0.5, 0.15),
        glossy(0.5, 0.8),
    ];
    let place = |i: i32| place(i % 3 - 1, i / 3);
    let things = (0..6).map(|i| ball(place(i), 0.35, i as u32 + 1)).collect();
    assert_invisible(&furnace(things, &bsdfs), 1e-2, 100);
}
