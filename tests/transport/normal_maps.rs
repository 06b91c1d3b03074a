//! Maps of normals, and of roughness and metal: what a picture says is what surfaces do.

use crate::common::*;
use bdpm::accel::Ray;
use bdpm::noise::Measure;
use bdpm::scene::bsdf::{Bsdf, Coated, DiffuseTransmission, Glossy};
use bdpm::scene::{Material, Mesh, NormalMap, Sampling, Scene, Surface, Texture};
use bdpm::settings::Direct;
use bdpm::{Renderer, Settings};
use glam::Vec3;
use std::sync::Arc;

fn texture(width: u32, height: u32, codes: &[[u8; 3]]) -> Arc<Texture> {
    let texels = codes.iter().map(|&[r, g, b]| [r, g, b, 255]).collect();
    let sampling = Sampling { nearest: true, ..Sampling::default() };
    Arc::new(Texture::new(width, height, texels).sampled(sampling))
}

fn map(codes: &[[u8; 3]]) -> Option<NormalMap> {
    Some(NormalMap { texture: texture(codes.len() as u32, 1, codes), scale: 1.0 })
}

/// A floor of corners `(-2, -2)` to `(2, 2)` that holds a texture once, `u` along x.
fn floor() -> Mesh {
    let mesh = square(Vec3::ZERO, Vec3::Z, 2.0, 0);
    let uvs = mesh.positions.iter().map(|p| 0.25 * p.truncate() + 0.5).collect();
    Mesh { uvs, ..mesh }
}

const TILTED_CODES: [u8; 3] = [223, 128, 255];

/// The normal of those codes.
fn tilted() -> Vec3 {
    Vec3::new(95.0, 0.0, 127.0).normalize()
}

/// The floor under a lamp and a point, beside a wall.
fn room(floor: Mesh, material: Material) -> Arc<Scene> {
    let wall = square(Vec3::new(-2.0, 0.0, 0.0), Vec3::X, 4.0, 1);
    let lamp = square(Vec3::new(0.5, 0.5, 2.0), -Vec3::Z, 0.5, 2);
    let camera = camera(Vec3::new(3.0, 0.3, 1.2), Vec3::new(0.2, 0.1, 0.0), 40.0);
    let lights = vec![point_light(Vec3::new(-0.5, 0.5, 1.5), 5.0)];
    scene(vec![floor, wall, lamp], vec![material, gray(0.7, 0.0), gray(0.0, 4.0)], lights, camera)
}

fn image(scene: &Arc<Scene>, direct: Direct) -> Vec<Vec3> {
    let accel = accel(scene);
    let settings = Settings { direct, merge_vertex: 2, light_paths: 5000, ..settings(12, 12) };
    let mut renderer = Renderer::new(scene, &accel, settings).unwrap();
    for _ in 0..4 {
        renderer.iterate(Measure::Off);
    }
    renderer.film().mean()
}

fn bsdfs() -> [Bsdf; 5] {
    let albedo = Vec3::new(0.8, 0.6, 0.4);
    [
        Bsdf::diffuse(albedo),
        Bsdf::DiffuseTransmission(DiffuseTransmission::new(albedo, Vec3::splat(0.2))),
        Bsdf::Coated(Coated::new(albedo, 1.5)),
        Bsdf::Glossy(Glossy::new(albedo, 0.3, 1.5, 0.5)),
        Bsdf::Glossy(Glossy::new(albedo, 0.3, 1.5, 0.1)),
    ]
}

#[test]
fn flat_map_leaves_images_bit_identical() {
    for bsdf in bsdfs() {
        let plain = Material::new("m", bsdf);
        let flat = Material { normal_map: map(&[[128, 128, 255]]), ..plain.clone() };
        for direct in [Direct::Connect, Direct::PhotonMap] {
            let same = image(&room(floor(), plain.clone()), direct)
                == image(&room(floor(), flat.clone()), direct);
            assert!(same, "{bsdf:?} {direct:?}");
        }
    }
}

#[test]
fn a_tilted_map_is_a_tilted_normal() {
    for bsdf in bsdfs() {
        let plain = Material::new("m", bsdf);
        let mapped = Material { normal_map: map(&[TILTED_CODES]), ..plain.clone() };
        let bent = Mesh { normals: vec![tilted(); 4], ..floor() };
        for direct in [Direct::Connect, Direct::PhotonMap] {
            let expected = image(&room(bent.clone(), plain.clone()), direct);
            let found = image(&room(floor(), mapped.clone()), direct);
            let flat = image(&room(floor(), plain.clone()), direct);
            // Rounding may send single paths another way.
            let (mut off, mut changed, mut sum) = (0.0, 0.0, 0.0);
            for ((found, expected), flat) in found.into_iter().zip(expected).zip(flat) {
                off += (found - expected).length();
                changed += (flat - expected).length();
                sum += expected.length();
            }
            assert!(off < 2e-3 * sum, "{bsdf:?} {direct:?}: {}", off / sum);
            assert!(changed > 0.02 * sum, "{bsdf:?} {direct:?}: it matters");
        }
    }
}

/// The surface of the floor that is seen from straight above `(x, y)`.
fn seen<T>(scene: &Arc<Scene>, x: f32, y: f32, see: impl Fn(Surface) -> T) -> T {
    let ray = Ray::new(Vec3::new(x, y, 1.0), -Vec3::Z);
    see(scene.surface(&ray, &accel(scene).closest_hit(&ray)))
}

#[test]
fn given_tangents_turn_the_picture() {
    let material = Material { normal_map: map(&[TILTED_CODES]), ..gray(0.5, 0.0) };
    let normal = |tangents| {
        let scene = room(Mesh { tangents, ..floor() }, material.clone());
        seen(&scene, 0.4, 0.3, |surface| surface.interpolated.unwrap())
    };
    let t = tilted();
    assert!((normal(vec![]) - t).length() < 1e-6);
    assert!((normal(vec![Vec3::ZERO; 4]) - t).length() < 1e-6);
    // Tangents may have any length and direction; their component off the surface does not count.
    let turned = normal(vec![Vec3::new(0.0, 3.0, 2.0); 4]);
    assert!((turned - Vec3::new(0.0, t.x, t.z)).length() < 1e-6, "{turned}");
}

#[test]
fn green_is_roughness_and_blue_is_metal() {
    let codes = [[9, 255, 0], [9, 128, 255], [9, 51, 102], [9, 0, 0]];
    let bsdf = |metallic, roughness: f32| {
        Bsdf::Glossy(Glossy::new(Vec3::splat(0.8), metallic, 1.4, roughness * roughness))
    };
    let material = Material {
        metallic_roughness_texture: Some(texture(4, 1, &codes)),
        ..Material::new("m", bsdf(0.5, 0.9))
    };
    let scene = room(floor(), material);
    assert!(scene.merges_by_direction());
    for (i, [_, green, blue]) in codes.into_iter().enumerate() {
        let share = |code: u8| f32::from(code) / 255.0;
        let Bsdf::Glossy(found) = seen(&scene, i as f32 - 1.5, 0.2, |surface| surface.bsdf) else {
            panic!("it stays glossy")
        };
        assert!((found.metallic() - 0.5 * share(blue)).abs() < 1e-6, "{found:?}");
        assert!((found.alpha() - (0.9 * share(green)).powi(2)).abs() < 1e-6, "{found:?}");
        let Bsdf::Glossy(expected) = bsdf(0.5 * share(blue), 0.9 * share(green)) else {
            unreachable!()
        };
        let off = found.normal_reflectance() - expected.normal_reflectance();
        assert!(off.abs() < 1e-6 && found.albedo() == expected.albedo());
    }
}

#[test]
fn light_paths_and_camera_paths_agree_over_bumps() {
    // Seen is a wall that the bumpy floor lights.
    let codes: Vec<[u8; 3]> = (0..16).map(|i| [[223, 128, 255], [60, 190, 255]][i % 2]).collect();
    for bsdf in bsdfs() {
        let mut scene =
            room(floor(), Material { normal_map: map(&codes), ..Material::new("m", bsdf) });
        Arc::make_mut(&mut scene).camera =
            camera(Vec3::new(2.0, 0.3, 1.2), Vec3::new(-2.0, 0.0, 1.2), 20.0);
        let accel = accel(&scene);
        let mean = |direct, merge_vertex| {
            let settings = by_way(Settings {
                direct,
                merge_vertex,
                light_paths: 10_000,
                camera_paths: 8,
                radius: 0.05,
                caustic_radius: 0.05,
                seed: u64::from(merge_vertex),
                ..settings(8, 8)
            });
            mean_luminance(&scene, &accel, settings, 150)
        };
        let reference = mean(Direct::Connect, 3);
        // Light that narrow facets send below the horizon of their normal is lost to light paths.
        let lost = if bsdf.has_rough() { 0.01 } else { 0.0 };
        for (direct, merge_vertex) in [
            (Direct::Connect, 1),
            (Direct::PhotonMap, 1),
            (Direct::Connect, 2),
            (Direct::Connect, MIS),
        ] {
            let other = mean(direct, merge_vertex);
            let error = other.error.hypot(reference.error);
            assert!(error < 6e-3 * reference.mean, "{error} of {}", reference.mean);
            let off = other.mean - reference.mean;
            println!("{bsdf:?} {direct:?} {merge_vertex}: {} +- {error}", off / reference.mean);
            assert!(
                off.abs() < 4.0 * error + (3e-3 + lost) * reference.mean,
                "{bsdf:?} {direct:?} {merge_vertex}: {other:?}, not {reference:?}"
            );
        }
    }
}
