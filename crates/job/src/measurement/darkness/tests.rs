//! Meters in scenes whose darkness is known.

use super::*;
use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::scene::backend::{self, Backend};
use bdpm_core::scene::bsdf::Bsdf;
use bdpm_core::scene::{Camera, Environment, FieldOfView, Material, Mesh, Spot};
use glam::Vec3;

/// A square of the side 2 `half` in the plane y = `height`, which faces up or down.
fn plane(height: f32, half: f32, up: bool, material: u32) -> Mesh {
    let corners = [[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]];
    let positions = corners.map(|[x, z]| Vec3::new(half * x, height, half * z));
    let triangles = if up { vec![[0, 1, 2], [0, 2, 3]] } else { vec![[0, 2, 1], [0, 3, 2]] };
    Mesh { positions: positions.into(), triangles, material, ..Mesh::default() }
}

fn gray(albedo: f32) -> Material {
    Material::new("gray", Bsdf::diffuse(Rgb::splat(albedo)))
}

fn lamp() -> Material {
    Material { emission: Rgb::ONE, ..gray(0.0) }
}

/// A spot at 2 m that shines down, within 30 degrees.
fn spot() -> Emitter {
    Emitter::Spot(Spot {
        position: Vec3::new(0.0, 2.0, 0.0),
        direction: Vec3::NEG_Y,
        intensity: Rgb::ONE,
        cos_inner: 0.9,
        cos_outer: 0.866,
        falloff: bdpm_core::scene::Falloff::default(),
    })
}

fn scene(meshes: Vec<Mesh>, materials: Vec<Material>, lights: Vec<Emitter>) -> Scene {
    let camera = Camera::look(Vec3::Y, Vec3::NEG_Y, Vec3::X, FieldOfView::X(60.0)).unwrap();
    Scene::new("some".into(), meshes, materials, lights, camera, vec![]).unwrap()
}

/// The completed reading 0 of a meter after so many camera paths.
fn completed(scene: &Scene, kind: MeterKind, meter: Meter, paths: f64) -> Reading {
    let scene = scene.with_meters(kind, vec![meter]);
    let accel = backend::build(Backend::Bvh, &scene).unwrap();
    let mut darkness = Darkness::new(&scene, &*accel);
    let traced = TracedPaths { camera_paths: paths, of_one_photon: 0.0 };
    let zero = Reading::new(0.0, 0.0, 0.0, 0.0, 100.0);
    let one = 0..1;
    let sets = darkness.complete(&[(vec![zero], zero)], std::slice::from_ref(&one), traced);
    assert_eq!(sets[0].0[0].is_known(), sets[0].1.is_known(), "a mean of one");
    sets[0].0[0]
}

fn plane_meter(x: f32, normal: Vec3) -> Meter {
    Meter::irradiance(Vec3::new(x, 0.0, 0.0), normal).unwrap()
}

#[test]
fn meters_outside_of_a_cone_are_proven_dark() {
    let up = plane_meter(1.9, Vec3::Y);
    // A floor that reflects does not light itself.
    for albedo in [0.0, 0.5] {
        let own = scene(vec![plane(0.0, 5.0, true, 0)], vec![gray(albedo)], vec![spot()]);
        assert_eq!(completed(&own, MeterKind::Irradiance, up, 0.0), Reading::default());
        let lit = completed(&own, MeterKind::Irradiance, plane_meter(0.1, Vec3::Y), 0.0);
        assert!(!lit.is_known(), "the cone lights it");
    }
    let ceiling = vec![plane(0.0, 5.0, true, 0), plane(3.0, 5.0, false, 0)];
    let own = scene(ceiling, vec![gray(0.5)], vec![spot()]);
    assert!(!completed(&own, MeterKind::Irradiance, up, 0.0).is_known(), "the ceiling reflects");
}

#[test]
fn meters_behind_a_black_screen_or_a_lamp_are_proven_dark() {
    let up = plane_meter(0.1, Vec3::Y);
    let screen = vec![plane(0.0, 5.0, true, 0), plane(1.0, 5.0, true, 0)];
    let own = scene(screen.clone(), vec![gray(0.0)], vec![spot()]);
    assert_eq!(completed(&own, MeterKind::Irradiance, up, 0.0), Reading::default());
    // Rays may pass a screen that is half opaque.
    let half = Material { opacity: Some(0.5), ..gray(0.0) };
    let own = scene(screen, vec![half], vec![spot()]);
    assert!(!completed(&own, MeterKind::Irradiance, up, 0.0).is_known());
    for (shines_up, is_dark) in [(true, true), (false, false)] {
        let meshes = vec![plane(0.0, 5.0, true, 0), plane(2.0, 1.0, shines_up, 1)];
        let own = scene(meshes, vec![gray(0.0), lamp()], vec![]);
        assert_eq!(completed(&own, MeterKind::Irradiance, up, 0.0).is_known(), is_dark);
    }
}

#[test]
fn skies_light_what_their_latitudes_show() {
    let mut pixels = vec![Rgb::ZERO; 16 * 8];
    pixels[..16 * 4].fill(Rgb::ONE);
    let own = scene(vec![plane(0.0, 5.0, true, 0)], vec![gray(0.0)], vec![]);
    let sky = own.with_environment(Environment::new(16, 8, pixels, 0.0));
    for (normal, is_dark) in [(Vec3::Y, false), (Vec3::X, false), (Vec3::NEG_Y, true)] {
        let reading = completed(&sky, MeterKind::Irradiance, plane_meter(0.0, normal), 0.0);
        assert_eq!(reading.is_known(), is_dark, "{normal}");
    }
}

#[test]
fn luminance_of_black_surfaces_and_of_nothing_is_0() {
    let own = scene(vec![plane(0.0, 5.0, true, 0)], vec![gray(0.0)], vec![spot()]);
    let at = Vec3::new(0.0, 1.0, 0.0);
    for direction in [Vec3::NEG_Y, Vec3::Y] {
        let meter = Meter::radiance(at, direction, 0.0).unwrap();
        assert_eq!(completed(&own, MeterKind::Radiance, meter, 0.0), Reading::default());
    }
    let gray = scene(vec![plane(0.0, 5.0, true, 0)], vec![gray(0.5)], vec![spot()]);
    let down = Meter::radiance(at, Vec3::NEG_Y, 0.0).unwrap();
    assert!(!completed(&gray, MeterKind::Radiance, down, 0.0).is_known());
    let cone = Meter::radiance(at, Vec3::Y, 0.5).unwrap();
    assert_eq!(completed(&gray, MeterKind::Radiance, cone, 0.0), Reading::default());
}

/// An enclosed meter: three times the brightest contribution over the number of paths.
#[test]
fn many_paths_without_light_bound_it() {
    let meshes =
        vec![plane(0.0, 5.0, true, 0), plane(1.0, 5.0, false, 0), plane(2.0, 1.0, false, 1)];
    let own = scene(meshes, vec![gray(0.5), lamp()], vec![]);
    let up = plane_meter(0.0, Vec3::Y);
    assert!(!completed(&own, MeterKind::Irradiance, up, 0.9 * DARK_PATHS).is_known());
    let paths = 10.0 * DARK_PATHS;
    let reading = completed(&own, MeterKind::Irradiance, up, paths);
    let bound = 3.0 / paths * PI * brightest_path(&own) * f64::from(LUMENS_PER_WATT);
    assert_eq!((reading.value, reading.noise, reading.direct), (0.0, 0.0, 0.0));
    assert!((reading.expanded / bound - 1.0).abs() < 1e-9, "{reading:?} {bound}");
}

#[test]
fn means_of_lit_and_dark_meters_have_the_light_that_dark_ones_may_have() {
    let lit = Reading::new(1.0, 0.0, 0.0, 0.0, 100.0);
    let zero = Reading::default();
    let dark = Reading { expanded: 8.0, ..zero };
    let half = Reading { value: 0.5 * lit.value, ..lit };
    assert_eq!(mean_of(&half, &[lit, zero], &[lit, dark]).expanded, 4.0);
    assert_eq!(mean_of(&half, &[lit, zero], &[lit, Reading::unknown()]), half);
    assert_eq!(mean_of(&zero, &[zero; 2], &[zero, dark]), Reading { expanded: 4.0, ..zero });
    assert!(!mean_of(&zero, &[zero; 2], &[Reading::unknown(), dark]).is_known());
}
