//! The renderer against the path tracer, which shares nothing of the transport with it: the same
//! images within noise, after the merge bias has been taken out by two radii.

use crate::common::images::{Difference, Subject};
use crate::common::*;
use bdpm::bsdf::{
    Bsdf, Coated, Conductor, Dielectric, Glossy, Reflectance, RoughDielectric, ThinDielectric,
};
use bdpm::scene::{Material, Mesh, NormalMap, Scene, Texture};
use bdpm::settings::{Direct, Settings};
use glam::Vec3;
use std::sync::Arc;

const SIDE: u32 = 12;

/// Strategies against the path tracer: each pixel, and the whole image.
fn assert_same(name: &str, scene: &Scene, strategies: &[(Direct, u32)]) {
    let accel = accel(scene);
    let base = settings(SIDE, SIDE);
    let subject = Subject { scene, accel: &*accel, settings: &base, region: &[] };
    let expected = subject.traced(16_384);
    for &(direct, merge_vertex) in strategies {
        let settings = by_way(Settings {
            direct,
            merge_vertex,
            light_paths: 40_000,
            camera_paths: 16,
            radius: 0.04,
            caustic_radius: 0.04,
            seed: 3,
            ..base.clone()
        });
        let found = Subject { settings: &settings, ..subject }.extrapolated(60);
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
    let all = [
        (Connect, 1),
        (Connect, 2),
        (Connect, MIS),
        (PhotonMap, 1),
        (PhotonMap, 2),
        (PhotonMap, MIS),
    ];
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
        assert_same(
            name,
            &with_ball(bsdf),
            &[(Direct::Connect, 2), (Direct::PhotonMap, 1), (Direct::Connect, MIS)],
        );
    }
}

fn glossy(metallic: f32, alpha: f32) -> Bsdf {
    Bsdf::Glossy(Glossy::new(Vec3::new(0.7, 0.3, 0.2), metallic, 1.5, alpha))
}

#[test]
fn a_glossy_ball_under_a_panel() {
    for (name, bsdf) in [
        ("smooth gloss", glossy(0.0, 0.0)),
        ("narrow gloss", glossy(0.0, 0.15)),
        ("wide gloss", glossy(0.0, 0.5)),
        ("half metal", glossy(0.5, 0.2)),
    ] {
        assert_same(
            name,
            &with_ball(bsdf),
            &[(Direct::Connect, 2), (Direct::PhotonMap, 1), (Direct::Connect, MIS)],
        );
    }
}

#[test]
fn a_glossy_ball_under_a_point() {
    // What no ray hits is connected to by narrow facets as well, besides what the base gets.
    let scene = with_ball(glossy(0.5, 0.15));
    let mut materials = scene.materials().to_vec();
    materials[1].emission = Vec3::ZERO;
    let lights = vec![point_light(Vec3::new(-0.6, -0.3, 0.5), 2.0)];
    let scene = crate::common::scene(scene.meshes().to_vec(), materials, lights, scene.camera);
    assert_same(
        "under a point",
        &scene,
        &[(Direct::Connect, 1), (Direct::PhotonMap, 2), (Direct::Connect, MIS)],
    );
}

/// 8 by 8 texels of these colors in turn.
fn checkered(colors: [[u8; 3]; 3]) -> Arc<Texture> {
    let texels = (0..64).map(|i| colors[(i + i / 8) % 3]).map(|[r, g, b]| [r, g, b, 255]);
    Arc::new(Texture::new(8, 8, texels.collect()))
}

#[test]
fn pictures_of_everything_in_a_box() {
    // The floor is bumpy, of all roughnesses and partly metal; the lamp is a picture.
    let holding_one = |mesh: Mesh| {
        let [o, u] = [mesh.positions[0], mesh.positions[1] - mesh.positions[0]];
        let v = mesh.positions[3] - o;
        let along = |p: &Vec3, side: Vec3| (*p - o).dot(side) / side.length_squared();
        let uvs = mesh.positions.iter().map(|p| [along(p, u), along(p, v)].into()).collect();
        Mesh { uvs, ..mesh }
    };
    let mut meshes = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, if axis == Vec3::Z { 2 } else { 0 }));
    }
    meshes.push(square(Vec3::new(0.0, 0.0, 0.99), -Vec3::Z, 0.5, 1));
    let meshes = meshes.into_iter().map(holding_one).collect();
    let white = Bsdf::Glossy(Glossy::new(Vec3::splat(0.9), 1.0, 1.5, 1.0));
    let normals = checkered([[128, 128, 255], [160, 140, 255], [120, 90, 255]]);
    let floor = Material {
        metallic_roughness_texture: Some(checkered([[0, 90, 0], [0, 255, 0], [0, 160, 200]])),
        albedo_texture: Some(checkered([[255, 160, 80], [200, 255, 160], [80, 200, 255]])),
        normal_map: Some(NormalMap { texture: normals, scale: 1.0 }),
        ..material(white)
    };
    let picture = checkered([[0, 0, 0], [255, 255, 255], [100, 200, 255]]);
    let lamp = Material { emission_texture: Some(picture), ..gray(0.0, 8.0) };
    let camera = camera(Vec3::new(-0.9, -0.85, 0.4), Vec3::new(0.2, 0.2, -0.6), 75.0);
    let scene = scene(meshes, vec![gray(0.5, 0.0), lamp, floor], vec![], camera);
    use Direct::{Connect, PhotonMap};
    assert_same("pictures", &scene, &[(Connect, 1), (Connect, 2), (PhotonMap, 1), (Connect, MIS)]);
}
