//! Scenes in a box whose images are held against the path tracer's, by the names of their tables.

use crate::common::*;
use bdpm::Scene;
use bdpm::scene::bsdf::{
    Bsdf, Coated, Conductor, Dielectric, Glossy, Reflectance, RoughDielectric, ThinDielectric,
};
use bdpm::scene::{
    AimedDistribution, Camera, Directional, Emitter, Environment, FieldOfView,
    IntensityDistribution, LuminousOpening, Material, Mesh, NormalMap, Photometry, PointLuminaire,
    Spot, Texture,
};
use glam::{DMat3, DQuat, DVec3, Vec3};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Pixels across and down.
pub const SIDE: u32 = 12;

/// All of them.
pub fn all() -> Vec<(&'static str, Arc<Scene>)> {
    let mut all = vec![
        ("box", furnished_box()),
        ("gloss-under-a-point", gloss_under_a_point()),
        ("pictures", pictures()),
        ("all-lights", all_lights()),
        ("window", window()),
    ];
    all.extend(balls().into_iter().map(|(name, bsdf)| (name, with_ball(bsdf))));
    all
}

/// One of them.
pub fn named(name: &str) -> Arc<Scene> {
    let found = all().into_iter().find(|(other, _)| *other == name);
    found.unwrap_or_else(|| panic!("no scene {name}")).1
}

/// Materials of the balls.
pub fn balls() -> Vec<(&'static str, Bsdf)> {
    let white = Reflectance::Artist { normal: Vec3::new(0.9, 0.8, 0.6) };
    vec![
        ("glass-ball", Bsdf::Dielectric(Dielectric::new(1.5))),
        ("sheet-ball", Bsdf::ThinDielectric(ThinDielectric::new(1.5))),
        ("mirror-ball", Bsdf::Mirror { reflectance: Vec3::splat(0.9) }),
        ("rough-metal-ball", Bsdf::Conductor(Conductor::new(white, 0.15))),
        ("rougher-metal-ball", Bsdf::Conductor(Conductor::new(white, 0.5))),
        ("rough-glass-ball", Bsdf::RoughDielectric(RoughDielectric::new(1.5, 0.2))),
        ("coated-ball", Bsdf::Coated(Coated::new(Vec3::new(0.7, 0.3, 0.2), 1.5))),
        ("smooth-gloss-ball", glossy(0.0, 0.0)),
        ("narrow-gloss-ball", glossy(0.0, 0.15)),
        ("wide-gloss-ball", glossy(0.0, 0.5)),
        ("half-metal-ball", glossy(0.5, 0.2)),
    ]
}

fn glossy(metallic: f32, alpha: f32) -> Bsdf {
    Bsdf::Glossy(Glossy::new(Vec3::new(0.7, 0.3, 0.2), metallic, 1.5, alpha))
}

fn material(bsdf: Bsdf) -> Material {
    Material::new("some", bsdf)
}

/// A ball of some material in the middle, under a panel.
fn with_ball(bsdf: Bsdf) -> Arc<Scene> {
    ball_lit_by(bsdf, 4.0, vec![])
}

/// A point light, which no ray hits: it is connected to narrow facets as well as to the base.
fn gloss_under_a_point() -> Arc<Scene> {
    ball_lit_by(glossy(0.5, 0.15), 0.0, vec![point_light(Vec3::new(-0.6, -0.3, 0.5), 2.0)])
}

/// By a panel of this radiance, and lights.
fn ball_lit_by(bsdf: Bsdf, panel: f32, lights: Vec<Emitter>) -> Arc<Scene> {
    let mut meshes = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 0));
    }
    meshes.push(square(Vec3::new(0.0, 0.0, 0.99), -Vec3::Z, 0.5, 1));
    meshes.push(sphere(Vec3::new(0.1, 0.1, -0.35), 0.45, 4, false, 2));
    let materials = vec![gray(0.5, 0.0), gray(0.0, panel), material(bsdf)];
    let camera = camera(Vec3::new(-0.9, -0.85, 0.4), Vec3::new(0.2, 0.2, -0.4), 75.0);
    scene(meshes, materials, lights, camera)
}

/// 8 by 8 texels of these colors in turn.
fn checkered(colors: [[u8; 3]; 3]) -> Arc<Texture> {
    let texels = (0..64).map(|i| colors[(i + i / 8) % 3]).map(|[r, g, b]| [r, g, b, 255]);
    Arc::new(Texture::new(8, 8, texels.collect()))
}

/// The mesh with texture coordinates along its sides.
fn holding_one_picture(mesh: Mesh) -> Mesh {
    let [o, u] = [mesh.positions[0], mesh.positions[1] - mesh.positions[0]];
    let v = mesh.positions[3] - o;
    let along = |p: &Vec3, side: Vec3| (*p - o).dot(side) / side.length_squared();
    let uvs = mesh.positions.iter().map(|p| [along(p, u), along(p, v)].into()).collect();
    Mesh { uvs, ..mesh }
}

/// The floor is bumpy, of all roughnesses and partly metal; the lamp is a picture.
fn pictures() -> Arc<Scene> {
    let mut meshes = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, if axis == Vec3::Z { 2 } else { 0 }));
    }
    meshes.push(square(Vec3::new(0.0, 0.0, 0.99), -Vec3::Z, 0.5, 1));
    let meshes = meshes.into_iter().map(holding_one_picture).collect();
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
    scene(meshes, vec![gray(0.5, 0.0), lamp, floor], vec![], camera)
}

/// The sun.
pub fn sun() -> Emitter {
    let direction = Vec3::new(0.5, 0.2, -0.7).normalize();
    Emitter::Directional(Directional::new(direction, Vec3::splat(3.0)))
}

/// A box that is open above, with a block, under a spot, the sun and a panel.
fn all_lights() -> Arc<Scene> {
    let mut meshes = vec![square(-Vec3::Z, Vec3::Z, 1.0, 0)];
    for axis in [Vec3::X, Vec3::Y] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 0));
        for side in [axis, -axis] {
            meshes.push(square(Vec3::new(0.2, 0.1, -0.75) + 0.25 * side, side, 0.25, 0));
        }
    }
    meshes.push(square(Vec3::new(0.2, 0.1, -0.5), Vec3::Z, 0.25, 0));
    meshes.push(square(Vec3::new(-0.5, 0.5, 0.9), -Vec3::Z, 0.2, 1));
    let spot = Spot {
        position: Vec3::new(0.7, -0.6, 0.8),
        direction: Vec3::new(-0.4, 0.5, -1.0).normalize(),
        intensity: Vec3::splat(1.5),
        cos_inner: 0.95,
        cos_outer: 0.7,
        falloff: bdpm::scene::Falloff::default(),
    };
    let lights = vec![Emitter::Spot(spot), sun()];
    let eye = Vec3::new(-0.8, -0.85, 0.7);
    let camera = Camera::look(eye, Vec3::new(1.0, 1.0, -1.0), Vec3::Z, FieldOfView::X(75.0));
    scene(meshes, vec![gray(0.5, 0.0), gray(0.0, 4.0)], lights, camera.unwrap())
}

/// A closed box with a block, under a point luminaire, a flat opening that shines up and down, and
/// a lantern.
pub fn luminaires() -> Arc<Scene> {
    let mut meshes = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 0));
    }
    for axis in [Vec3::X, Vec3::Y] {
        for side in [axis, -axis] {
            meshes.push(square(Vec3::new(0.2, 0.1, -0.75) + 0.25 * side, side, 0.25, 0));
        }
    }
    meshes.push(square(Vec3::new(0.2, 0.1, -0.5), Vec3::Z, 0.25, 0));
    // Wide below, weak above, and stronger to one side
    let polar = vec![0.0, 0.5, 1.2, 0.5 * PI, 2.2, PI];
    let azimuth = vec![0.0, 0.5 * PI, PI, 1.5 * PI, TAU];
    let round = |value: f64| [value, 1.5 * value, value, 0.5 * value, value];
    let values = [1.0, 0.9, 0.6, 0.15, 0.3, 0.4].map(round).as_flattened().to_vec();
    let own = IntensityDistribution::new(Photometry::C, polar, azimuth, values).unwrap();
    let own = Arc::new(own);
    let aimed = |tilt: f64, factor: f32| {
        let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), tilt);
        AimedDistribution::new(own.clone(), DMat3::from_quat(turn), Vec3::splat(factor))
    };
    let position = Vec3::new(-0.6, 0.3, 0.6);
    let point = PointLuminaire { position, aimed: aimed(0.4, 0.5) };
    let panel = square(Vec3::new(0.5, -0.5, 0.9), Vec3::new(0.2, 0.0, 1.0), 0.15, 1);
    let lantern = sphere(Vec3::new(0.5, 0.6, 0.3), 0.15, 1, false, 2);
    let with_opening = |aimed, mesh: &Mesh, is_flat| {
        let opening = LuminousOpening::new(aimed, mesh, is_flat);
        Material { luminous_opening: Some(Arc::new(opening)), ..gray(0.0, 0.0) }
    };
    let materials = vec![
        gray(0.5, 0.0),
        with_opening(aimed(0.2, 0.6), &panel, true),
        with_opening(aimed(0.0, 0.4), &lantern, false),
    ];
    meshes.extend([panel, lantern]);
    let eye = Vec3::new(-0.8, -0.85, 0.7);
    let camera = Camera::look(eye, Vec3::new(1.0, 1.0, -0.7), Vec3::Z, FieldOfView::X(80.0));
    scene(meshes, materials, vec![Emitter::Luminaire(Box::new(point))], camera.unwrap())
}

/// A room with a window to an uneven environment.
fn window() -> Arc<Scene> {
    let mut meshes = vec![square(-Vec3::Z, Vec3::Z, 1.0, 0), square(Vec3::Z, -Vec3::Z, 1.0, 0)];
    for wall in [-Vec3::X, Vec3::Y, -Vec3::Y] {
        meshes.push(square(wall, -wall, 1.0, 0));
    }
    let pixel = |i: u32| Vec3::new(1.0, 0.8, 0.5) * if i % 5 == 2 { 8.0 } else { 0.5 };
    let map = Environment::new(16, 8, (0..128).map(pixel).collect(), 20.0);
    let camera = camera(Vec3::new(-0.9, -0.8, 0.2), Vec3::new(1.0, 0.5, -0.2), 85.0);
    let scene = scene(meshes, vec![gray(0.5, 0.0)], vec![], camera);
    Arc::unwrap_or_clone(scene).with_environment(map).into()
}
