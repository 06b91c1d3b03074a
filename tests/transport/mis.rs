//! Paths that are found in several ways: the weights add up to 1, whatever they are.

use crate::common::*;
use bdpm::bsdf::{Bsdf, Coated, Conductor, Dielectric, Glossy, Reflectance, RoughDielectric};
use bdpm::noise::Measure;
use bdpm::scene::{Camera, Emitter, Environment, FieldOfView, Material, Mesh, Scene, Spot};
use bdpm::settings::{Direct, Kernel, Roulette, Strategy};
use bdpm::{Renderer, Settings};
use glam::Vec3;

const SIDE: u32 = 16;
const TILE: u32 = 4;
const TILES: usize = (SIDE / TILE * (SIDE / TILE)) as usize;

/// Scales of merges at both vertices, and the planned light paths over the actual ones.
type Weighting = ([f64; 2], f64);

fn weighted(settings: &Settings, ([mis_c1, mis_c2], planned): Weighting) -> Settings {
    let mis_light_paths = (f64::from(settings.light_paths) * planned) as u32;
    let settings = Settings { mis_light_paths, mis_c1, mis_c2, ..settings.clone() };
    Settings { strategy: Strategy::Mis, merge_vertex: 2, ..settings }
}

/// Mean of each tile in each iteration: `[tile][iteration]`.
fn tiles(scene: &Scene, settings: Settings, iterations: usize) -> Vec<Vec<f64>> {
    let all = pixel_samples(scene, &*accel(scene), settings, iterations);
    let mut tiles = vec![vec![0.0; iterations]; TILES];
    for (pixel, samples) in (0..).zip(all) {
        let (x, y) = (pixel % SIDE / TILE, pixel / SIDE / TILE);
        let tile = &mut tiles[(y * (SIDE / TILE) + x) as usize];
        tile.iter_mut().zip(samples).for_each(|(sum, x)| *sum += x / f64::from(TILE * TILE));
    }
    tiles
}

/// Asserts that differences have the mean 0 in each tile, and over all of them within `resolution` of `value`;
/// `systematic` is what they may be off besides, relative.
#[track_caller]
fn assert_zero(what: &str, differences: &[Vec<f64>], value: f64, resolution: f64, systematic: f64) {
    let mut square = 0.0;
    for samples in differences {
        let Estimate { mean, error } = Estimate::from_samples(samples);
        square += ((mean.abs() - 2.0 * systematic * value).max(0.0) / error).powi(2) / TILES as f64;
    }
    let iterations = differences[0].len();
    let whole = |i: usize| differences.iter().map(|tile| tile[i]).sum::<f64>() / TILES as f64;
    let Estimate { mean, error } =
        Estimate::from_samples(&(0..iterations).map(whole).collect::<Vec<_>>());
    let (off, error) = (mean / value, error / value);
    println!("{what}: off by {off:+.5} +- {error:.5}, squared deviations of tiles {square:.2}");
    assert!(error < resolution, "{what}: {error} says little");
    assert!(off.abs() < 4.0 * error + systematic, "{what}: off by {off} +- {error}");
    // The mean of 16 squares has a standard error of .35, and more as tiles share light paths.
    assert!(square < 4.0, "{what}: {square}");
}

/// What shows other weights at the same paths; `k = 2` is held against each.
const WEIGHTINGS: [Weighting; 3] = [([1.0, 1.0], 1.0), ([0.3, 2.0], 0.02), ([4.0, 0.1], 0.1)];

/// Everything that does not absorb is as bright as the walls, which emit 1 and reflect half: 2.
fn furnace(bsdfs: &[Bsdf], normals: bool) -> Scene {
    let mut meshes = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 0));
    }
    let mut materials = vec![gray(0.5, 1.0)];
    for (index, bsdf) in bsdfs.iter().enumerate() {
        let center =
            Vec3::new(-0.45 + 0.6 * (index % 2) as f32, 0.3, -0.5 + 0.8 * (index / 2) as f32);
        let ball = sphere(center, 0.3, 4, false, index as u32 + 1);
        let own = ball.positions.iter().map(|p| (*p - center).normalize()).collect();
        meshes.push(Mesh { normals: if normals { own } else { vec![] }, ..ball });
        materials.push(Material::new("lossless", *bsdf));
    }
    let camera = camera(Vec3::new(-0.1, -0.97, 0.1), Vec3::new(-0.1, 1.0, 0.0), 75.0);
    scene(meshes, materials, vec![], camera)
}

fn assert_furnace(name: &str, scene: &Scene, loss: f64, iterations: usize) {
    for (direct, roulette, caustic_radius) in [
        (Direct::Connect, Roulette::Albedo, 0.05),
        (Direct::Connect, Roulette::Weight, 0.15),
        (Direct::PhotonMap, Roulette::Weight, 0.05),
    ] {
        let settings = Settings {
            direct,
            light_roulette: roulette,
            camera_roulette: roulette,
            kernel: Kernel::Area,
            light_paths: 8000,
            camera_paths: 8,
            radius: 0.15,
            caustic_radius,
            seed: 5,
            ..settings(SIDE, SIDE)
        };
        let single = tiles(scene, Settings { merge_vertex: 2, ..settings.clone() }, iterations);
        for weighting in WEIGHTINGS {
            let several = tiles(scene, weighted(&settings, weighting), iterations);
            let what = format!("{name} {direct:?} {roulette:?} {weighting:?}");
            let exact: Vec<Vec<f64>> =
                several.iter().map(|tile| tile.iter().map(|x| x - 2.0).collect()).collect();
            assert_zero(&format!("{what}, 2"), &exact, 2.0, 3e-3, loss);
            let differences: Vec<Vec<f64>> = several
                .iter()
                .zip(&single)
                .map(|(several, single)| several.iter().zip(single).map(|(a, b)| a - b).collect())
                .collect();
            assert_zero(&format!("{what}, k = 2"), &differences, 2.0, 3e-3, loss);
        }
    }
}

fn white_metal(alpha: f32) -> Bsdf {
    let reflectance = Reflectance::Artist { normal: Vec3::ONE };
    Bsdf::Conductor(Conductor::new(reflectance, alpha))
}

#[test]
fn diffuse_walls_where_all_is_as_bright() {
    assert_furnace("walls", &furnace(&[Bsdf::diffuse(Vec3::ONE)], false), 0.0, 40);
}

#[test]
fn smooth_things_where_all_is_as_bright() {
    let bsdfs = [
        Bsdf::Mirror { reflectance: Vec3::ONE },
        Bsdf::Dielectric(Dielectric { eta: 1.5 }),
        Bsdf::Coated(Coated::new(Vec3::ONE, 1.5)),
        Bsdf::Glossy(Glossy::new(Vec3::ONE, 0.0, 1.5, 0.0)),
    ];
    assert_furnace("smooth", &furnace(&bsdfs, false), 0.0, 40);
}

#[test]
fn rough_things_where_all_is_as_bright() {
    let bsdfs = [
        white_metal(0.15),
        white_metal(0.6),
        Bsdf::Glossy(Glossy::new(Vec3::ONE, 0.3, 1.5, 0.2)),
        Bsdf::Glossy(Glossy::new(Vec3::ONE, 0.5, 1.5, 0.5)),
    ];
    assert_furnace("rough", &furnace(&bsdfs, false), 1e-3, 40);
    // Single scattering loses a little.
    let glass = [Bsdf::RoughDielectric(RoughDielectric::new(1.5, 0.05))];
    assert_furnace("rough glass", &furnace(&glass, false), 2e-3, 40);
}

/// Walls under a coat, between which light paths choose to be mirrored and camera paths are, too, where they are cut.
#[test]
fn coated_walls_where_all_is_as_bright() {
    let mut meshes = Vec::new();
    for (index, axis) in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().enumerate() {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, u32::from(index != 1)));
    }
    let coated = Bsdf::Coated(Coated::new(Vec3::ONE, 2.0));
    let materials = vec![gray(0.5, 1.0), Material::new("coated", coated)];
    let camera = camera(Vec3::new(0.4, 0.6, 0.5), Vec3::new(-0.8, -0.3, -0.8), 75.0);
    assert_furnace("coated walls", &scene(meshes, materials, vec![], camera), 0.0, 200);
}

/// A room that is open above under lights of all kinds, with a mirror, glass and gloss.
fn room_under_all_lights() -> Scene {
    let mut meshes = vec![square(-Vec3::Z, Vec3::Z, 1.0, 0)];
    for axis in [Vec3::X, Vec3::Y] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 0));
    }
    meshes.push(square(Vec3::new(-0.5, 0.5, 0.9), -Vec3::Z, 0.2, 1));
    meshes.push(sphere(Vec3::new(0.3, 0.3, -0.6), 0.3, 3, false, 2));
    let spot = Spot {
        position: Vec3::new(0.7, -0.6, 0.8),
        direction: Vec3::new(-0.4, 0.5, -1.0).normalize(),
        intensity: Vec3::new(1.5, 1.0, 0.5),
        cos_inner: 0.95,
        cos_outer: 0.7,
    };
    let direction = Vec3::new(0.3, 0.2, -1.0).normalize();
    let sun = bdpm::scene::Directional::new(direction, Vec3::splat(1.0));
    let lights = vec![
        Emitter::Spot(spot),
        Emitter::Directional(sun),
        point_light(Vec3::new(-0.5, -0.4, 0.5), 0.4),
    ];
    let eye = Vec3::new(-0.8, -0.85, 0.7);
    let camera = Camera::look(eye, Vec3::new(1.0, 1.0, -1.0), Vec3::Z, FieldOfView::X(75.0));
    let gloss = Bsdf::Glossy(Glossy::new(Vec3::new(0.7, 0.4, 0.3), 0.3, 1.5, 0.5));
    let materials = vec![gray(0.6, 0.0), gray(0.0, 4.0), Material::new("gloss", gloss)];
    let map = vec![Vec3::splat(0.5), Vec3::new(0.2, 0.4, 2.0)];
    scene(meshes, materials, lights, camera.unwrap())
        .with_environment(Environment::new(2, 1, map, 30.0))
}

#[test]
fn every_weighting_has_the_same_mean_under_all_lights() {
    let scene = room_under_all_lights();
    let settings = Settings {
        kernel: Kernel::Area,
        light_paths: 20_000,
        camera_paths: 8,
        radius: 0.05,
        caustic_radius: 0.03,
        seed: 6,
        ..settings(SIDE, SIDE)
    };
    let iterations = 60;
    let single = tiles(&scene, Settings { merge_vertex: 2, ..settings.clone() }, iterations);
    let value = single.iter().flatten().sum::<f64>() / (TILES * iterations) as f64;
    for weighting in WEIGHTINGS {
        let several = tiles(&scene, weighted(&settings, weighting), iterations);
        let differences: Vec<Vec<f64>> = several
            .iter()
            .zip(&single)
            .map(|(several, single)| several.iter().zip(single).map(|(a, b)| a - b).collect())
            .collect();
        // The kernel's bias is not the same at both vertices.
        assert_zero(&format!("{weighting:?}"), &differences, value, 2e-3, 2e-3);
    }
}

/// Images of one iteration, and their greatest relative deviation.
fn deviation(scene: &Scene, one: Settings, other: Settings) -> f64 {
    let accel = accel(scene);
    let [one, other] = [one, other].map(|settings| {
        let mut renderer = Renderer::new(scene, &*accel, settings).unwrap();
        renderer.iterate(Measure::Off);
        renderer.film().mean()
    });
    let off = one.iter().zip(&other).map(|(a, b)| f64::from((*a - *b).length()));
    let mean = other.iter().map(|b| f64::from(b.length())).sum::<f64>() / other.len() as f64;
    off.fold(0.0, f64::max) / mean
}

#[test]
fn weights_for_one_way_alone_give_the_images_of_that_strategy() {
    let all = room_under_all_lights();
    for roulette in [Roulette::Albedo, Roulette::Weight] {
        let settings = Settings {
            light_roulette: roulette,
            camera_roulette: roulette,
            light_paths: 20_000,
            caustic_radius: 0.05,
            ..settings(SIDE, SIDE)
        };
        let second = Settings { merge_vertex: 2, ..settings.clone() };
        let off = deviation(&all, weighted(&settings, ([0.0, 1.0], 1.0)), second);
        assert!(off < 1e-5, "k = 2: {off}");
        for scene in [&all, &furnished_box()] {
            let first = weighted(&settings, ([1e9, 0.0], 1e5));
            let off = deviation(scene, first, Settings { merge_vertex: 1, ..settings.clone() });
            assert!(off < 1e-3, "k = 1: {off}");
        }
    }
}
