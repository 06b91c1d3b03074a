//! The goniophotometer against lamps of known distributions, and a model against the luminaire that
//! was measured.

use crate::common::*;
use bdpm::Scene;
use bdpm::light::photometry::{LuminaireDescription, LuminaireFile, OpeningShape, write_lm63};
use bdpm::measurement::goniometer::{Goniometer, GoniometerGrid};
use bdpm::scene::{AimedDistribution, Emitter, Mesh, PointLuminaire};
use bdpm::settings::Settings;
use glam::{DMat3, Vec3};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

const LUMENS_PER_WATT: f64 = 683.0;

fn far_camera() -> bdpm::scene::Camera {
    camera(Vec3::new(0.0, -5.0, 0.0), Vec3::ZERO, 40.0)
}

fn measured(scene: &Arc<Scene>, [gamma, c]: [f64; 2], paths: u32, iterations: u32) -> Goniometer {
    let grid = GoniometerGrid::new(gamma, c, DMat3::IDENTITY).unwrap();
    let mut own = Goniometer::new(scene, grid, 3, paths).unwrap();
    let accel = accel(scene);
    (0..iterations).for_each(|_| own.iterate(scene, &*accel));
    own
}

/// Mean of an intensity over the hat function of the node at `gamma`, by midpoints; angles in
/// radians.
fn over_hat(intensity: impl Fn(f64) -> f64, gamma: f64, step: f64) -> f64 {
    let (mut sum, mut weights) = (0.0, 0.0);
    let n = 4000;
    for i in 0..n {
        let at = gamma - step + 2.0 * step * (f64::from(i) + 0.5) / f64::from(n);
        if (0.0..=PI).contains(&at) {
            let weight = (1.0 - (at - gamma).abs() / step) * at.sin();
            sum += weight * intensity(at);
            weights += weight;
        }
    }
    sum / weights
}

/// Asserts the intensity of every node, cd, and the flux, lm.
fn assert_distribution(own: &Goniometer, intensity: impl Fn(f64) -> f64, flux: f64) {
    let total = own.flux();
    assert!((total.value - flux).abs() < 4.0 * total.error + 2e-6 * flux, "{total:?} {flux}");
    // The interpolated distribution has the flux of all paths.
    let distribution = own.distribution();
    assert!((distribution.flux() / total.value - 1.0).abs() < 1e-9);
    let (gammas, planes) = (own.gammas(), own.planes());
    let step = (gammas[1] - gammas[0]).to_radians();
    let peak = distribution.peak();
    let nodes = own.intensities();
    let mut square = 0.0;
    for (row, nodes) in nodes.chunks(planes.len()).enumerate() {
        let expected = over_hat(&intensity, gammas[row].to_radians(), step);
        for node in nodes {
            let off = (node.value - expected).abs();
            assert!(off < 5.5 * node.error + 1e-5 * peak, "{row}: {node:?} {expected}");
            square += (off / node.error.max(1e-5 * peak)).powi(2);
        }
    }
    let square = square / nodes.len() as f64;
    assert!(square < 2.0, "{square}");
}

#[test]
fn lambertian_panel_has_the_cosine_of_its_angle() {
    // A panel of 0.4 by 0.4 that faces down with the radiance 3
    let panel = square(Vec3::new(0.1, 0.0, 0.2), -Vec3::Z, 0.2, 0);
    let scene = scene(vec![panel], vec![gray(0.0, 3.0)], vec![], far_camera());
    let own = measured(&scene, [10.0, 45.0], 20_000, 40);
    let peak = LUMENS_PER_WATT * 3.0 * 0.16;
    assert_distribution(&own, |gamma| peak * gamma.cos().max(0.0), PI * peak);
}

#[test]
fn shining_sphere_has_the_same_intensity_everywhere() {
    let ball = sphere(Vec3::ZERO, 0.3, 3, false, 0);
    // The area of the polyhedron; projected, a fourth of it.
    let area = area(&ball);
    let scene = scene(vec![ball], vec![gray(0.5, 2.0)], vec![], far_camera());
    let own = measured(&scene, [15.0, 60.0], 20_000, 40);
    let intensity = LUMENS_PER_WATT * 2.0 * area / 4.0;
    assert_distribution(&own, |_| intensity, TAU * 2.0 * intensity);
}

/// A lamp in an open, white box, without a floor: it shines down, most strongly below.
fn reflector() -> Vec<Mesh> {
    let mut meshes = vec![square(Vec3::Z * 0.05, -Vec3::Z, 0.05, 1)];
    for axis in [Vec3::X, Vec3::Y] {
        meshes.push(square(axis * 0.05, -axis, 0.05, 1));
        meshes.push(square(-axis * 0.05, axis, 0.05, 1));
    }
    meshes.push(square(Vec3::Z * 0.03, -Vec3::Z, 0.02, 2));
    meshes
}

#[test]
fn measured_luminaire_lights_a_floor_like_its_model() {
    let materials = || vec![gray(0.6, 0.0), gray(0.8, 0.0), gray(0.0, 50.0)];
    let lamp = scene(reflector(), materials(), vec![], far_camera());
    let own = measured(&lamp, [5.0, 30.0], 50_000, 40);
    let ratio = own.flux().value
        / (LUMENS_PER_WATT * f64::from(bdpm::base::math::luminance(lamp.lights().power())));
    assert!(ratio > 0.5 && ratio < 0.95, "white walls absorb a part: {ratio}");

    // Read back from a file
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lamp.ies");
    let about = LuminaireDescription {
        name: "lamp".into(),
        origin: "test".into(),
        opening: OpeningShape::Point,
        lamp_lumens: None,
        watts: 0.0,
    };
    std::fs::write(&path, write_lm63(&own.distribution(), &about)).unwrap();
    let distribution = LuminaireFile::read(&path).unwrap().distribution;
    let factor = Vec3::splat(1.0 / LUMENS_PER_WATT as f32);
    let aimed = AimedDistribution::new(Arc::new(distribution), DMat3::IDENTITY, factor);
    let point = Emitter::Luminaire(Box::new(PointLuminaire { position: Vec3::ZERO, aimed }));

    for at in [Vec3::new(0.0, 0.0, -3.0), Vec3::new(1.5, 0.6, -3.0)] {
        let floor = square(Vec3::Z * -3.0, Vec3::Z, 4.0, 0);
        let view = || camera(at + Vec3::new(0.3, -1.0, 1.0), at, 4.0);
        let model = scene([vec![floor.clone()], reflector()].concat(), materials(), vec![], view());
        let file = scene(vec![floor], materials(), vec![point.clone()], view());
        let mean = |scene: &Arc<Scene>, camera_paths: u32, iterations: usize| {
            // All paths by connections and merges of small radii
            let settings = Settings {
                merge_vertex: 1,
                light_paths: 200_000,
                camera_paths,
                radius: 0.1,
                caustic_radius: 0.1,
                ..settings(4, 4)
            };
            mean_luminance(scene, &accel(scene), settings, iterations)
        };
        let (model, file) = (mean(&model, 16, 60), mean(&file, 4, 20));
        // Error of the nodes around the direction, and the bend of the intensity between them
        let direction = at.as_dvec3().normalize();
        let gamma = direction.z.abs().acos().to_degrees();
        let row = (gamma / 5.0).round() as usize;
        let node = own.intensities()[row * own.planes().len()];
        let error = model.error.hypot(file.error).hypot(file.mean * node.error / node.value);
        let off = (model.mean - file.mean).abs();
        println!("{at}: {model:?} {file:?}, node {node:?}");
        assert!(off < 4.0 * error + 6e-3 * file.mean, "{at}: {model:?} {file:?} {node:?}");
        assert!(error < 0.02 * file.mean, "{error} says little");
    }
}

#[test]
fn measurement_does_not_depend_on_the_number_of_threads() {
    let scene = scene(
        reflector(),
        vec![gray(0.6, 0.0), gray(0.8, 0.0), gray(0.0, 5.0)],
        vec![],
        far_camera(),
    );
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| measured(&scene, [10.0, 30.0], 30_001, 4))
    };
    let (one, three) = (with(1), with(3));
    assert_eq!(one.intensities(), three.intensities());
    assert_eq!(one.flux(), three.flux());
}

#[test]
fn scenes_with_light_from_outside_are_refused() {
    let panel = square(Vec3::ZERO, Vec3::Z, 1.0, 0);
    let sun = boxes::sun();
    let scene = scene(vec![panel], vec![gray(0.5, 1.0)], vec![sun], far_camera());
    let grid = GoniometerGrid::new(10.0, 30.0, DMat3::IDENTITY).unwrap();
    let refused = Goniometer::new(&scene, grid, 1, 100).unwrap_err();
    assert!(refused.problem().contains("parallel light"), "{refused}");
}
