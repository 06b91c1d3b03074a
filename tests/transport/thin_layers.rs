//! Thin bodies and layers: no light leaks through them or between them, whatever samples it, and
//! however near they are.

use crate::common::strategies::ALL;
use crate::common::*;
use bdpm::Settings;
use bdpm::base::math::Rgb;
use bdpm::scene::lights::environment::Environment;
use bdpm::scene::{Material, Mesh, Scene};
use bdpm::settings::{Direct, Kernel, Strategy};
use glam::Vec3;
use std::sync::Arc;

const RADIUS: f32 = 0.2;

/// Distances between layers, over the merge radius.
const GAPS: [f32; 3] = [1e-2, 1e-3, 1e-4];

/// The closed box between two corners, its fronts outside.
fn closed_box(low: Vec3, high: Vec3) -> Mesh {
    let corner = |i: u32| {
        let pick = |axis: usize| if i >> axis & 1 == 0 { low[axis] } else { high[axis] };
        Vec3::new(pick(0), pick(1), pick(2))
    };
    let positions = (0..8).map(corner).collect();
    let quads: [[u32; 4]; 6] =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    Mesh { name: "box".into(), positions, triangles, ..Mesh::default() }
}

/// A sky of one radiance above the plane `y = 0` and another below.
fn sky(above: f32, below: f32) -> Environment {
    Environment::new(1, 2, vec![Rgb::splat(above), Rgb::splat(below)], 0.0)
}

fn under(sky: Environment, scene: Arc<Scene>) -> Arc<Scene> {
    Arc::new(Arc::unwrap_or_clone(scene).with_environment(sky))
}

fn merging(direct: Direct, merge_vertex: u32, light_paths: u32) -> Settings {
    by_way(Settings {
        kernel: Kernel::Area,
        radius: RADIUS,
        caustic_radius: RADIUS,
        direct,
        merge_vertex,
        light_paths,
        ..settings(24, 24)
    })
}

/// Light on the ground around a closed house, whose floor has the same normal, does not show
/// inside; and light inside does not show on the ground.
#[test]
fn light_does_not_leak_between_a_floor_and_the_ground_under_it() {
    for gap in GAPS.map(|gap| gap * RADIUS) {
        let ground = square(-gap * Vec3::Y, Vec3::Y, 4.0, 0);
        let house = closed_box(Vec3::new(-1.0, 0.0, -1.0), Vec3::ONE);
        let meshes = vec![house, ground];
        let eye = camera(Vec3::new(-0.9, 0.9, -0.8), Vec3::new(0.3, 0.0, 0.2), 90.0);
        let outside =
            under(sky(1.0, 0.0), scene(meshes.clone(), vec![gray(0.5, 0.0)], vec![], eye));
        let eye = camera(Vec3::new(-3.0, 3.0, 0.1), Vec3::new(-1.1, 0.0, 0.0), 20.0);
        let lamp = vec![point_light(Vec3::new(0.0, 0.5, 0.0), 1.0)];
        let inside = scene(meshes, vec![gray(0.5, 0.0)], lamp, eye);
        for (name, scene) in [("outside", outside), ("inside", inside)] {
            for (direct, merge_vertex) in ALL {
                let settings = merging(direct, merge_vertex, 20_000);
                let found = mean_luminance(&scene, &accel(&scene), settings, 2);
                let what = format!("light {name}, gap {gap}, {direct:?} k = {merge_vertex}");
                assert_eq!(found.mean, 0.0, "{what}");
            }
        }
    }
}

/// A sheet on a floor under an even sky is as bright as the floor: its photons are not shared with
/// it.
#[test]
fn sheet_on_a_floor_has_all_of_its_light() {
    for gap in [0.05, 1e-2, 1e-3, 1e-4, 1e-5].map(|gap| gap * RADIUS) {
        let floor = square(Vec3::ZERO, Vec3::Y, 2.0, 0);
        let sheet = square(gap * Vec3::Y, Vec3::Y, 0.4, 0);
        // Under a sheet this near there is no light, so that the floor beside it is exact as well.
        let is_near = gap < 2e-3 * RADIUS;
        let side = if is_near { 0.8 } else { 0.39 };
        let fov = 2.0 * f32::atan(side / 2.0).to_degrees();
        let eye = camera(Vec3::new(0.0, 2.0, 0.0), Vec3::ZERO, fov);
        let scene = scene(vec![floor, sheet], vec![gray(0.5, 0.0)], vec![], eye);
        let scene = under(sky(1.0, 1.0), scene);
        for merge_vertex in [1, MIS] {
            let settings = merging(Direct::PhotonMap, merge_vertex, 100_000);
            let found = mean_luminance(&scene, &accel(&scene), settings, 10);
            println!("gap {gap}, k = {merge_vertex}: {found:?}");
            found.assert_is(0.5, 0.0);
        }
    }
}

/// The dark side of thin plates, closed and open, beside a side that is a thousand times as bright.
#[test]
fn dark_side_of_a_thin_plate_is_a_thousandth_of_the_bright_side() {
    for (gap, merge_vertex) in [(1e-2, 1), (1e-3, MIS), (1e-5, MIS)] {
        let gap = gap * RADIUS;
        let half = Vec3::new(1.0, 0.5 * gap, 1.0);
        let sheet = |y: f32, up: f32| square(y * gap * Vec3::Y, up * Vec3::Y, 1.0, 0);
        let plates = [
            ("closed box", vec![closed_box(-half, half)]),
            ("two sheets back to back", vec![sheet(0.5, 1.0), sheet(-0.5, -1.0)]),
            ("two sheets of one normal", vec![sheet(0.5, 1.0), sheet(-0.5, 1.0)]),
            ("sheet", vec![sheet(0.0, 1.0)]),
        ];
        for (name, meshes) in plates {
            let eye = camera(Vec3::new(0.0, -2.0, 0.0), Vec3::ZERO, 50.0);
            let scene = scene(meshes, vec![gray(0.5, 0.0)], vec![], eye);
            let scene = under(sky(1000.0, 1.0), scene);
            let settings = merging(Direct::PhotonMap, merge_vertex, 250_000);
            let found = mean_luminance(&scene, &accel(&scene), settings, 16);
            println!("{name}, gap {gap}, k = {merge_vertex}: {found:?}");
            found.assert_is(0.5, 0.0);
        }
    }
}

/// A blind, a closed box much thinner than the radius that lets some light through, before a lamp:
/// the side of the room does not show the light of the side of the lamp.
#[test]
fn blind_before_a_lamp_shows_its_own_light() {
    let room = closed_box(Vec3::new(-1.0, -1.0, -1.0), Vec3::ONE);
    let blind = closed_box(Vec3::new(-0.6, -0.6, -0.7002), Vec3::new(0.6, 0.6, -0.7));
    let lamp = square(Vec3::new(0.0, 0.0, -0.95), Vec3::Z, 0.3, 2);
    let slats = Material { opacity: Some(0.978), ..gray(0.5, 0.0) };
    let meshes = vec![room, Mesh { material: 1, ..blind }, lamp];
    let eye = camera(Vec3::new(0.1, 0.2, 0.8), Vec3::new(0.0, 0.0, -0.7), 40.0);
    let scene = scene(meshes, vec![gray(0.5, 0.0), slats, gray(0.0, 50.0)], vec![], eye);
    let accel = accel(&scene);
    let path = Settings { strategy: Strategy::Path, merge_vertex: 2, ..settings(16, 16) };
    let expected = mean_luminance(&scene, &accel, Settings { camera_paths: 64, ..path }, 48);
    let ways = [
        (Direct::PhotonMap, 1),
        (Direct::Connect, 1),
        (Direct::Connect, 2),
        (Direct::Connect, MIS),
    ];
    for (direct, merge_vertex) in ways {
        let own = merging(direct, merge_vertex, 100_000);
        let own = Settings { width: 16, height: 16, camera_paths: 16, ..own };
        let found = mean_luminance(&scene, &accel, own, 48);
        let error = found.error.hypot(expected.error);
        println!("{direct:?} k = {merge_vertex}: {found:?}, path {expected:?}");
        // Light falls toward the edges of the blind and of the shadow, which a radius of a sixth of
        // it blurs: 2 % remain.
        assert!(
            (found.mean - expected.mean).abs() < 4.0 * error + 0.02 * expected.mean,
            "{direct:?} k = {merge_vertex}: {found:?}, path {expected:?}"
        );
        assert!(error < 0.02 * expected.mean, "{found:?} {expected:?}");
    }
}

/// Tiles side by side, each a body of its own, are one layer: photons of neighbors merge.
#[test]
fn tiles_side_by_side_are_one_layer() {
    let side = 0.05;
    let tile = |i: i32, j: i32| {
        let low = Vec3::new(i as f32, -0.2, j as f32) * side;
        closed_box(low, low + side * Vec3::new(1.0, 0.2, 1.0))
    };
    let tiles = (-20..20).flat_map(|i| (-20..20).map(move |j| (i, j)));
    let mut separate: Vec<Mesh> = tiles.map(|(i, j)| tile(i, j)).collect();
    separate.iter_mut().for_each(|mesh| mesh.name = "tile".into());
    let whole = vec![square(Vec3::ZERO, Vec3::Y, 1.0, 0)];
    let image = |meshes: Vec<Mesh>| {
        let eye = camera(Vec3::new(0.0, 2.0, 0.0), Vec3::ZERO, 30.0);
        let scene = under(sky(1.0, 0.0), scene(meshes, vec![gray(0.5, 0.0)], vec![], eye));
        mean_luminance(&scene, &accel(&scene), merging(Direct::PhotonMap, 1, 50_000), 10)
    };
    let [separate, whole] = [separate, whole].map(image);
    println!("{separate:?} {whole:?}");
    separate.assert_is(0.5, 0.0);
    whole.assert_is(0.5, 0.0);
    // If each tile merged its own photons only, 50 times as few photons would count.
    assert!(separate.error < 2.0 * whole.error, "{separate:?} {whole:?}");
}
