//! Luminaires: the illuminance of a floor by the inverse square law, and agreement of all
//! techniques.

use crate::common::strategies::ALL;
use crate::common::*;
use bdpm::light::photometry::LuminaireFile;
use bdpm::scene::{
    AimedDistribution, Emitter, IntensityDistribution, LuminousOpening, Material, Mesh,
    PointLuminaire,
};
use bdpm::settings::{Direct, Kernel, Settings, Strategy};
use glam::{DMat3, DVec3, Vec3};
use std::f64::consts::PI;
use std::path::Path;
use std::sync::Arc;

const ALBEDO: f32 = 0.6;

/// A distribution of the test data, with -z down.
fn distribution(name: &str) -> Arc<IntensityDistribution> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/photometry").join(name);
    Arc::new(LuminaireFile::read(&path).unwrap().distribution)
}

fn aimed(own: &Arc<IntensityDistribution>) -> AimedDistribution {
    AimedDistribution::new(Arc::clone(own), DMat3::IDENTITY, Vec3::splat(0.01))
}

/// The radiance that a camera sees around the point `at` of a floor, under a light.
fn assert_radiance(
    (meshes, materials): (Vec<Mesh>, Vec<Material>),
    lights: Vec<Emitter>,
    at: Vec3,
    irradiance: f64,
    systematic: f64,
) {
    let floor = square(Vec3::ZERO, Vec3::Z, 4.0, 0);
    let from = at + Vec3::new(0.3, -1.0, 1.4);
    let meshes = [vec![floor], meshes].concat();
    let materials = [vec![gray(ALBEDO, 0.0)], materials].concat();
    let scene = scene(meshes, materials, lights, camera(from, at, 2.0));
    for direct in [Direct::Connect, Direct::PhotonMap] {
        let settings = Settings {
            direct,
            light_paths: 20_000,
            radius: 0.05,
            caustic_radius: 0.05,
            ..settings(4, 4)
        };
        let iterations = if direct == Direct::Connect { 50 } else { 200 };
        let mean = mean_luminance(&scene, &accel(&scene), settings, iterations);
        let expected = f64::from(ALBEDO) / PI * irradiance;
        println!("{direct:?} {at}: {mean:?}, {expected}");
        mean.assert_is(expected, systematic);
    }
}

#[test]
fn point_luminaires_light_a_floor_by_the_inverse_square_law() {
    // E = I cos^3 / h^2
    let height = 2.0;
    let position = Vec3::new(0.0, 0.0, height);
    for (name, at) in [
        ("round.ldt", Vec3::ZERO),
        ("round.ldt", Vec3::new(1.1, 0.4, 0.0)),
        ("none.ldt", Vec3::new(-0.5, 0.9, 0.0)),
        ("quarter.ies", Vec3::new(0.7, 0.9, 0.0)),
        ("flood.ies", Vec3::new(0.5, -0.3, 0.0)),
    ] {
        let own = distribution(name);
        let down = (at - position).as_dvec3();
        let cos = f64::from(height) / down.length();
        let intensity = 0.01 * own.intensity(down.normalize());
        let irradiance = intensity * cos.powi(3) / f64::from(height).powi(2);
        let light = Emitter::Luminaire(Box::new(PointLuminaire { position, aimed: aimed(&own) }));
        // Within the field of view and the merge radius the irradiance bends.
        assert_radiance((vec![], vec![]), vec![light], at, irradiance, 4e-3);
    }
}

#[test]
fn openings_light_a_floor_by_the_integral_over_their_surface() {
    let own = distribution("none.ldt");
    let center = Vec3::new(0.0, 0.0, 1.0);
    for (is_flat, at) in [(true, Vec3::new(0.3, 0.2, 0.0)), (false, Vec3::new(-0.4, 0.5, 0.0))] {
        let mesh = if is_flat {
            square(center, Vec3::new(0.2, 0.1, 1.0), 0.3, 1)
        } else {
            sphere(center, 0.25, 1, false, 1)
        };
        let opening = Arc::new(LuminousOpening::new(aimed(&own), &mesh, is_flat));
        // Midpoints of small parts of each triangle
        let (steps, mut irradiance) = (60, 0.0);
        for indices in &mesh.triangles {
            let [a, b, c] = indices.map(|i| mesh.positions[i as usize].as_dvec3());
            let cross = (b - a).cross(c - a);
            let part = 0.5 * cross.length() / f64::from(steps * steps);
            for i in 0..steps {
                for j in 0..steps - i {
                    let turned = (i + j + 1 < steps).then_some(2.0 / 3.0);
                    for inside in [Some(1.0 / 3.0), turned].into_iter().flatten() {
                        let [u, v] = [i, j].map(|k| (f64::from(k) + inside) / f64::from(steps));
                        let to_floor = at.as_dvec3() - (a + u * (b - a) + v * (c - a));
                        let direction: DVec3 = to_floor.normalize();
                        let cos = direction.dot(cross.normalize());
                        let cos = if is_flat { cos.abs() } else { cos.max(0.0) };
                        let radiance = f64::from(opening.radiance(direction.as_vec3()).x);
                        irradiance +=
                            radiance * cos * -direction.z * part / to_floor.length_squared();
                    }
                }
            }
        }
        let material = Material { luminous_opening: Some(opening), ..gray(0.0, 0.0) };
        assert_radiance((vec![mesh], vec![material]), vec![], at, irradiance, 4e-3);
    }
}

#[test]
fn a_room_with_luminaires_is_the_same_by_every_strategy() {
    let scene = boxes::luminaires();
    let accel = accel(&scene);
    let base = Settings {
        kernel: Kernel::Area,
        light_paths: 40_000,
        camera_paths: 16,
        radius: 0.02,
        caustic_radius: 0.02,
        seed: 3,
        ..settings(boxes::SIDE, boxes::SIDE)
    };
    // Path tracing hits the openings and connects to them, weighted, and has no bias.
    let path = Settings { strategy: Strategy::Path, merge_vertex: 2, ..base.clone() };
    let expected = mean_luminance(&scene, &accel, Settings { camera_paths: 256, ..path }, 20);
    println!("{expected:?}");
    assert!(expected.error < 0.01 * expected.mean, "{expected:?} says little");
    let guided = [(Direct::Connect, MIS, 16), (Direct::PhotonMap, 1, 16)];
    let plain = ALL.map(|(direct, merge_vertex)| (direct, merge_vertex, 0));
    for (direct, merge_vertex, guide) in plain.into_iter().chain(guided) {
        let settings = by_way(Settings { direct, merge_vertex, guide, ..base.clone() });
        let found = mean_luminance(&scene, &accel, settings, 24);
        let error = found.error.hypot(expected.error);
        let off = found.mean - expected.mean;
        println!("{direct:?} k = {merge_vertex}, guide {guide}: {found:?}, off by {off}");
        // Edges of small bodies leave a bias of the radius.
        assert!(off.abs() < 4.0 * error + 0.01 * expected.mean, "{found:?} {expected:?}");
        assert!(error < 0.02 * expected.mean, "{found:?} says little");
    }
}
