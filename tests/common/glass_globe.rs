//! Meters around a lamp in a globe of thin glass.

use super::{camera, gray, point_light, scene, square};
use bdpm::load::Loaded;
use bdpm::scene::backend::Backend;
use bdpm::scene::bsdf::{Bsdf, ThinDielectric};
use bdpm::scene::{Camera, Material, Mesh, Meter, MeterKind, MeterSet};
use bdpm::settings::PartialSettings;
use bdpm::{MeasureJob, Measurement, Scene};
use glam::Vec3;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

pub const LUMENS: f32 = 683.0;

/// A camera that sees none of the scenes: meters do not depend on it.
pub fn blind() -> Camera {
    camera(Vec3::new(0.0, 0.0, 100.0), Vec3::new(0.0, 0.0, 200.0), 20.0)
}

pub fn sheet() -> Material {
    Material::new("sheet", Bsdf::ThinDielectric(ThinDielectric::new(1.5)))
}

/// A measurement of a meter.
pub fn job(scene: Arc<Scene>, meter: Meter) -> MeasureJob {
    let cornell_box = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");
    let other = bdpm::load(Path::new(cornell_box)).unwrap();
    let loaded = Loaded { scene, defaults: PartialSettings::default(), ..other };
    let set = MeterSet::single("meter", MeterKind::Irradiance, meter);
    MeasureJob::new(&loaded).meters(vec![set]).backend(Backend::Bvh)
}

/// Measures to a target.
pub fn measure(scene: Arc<Scene>, meter: Meter, target: f64) -> Measurement {
    let settings = PartialSettings { seed: Some(4), ..PartialSettings::default() };
    let job = job(scene, meter).target(target).settings(settings);
    job.run(|_| ControlFlow::Continue(())).unwrap()
}

/// A globe of rings of quadrilaterals around +z, as modelers make it: all corners of a pole are at
/// one place, up to rounding.
fn globe(radius: f64, rings: u32, sectors: u32, material: u32) -> Mesh {
    use std::f64::consts::PI;
    let (mut positions, mut normals, mut triangles) = (vec![], vec![], vec![]);
    for ring in 0..=rings {
        for sector in 0..sectors {
            let theta = PI * f64::from(ring) / f64::from(rings);
            let phi = 2.0 * PI * f64::from(sector) / f64::from(sectors);
            let at =
                glam::DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
            positions.push((radius * at).as_vec3());
            normals.push(at.as_vec3());
        }
    }
    for ring in 0..rings {
        for sector in 0..sectors {
            let corner =
                |down: u32, right: u32| (ring + down) * sectors + (sector + right) % sectors;
            triangles.push([corner(0, 0), corner(1, 0), corner(1, 1)]);
            triangles.push([corner(0, 0), corner(1, 1), corner(0, 1)]);
        }
    }
    Mesh { positions, normals, triangles, material, ..Mesh::default() }
}

/// Number of directions of [`assert_globe_shows_its_lamp_once`].
pub const DIRECTIONS: usize = 11;

/// Meters on the axis, the seams and the corners of a globe of thin glass around a lamp: straight
/// rays meet poles, edges and corners of the mesh exactly. By symmetry, the lamp has its own
/// intensity. Counted as photons and as a connection, it would have twice that.
/// `indices` choose among the directions.
#[track_caller]
pub fn assert_globe_shows_its_lamp_once(indices: &[usize]) {
    let mesh = globe(0.1, 16, 32, 1);
    let lamp = point_light(Vec3::ZERO, 100.0 / LUMENS);
    // The floor is below all meters.
    let floor = square(Vec3::new(0.0, 0.0, -3.0), Vec3::Z, 3.0, 0);
    let corners = [0, 32, 64, 161, 290, 511, 543].map(|at: usize| mesh.positions[at].normalize());
    let edge = (mesh.normals[64] + mesh.normals[96]).normalize();
    let directions = [&corners[..], &[Vec3::Z, Vec3::NEG_Z, Vec3::X, edge]].concat();
    assert_eq!(directions.len(), DIRECTIONS);
    let lit = scene(vec![floor, mesh], vec![gray(0.0, 0.0), sheet()], vec![lamp], blind());
    for direction in indices.iter().map(|&index| directions[index]) {
        let meter = Meter::irradiance(direction, -direction).unwrap();
        let reading = measure(Arc::clone(&lit), meter, 0.1).sets[0].readings[0];
        let off = (reading.value - 100.0).abs();
        assert!(off < 1.5 * reading.expanded + 0.5, "{direction}: {reading:?}, not 100 lx");
    }
}
