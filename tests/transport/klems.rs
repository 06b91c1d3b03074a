//! Sheets with matrices of scattering: the radiance that the matrices say on both sides, and all
//! strategies against the path tracer.

use super::diffuse_transmission::{STRATEGIES, assert_is_path_traced, curtain};
use crate::common::klems::uneven;
use crate::common::*;
use bdpm::Settings;
use bdpm::scene::bsdf::Vertex;
use bdpm::scene::{Directional, Emitter, Material};
use bdpm::settings::{Direct, Kernel};
use glam::Vec3;

/// Sunlight of irradiance `E` on a sheet has the radiance `f E` from either side, where `f` is the
/// value between the patches of the sun and of the camera.
#[test]
fn sunlight_on_a_sheet_has_the_radiance_of_its_matrices() {
    let bsdf = uneven(0.9, Vec3::new(0.2, 1.0, 0.4));
    let eye = Vec3::new(1.3, 0.3, 1.9);
    let mut seen = Vec::new();
    for (x, side) in [(0.4, 1.0), (0.4, -1.0), (-1.2, -1.0)] {
        let to_sun = Vec3::new(x, 0.3, side).normalize();
        let sun = Emitter::Directional(Directional::new(-to_sun, Vec3::splat(10.0)));
        let at = Vertex { normal: Vec3::Z, wo: eye.normalize(), front: true, tangent: None };
        let value = f64::from(bsdf.eval(&at, to_sun).x);
        let expected = 10.0 * f64::from(to_sun.z.abs()) * value;
        assert!(expected > 0.05, "{expected}");
        let plane = square(Vec3::ZERO, Vec3::Z, 1.0, 0);
        let camera = camera(eye, Vec3::new(0.1, 0.1, 0.0), 1.0);
        let scene = scene(vec![plane], vec![Material::new("sheet", bsdf)], vec![sun], camera);
        for (direct, merge_vertex, kernel) in STRATEGIES {
            let light_paths = 20_000;
            let own = Settings { direct, merge_vertex, kernel, light_paths, ..settings(4, 4) };
            let mean = mean_luminance(&scene, &accel(&scene), by_way(own), 60);
            println!("{side} {direct:?} {merge_vertex} {kernel:?}: {mean:?}, not {expected}");
            mean.assert_is(expected, 3e-3);
        }
        seen.push(value);
    }
    assert!(seen[0] != seen[1] && seen[1] != seen[2], "the value depends on nothing: {seen:?}");
}

#[test]
fn light_behind_blinds_is_that_of_the_path_tracer() {
    let scene = curtain([uneven(0.8, Vec3::Z), uneven(0.9, Vec3::new(0.3, 1.0, 0.1))]);
    let merges = [(Direct::Connect, MIS, Kernel::Area), (Direct::PhotonMap, MIS, Kernel::Area)];
    assert_is_path_traced(&scene, &merges);
}
