//! The decisive test of materials: in a closed sphere whose walls emit `Le` and reflect the share
//! `rho`, holding only lossless things, the radiance in the air is `Le/(1 - rho)` wherever one
//! looks. Light counted twice, lost emission and errors of the refractive index all show.

use crate::common::white_furnace::{
    EVERY_WAY, assert_invisible_by, assert_sheets_are_invisible, ball, furnace, place,
};
use crate::common::*;
use bdpm::scene::Scene;
use bdpm::scene::bsdf::{
    Bsdf, Coated, Conductor, Dielectric, Glossy, Reflectance, RoughDielectric, ThinDielectric,
};
use bdpm::settings::Kernel;
use glam::Vec3;
use std::sync::Arc;

fn metal(alpha: f32) -> Bsdf {
    Bsdf::Conductor(Conductor::new(Reflectance::Artist { normal: Vec3::ONE }, alpha))
}

fn glass(eta: f32) -> Bsdf {
    Bsdf::Dielectric(Dielectric::new(eta))
}

fn glossy(metallic: f32, alpha: f32) -> Bsdf {
    Bsdf::Glossy(Glossy::new(Vec3::ONE, metallic, 1.5, alpha))
}

/// Whether all pixels see `EXPECTED` less at most `loss` of it, by every strategy.
fn assert_invisible(scene: &Arc<Scene>, loss: f64, iterations: usize) {
    assert_invisible_by(&EVERY_WAY, Kernel::Disc, scene, loss, iterations);
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
    assert_sheets_are_invisible(&EVERY_WAY[..2]);
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
