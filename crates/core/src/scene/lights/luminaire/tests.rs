//! Luminous openings: their far field, their densities, and irradiance by quadrature.

use super::*;
use crate::base::math::{luminance, uniform_sphere};
use crate::base::rng::{Rng, Stream, StreamKey};
use crate::scene::Photometry;
use glam::DQuat;
use std::f64::consts::{PI as PI64, TAU as TAU64};

fn rng(index: u64) -> Rng {
    StreamKey::new(12, Stream::Test, index).rng(0)
}

/// A tilted distribution without symmetry that shines everywhere.
pub(in crate::scene::lights) fn aimed() -> AimedDistribution {
    let polar = vec![0.0, 0.4, 1.2, 1.9, PI64];
    let azimuth = vec![0.0, 1.0, 2.5, 4.0, TAU64];
    let rows = [[90.0; 5], [80.0, 50.0, 60.0, 90.0, 80.0], [40.0, 5.0, 30.0, 50.0, 40.0]];
    let rest = [[10.0, 20.0, 4.0, 8.0, 10.0], [6.0; 5]];
    let values = rows.iter().chain(&rest).flatten().copied().collect();
    let own = IntensityDistribution::new(Photometry::C, polar, azimuth, values).unwrap();
    let turn = DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), 0.7);
    AimedDistribution::new(Arc::new(own), DMat3::from_quat(turn), Rgb::new(0.02, 0.01, 0.03))
}

/// An opening of a flat square of the side 0.4, or of a box of 0.4 by 0.6 by 0.2.
pub(in crate::scene::lights) fn opening(is_flat: bool, center: Vec3) -> OpeningEmitter {
    let corner = |bits: u32| {
        let sign = |axis: u32| if bits >> axis & 1 == 1 { 1.0 } else { -1.0 };
        center + Vec3::new(0.2 * sign(0), 0.3 * sign(1), 0.1 * sign(2))
    };
    let faces: &[[u32; 4]] = if is_flat {
        &[[4, 5, 7, 6]]
    } else {
        &[[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]]
    };
    let triangles: Vec<_> = faces.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let mesh = Mesh { positions: (0..8).map(corner).collect(), triangles, ..Mesh::default() };
    let shape =
        |indices: &[u32; 3]| Triangle::new(indices.map(|index| mesh.positions[index as usize]), 0);
    let opening = LuminousOpening::new(aimed(), &mesh, is_flat);
    OpeningEmitter::new(Arc::new(opening), mesh.triangles.iter().map(shape).collect())
}

#[test]
fn far_field_of_an_opening_is_the_intensity_of_its_distribution() {
    let mut rng = rng(0);
    for is_flat in [true, false] {
        let lamp = opening(is_flat, Vec3::ONE);
        for _ in 0..1000 {
            let direction = uniform_sphere(rng.next_2d());
            let radiance = lamp.opening.radiance(direction);
            let area: f32 = lamp.triangles.iter().map(|one| projected(one, direction)).sum();
            let expected = aimed().intensity(direction);
            assert!((radiance * area - expected).abs().max_element() < 1e-5 * expected.x);
        }
    }
}

#[test]
fn light_paths_of_an_opening_have_the_density_of_its_radiance() {
    // Means of functions of position and direction: over light paths, and by the definition of
    // radiance.
    let functions: [fn(Vec3, Vec3) -> f64; 5] = [
        |_, _| 1.0,
        |x, w| f64::from(x.x * w.x),
        |x, w| f64::from(x.y * w.z * w.z),
        |_, w| f64::from(w.z),
        |x, w| f64::from(x.z * w.y + x.x * x.x),
    ];
    for is_flat in [true, false] {
        let lamp = opening(is_flat, Vec3::ZERO);
        let mut rng = rng(1);
        let n = 200_000;
        let mut sums = [[[0.0; 2]; 2]; 5];
        for _ in 0..n {
            let path = lamp.emit(0.5, [(); 4].map(|()| rng.next_f64()));
            assert_eq!(path.flux, aimed().power() / 0.5);
            // A uniform triangle, point and direction
            let direction = uniform_sphere(rng.next_2d());
            let index = (rng.next_f64() * lamp.triangles.len() as f64) as usize;
            let triangle = &lamp.triangles[index];
            let point = triangle.point(uniform_triangle(rng.next_2d()));
            let cos = triangle.normal.dot(direction).max(0.0);
            let inverse = 4.0 * PI * triangle.area() * lamp.triangles.len() as f32;
            let flux = luminance(lamp.opening.radiance(direction)) * cos * inverse;
            for (f, sums) in functions.iter().zip(&mut sums) {
                let own = f(path.origin, path.direction);
                let other = f64::from(flux) * f(point, direction);
                for (sum, value) in sums.iter_mut().zip([own, other]) {
                    sum[0] += value / f64::from(n);
                    sum[1] += value * value / f64::from(n);
                }
            }
        }
        let power = f64::from(luminance(aimed().power()));
        for [own, other] in sums {
            let error =
                |[mean, square]: [f64; 2]| ((square - mean * mean).max(0.0) / f64::from(n)).sqrt();
            let error_of_both = (power * error(own)).hypot(error(other));
            let off = (power * own[0] - other[0]).abs();
            assert!(off < 4.0 * error_of_both + 1e-6, "{own:?} {other:?} {error_of_both}");
        }
    }
}

#[test]
fn numbers_of_a_light_path_are_those_that_started_it() {
    for is_flat in [true, false] {
        let lamp = opening(is_flat, Vec3::new(0.5, 0.2, -0.1));
        let mut rng = rng(2);
        let mut strayed = 0;
        for _ in 0..20_000 {
            let numbers = [(); 4].map(|()| rng.next_f64());
            let path = lamp.emit(1.0, numbers);
            let again = lamp.emission_numbers(path.origin, path.direction);
            let off = |k: usize| (again[k].unwrap() - numbers[k]).abs();
            // Single precision, which points at the tip of a triangle lose.
            strayed += u32::from((0..4).any(|k| off(k) > 2e-3));
        }
        assert!(strayed < 100, "{strayed}");
    }
}

#[test]
fn irradiance_by_connections_is_the_integral_over_the_surface() {
    for (is_flat, from) in [
        (true, Vec3::new(0.3, 0.1, -0.5)),
        (true, Vec3::new(3.0, 1.0, 2.0)),
        (false, Vec3::new(0.4, 0.2, -0.3)),
        (false, Vec3::new(-4.0, 3.0, 1.0)),
    ] {
        let lamp = opening(is_flat, Vec3::ZERO);
        // Midpoints of equal parts of each triangle
        let steps = 200;
        let mut expected = Rgb::ZERO.as_dvec3();
        for triangle in &lamp.triangles {
            let part = triangle.area() / (steps * steps) as f32;
            for i in 0..steps {
                for j in 0..steps - i {
                    let turned = (i + j + 1 < steps).then_some(2.0 / 3.0);
                    for inside in [Some(1.0 / 3.0), turned].into_iter().flatten() {
                        let at = [i, j].map(|k| (k as f32 + inside) / steps as f32);
                        let (wi, distance2) = toward(triangle.point(at), from);
                        let cos = -wi.dot(triangle.normal);
                        if cos > 0.0 {
                            let irradiance = lamp.opening.radiance(-wi) * (cos * part / distance2);
                            expected += irradiance.as_dvec3();
                        }
                    }
                }
            }
        }
        let mut rng = rng(3);
        let n = 100_000;
        let (mut sum, mut square) = (0.0, 0.0);
        for _ in 0..n {
            let Some(sample) = lamp.connect(from, 0.25, &mut rng) else { continue };
            let value = 0.25 * f64::from(sample.irradiance.x);
            sum += value / f64::from(n);
            square += value * value / f64::from(n);
            let direction = -sample.wi;
            let inverse = lamp.inverse_pdf_w(sample.target, direction, from).unwrap();
            let off = (inverse / (0.25 * sample.inverse_pdf_w) - 1.0).abs();
            assert!(off < 1e-3, "{inverse} {}", sample.inverse_pdf_w);
        }
        let error = ((square - sum * sum) / f64::from(n)).sqrt();
        let off = (sum - expected.x).abs();
        assert!(off < 4.0 * error + 2e-4 * expected.x, "{sum} +- {error}, {}", expected.x);
        assert!(error < 0.01 * sum);
    }
}

#[test]
fn beams_bound_the_directions_with_intensity() {
    let whole = vec![0.0, TAU64];
    let beam = |polar: Vec<f64>, values: Vec<f64>| {
        let own = IntensityDistribution::new(Photometry::C, polar, whole.clone(), values).unwrap();
        AimedDistribution::new(Arc::new(own), DMat3::IDENTITY, Rgb::ONE).beam().0
    };
    let right = 0.5 * PI64;
    let down = beam(vec![0.0, 1.0, right], vec![1.0; 6]);
    assert_eq!((down.axis, down.spread, down.reach), (-Vec3::Z, 0.0, FRAC_PI_2));
    let dark_above = beam(vec![0.0, right, PI64], vec![2.0, 2.0, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!((dark_above.axis, dark_above.spread), (-Vec3::Z, 0.0));
    let up = beam(vec![right, PI64], vec![1.0; 4]);
    assert_eq!((up.axis, up.spread), (Vec3::Z, 0.0));
    assert_eq!(beam(vec![0.0, 1.0, 1.7], vec![1.0; 6]).spread, PI);
}
