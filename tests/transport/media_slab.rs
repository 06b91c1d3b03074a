//! Multiple scattering in plane slabs, against the theory of radiative transfer (Chandrasekhar,
//! *Radiative Transfer*, 1950). Walls of mirrors make a slab as wide as the plane.

use super::media::{SIDE, means};
use crate::common::fog::{block, gray_medium, index_matched, medium};
use crate::common::*;
use bdpm::Settings;
use bdpm::base::math::luminance;
use bdpm::scene::bsdf::{Bsdf, Conductor, Reflectance};
use bdpm::scene::{Camera, Material, Mesh, Scene};
use glam::Vec3;
use std::sync::Arc;

/// A shaft with walls of mirrors, 2 `half` apart, around a block of the material 1 with its lower
/// face at 0 and its upper face at 1, a floor of the material 2 below it and a ceiling of the
/// material 3 above it.
fn shaft(half: f32, slab: Material, floor: Material, ceiling: Material, eye: Camera) -> Arc<Scene> {
    let white = Reflectance::Artist { normal: Vec3::ONE };
    let mirror = Material::new("mirror", Bsdf::Conductor(Conductor::new(white, 0.0)));
    let sides = [Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y];
    let center = Vec3::new(0.0, 0.0, 0.5);
    let mut meshes: Vec<Mesh> = sides.map(|side| wall(center + half * side, -side)).into();
    // The other faces of the block are behind the mirrors.
    meshes.push(block(center, 0.5, 1));
    let block = meshes.last_mut().unwrap();
    block.positions.iter_mut().for_each(|corner| *corner *= Vec3::new(1.2, 1.2, 1.0));
    meshes.push(square(-0.2 * Vec3::Z, Vec3::Z, 1.01 * half, 2));
    meshes.push(square(1.2 * Vec3::Z, -Vec3::Z, 1.01 * half, 3));
    scene(meshes, vec![mirror, slab, floor, ceiling], vec![], eye)
}

/// A wall that is higher than the shaft.
fn wall(center: Vec3, normal: Vec3) -> Mesh {
    square(center, normal, 1.0, 0)
}

fn base() -> Settings {
    Settings {
        light_paths: 10_000,
        camera_paths: 24,
        radius: 0.012,
        caustic_radius: 0.012,
        medium_scale: 1.0,
        seed: 7,
        ..settings(SIDE, SIDE)
    }
}

/// Asserts that each strategy has this mean.
#[track_caller]
fn assert_means(scene: &Arc<Scene>, settings: &Settings, iterations: u64, expected: f64) {
    for (name, Estimate { mean, error }) in means(scene, settings, iterations) {
        println!("{name}: {mean:.5} +- {error:.5}, {expected:.5}");
        assert!(error < 0.015 * expected, "says little: {name}");
        // Faces cut off balls. The center of what is left is deeper in the slab, where the fluence
        // differs: by .145 radii on average, for points less than a radius deep. In the half-space,
        // a radius is .144 mean free paths, and about this share of the light comes from there. The
        // fluence changes by up to 1.4 of its value per mean free path (1/q of Hopf). Hence
        // .145 * .144 * .144 * 1.4 = 4e-3.
        assert!((mean - expected).abs() < 4.0 * error + 5e-3 * expected, "{name}");
    }
}

/// A thick slab that absorbs nothing transmits (4/3)/(tau + 2 q) of the flux of uniform light,
/// where q = 0.710446 is the constant of Hopf. What is left out falls as exp(-tau): it is 4e-5 of
/// the result for tau = 4, by a solution of the integral equation.
#[test]
fn thick_slab_transmits_as_in_the_diffusion_limit() {
    let thickness = 4.0;
    let transmitted = 4.0 / 3.0 / (thickness + 2.0 * 0.710_446);
    // The ceiling sends a part of the light back, of which the slab reflects all that it does not
    // transmit.
    let albedo = 0.5;
    let expected = albedo * transmitted / (1.0 - albedo * (1.0 - transmitted));
    let eye = camera(Vec3::new(0.03, 0.02, 1.05), Vec3::new(0.03, 0.02, 1.2), 60.0);
    let slab = index_matched(&gray_medium(0.0, thickness as f32, 0.0));
    let scene = shaft(0.2, slab, gray(0.0, 1.0), gray(albedo as f32, 0.0), eye);
    assert_means(&scene, &base(), 14, expected);
}

/// The function H of Chandrasekhar for isotropic scattering with this albedo, at the nodes of the
/// midpoint rule on [0, 1] and at 1: 1/H(m) = sqrt(1 - albedo) + albedo/2 int n H(n)/(m + n) dn.
fn h_function(albedo: f64) -> f64 {
    const NODES: usize = 400;
    let node = |i: usize| (i as f64 + 0.5) / NODES as f64;
    let at = |m: f64, h: &[f64]| {
        let sum: f64 = (0..NODES).map(|i| node(i) * h[i] / (m + node(i))).sum();
        1.0 / ((1.0 - albedo).sqrt() + 0.5 * albedo * sum / NODES as f64)
    };
    let mut h = vec![1.0; NODES];
    for _ in 0..300 {
        // The mean of both converges where the iteration alternates.
        h = (0..NODES).map(|i| 0.5 * (h[i] + at(node(i), &h))).collect();
    }
    at(1.0, &h)
}

/// A half-space under uniform light sends 1 - H(m) sqrt(1 - albedo) of its radiance back, at the
/// cosine m to the normal.
#[test]
fn half_space_reflects_as_the_h_function_has_it() {
    // Chandrasekhar, table XI.
    assert!((h_function(1.0) - 2.9078).abs() < 1e-4, "{}", h_function(1.0));
    let albedo = Vec3::new(0.6, 0.8, 0.95);
    let reflected = albedo.to_array().map(|albedo| {
        let albedo = f64::from(albedo);
        (1.0 - h_function(albedo) * (1.0 - albedo).sqrt()) as f32
    });
    let expected = f64::from(luminance(Vec3::from(reflected)));
    let extinction = 12.0;
    let slab = index_matched(&medium(extinction * (Vec3::ONE - albedo), extinction * albedo, 0.0));
    let eye = camera(Vec3::new(0.03, 0.02, 1.19), Vec3::new(0.03, 0.02, 1.0), 2.0);
    let scene = shaft(0.1, slab, gray(0.0, 0.0), gray(0.0, 1.0), eye);
    // The camera sees little of the shaft.
    let settings = Settings { light_paths: 30_000, ..base() };
    assert_means(&scene, &settings, 12, expected);
}
