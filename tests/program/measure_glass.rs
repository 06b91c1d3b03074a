//! Meters whose light arrives through glass or by mirrors, against closed forms.

use crate::common::{camera, gray, point_light, scene, sphere, square};
use bdpm::load::Loaded;
use bdpm::scene::backend::Backend;
use bdpm::scene::bsdf::{Bsdf, Dielectric, ThinDielectric};
use bdpm::scene::{
    Camera, Directional, Emitter, Environment, Material, Mesh, Meter, MeterKind, MeterSet, Spot,
};
use bdpm::settings::PartialSettings;
use bdpm::{MeasureJob, Measurement, Scene};
use glam::Vec3;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

const LUMENS: f32 = 683.0;

/// A camera that sees none of the scenes: meters do not depend on it.
fn blind() -> Camera {
    camera(Vec3::new(0.0, 0.0, 100.0), Vec3::new(0.0, 0.0, 200.0), 20.0)
}

fn glass() -> Material {
    Material::new("glass", Bsdf::Dielectric(Dielectric::new(1.5)))
}

fn sheet() -> Material {
    Material::new("sheet", Bsdf::ThinDielectric(ThinDielectric::new(1.5)))
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

/// Measures to a target, or for a short time.
fn measure(scene: Arc<Scene>, meter: Meter, target: Option<f64>) -> Measurement {
    let cornell_box = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");
    let other = bdpm::load(Path::new(cornell_box)).unwrap();
    let loaded = Loaded { scene, defaults: PartialSettings::default(), ..other };
    let set = MeterSet::single("meter", MeterKind::Irradiance, meter);
    let time = target.is_none().then_some(Duration::from_millis(300));
    let job = MeasureJob::new(&loaded).meters(vec![set]).target(target).time(time);
    let settings = PartialSettings { seed: Some(4), ..PartialSettings::default() };
    job.settings(settings).backend(Backend::Bvh).run(|_| ControlFlow::Continue(())).unwrap()
}

/// Checks that the interval of a reading holds the value, and that it is not wider than this share
/// of it.
#[track_caller]
fn assert_holds(scene: Arc<Scene>, meter: Meter, expected: f64, width: f64) {
    let measurement = measure(scene, meter, Some(width));
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

#[test]
fn meters_without_any_light_are_unknown() {
    let lamp = square(Vec3::new(0.0, 0.0, 3.0), Vec3::Z, 0.5, 1);
    let cover = square(Vec3::new(0.0, 0.0, 2.0), Vec3::NEG_Z, 50.0, 0);
    let dark = scene(vec![lamp, cover], vec![gray(0.5, 0.0), gray(0.0, 1.0)], vec![], blind());
    let measurement = measure(dark, up(), None);
    let reading = measurement.sets[0].readings[0];
    assert!(!reading.is_known() && reading.expanded.is_nan(), "{reading:?}");
    assert!(!measurement.reached);
    assert_eq!(measurement.unknown(), [("meter", 1)]);
    assert!(measurement.sets[0].uniformity().value.is_nan());
}
