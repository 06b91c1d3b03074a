//! Furnaces in which paths are found in several ways: those that `tests/transport/mis.rs` has no
//! time for.

// The resolutions below limit the standard errors alone, so that a test says something. Means are
// held to four of their own standard errors. Radii shrink at the 5120 triangles of each ball, which
// adds noise: 40 iterations had standard errors of .0030 to .0042. Rough balls have heavier tails.

use crate::common::several_ways::*;
use crate::common::*;
use bdpm::scene::Material;
use bdpm::scene::bsdf::{Bsdf, Coated, Glossy, RoughDielectric};
use glam::Vec3;

#[test]
fn diffuse_walls_in_a_furnace_have_its_radiance() {
    let scene = furnace(&[Bsdf::diffuse(Vec3::ONE)], false);
    assert_furnace("walls", &scene, 0.0, (40, 4e-3), (&WAYS, &WEIGHTINGS));
}

/// Each of three weightings and each way of direct light with it. `make check-long` has all pairs.
const SOME: [(&[Way], &[Weighting]); 2] =
    [(&[WAYS[0]], &FIRST), (&[WAYS[1], WAYS[2]], &[FIRST[0]])];
const FIRST: [Weighting; 3] = [WEIGHTINGS[0], WEIGHTINGS[1], WEIGHTINGS[2]];

#[test]
fn smooth_objects_in_a_furnace_have_its_radiance() {
    SOME.iter().for_each(|pairs| assert_smooth(*pairs));
}

#[test]
fn rough_objects_in_a_furnace_have_its_radiance() {
    SOME.iter().for_each(|pairs| assert_rough(*pairs));
}

#[test]
#[ignore = "takes minutes: make check-long"]
fn smooth_and_rough_objects_in_a_furnace_by_all_ways() {
    assert_smooth((&WAYS, &FIRST));
    assert_rough((&WAYS, &FIRST));
}

fn assert_smooth(pairs: (&[Way], &[Weighting])) {
    assert_furnace("smooth", &smooth_things(), 0.0, (80, 4e-3), pairs);
}

fn assert_rough(pairs: (&[Way], &[Weighting])) {
    let bsdfs = [
        white_metal(0.15),
        white_metal(0.6),
        Bsdf::Glossy(Glossy::new(Vec3::ONE, 0.3, 1.5, 0.2)),
        Bsdf::Glossy(Glossy::new(Vec3::ONE, 0.5, 1.5, 0.5)),
    ];
    assert_furnace("rough", &furnace(&bsdfs, false), 1e-3, (80, 6e-3), pairs);
    // Single scattering loses a little.
    let glass = [Bsdf::RoughDielectric(RoughDielectric::new(1.5, 0.05))];
    assert_furnace("rough glass", &furnace(&glass, false), 2e-3, (80, 6e-3), pairs);
}

/// Walls under a coat, between which light paths choose to be mirrored and camera paths are, too,
/// where they are cut.
#[test]
#[ignore = "takes minutes: make check-long"]
fn coated_walls_in_a_furnace_have_its_radiance() {
    let mut meshes = Vec::new();
    for (index, axis) in [Vec3::X, Vec3::Y, Vec3::Z].into_iter().enumerate() {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, u32::from(index != 1)));
    }
    let coated = Bsdf::Coated(Coated::new(Vec3::ONE, 2.0));
    let materials = vec![gray(0.5, 1.0), Material::new("coated", coated)];
    let camera = camera(Vec3::new(0.4, 0.6, 0.5), Vec3::new(-0.8, -0.3, -0.8), 75.0);
    assert_furnace(
        "coated walls",
        &scene(meshes, materials, vec![], camera),
        0.0,
        (200, 3e-3),
        (&WAYS, &WEIGHTINGS[..3]),
    );
}
