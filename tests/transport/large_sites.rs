//! Small objects on large grounds: rays, photons and meters near the object do not depend on the
//! size of the ground.

use crate::common::*;
use bdpm::Settings;
use bdpm::noise::Measure;
use bdpm::render::photon_only_light::CausticLight;
use bdpm::scene::bsdf::{Bsdf, Dielectric};
use bdpm::scene::{Directional, Emitter, Environment, Material, Mesh, Meter, MeterKind};
use bdpm::settings::{Direct, Strategy};
use bdpm::{Renderer, Scene};
use glam::Vec3;
use std::sync::Arc;

/// Half sides of the ground, over the half side of the object on it.
const GROUNDS: [f32; 4] = [8.0, 1e3, 1e4, 1e6];

/// A ground at height 0 around the origin.
fn ground(half: f32) -> Mesh {
    square(Vec3::ZERO, Vec3::Z, half, 0)
}

/// A box of half side 1 that stands on the ground without a bottom, with walls of this material.
fn hut(material: u32) -> Vec<Mesh> {
    let face = |normal: Vec3| square(Vec3::Z + normal, normal, 1.0, material);
    [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z].map(face).to_vec()
}

fn sun() -> Emitter {
    let direction = Vec3::new(0.48, 0.36, -0.8);
    Emitter::Directional(Directional::new(direction, Vec3::splat(3.0)))
}

/// Light of suns, of a sky and of a lamp that is far away stays outside of a closed hut.
#[test]
fn closed_hut_on_a_ground_of_any_size_is_dark_inside() {
    for half in GROUNDS {
        let meshes = [vec![ground(half)], hut(0)].concat();
        // It sees the middle of the floor: photons merge through walls without a thickness.
        let inside = camera(Vec3::new(0.1, 0.0, 1.5), Vec3::ZERO, 40.0);
        let lamp = point_light(Vec3::new(0.3, -0.2, half), half * half);
        let dark = scene(meshes, vec![gray(0.5, 0.0)], vec![sun(), lamp], inside);
        let sky = Environment::new(1, 1, vec![Vec3::ONE], 0.0);
        let dark = Arc::new(Arc::unwrap_or_clone(dark).with_environment(sky));
        for strategy in [Strategy::Path, Strategy::Single, Strategy::Mis] {
            let own = Settings {
                strategy,
                merge_vertex: if strategy == Strategy::Single { 1 } else { 2 },
                light_paths: 20_000,
                radius: 0.05,
                caustic_radius: 0.05,
                ..settings(16, 12)
            };
            let lit = pixel_means(&dark, own, 8);
            let brightest = lit.iter().map(|[mean, _]| *mean).fold(0.0, f64::max);
            assert_eq!(brightest, 0.0, "{strategy:?} on a ground of {half}");
        }
    }
}

/// The ground inside of a box that hovers a little above it, under a sun: light enters only through
/// the gap.
#[test]
fn contact_shadows_do_not_depend_on_the_size_of_the_ground() {
    let shadow = |half: f32| {
        let gap = 0.01;
        let up = |mut mesh: Mesh| {
            mesh.positions.iter_mut().for_each(|position| position.z += gap);
            mesh
        };
        let meshes = [vec![ground(half)], hut(0).into_iter().map(up).collect()].concat();
        let view = camera(Vec3::new(0.1, 0.0, 1.5), Vec3::ZERO, 40.0);
        let lit = scene(meshes, vec![gray(0.5, 0.0)], vec![sun()], view);
        let own = Settings { strategy: Strategy::Path, camera_paths: 16, ..settings(16, 12) };
        let all = pixel_means(&lit, own, 40);
        let mean = all.iter().map(|[mean, _]| mean).sum::<f64>();
        [mean, all.iter().map(|[_, error]| error * error).sum::<f64>()]
    };
    let [mean, variance] = shadow(8.0);
    for half in GROUNDS {
        let [own, noise] = shadow(half);
        let error = (variance + noise).sqrt();
        assert!((own - mean).abs() < 4.0 * error, "{half}: {own}, not {mean} +- {error}");
    }
}

/// A meter in free air, one on the ground in the sun, and one in the shadow of the hut next to its
/// wall: exact values of direct light over black surfaces.
#[test]
fn meters_do_not_depend_on_the_size_of_the_ground() {
    let lamp = point_light(Vec3::new(-3.0, 0.0, 1.6), 2.0);
    for half in GROUNDS {
        let meshes = [vec![ground(half)], hut(0)].concat();
        let view = camera(Vec3::new(-4.0, 0.0, 3.0), Vec3::ZERO, 60.0);
        let lit = scene(meshes, vec![gray(0.0, 0.0)], vec![sun(), lamp.clone()], view);
        let up = |x: f32, y: f32, z: f32| Meter::irradiance(Vec3::new(x, y, z), Vec3::Z).unwrap();
        // Below the lamp; on the ground; behind the hut, a millimeter off its wall, where neither
        // light shines.
        let meters = vec![up(-3.0, 0.0, 1.2), up(-3.0, 0.0, 0.0), up(1.001, 0.5, 0.0)];
        let expected = [2.4 + 2.0 / 0.16, 2.4 + 2.0 / 2.56, 0.0];
        let metered = Arc::new(lit.with_meters(MeterKind::Irradiance, meters));
        let own = Settings {
            strategy: Strategy::Path,
            width: 3,
            height: 1,
            camera_paths: 64,
            ..settings(3, 1)
        };
        for ([mean, error], expected) in pixel_means(&metered, own, 40).into_iter().zip(expected) {
            assert!(
                (mean - expected).abs() <= 4.0 * error + 1e-4 * expected,
                "{mean} +- {error} on a ground of {half}, not {expected}"
            );
        }
    }
}

/// A cube of glass above a ground, under a sun.
fn gem(half: f32) -> Arc<Scene> {
    let face = |normal: Vec3| square(Vec3::new(0.0, 0.0, 1.0) + 0.5 * normal, normal, 0.5, 1);
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    let faces = axes.into_iter().flat_map(|axis| [axis, -axis]).map(face);
    let meshes = std::iter::once(ground(half)).chain(faces).collect();
    let glass = Material::new("glass", Bsdf::Dielectric(Dielectric::new(1.5)));
    let view = camera(Vec3::new(0.3, -3.0, 4.0), Vec3::new(0.5, 0.3, 0.0), 40.0);
    scene(meshes, vec![gray(0.5, 0.0), glass], vec![sun()], view)
}

/// The caustic of a gem is found, with the noise that it has on a small ground.
#[test]
fn caustic_of_a_gem_does_not_depend_on_the_size_of_the_ground() {
    let of = |half: f32| {
        let gem = gem(half);
        let own = Settings {
            strategy: Strategy::Single,
            merge_vertex: 1,
            direct: Direct::Connect,
            light_paths: 4096,
            radius: 0.05,
            caustic_radius: 0.05,
            ..settings(24, 18)
        };
        let all = pixel_means(&gem, own, 48);
        let mean = all.iter().map(|[mean, _]| mean).sum::<f64>();
        let variance = all.iter().map(|[_, error]| error * error).sum::<f64>();
        [mean, variance]
    };
    let [mean, variance] = of(8.0);
    for half in [300.0, 3000.0, 1e6] {
        let [own, noise] = of(half);
        // The same pixels: their light paths are others.
        let error = (variance + noise).sqrt();
        assert!((own - mean).abs() < 4.0 * error, "{half}: {own}, not {mean} +- {error}");
        assert!(noise < 1.5 * variance, "{half}: {noise} {variance}");
    }
}

#[test]
fn light_of_suns_by_way_of_glass_is_known_in_advance() {
    let light = CausticLight::of(&gem(8.0)).unwrap();
    assert_eq!(light.describe(), "light of `light 1` by way of `glass`");
    let open = scene(vec![ground(8.0)], vec![gray(0.5, 0.0)], vec![sun()], gem(8.0).camera);
    assert_eq!(CausticLight::of(&open), None);
    let mut renderer = Renderer::new(
        &gem(300.0),
        &accel(&gem(300.0)),
        Settings { strategy: Strategy::Single, light_paths: 1024, ..settings(8, 6) },
    )
    .unwrap();
    let report = renderer.iterate(Measure::Off);
    assert!(report.found_caustics && report.light_paths == 1024);
}
