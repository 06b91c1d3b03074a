//! Boxes far from the origin and of other sizes: meters and images are those of the box at the
//! origin.

use crate::common::*;
use bdpm::Settings;
use bdpm::load::{Loaded, load};
use bdpm::scene::{Meter, MeterKind};
use std::fs::write;
use std::sync::Arc;
use tempfile::TempDir;

/// A box of side 4 with a panel under its ceiling and a lamp in its middle, times a scale, whose
/// center is at a distance along x, y and z. The radiances do not depend on either.
fn room(distance: f64, scale: f64) -> Loaded {
    let folder = TempDir::new().unwrap();
    let at = |x: f64, y: f64, z: f64| [x, y, z].map(|own| distance + scale * own);
    let mut obj = String::new();
    for [x, y, z] in [0, 1, 2, 3, 4, 5, 6, 7].map(|i| [i & 1, i >> 1 & 1, i >> 2].map(sign)) {
        let [x, y, z] = at(2.0 * x, 2.0 * y, 2.0 * z);
        obj += &format!("v {x} {y} {z}\n");
    }
    for [x, z] in [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]] {
        let [x, y, z] = at(x, 1.9, z);
        obj += &format!("v {x} {y} {z}\n");
    }
    obj += "usemtl wall\nf 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
    obj += "usemtl panel\nf 9 10 11 12\n";
    let text = format!(
        "[camera]\nposition = {:?}\ntarget = {:?}\nfov_x_deg = 60\n[[mesh]]\nfile = 'a.obj'\n\
         [materials.wall]\nalbedo = 0.5\n[materials.panel]\nalbedo = 0\nemission = 3\n\
         [[light]]\ntype = 'point'\nposition = {:?}\nintensity = {}\n",
        at(-1.5, 0.5, 1.5),
        at(1.0, -1.0, -1.0),
        at(0.25, 0.0, 0.5),
        8.0 * scale * scale
    );
    write(folder.path().join("a.obj"), obj).unwrap();
    write(folder.path().join("scene.toml"), text).unwrap();
    load(folder.path()).unwrap()
}

fn sign(bit: i32) -> f64 {
    f64::from(2 * bit - 1)
}

/// Means and standard errors of the pixels, and of meters: one on the floor and one in free air.
fn readings(distance: f64, scale: f64) -> Vec<[f64; 2]> {
    let loaded = room(distance, scale);
    let scene = &loaded.scene;
    let radius = (0.1 * scale) as f32;
    let own = Settings { radius, caustic_radius: radius, ..settings(4, 3) };
    let mut all = pixel_means(scene, own.clone(), 40);
    let origin = scene.file_origin();
    let meter = |x: f64, y: f64, z: f64| {
        let at = [x, y, z].map(|own| distance + scale * own);
        Meter::irradiance((glam::DVec3::from(at) - origin).as_vec3(), glam::Vec3::Y).unwrap()
    };
    let meters = vec![meter(1.0, -2.0, 0.5), meter(-0.5, -1.0, 0.75)];
    let metered = Arc::new(scene.with_meters(MeterKind::Irradiance, meters));
    all.extend(pixel_means(
        &metered,
        Settings { width: 2, height: 1, camera_paths: 64, ..own },
        40,
    ));
    all
}

#[test]
fn boxes_at_any_distance_and_of_any_size_have_the_numbers_of_the_one_at_the_origin() {
    let expected = readings(0.0, 1.0);
    let far = [1e3, 1e4, 1e5, 1e6].map(|distance| (distance, 1.0));
    let scaled = [1e-3, 1e3, 1e6].map(|scale| (1e5 * scale, scale));
    for (distance, scale) in far.into_iter().chain(scaled).chain([(0.0, 1e-3), (0.0, 1e6)]) {
        for (index, (own, near)) in readings(distance, scale).iter().zip(&expected).enumerate() {
            // The random numbers are the same: only rounding, and paths that it turns, differ.
            let ([mean, error], [expected, _]) = (own, near);
            let difference = (mean - expected).abs();
            assert!(
                difference < 0.5 * error + 1e-4 * expected && *error < 0.5 * expected,
                "{index}: {mean} at {distance} times {scale}, not {expected} +- {error}"
            );
        }
    }
}
