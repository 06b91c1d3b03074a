//! The renderer against the path tracer, which shares nothing of the transport with it: the same
//! images within noise, after the merge bias has been taken out by two radii.

mod common;

use bdpm::bsdf::{
    Bsdf, Coated, Conductor, Dielectric, Reflectance, RoughDielectric, ThinDielectric,
};
use bdpm::scene::{Material, Scene};
use bdpm::settings::{Direct, Settings};
use common::images::{Difference, Pixels};
use common::*;
use glam::Vec3;

const SIDE: u32 = 12;

/// Strategies against the path tracer: each pixel, and the whole image.
fn assert_same(name: &str, scene: &Scene, strategies: &[(Direct, u32)]) {
    let accel = accel(scene);
    let expected = Pixels::traced(scene, &*accel, &settings(SIDE, SIDE), 16_384);
    for &(direct, merge_vertex) in strategies {
        let settings = Settings {
            direct,
            merge_vertex,
            light_paths: 40_000,
            camera_paths: 16,
            radius: 0.04,
            seed: 3,
            ..settings(SIDE, SIDE)
        };
        let found = Pixels::extrapolated(scene, &*accel, &settings, 60);
        let Difference { off, error, z2 } = found.against(&expected);
        println!("{name} {direct:?} k = {merge_vertex}: {off:.5} +- {error:.5}, z^2 {z2:.2}");
        assert!(error < 0.008, "{name} {direct:?} {merge_vertex}: {error}");
        // Along edges the kernel loses area in proportion to the radius, which two radii do not
        // take out: about 0.2 (sqrt(2) - 1) times the share of the surfaces within a radius.
        assert!(off.abs() < 4.0 * error + 5e-3, "{name} {direct:?} {merge_vertex}: {off}");
        // Heavy tails: 144 squares of about 1 scatter by more than their 0.12.
        assert!(z2 < 2.0, "{name} {direct:?} {merge_vertex}: {z2}");
    }
}

fn material(bsdf: Bsdf) -> Material {
    Material::new("some", bsdf)
}

/// A box with a panel above and a ball of some material in the middle.
fn with_ball(bsdf: Bsdf) -> Scene {
    let mut meshes = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 0));
    }
    meshes.push(square(Vec3::new(0.0, 0.0, 0.99), -Vec3::Z, 0.5, 1));
    meshes.push(sphere(Vec3::new(0.1, 0.1, -0.35), 0.45, 4, false, 2));
    let materials = vec![gray(0.5, 0.0), gray(0.0, 4.0), material(bsdf)];
    let camera = camera(Vec3::new(-0.9, -0.85, 0.4), Vec3::new(0.2, 0.2, -0.4), 75.0);
    scene(meshes, materials, vec![], camera)
}

#[test]
fn diffuse_surfaces_under_a_point_and_a_panel() {
    use Direct::{Connect, PhotonMap};
    let all = [(Connect, 1), (Connect, 2), (PhotonMap, 1), (PhotonMap, 2)];
    assert_same("box", &furnished_box(), &all);
}

#[test]
fn a_ball_of_each_material_under_a_panel() {
    let white = Reflectance::Artist { normal: Vec3::new(0.9, 0.8, 0.6) };
    for (name, bsdf) in [
        ("glass", Bsdf::Dielectric(Dielectric { eta: 1.5 })),
        ("sheet", Bsdf::ThinDielectric(ThinDielectric { eta: 1.5 })),
        ("mirror", Bsdf::Mirror { reflectance: Vec3::splat(0.9) }),
        ("rough metal", Bsdf::Conductor(Conductor::new(white, 0.15))),
        ("rougher metal", Bsdf::Conductor(Conductor::new(white, 0.5))),
        ("rough glass", Bsdf::RoughDielectric(RoughDielectric::new(1.5, 0.2))),
        ("coat", Bsdf::Coated(Coated::new(Vec3::new(0.7, 0.3, 0.2), 1.5))),
    ] {
        assert_same(name, &with_ball(bsdf), &[(Direct::Connect, 2), (Direct::PhotonMap, 1)]);
    }
}
