//! Small objects on large grounds: rays, photons and meters near the object do not depend on the
//! size of the ground.

use crate::common::*;
use bdpm::Settings;
use bdpm::noise::Measure;
use bdpm::render::findable_light::CausticLight;
use bdpm::scene::bsdf::{Bsdf, Dielectric};
use bdpm::scene::{Directional, Emitter, Material, Mesh, Meter, MeterKind};
use bdpm::settings::{Direct, Strategy};
use bdpm::{Renderer, Scene};
use glam::Vec3;
use std::sync::Arc;

/// Half sides of the ground, over the half side of the object on it.
const GROUNDS: [f32; 3] = [8.0, 1e3, 1e4];

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

/// A meter in free air, one on the ground in the sun, and one in the shadow of the hut: exact
/// values of direct light over black surfaces.
#[test]
fn meters_do_not_depend_on_the_size_of_the_ground() {
    let lamp = point_light(Vec3::new(-3.0, 0.0, 1.6), 2.0);
    for half in GROUNDS {
        let meshes = [vec![ground(half)], hut(0)].concat();
        let view = camera(Vec3::new(-4.0, 0.0, 3.0), Vec3::ZERO, 60.0);
        let lit = scene(meshes, vec![gray(0.0, 0.0)], vec![sun(), lamp.clone()], view);
        let up = |x: f32, y: f32, z: f32| Meter::irradiance(Vec3::new(x, y, z), Vec3::Z).unwrap();
        // Below the lamp; on the ground; behind the hut, where neither light shines.
        let meters = vec![up(-3.0, 0.0, 1.2), up(-3.0, 0.0, 0.0), up(1.4, 0.5, 0.0)];
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
    for half in [300.0, 3000.0] {
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
