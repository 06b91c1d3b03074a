//! Meters whose light arrives through glass or by mirrors, against closed forms.

use crate::common::glass_globe::{
    LUMENS, assert_globe_shows_its_lamp_once, blind, job, measure, sheet,
};
use crate::common::{gray, point_light, scene, sphere, square};
use bdpm::Scene;
use bdpm::scene::bsdf::{Bsdf, Dielectric};
use bdpm::scene::{
    Directional, Emitter, Environment, Material, Mesh, Meter, MeterKind, MeterSet, Spot,
};
use bdpm::settings::{PartialSettings, Strategy};
use glam::Vec3;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::Duration;

fn glass() -> Material {
    Material::new("glass", Bsdf::Dielectric(Dielectric::new(1.5)))
}

fn mirror(reflectance: f32) -> Material {
    Material::new("mirror", Bsdf::Mirror { reflectance: Vec3::splat(reflectance) })
}

/// A slab of glass between two heights.
fn slab(low: f32, high: f32, half: f32, material: u32) -> Vec<Mesh> {
    let face = |z: f32, normal: Vec3| square(Vec3::new(0.0, 0.0, z), normal, half, material);
    let mut meshes = vec![face(high, Vec3::Z), face(low, Vec3::NEG_Z)];
    for normal in [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y] {
        let up = normal.cross(Vec3::Z);
        let corner = |a: f32, z: f32| half * normal + a * half * up + z * Vec3::Z;
        let corners = [corner(1.0, low), corner(-1.0, low), corner(-1.0, high), corner(1.0, high)];
        let triangles = vec![[0, 1, 2], [0, 2, 3]];
        let mesh = Mesh { positions: corners.into(), triangles, material, ..Mesh::default() };
        let [a, b, c] = [0, 1, 2].map(|i: usize| mesh.positions[i]);
        assert!((b - a).cross(c - a).dot(normal) > 0.0);
        meshes.push(mesh);
    }
    meshes
}

/// Checks that the interval of a reading holds the value, and that it is not wider than this share
/// of it.
#[track_caller]
fn assert_holds(scene: Arc<Scene>, meter: Meter, expected: f64, width: f64) {
    let measurement = measure(scene, meter, width);
    let reading = measurement.sets[0].readings[0];
    println!("{reading:?}, not {expected}: {:?}", measurement.techniques);
    // Rounding of single precision besides the stated uncertainty.
    let off = (reading.value - expected).abs();
    assert!(off <= 1.5 * reading.expanded + 1e-4 * expected, "{reading:?}, not {expected}");
    assert!(reading.expanded <= width * expected, "{reading:?} for {expected}");
}

fn up() -> Meter {
    Meter::irradiance(Vec3::ZERO, Vec3::Z).unwrap()
}

fn floor() -> Mesh {
    square(Vec3::new(0.0, 0.0, -1.0), Vec3::Z, 3.0, 0)
}

/// Lamps of 1000 cd at 2 m, behind one centimeter of glass. Expected: `I T/d^2`, where
/// `T = (1 - R)/(1 + R)` has all reflections and the distance is shorter by `t (1 - 1/n)`. The slab
/// is not at half the height, where its edges would mirror the lamp to the meter.
#[test]
fn lamps_without_a_surface_shine_through_slabs_and_sheets() {
    let at = Vec3::new(0.0, 0.0, 2.0);
    let intensity = 1000.0 / LUMENS;
    let spot = Emitter::Spot(Spot {
        position: at,
        direction: Vec3::NEG_Z,
        intensity: Vec3::splat(intensity),
        cos_inner: 0.9,
        cos_outer: 0.8,
        falloff: bdpm::scene::Falloff::default(),
    });
    let transmittance = 0.96 / 1.04;
    let through_slab = 1000.0 * transmittance / (2.0f64 - 0.01 / 3.0).powi(2);
    for lamp in [point_light(at, intensity), spot] {
        let meshes = [vec![floor()], slab(0.7, 0.71, 2.0, 1)].concat();
        let lit = scene(meshes, vec![gray(0.0, 0.0), glass()], vec![lamp.clone()], blind());
        assert_holds(lit, up(), through_slab, 0.02);
        let meshes = vec![floor(), square(Vec3::Z, Vec3::Z, 2.0, 1)];
        let lit = scene(meshes, vec![gray(0.0, 0.0), sheet()], vec![lamp], blind());
        assert_holds(lit, up(), 250.0 * transmittance, 0.02);
    }
}

/// A lamp that a slab displaces by much: the exact path is found by bisection of the angle. No edge
/// of the slab mirrors the lamp to the meter.
#[test]
fn oblique_lamp_behind_a_thick_slab_is_seen_where_it_displaces_it() {
    let (x, height, thickness) = (2.0f64, 1.5f64, 0.3);
    let inside = |sin: f64| (1.0 - (sin / 1.5).powi(2)).sqrt();
    let reach = |sin: f64| {
        let cos = (1.0 - sin * sin).sqrt();
        (height - thickness) * sin / cos + thickness * (sin / 1.5) / inside(sin)
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if reach(middle) < x { low = middle } else { high = middle }
    }
    let sin: f64 = low;
    let cos = (1.0 - sin * sin).sqrt();
    // dX/d(theta), by differences, times the distance from the axis: the area of a small solid
    // angle.
    let step = 1e-6;
    let turned = |by: f64| reach((sin.asin() + by).sin());
    let slope = (turned(step) - turned(-step)) / (2.0 * step);
    let spread = x / sin * slope * cos;
    let reflectance = |cos: f64, cos_inside: f64| {
        let s = ((cos - 1.5 * cos_inside) / (cos + 1.5 * cos_inside)).powi(2);
        let p = ((1.5 * cos - cos_inside) / (1.5 * cos + cos_inside)).powi(2);
        [s, p]
    };
    let through = reflectance(cos, inside(sin)).map(|r| (1.0 - r) / (1.0 + r));
    let transmittance = 0.5 * (through[0] + through[1]);
    let expected = 1000.0 * transmittance * cos / spread;
    let meshes = [vec![floor()], slab(0.2, 0.5, 4.0, 1)].concat();
    let lamp = point_light(Vec3::new(x as f32, 0.0, height as f32), 1000.0 / LUMENS);
    let lit = scene(meshes, vec![gray(0.0, 0.0), glass()], vec![lamp], blind());
    assert_holds(lit, up(), expected, 0.02);
}

/// Parallel light of 10,000 lx at 45 degrees through one centimeter of glass: `E T cos` with the
/// mean transmittance of both polarizations.
#[test]
fn parallel_light_shines_through_a_slab() {
    let half = 0.5f64.sqrt();
    let inside = (1.0f64 - 0.5 / 2.25).sqrt();
    let s = ((half - 1.5 * inside) / (half + 1.5 * inside)).powi(2);
    let p = ((1.5 * half - inside) / (1.5 * half + inside)).powi(2);
    let transmittance = 0.5 * ((1.0 - s) / (1.0 + s) + (1.0 - p) / (1.0 + p));
    let direction = Vec3::new(half as f32, 0.0, -half as f32);
    let sun = Directional::new(direction, Vec3::splat(10_000.0 / LUMENS));
    let meshes = [vec![floor()], slab(1.0, 1.01, 3.0, 1)].concat();
    let sun = vec![Emitter::Directional(sun)];
    let lit = scene(meshes, vec![gray(0.0, 0.0), glass()], sun, blind());
    assert_holds(lit, up(), 10_000.0 * transmittance * half, 0.02);
}

/// Share of the light that two panes of index 1.5 transmit at an angle, with all reflections inside
/// and between them: the mean over both polarizations of `(1 - R)/(1 + 3 R)`.
fn through_two_panes(degrees: f64) -> f64 {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let inside = (1.0 - (sin / 1.5).powi(2)).sqrt();
    let s = ((cos - 1.5 * inside) / (cos + 1.5 * inside)).powi(2);
    let p = ((1.5 * cos - inside) / (1.5 * cos + inside)).powi(2);
    let through = |reflectance: f64| (1.0 - reflectance) / (1.0 + 3.0 * reflectance);
    0.5 * (through(s) + through(p))
}

/// Parallel light through two sheets, which each polarize it: 76.6 % at 60 degrees and 47.5 % at 75
/// degrees. Without polarization, it would be 3.9 and 5.8 % less.
#[test]
fn two_panes_transmit_each_polarization_on_its_own() {
    for (degrees, tolerance) in [(60.0f64, 0.018), (75.0, 0.03)] {
        let (sin, cos) = (degrees.to_radians().sin() as f32, degrees.to_radians().cos() as f32);
        let toward = Vec3::new(sin, 0.0, cos);
        let sun = Emitter::Directional(Directional::new(-toward, Vec3::splat(10_000.0 / LUMENS)));
        let panes = [1.0, 2.0].map(|z| square(Vec3::new(0.0, 0.0, z), Vec3::Z, 60.0, 1));
        let meshes = [vec![floor()], panes.into()].concat();
        let lit = scene(meshes, vec![gray(0.0, 0.0), sheet()], vec![sun], blind());
        let meter = Meter::irradiance(Vec3::ZERO, toward).unwrap();
        let measurement = measure(lit, meter, 0.02);
        let reading = measurement.sets[0].readings[0];
        let expected = 10_000.0 * through_two_panes(degrees);
        let off = (reading.value - expected).abs();
        assert!(off < tolerance * expected, "{reading:?}, not {expected}");
        assert!(off <= 1.5 * reading.expanded, "{reading:?}, not {expected}");
        let is_noted = |note: &String| note.contains("reflections between panes");
        assert!(measurement.warnings.iter().any(is_noted), "{:?}", measurement.warnings);
    }
}

/// The luminance of the half of an even sky behind two slabs is too low by lost polarization: its
/// interval holds the right one, and a note says so. Light that the slabs mirror comes from the
/// black half.
#[test]
fn intervals_of_luminance_behind_two_slabs_hold_the_lost_polarization() {
    let direction = Vec3::new(60f32.to_radians().sin(), 0.0, 60f32.to_radians().cos());
    let meshes = [vec![floor()], slab(1.0, 1.01, 60.0, 1), slab(2.0, 2.01, 60.0, 1)].concat();
    let lit = scene(meshes, vec![gray(0.0, 0.0), glass()], vec![], blind());
    // Columns 0 and 15 are toward +z.
    let is_lit = |pixel: usize| !(4..12).contains(&(pixel % 16));
    let pixels = (0..16 * 8).map(|pixel| if is_lit(pixel) { Vec3::ONE } else { Vec3::ZERO });
    let sky = Environment::new(16, 8, pixels.collect(), 0.0);
    let lit = Arc::new(Scene::clone(&lit).with_environment(sky));
    let meter = Meter::radiance(Vec3::ZERO, direction, 0.0).unwrap();
    let set = MeterSet::single("meter", MeterKind::Radiance, meter);
    let job = job(lit, meter).meters(vec![set]).target(0.01);
    let measurement = job.run(|_| ControlFlow::Continue(())).unwrap();
    let reading = measurement.sets[0].readings[0];
    let expected = f64::from(LUMENS) * through_two_panes(60.0);
    let off = (reading.value - expected).abs();
    assert!(off <= reading.expanded && reading.expanded < 0.1 * expected, "{reading:?} {expected}");
    assert!(measurement.warnings.iter().any(|note| note.contains("reflections between panes")));
}

/// A meter that a lamp lights by a mirror alone: the image of the lamp behind the mirror, and a
/// baffle.
#[test]
fn lamp_shines_by_a_mirror_past_a_baffle() {
    let wall = square(Vec3::new(1.0, 0.0, 0.0), Vec3::NEG_X, 2.0, 1);
    let baffle = square(Vec3::new(0.0, 0.0, 0.5), Vec3::Z, 0.2, 0);
    let lamp = point_light(Vec3::Z, 1000.0 / LUMENS);
    let materials = vec![gray(0.0, 0.0), mirror(0.9)];
    let lit = scene(vec![floor(), wall, baffle], materials, vec![lamp], blind());
    let distance2 = 5.0f64;
    assert_holds(lit, up(), 0.9 * 1000.0 / distance2.powf(1.5), 0.1);
}

/// A sun of .5 degrees in an environment, through a sheet and through a slab: connections find it,
/// camera paths hardly.
#[test]
fn small_sun_of_an_environment_shines_through_panes() {
    let (width, height) = (720u32, 360u32);
    let mut pixels = vec![Vec3::ZERO; (width * height) as usize];
    let sun = (height / 4 * width + width / 2) as usize;
    pixels[sun] = Vec3::splat(1e4);
    let map = Environment::new(width, height, pixels, 0.0);
    // The meter faces the middle of the sun's pixel.
    let theta = std::f32::consts::PI * (height as f32 / 4.0 + 0.5) / height as f32;
    let phi = std::f32::consts::TAU * 0.5 / width as f32;
    let toward = Vec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos());
    let open = f64::from(LUMENS) * f64::from(map.integral().x);
    let meter = Meter::irradiance(Vec3::ZERO, toward).unwrap();
    // Panes face the sun, about.
    let turn = glam::Quat::from_rotation_arc(Vec3::Z, toward);
    let turned = |meshes: Vec<Mesh>| -> Vec<Mesh> {
        let point = |position: &Vec3| turn * *position;
        let one =
            |mesh: Mesh| Mesh { positions: mesh.positions.iter().map(point).collect(), ..mesh };
        meshes.into_iter().map(one).collect()
    };
    let panes = [vec![square(Vec3::Z, Vec3::Z, 2.0, 1)], slab(1.0, 1.01, 2.0, 2)];
    for meshes in panes {
        let materials = vec![gray(0.0, 0.0), sheet(), glass()];
        let meshes = turned([vec![floor()], meshes].concat());
        let lit = Scene::clone(&scene(meshes, materials, vec![], blind()));
        let lit = Arc::new(lit.with_environment(map.clone()));
        // The pixel is half a degree wide, hence its cosines are 1.
        assert_holds(lit, meter, open * 0.96 / 1.04, 0.02);
    }
}

/// A lamp in the center of a ball of clear glass: by symmetry, its light leaves along the radius
/// and has the intensity of the lamp. The normals are smooth, so that only photons on discs carry
/// it.
#[test]
fn lamp_in_a_glass_globe_shines_as_without_it() {
    let mut globe = sphere(Vec3::Z, 0.2, 4, false, 1);
    globe.normals = globe.positions.iter().map(|point| (*point - Vec3::Z).normalize()).collect();
    let lamp = point_light(Vec3::Z, 1000.0 / LUMENS);
    let lit = scene(vec![floor(), globe], vec![gray(0.0, 0.0), glass()], vec![lamp], blind());
    assert_holds(lit, up(), 1000.0, 0.1);
}

/// A lamp of the size of the pane in front of it: rays start off the pane, so that the lamp seems
/// nearer by as much, and must not block itself. The size of the pane does not matter where it
/// covers the lamp.
#[test]
fn lamp_behind_a_pane_of_any_size_does_not_block_itself() {
    let reading = |half: f32| {
        let pane = square(Vec3::Z, Vec3::Z, half, 1);
        let lamp = square(Vec3::new(0.0, 0.0, 1.5), Vec3::NEG_Z, 0.5, 2);
        let materials = vec![gray(0.2, 0.0), sheet(), gray(0.0, 1.0)];
        let lit = scene(vec![floor(), pane, lamp], materials, vec![], blind());
        measure(lit, up(), 0.01).sets[0].readings[0]
    };
    let small = reading(0.6);
    assert!(small.value > 150.0, "{small:?}");
    for half in [3.0, 30.0, 1e3, 1e5] {
        let large = reading(half);
        let off = (large.value - small.value).abs();
        // Light that the larger pane mirrors back to the floor is less than a percent.
        let systematic = 0.01 * small.value;
        assert!(off < large.expanded + small.expanded + systematic, "{half}: {large:?} {small:?}");
    }
}

/// A pole, a corner, the middle of an edge and the axis; `tests/check` has other directions.
#[test]
fn meters_on_axis_and_seams_of_a_globe_see_its_lamp_once() {
    assert_globe_shows_its_lamp_once(&[0, 3, 7, 10]);
}

/// Few paths prove nothing.
#[test]
fn meters_without_any_light_are_unknown() {
    let lamp = square(Vec3::new(0.0, 0.0, 3.0), Vec3::Z, 0.5, 1);
    let cover = square(Vec3::new(0.0, 0.0, 2.0), Vec3::NEG_Z, 50.0, 0);
    let dark = scene(vec![lamp, cover], vec![gray(0.5, 0.0), gray(0.0, 1.0)], vec![], blind());
    let settings = PartialSettings {
        strategy: Some(Strategy::Path),
        light_paths: Some(1000),
        camera_paths: Some(16),
        ..PartialSettings::default()
    };
    let job = job(dark, up()).settings(settings).time(Duration::from_millis(1));
    let measurement = job.run(|_| ControlFlow::Continue(())).unwrap();
    let reading = measurement.sets[0].readings[0];
    assert!(!reading.is_known() && reading.expanded.is_nan(), "{reading:?}");
    assert!(!measurement.reached);
    assert_eq!(measurement.unknown(), [("meter", 1)]);
    assert!(measurement.sets[0].uniformity().value.is_nan());
}
