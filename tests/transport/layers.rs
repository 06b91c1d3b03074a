//! Layers beside the image: what is seen against what is known of the scene, and light by kind.

use crate::common::{accel, camera, furnished_box, gray, point_light, scene, settings, square};
use bdpm::film::aov::AovSelection;
use bdpm::film::features::{DenoiseFeatures, FAR};
use bdpm::noise::Measure;
use bdpm::noise::film::BatchGrain;
use bdpm::render::RenderConfig;
use bdpm::render::block::CombinedImage;
use bdpm::scene::bsdf::{Bsdf, Dielectric};
use bdpm::scene::{Material, Scene};
use bdpm::settings::{Direct, Kernel, Strategy};
use bdpm::{Renderer, Settings};
use glam::{DVec3, Vec3};
use std::sync::Arc;

const CONFIG: RenderConfig = RenderConfig {
    aovs: AovSelection { light: true, features: true, folds: true, halves: false },
    grain: BatchGrain::Tile,
    nested_part: None,
    photon_only: false,
    independent_paths: false,
    hides_lights: false,
    ranks: 1,
};

fn colored(albedo: Vec3) -> Material {
    Material::new("colored", Bsdf::diffuse(albedo))
}

/// A red wall at z = 0 seen from z = 4 along the axis; what lies between is of the second material.
fn wall(between: Option<Material>, tilt: Vec3) -> Arc<Scene> {
    let red = Vec3::new(0.8, 0.2, 0.1);
    let mut meshes = vec![square(Vec3::ZERO, Vec3::Z, 50.0, 0)];
    let mut materials = vec![colored(red)];
    if let Some(material) = between {
        meshes.push(square(Vec3::new(0.0, 0.0, 2.0), tilt, 50.0, 1));
        meshes.push(square(Vec3::new(0.0, 0.0, 1.5), -tilt, 50.0, 1));
        materials.push(material);
    }
    let light = point_light(Vec3::new(0.3, 0.2, 3.0), 5.0);
    scene(meshes, materials, vec![light], camera(Vec3::Z * 4.0, Vec3::ZERO, 40.0))
}

/// Means over the image of guides, of positions and of depths.
fn seen(scene: &Arc<Scene>, settings: Settings, iterations: u64) -> (DenoiseFeatures, Vec3, f32) {
    let accel = accel(scene);
    let mut renderer = Renderer::new(scene, &accel, settings).unwrap().configure(CONFIG).unwrap();
    for _ in 0..iterations {
        renderer.iterate(Measure::Off);
    }
    let pixels = renderer.film().pixels();
    let features = renderer.shared().features.as_ref().unwrap();
    let first_hits = renderer.shared().first_hits.as_ref().unwrap();
    let (mut albedo, mut normal, mut position) = <(DVec3, DVec3, DVec3)>::default();
    let (mut depth, share) = (0.0, 1.0 / pixels as f64);
    for pixel in 0..pixels {
        let (own, (place, away)) = (features.mean(pixel, |_| true), first_hits.mean_hit(pixel));
        albedo += own.albedo.as_dvec3() * share;
        normal += own.normal.as_dvec3() * share;
        position += place.as_dvec3() * share;
        depth += f64::from(away) * share;
    }
    let guide = DenoiseFeatures { albedo: albedo.as_vec3(), normal: normal.as_vec3() };
    (guide, position.as_vec3(), depth as f32)
}

fn assert_near(found: Vec3, expected: Vec3, tolerance: f32) {
    assert!((found - expected).abs().max_element() <= tolerance, "{found}, not {expected}");
}

#[test]
fn albedo_normal_depth_and_position_of_a_wall_are_its_own() {
    let red = Vec3::new(0.8, 0.2, 0.1);
    let (guide, position, depth) = seen(&wall(None, Vec3::Z), settings(16, 12), 4);
    assert_near(guide.albedo, red, 1e-5);
    assert_near(guide.normal, Vec3::Z, 1e-5);
    // Means over a symmetric image; the depth is that of the plane.
    assert_near(position, Vec3::ZERO, 0.05);
    assert!((depth - 4.0).abs() < 1e-4, "{depth}");
}

#[test]
fn mirrors_show_what_they_reflect_with_their_tint() {
    // A mirror at 45 degrees before the camera shows a wall beside: blue, facing the mirror.
    let tint = Vec3::new(0.9, 0.8, 0.7);
    let blue = Vec3::new(0.1, 0.2, 0.8);
    let mirror = Material::new("mirror", Bsdf::Mirror { reflectance: tint });
    let meshes = vec![
        square(Vec3::ZERO, Vec3::new(1.0, 0.0, 1.0), 30.0, 0),
        square(Vec3::X * 9.0, -Vec3::X, 200.0, 1),
    ];
    let lights = vec![point_light(Vec3::new(6.0, 0.0, 2.0), 5.0)];
    let camera = camera(Vec3::Z * 4.0, Vec3::ZERO, 20.0);
    let scene = scene(meshes, vec![mirror, colored(blue)], lights, camera);
    let (guide, position, depth) = seen(&scene, settings(16, 16), 4);
    assert_near(guide.albedo, tint * blue, 1e-5);
    assert_near(guide.normal, -Vec3::X, 1e-5);
    // Position and depth are those of the mirror itself.
    assert!(position.x.abs() < 0.2 && depth < 4.5, "{position} {depth}");
}

#[test]
fn glass_shows_what_is_behind_by_the_share_that_passes() {
    // A slab of index 1.5, nearly at normal incidence: (1 - r)/(1 + r) passes, r = 4 %; the rest
    // goes into nothing.
    let glass = Material::new("glass", Bsdf::Dielectric(Dielectric::new(1.5)));
    let (guide, _, depth) = seen(&wall(Some(glass), Vec3::Z), settings(32, 32), 60);
    // A share of 245760 paths has a standard error of .0005.
    let passed = 0.9231 * Vec3::new(0.8, 0.2, 0.1);
    assert_near(guide.albedo, passed, 0.006);
    assert!((guide.normal.z - 0.9231).abs() < 0.006, "{}", guide.normal);
    assert!((depth - 2.0).abs() < 1e-3, "{depth}");
}

#[test]
fn nothing_is_told_where_there_is_nothing() {
    let meshes = vec![square(Vec3::new(0.0, 0.0, 9.0), Vec3::Z, 1.0, 0)];
    let lights = vec![point_light(Vec3::Z * 12.0, 5.0)];
    let camera = camera(Vec3::Z * 4.0, Vec3::ZERO, 40.0);
    let scene = scene(meshes, vec![gray(0.5, 0.0)], lights, camera);
    let (guide, position, depth) = seen(&scene, settings(8, 8), 2);
    assert_eq!((guide, position, depth), (DenoiseFeatures::default(), Vec3::ZERO, FAR));
}

/// Settings under which light is found in different ways.
fn ways() -> Vec<Settings> {
    let start = Settings { radius: 0.08, caustic_radius: 0.04, ..settings(20, 15) };
    let single = |merge_vertex, direct| Settings { merge_vertex, direct, ..start.clone() };
    vec![
        single(1, Direct::Connect),
        single(2, Direct::Connect),
        single(1, Direct::PhotonMap),
        Settings { caustic_radius: start.radius, ..single(1, Direct::Connect) },
        Settings { kernel: Kernel::Area, ..single(2, Direct::Connect) },
        Settings { strategy: Strategy::Mis, ..single(2, Direct::Connect) },
    ]
}

/// A box with a mirror on the floor, so that there are caustics. Each wall has its color: sums of
/// equal photons would not depend on their order.
fn mirrored_box() -> Arc<Scene> {
    let mut meshes = Vec::new();
    for (number, axis) in (0..).zip([Vec3::X, Vec3::Y, Vec3::Z]) {
        meshes.push(square(axis, -axis, 1.0, 2 * number));
        meshes.push(square(-axis, axis, 1.0, 2 * number + 1));
    }
    meshes.push(square(Vec3::new(0.0, 0.0, -0.8), Vec3::new(0.2, 0.1, 1.0), 0.4, 6));
    meshes.push(square(Vec3::new(0.0, 0.0, 0.95), -Vec3::Z, 0.2, 7));
    let mirror = Material::new("mirror", Bsdf::Mirror { reflectance: Vec3::splat(0.9) });
    let wall = |number: u8| {
        let share = f32::from(number);
        colored(Vec3::new(0.3 + 0.07 * share, 0.71 - 0.05 * share, 0.37 + 0.03 * share))
    };
    let mut materials: Vec<Material> = (0..6).map(wall).collect();
    materials.extend([mirror, gray(0.0, 4.0)]);
    let camera = camera(Vec3::new(-0.9, -0.85, 0.2), Vec3::new(0.1, 0.1, 0.25), 80.0);
    scene(meshes, materials, vec![point_light(Vec3::new(-0.5, 0.4, 0.3), 0.3)], camera)
}

#[test]
fn the_image_is_the_same_bit_for_bit_and_the_sum_of_its_light() {
    let scene = mirrored_box();
    let accel = accel(&scene);
    for (way, settings) in ways().into_iter().enumerate() {
        let mut plain = Renderer::new(&scene, &accel, settings.clone()).unwrap();
        let mut kept = plain.with_settings(settings).unwrap().configure(CONFIG).unwrap();
        for iteration in 0..9 {
            let measure = if iteration % 3 == 0 { Measure::Pairs } else { Measure::Off };
            plain.iterate(measure);
            kept.iterate(measure);
        }
        assert_eq!(plain.film(), kept.film(), "{way}");
        let image = CombinedImage::new(kept.blocks(), vec![1.0]);
        let mean = image.mean();
        let light = image.light_rows(kept.shared(), 0..image.resolution().1).unwrap();
        let mut sums = [DVec3::ZERO; 4];
        for (pixel, light) in mean.iter().zip(&light) {
            let told = light.emission + light.direct + light.caustics;
            let indirect = pixel.as_dvec3() - told;
            let least = -1e-5 * pixel.max_element() as f64;
            assert!(indirect.min_element() >= least, "{way}: {pixel} {light:?}");
            for (sum, kind) in
                sums.iter_mut().zip([light.emission, light.direct, light.caustics, indirect])
            {
                *sum += kind;
            }
        }
        let [emission, direct, caustics, indirect] = sums;
        assert!(emission.x > 0.0 && direct.x > 0.0 && indirect.x > 0.0, "{way}: {sums:?}");
        // With direct light from the photon map, caustics are part of it.
        assert_eq!(caustics.x > 0.0, kept.settings().direct == Direct::Connect, "{way}");
    }
}

#[test]
fn light_of_each_kind_is_the_same_however_it_is_found() {
    let scene = mirrored_box();
    let accel = accel(&scene);
    let mut found = Vec::new();
    for settings in ways() {
        let settings = Settings { light_paths: 4000, ..settings };
        let photon_map = settings.direct == Direct::PhotonMap;
        let mut renderer =
            Renderer::new(&scene, &accel, settings).unwrap().configure(CONFIG).unwrap();
        // Means over the image of each iteration.
        let mut means: Vec<[f64; 3]> = Vec::new();
        let mut before = [0.0; 3];
        for _ in 0..60 {
            renderer.iterate(Measure::Off);
            let light = renderer.block().statistics.light.as_ref().unwrap().folds()[0].values();
            let sum = |of: &dyn Fn(usize) -> f64| {
                (0..light.len()).map(of).sum::<f64>() / light.len() as f64
            };
            let now = [
                sum(&|at| light[at].emission.x),
                sum(&|at| light[at].direct.x),
                sum(&|at| light[at].caustics.x),
            ];
            means.push([0, 1, 2].map(|kind| now[kind] - before[kind]));
            before = now;
        }
        let n = means.len() as f64;
        let statistic = [0, 1, 2].map(|kind| {
            let mean = means.iter().map(|m| m[kind]).sum::<f64>() / n;
            let variance = means.iter().map(|m| (m[kind] - mean).powi(2)).sum::<f64>() / (n - 1.0);
            (mean, variance / n)
        });
        found.push((photon_map, statistic));
    }
    let (_, first) = found[0];
    for (way, (photon_map, statistic)) in found.iter().enumerate().skip(1) {
        for kind in 0..3 {
            let mut expected = first[kind];
            if *photon_map && kind > 0 {
                expected = if kind == 1 {
                    (first[1].0 + first[2].0, first[1].1 + first[2].1)
                } else {
                    (0.0, 0.0)
                };
            }
            let off = statistic[kind].0 - expected.0;
            let error = (statistic[kind].1 + expected.1).sqrt();
            // The merge bias of what is gathered comes on top: discs lose light at edges.
            let bias = if kind == 0 || (kind == 1 && !photon_map) { 0.0 } else { 0.1 * expected.0 };
            assert!(off.abs() <= 4.0 * error + bias, "{way} {kind}: {statistic:?} {first:?}");
        }
    }
}

#[test]
fn layers_do_not_depend_on_measuring() {
    let scene = furnished_box();
    let accel = accel(&scene);
    let own = Settings { camera_paths: 1, ..settings(20, 15) };
    let mut plain = Renderer::new(&scene, &accel, own.clone()).unwrap().configure(CONFIG).unwrap();
    let mut measured = plain.with_settings(own).unwrap().configure(CONFIG).unwrap();
    for _ in 0..3 {
        plain.iterate(Measure::Off);
        measured.iterate(Measure::Pairs);
    }
    assert_eq!(plain.shared(), measured.shared());
    assert_eq!(plain.block().statistics.light, measured.block().statistics.light);
    assert_eq!(plain.block().statistics.folds, measured.block().statistics.folds);
}

/// What a renderer that hides lights leaves out is the layer of emission, pixel by pixel.
#[test]
fn hidden_lights_are_the_layer_of_emission() {
    let scene = mirrored_box();
    let accel = accel(&scene);
    for (way, own) in ways().into_iter().enumerate() {
        let render = |hides_lights: bool| {
            let config = RenderConfig { hides_lights, ..CONFIG };
            let renderer = Renderer::new(&scene, &accel, own.clone()).unwrap();
            let mut renderer = renderer.configure(config).unwrap();
            (0..4).for_each(|_| drop(renderer.iterate(Measure::Off)));
            renderer
        };
        let [shown, hidden] = [false, true].map(render);
        let image = CombinedImage::new(shown.blocks(), vec![1.0]);
        let light = image.light_rows(shown.shared(), 0..image.resolution().1).unwrap();
        let rest = CombinedImage::new(hidden.blocks(), vec![1.0]).mean();
        let mut sum = 0.0;
        for ((shown, rest), light) in image.mean().iter().zip(rest).zip(&light) {
            let off = (shown.as_dvec3() - rest.as_dvec3() - light.emission).abs().max_element();
            assert!(off <= 1e-5 * (1.0 + f64::from(shown.max_element())), "{way}: {shown} {rest}");
            sum += light.emission.x;
        }
        assert!(sum > 0.0, "{way}: a lamp is seen");
    }
}
