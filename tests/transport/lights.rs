//! Each kind of light: what it does to a surface by connection, by photons and by a formula, and
//! whether both ways of direct light and the path tracer make the same of it.

use crate::common::boxes::sun;
use crate::common::strategies::{ALL, assert_same};
use crate::common::*;
use bdpm::image_io::{Image, Layer, write_exr};
use bdpm::noise::Measure;
use bdpm::scene::bsdf::{Bsdf, Dielectric};
use bdpm::scene::{Emitter, Environment, Falloff, Material, Spot};
use bdpm::settings::{Direct, Settings};
use bdpm::{Renderer, Scene};
use glam::Vec3;
use std::f64::consts::PI;
use std::sync::Arc;

const ALBEDO: f32 = 0.6;

/// A plane, seen over a small angle around a point, lit by `light`.
fn lit_plane(light: Emitter, at: Vec3) -> Arc<Scene> {
    let plane = square(Vec3::ZERO, Vec3::Z, 4.0, 0);
    let from = at + Vec3::new(0.3, -1.0, 2.0);
    scene(vec![plane], vec![gray(ALBEDO, 0.0)], vec![light], camera(from, at, 2.0))
}

fn spot() -> Spot {
    Spot {
        position: Vec3::new(0.0, 0.0, 2.0),
        direction: Vec3::new(0.3, 0.1, -1.0).normalize(),
        intensity: Vec3::splat(10.0),
        cos_inner: 0.97,
        cos_outer: 0.8,
        falloff: Falloff::default(),
    }
}

/// Irradiance from a spot by its definition, in f64.
fn irradiance(spot: &Spot, at: Vec3) -> f64 {
    let to_surface = (at - spot.position).as_dvec3();
    let (distance, [inner, outer]) = (to_surface.length(), [spot.cos_inner, spot.cos_outer]);
    let cosine = to_surface.dot(spot.direction.as_dvec3()) / distance;
    let share = ((cosine - outer) / (inner - outer)).clamp(0.0, 1.0).powi(2);
    let cos_surface = -to_surface.z / distance;
    f64::from(spot.intensity.x) * share * cos_surface / distance.powi(2)
}

#[test]
fn spots_and_suns_light_a_plane_as_documented() {
    let radiance = f64::from(ALBEDO) / PI;
    let sun_irradiance = 3.0 * 0.7 / 0.78f64.sqrt();
    // On the axis, in the falloff, and everywhere for the sun.
    let inside = Vec3::new(0.6, 0.2, 0.0);
    let falloff = Vec3::new(1.3, -0.4, 0.0);
    // The sun lights the plane evenly: there is no bias at any radius.
    for (name, light, at, radius, expected) in [
        ("spot", Emitter::Spot(spot()), inside, 0.03, irradiance(&spot(), inside)),
        ("falloff", Emitter::Spot(spot()), falloff, 0.03, irradiance(&spot(), falloff)),
        ("sun", sun(), falloff, 0.2, sun_irradiance),
    ] {
        let scene = lit_plane(light, at);
        for direct in [Direct::Connect, Direct::PhotonMap] {
            let settings = Settings {
                direct,
                light_paths: 20_000,
                radius,
                caustic_radius: radius,
                ..settings(4, 4)
            };
            let iterations = if direct == Direct::Connect { 50 } else { 900 };
            let mean = mean_luminance(&scene, &accel(&scene), settings, iterations);
            println!("{name} {direct:?}: {mean:?}, {}", radiance * expected);
            // Within the field of view of 2 degrees the falloff bends by less.
            mean.assert_is(radiance * expected, 2e-3);
        }
    }
}

#[test]
fn outside_of_a_spots_cone_is_dark() {
    let scene = lit_plane(Emitter::Spot(spot()), Vec3::new(-2.0, 0.0, 0.0));
    let accel = accel(&scene);
    for direct in [Direct::Connect, Direct::PhotonMap] {
        let settings = Settings { direct, ..settings(4, 4) };
        let mut renderer = Renderer::new(&scene, &accel, settings).unwrap();
        (0..20).for_each(|_| drop(renderer.iterate(Measure::Off)));
        assert_eq!(renderer.film().mean_luminance(), 0.0);
    }
}

#[test]
fn a_room_under_all_lights_is_the_same_by_every_strategy_and_the_path_tracer() {
    assert_same("all-lights", &ALL);
}

/// Under light that is the same from everywhere, lossless things are as bright as what is behind.
#[test]
fn lossless_things_are_invisible_in_a_uniform_environment() {
    let material = |bsdf| Material::new("white", bsdf);
    let materials = vec![gray(1.0, 0.0), material(Bsdf::Dielectric(Dielectric::new(1.5)))];
    let meshes = vec![
        sphere(Vec3::new(-0.6, 0.0, 0.0), 0.5, 4, false, 0),
        sphere(Vec3::new(0.6, 0.0, 0.0), 0.5, 4, false, 1),
    ];
    let camera = camera(Vec3::new(0.0, -3.0, 0.5), Vec3::ZERO, 45.0);
    let environment = Environment::new(1, 1, vec![Vec3::splat(2.0)], 0.0);
    let scene = Arc::unwrap_or_clone(scene(meshes, materials, vec![], camera));
    let scene = Arc::new(scene.with_environment(environment));
    let accel = accel(&scene);
    for direct in [Direct::Connect, Direct::PhotonMap] {
        for merge_vertex in [1, 2, MIS] {
            let settings = by_way(Settings {
                direct,
                merge_vertex,
                light_paths: 20_000,
                camera_paths: 8,
                radius: 0.08,
                caustic_radius: 0.08,
                ..settings(6, 6)
            });
            let all = pixel_samples(&scene, &accel, settings, 120);
            let (mut worst, mut sum) = (0.0f64, Estimate { mean: 0.0, error: 0.0 });
            for samples in &all {
                let Estimate { mean, error } = Estimate::from_samples(samples);
                worst = worst.max((mean - 2.0).abs() / error.max(2e-3));
                sum.mean += mean / 36.0;
                sum.error = sum.error.hypot(error / 36.0);
            }
            println!("{direct:?} k = {merge_vertex}: {sum:?}, worst {worst}");
            assert!(worst < 5.0, "{direct:?} {merge_vertex}: {worst}");
            sum.assert_is(2.0, 1e-3);
        }
    }
}

#[test]
fn an_environment_through_a_window_is_the_same_by_every_strategy() {
    assert_same("window", &ALL);
}

/// One pixel of a map, by its files.
#[test]
fn environments_come_from_exr_and_hdr_files() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let pixels = [Vec3::new(0.5, 1.0, 2.0), Vec3::new(4.0, 0.25, 0.125)];
    let image = Image {
        width: 2,
        height: 1,
        layers: vec![Layer::rgb("", &pixels)],
        metadata: Default::default(),
    };
    write_exr(&at("map.exr"), &image).unwrap();
    // Shared exponents: 0.5 * 2^1 and so on, exact for powers of 2.
    let mut hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n".to_vec();
    hdr.extend([32, 64, 128, 130, 128, 8, 4, 131]);
    std::fs::write(at("map.hdr"), hdr).unwrap();
    std::fs::write(at("a.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let load = |environment: &str| {
        let text = format!(
            "[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\nfov_y_deg = 40\n\n[[mesh]]\nfile = \
             \"a.obj\"\n\n[environment]\n{environment}\n"
        );
        std::fs::write(at("s.toml"), text).unwrap();
        bdpm::load::load(at("s.toml"))
    };
    for file in ["map.exr", "map.hdr"] {
        let scene = load(&format!("file = \"{file}\"\nradiance = 3")).unwrap().scene;
        // The left half of the map is on the left of somebody who looks toward -z.
        let radiance =
            |x: f32| scene.lights().environment_radiance(Vec3::new(x, 0.0, -1.0).normalize());
        assert_eq!([radiance(-0.5), radiance(0.5)], pixels.map(|pixel| 3.0 * pixel), "{file}");
    }
    assert_eq!(
        load("radiance = [1, 2, 3]").unwrap().scene.lights().environment_radiance(Vec3::X).y,
        2.0
    );
    std::fs::write(at("bad.hdr"), "#?RADIANCE\n\n-Y 9999 +X 9999\n").unwrap();
    std::fs::write(at("bad.exr"), "no").unwrap();
    for (environment, expected) in [
        ("", "s.toml:9: the environment needs `file` or `radiance`"),
        ("radiance = 0", "has no light"),
        ("radiance = -1", "s.toml:10: light is negative"),
        ("file = \"no.exr\"", "no.exr: cannot read"),
        ("file = \"map.png\"", "map.png: the image is neither"),
        ("file = \"bad.hdr\"", "bad.hdr: cannot read it as an HDR image"),
        ("file = \"bad.exr\"", "bad.exr: this is no EXR image"),
        ("file = \"map.exr\"\nturn_deg = inf", "`turn_deg` is not finite"),
    ] {
        let shown = load(environment).unwrap_err().to_string();
        assert!(shown.contains(expected) && shown.contains("\nhelp: "), "{environment}: {shown}");
    }
}

/// Shadow rays of a sun start outside of the scene. Rounding errors there exceed the distance by
/// which they end before a small surface far inside.
#[test]
fn surfaces_in_a_large_scene_do_not_shadow_themselves() {
    let normal = Vec3::new(0.31, -0.23, 0.87).normalize();
    let center = Vec3::new(0.7, 0.4, 0.9);
    let plane = square(center, normal, 2.0, 0);
    let far = square(Vec3::new(900.0, -700.0, 0.0), Vec3::X, 1.0, 0);
    let direction = Vec3::new(0.35, 0.21, -0.9).normalize();
    let light = bdpm::scene::Directional::new(direction, Vec3::ONE);
    let camera = camera(center + 3.0 * normal + 0.5 * Vec3::X, center, 20.0);
    let light = Emitter::Directional(light);
    let scene = scene(vec![plane, far], vec![gray(ALBEDO, 0.0)], vec![light], camera);
    let settings = Settings { light_paths: 100, camera_paths: 8, ..settings(32, 32) };
    let mut renderer = Renderer::new(&scene, &accel(&scene), settings).unwrap();
    renderer.iterate(Measure::Off);
    let expected = f64::from(ALBEDO * -direction.dot(normal)) / PI;
    for value in renderer.film().mean() {
        let off = f64::from(value.x) / expected - 1.0;
        assert!(off.abs() < 1e-4, "{value} {expected}");
    }
}
