//! Meters against closed forms, and against rays of a path tracer, which connects no meter with a
//! light.

use crate::common::boxes;
use crate::common::images::{Difference, Subject};
use crate::common::*;
use bdpm::scene::{Camera, Environment, Meter, MeterKind};
use bdpm::settings::Direct::{self, Connect, PhotonMap};
use bdpm::{Scene, Settings};
use glam::Vec3;
use std::f64::consts::PI;
use std::sync::Arc;

/// Mean of each meter and its standard error, W/m^2 or W/(m^2 sr).
fn read(scene: &Arc<Scene>, kind: MeterKind, meters: Vec<Meter>, own: Settings) -> Vec<[f64; 2]> {
    let width = meters.len() as u32;
    let scene = Arc::new(scene.with_meters(kind, meters));
    pixel_means(&scene, Settings { width, height: 1, ..own }, 100)
}

fn irradiance(scene: &Arc<Scene>, meters: &[[Vec3; 2]], own: Settings) -> Vec<[f64; 2]> {
    let meters = meters.iter().map(|[at, normal]| Meter::irradiance(*at, *normal).unwrap());
    read(scene, MeterKind::Irradiance, meters.collect(), own)
}

fn assert_within([mean, error]: [f64; 2], expected: f64) {
    let estimate = Estimate { mean, error };
    estimate.assert_is(expected, 1e-5);
}

/// A camera that sees none of the scene: meters do not depend on it.
fn blind() -> Camera {
    camera(Vec3::new(0.0, 0.0, 100.0), Vec3::new(0.0, 0.0, 200.0), 20.0)
}

#[test]
fn point_light_above_a_plane_follows_the_inverse_square_law() {
    let floor = square(Vec3::ZERO, Vec3::Z, 5.0, 0);
    let lamp = point_light(Vec3::new(0.0, 0.0, 2.0), 3.0);
    let scene = scene(vec![floor], vec![gray(0.0, 0.0)], vec![lamp], blind());
    let meters = [0.0, 1.0, 3.0].map(|x| [Vec3::new(x, 0.0, 0.0), Vec3::Z]);
    let own = Settings { camera_paths: 1, light_paths: 1, ..settings(1, 1) };
    for ([mean, error], [at, _]) in irradiance(&scene, &meters, own).into_iter().zip(meters) {
        // I cos(theta)/d^2, with cos(theta) = h/d. A single light leaves no noise.
        let expected = 3.0 * 2.0 / f64::from(4.0 + at.x * at.x).powf(1.5);
        assert!((mean / expected - 1.0).abs() < 1e-5 && error < 1e-6 * mean, "{mean} {expected}");
    }
}

#[test]
fn square_panel_lights_meters_by_its_form_factor() {
    // A panel of side 2 at height 1 over meters below its center and one of its corners, and one
    // that faces away.
    let panel = square(Vec3::new(0.0, 0.0, 1.0), -Vec3::Z, 1.0, 0);
    let scene = scene(vec![panel], vec![gray(0.0, 7.0)], vec![], blind());
    let meters = [
        [Vec3::ZERO, Vec3::Z],
        [Vec3::new(1.0, 1.0, 0.0), Vec3::Z],
        [Vec3::new(0.0, 0.0, 0.0), Vec3::NEG_Z],
    ];
    // Differential element below a corner of a rectangle of sides `a` and `b` at height 1 (Howell,
    // C-1).
    let corner = |a: f64, b: f64| {
        let part = |a: f64, b: f64| a / (1.0 + a * a).sqrt() * (b / (1.0 + a * a).sqrt()).atan();
        (part(a, b) + part(b, a)) / (2.0 * PI)
    };
    let own = Settings { camera_paths: 64, ..settings(1, 1) };
    let found = irradiance(&scene, &meters, own);
    assert_within(found[0], PI * 7.0 * 4.0 * corner(1.0, 1.0));
    assert_within(found[1], PI * 7.0 * corner(2.0, 2.0));
    assert_eq!(found[2], [0.0; 2]);
}

#[test]
fn sky_lights_a_free_meter_by_its_visible_half() {
    let floor = square(Vec3::new(0.0, 0.0, -1.0), Vec3::Z, 1.0, 0);
    let scene = scene(vec![floor], vec![gray(0.0, 0.0)], vec![], blind());
    let scene =
        Scene::clone(&scene).with_environment(Environment::new(1, 1, vec![Vec3::splat(2.0)], 0.0));
    let meters = [[Vec3::ZERO, Vec3::Z], [Vec3::ZERO, Vec3::X]];
    let own = Settings { camera_paths: 64, ..settings(1, 1) };
    let found = irradiance(&Arc::new(scene), &meters, own);
    assert_within(found[0], 2.0 * PI);
    // The black floor covers two rectangles of 1 by 1 below the meter, perpendicular to it (Howell,
    // C-3).
    let covered = (1.0f64.atan() - 0.5f64.sqrt() * 0.5f64.sqrt().atan()) / PI;
    assert_within(found[1], 2.0 * PI * (1.0 - covered));
}

#[test]
fn closed_box_of_uniform_light_has_the_irradiance_of_the_furnace() {
    let mut meshes = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 0));
    }
    let scene = scene(meshes, vec![gray(0.6, 1.0)], vec![], blind());
    // On a wall, and in the middle.
    let meters = [[Vec3::new(0.2, 0.1, -1.0), Vec3::Z], [Vec3::ZERO, Vec3::new(1.0, 2.0, 0.5)]];
    for (direct, merge_vertex) in [(Connect, 1), (Connect, 2), (Connect, MIS)] {
        let own = Settings {
            direct,
            merge_vertex,
            light_paths: 20_000,
            camera_paths: 64,
            radius: 0.02,
            caustic_radius: 0.02,
            kernel: bdpm::settings::Kernel::Area,
            ..settings(1, 1)
        };
        for [mean, error] in irradiance(&scene, &meters, by_way(own)) {
            // Radiance 1/(1 - 0.6) everywhere. The photon of a wall counts for the area within the
            // radius.
            Estimate { mean, error }.assert_is(PI / 0.4, 2e-3);
        }
    }
}

#[test]
fn cone_of_a_luminance_meter_sees_its_share_of_a_panel() {
    // Half of the cones of two meters look past the straight edge of a large panel.
    let panel = square(Vec3::new(50.0, 0.0, 1.0), -Vec3::Z, 50.0, 0);
    let scene = scene(vec![panel], vec![gray(0.0, 3.0)], vec![], blind());
    let at = |half_angle: f32| Meter::radiance(Vec3::ZERO, Vec3::Z, half_angle).unwrap();
    let inside = Meter::radiance(Vec3::new(9.0, 0.0, 0.0), Vec3::Z, 0.3).unwrap();
    let meters = vec![at(0.3), at(0.6), inside];
    let own = Settings { camera_paths: 100, ..settings(1, 1) };
    let found = read(&scene, MeterKind::Radiance, meters, own);
    assert_within(found[0], 1.5);
    assert_within(found[1], 1.5);
    assert_within(found[2], 3.0);
}

#[test]
fn meters_agree_with_a_path_tracer_by_all_strategies() {
    for name in ["glass-ball", "rough-metal-ball"] {
        let scene = boxes::named(name);
        let points = [
            ([0.3, -0.4, -1.0], Vec3::Z),
            ([-0.7, 0.5, -1.0], Vec3::Z),
            ([0.0, -0.6, 0.1], Vec3::Z),
            ([0.8, 0.0, 0.0], Vec3::NEG_X),
            ([-0.5, -0.5, -0.3], Vec3::new(1.0, 1.0, 0.2)),
        ];
        let meters = points.map(|(at, normal)| Meter::irradiance(Vec3::from(at), normal).unwrap());
        let scene = &Arc::new(scene.with_meters(MeterKind::Irradiance, meters.to_vec()));
        let accel = accel(scene);
        let traced_settings = &Settings { seed: 8, ..settings(points.len() as u32, 1) };
        let traced = Subject { scene, accel: &accel, settings: traced_settings, region: &[] };
        let expected = traced.traced(1 << 16);
        let strategies: [(Direct, u32); 4] =
            [(Connect, 1), (Connect, 2), (PhotonMap, 1), (Connect, MIS)];
        for (direct, merge_vertex) in strategies {
            let settings = by_way(Settings {
                direct,
                merge_vertex,
                light_paths: 40_000,
                camera_paths: 500,
                radius: 0.04,
                caustic_radius: 0.04,
                seed: 3,
                ..settings(points.len() as u32, 1)
            });
            let subject = Subject { scene, accel: &accel, settings: &settings, region: &[] };
            let difference = subject.extrapolated(20).against(&expected);
            let what = format!("{name} {direct:?} k = {merge_vertex}: {difference}");
            println!("{what}");
            let Difference { off, error, z2, .. } = difference;
            assert!(error < 0.01, "says little: {what}");
            // Edges: as in `common::strategies`.
            assert!(off.abs() < 4.0 * error + 5e-3 && z2 < 3.0, "{what}");
        }
    }
}

/// A black wall in the plane of height 1 with a square opening of this half side around the axis.
fn wall_with_opening(half: f32) -> Vec<bdpm::scene::Mesh> {
    let far = 500.0;
    let rectangle = |low: [f32; 2], high: [f32; 2]| {
        let corner = |x: f32, y: f32| Vec3::new(x, y, 1.0);
        bdpm::scene::Mesh {
            name: "wall".into(),
            positions: vec![
                corner(low[0], low[1]),
                corner(low[0], high[1]),
                corner(high[0], high[1]),
                corner(high[0], low[1]),
            ],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            material: 0,
            ..Default::default()
        }
    };
    vec![
        rectangle([-far, -far], [-half, far]),
        rectangle([half, -far], [far, far]),
        rectangle([-half, -far], [half, -half]),
        rectangle([-half, half], [half, far]),
    ]
}

/// Irradiance of the horizontal below an opening of half side `half` at height 1, by the midpoint
/// rule. `radiance` is that of a direction of this cosine with the vertical.
fn through_opening(half: f64, radiance: impl Fn(f64) -> f64) -> f64 {
    let n = 1000;
    let at = |i: usize| half * (2.0 * (i as f64 + 0.5) / n as f64 - 1.0);
    let cell = (2.0 * half / n as f64).powi(2);
    let sum = (0..n * n).map(|index| {
        let [x, y] = [at(index % n), at(index / n)];
        let cos = (1.0 + x * x + y * y).sqrt().recip();
        radiance(cos) * cos.powi(4)
    });
    sum.sum::<f64>() * cell
}

#[test]
fn uniform_sky_through_an_opening_follows_its_form_factor() {
    let scene = scene(wall_with_opening(0.5), vec![gray(0.0, 0.0)], vec![], blind());
    let scene = Scene::clone(&scene).with_environment(Environment::new(1, 1, vec![Vec3::ONE], 0.0));
    let own = Settings { camera_paths: 2000, ..settings(1, 1) };
    let found = irradiance(&Arc::new(scene), &[[Vec3::ZERO, Vec3::Z]], own);
    let quarter = 0.5 / 1.25f64.sqrt() * (0.5 / 1.25f64.sqrt()).atan() / PI;
    let expected = PI * 4.0 * quarter;
    assert!((through_opening(0.5, |_| 1.0) / expected - 1.0).abs() < 1e-5);
    assert_within(found[0], expected);
}

#[test]
fn overcast_sky_lights_the_horizontal_as_a_whole_and_through_a_roof_opening() {
    // CIE standard overcast sky: type 1, whose gradation is 1 + 4 exp(-0.7/cos Z).
    let text = "[camera]\nposition = [0, 0, 0]\ntarget = [1, 0, 0]\nup = [0, 0, 1]\nfov_x_deg = 40\n\
                [[mesh]]\nfile = \"a.obj\"\nmaterial = \"black\"\n[materials.black]\nalbedo = 0\n\
                [sky]\nmodel = \"cie\"\ncie_type = 1\ndiffuse_lx = 6830\n";
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.toml"), text).unwrap();
    std::fs::write(folder.path().join("a.obj"), "v 0 0 -9\nv 1 0 -9\nv 0 1 -9\nf 1 2 3\n").unwrap();
    let loaded = bdpm::load(folder.path().join("a.toml")).unwrap();
    let environment = loaded.scene.lights().environment().cloned();
    let own = Settings { camera_paths: 400, ..settings(1, 1) };
    let up = loaded_up(&loaded.scene);
    let whole = irradiance(&loaded.scene, &[[Vec3::ZERO, up]], own.clone());
    let [mean, error] = whole[0];
    Estimate { mean, error }.assert_is(10.0, 5e-3);
    // The opening is above the vertical of the sky.
    let turn = glam::Quat::from_rotation_arc(Vec3::Z, up);
    let mut meshes = wall_with_opening(0.5);
    for position in meshes.iter_mut().flat_map(|mesh| &mut mesh.positions) {
        *position = turn * *position;
    }
    let roof = scene(meshes, vec![gray(0.0, 0.0)], vec![], blind());
    let roof = Scene::clone(&roof).with_environment(environment);
    let found = irradiance(&Arc::new(roof), &[[Vec3::ZERO, up]], own);
    let gradation = |cos: f64| 1.0 + 4.0 * (-0.7 / cos).exp();
    // Irradiance of the whole hemisphere by the midpoint rule in the cosine.
    let n = 100_000;
    let hemisphere: f64 = (0..n)
        .map(|i| (f64::from(i) + 0.5) / f64::from(n))
        .map(|cos| 2.0 * PI * gradation(cos) * cos / f64::from(n))
        .sum();
    let expected = 10.0 * through_opening(0.5, gradation) / hemisphere;
    let [mean, error] = found[0];
    Estimate { mean, error }.assert_is(expected, 5e-3);
}

/// The direction in which skies of scene files have their zenith.
fn loaded_up(scene: &Scene) -> Vec3 {
    let lights = scene.lights();
    let brightness = |direction: Vec3| lights.environment_radiance(direction).x;
    let axes = [Vec3::X, Vec3::Y, Vec3::Z];
    axes.into_iter().max_by(|a, b| brightness(*a).total_cmp(&brightness(*b))).unwrap()
}

#[test]
fn clear_pane_transmits_its_share_of_a_lamp() {
    use bdpm::scene::bsdf::{Bsdf, ThinDielectric};
    let lamp = square(Vec3::new(0.0, 0.0, 4.0), -Vec3::Z, 0.3, 0);
    let pane = square(Vec3::new(0.0, 0.0, 1.0), Vec3::Z, 3.0, 1);
    let glass = bdpm::scene::Material::new("pane", Bsdf::ThinDielectric(ThinDielectric::new(1.5)));
    let materials = vec![gray(0.0, 100.0), glass];
    let own = Settings { camera_paths: 4000, ..settings(1, 1) };
    let found = |meshes| {
        let scene = scene(meshes, materials.clone(), vec![], blind());
        irradiance(&scene, &[[Vec3::ZERO, Vec3::Z]], own.clone())[0]
    };
    let [open, _] = found(vec![lamp.clone()]);
    let [mean, error] = found(vec![lamp, pane]);
    // Both interfaces with all reflections in between, at nearly normal incidence: 2n/(n^2 + 1).
    Estimate { mean, error }.assert_is(open * 3.0 / 3.25, 1e-3);
}

#[test]
fn scenes_with_only_some_of_their_lights_have_their_power() {
    let panel = |x: f32, material: u32| square(Vec3::new(x, 0.0, 1.0), -Vec3::Z, 0.5, material);
    let named = |name: &str, emission: f32| bdpm::scene::Material {
        name: name.into(),
        ..gray(0.2, emission)
    };
    let materials = vec![named("floor", 0.0), named("left", 2.0), named("right", 3.0)];
    let meshes = vec![square(Vec3::ZERO, Vec3::Z, 3.0, 0), panel(-1.0, 1), panel(1.0, 2)];
    let lights = vec![point_light(Vec3::Z, 5.0)];
    let scene = scene(meshes, materials, lights, blind());
    let scene = Scene::clone(&scene).with_environment(Environment::new(1, 1, vec![Vec3::ONE], 0.0));
    let sources = scene.light_sources();
    let names: Vec<&str> = sources.iter().map(|(_, name)| &name[..]).collect();
    assert_eq!(names, ["light 1", "left", "right", "environment"]);
    let power = |scene: &Scene| f64::from(scene.lights().power().x);
    let alone: Vec<f64> = sources
        .iter()
        .map(|(source, _)| power(&scene.with_only(std::slice::from_ref(source)).unwrap()))
        .collect();
    for (alone, expected) in alone.iter().zip([4.0 * PI * 5.0, PI * 2.0, PI * 3.0]) {
        assert!((alone / expected - 1.0).abs() < 1e-5, "{alone} {expected}");
    }
    let all = power(&scene);
    assert!((alone.iter().sum::<f64>() / all - 1.0).abs() < 1e-5, "{alone:?} {all}");
    let dark = scene.with_only(&[]).unwrap();
    assert!(dark.lights().is_empty());
}

#[test]
fn luminous_openings_shine_only_in_scenes_that_have_their_material() {
    let scene = boxes::luminaires();
    let sources = scene.light_sources();
    assert_eq!(sources.len(), 3, "{sources:?}");
    let power = |scene: &Scene| f64::from(scene.lights().power().x);
    let alone: Vec<f64> = sources
        .iter()
        .map(|(source, _)| power(&scene.with_only(std::slice::from_ref(source)).unwrap()))
        .collect();
    // All have the same distribution, with these factors.
    for (part, factor) in alone.iter().zip([0.5, 0.6, 0.4]) {
        let expected = alone[0] * factor / 0.5;
        assert!((part / expected - 1.0).abs() < 1e-5, "{alone:?}");
    }
    let all = power(&scene);
    assert!((alone.iter().sum::<f64>() / all - 1.0).abs() < 1e-5, "{alone:?} {all}");
    assert!(scene.with_only(&[]).unwrap().lights().is_empty());
}
