//! Distributions against closed forms, numeric integrals and histograms.

use super::*;
use crate::base::rng::{Rng, Stream, StreamKey};
use std::f64::consts::PI;

fn rng(index: u64) -> Rng {
    StreamKey::new(11, Stream::Test, index).rng(0)
}

fn degrees(angles: &[f64]) -> Vec<f64> {
    angles.iter().map(|angle| angle.to_radians()).collect()
}

/// A distribution without symmetry, with uneven angles and a dark sector.
fn uneven(photometry: Photometry) -> IntensityDistribution {
    let (polar, azimuth) = match photometry {
        Photometry::C => (
            degrees(&[0.0, 5.0, 30.0, 55.0, 90.0, 120.0]),
            degrees(&[0.0, 40.0, 90.0, 200.0, 300.0, 360.0]),
        ),
        _ => (degrees(&[20.0, 60.0, 90.0, 100.0, 170.0]), degrees(&[-70.0, -10.0, 30.0, 80.0])),
    };
    let mut rng = rng(1);
    let mut values: Vec<f64> = (0..polar.len() * azimuth.len())
        .map(|_| (3.0 * rng.next_f64() - 0.6).max(0.0) * 100.0)
        .collect();
    if photometry == Photometry::C {
        // The last azimuth is the first one, and the pole is one direction.
        let columns = azimuth.len();
        values[..columns].fill(150.0);
        values.chunks_mut(columns).for_each(|row| row[columns - 1] = row[0]);
    }
    IntensityDistribution::new(photometry, polar, azimuth, values).unwrap()
}

const ALL: [Photometry; 3] = [Photometry::A, Photometry::B, Photometry::C];

#[test]
fn flux_of_simple_distributions_has_its_closed_form() {
    let whole = [0.0, TAU].to_vec();
    let constant = |value: f64, polar: Vec<f64>| {
        let count = 2 * polar.len();
        IntensityDistribution::new(Photometry::C, polar, whole.clone(), vec![value; count]).unwrap()
    };
    let sphere = constant(7.0, vec![0.0, 1.0, PI]);
    assert!((sphere.flux() / (4.0 * PI * 7.0) - 1.0).abs() < 1e-12);
    let half = constant(7.0, vec![0.0, 0.5 * PI]);
    assert!((half.flux() / (2.0 * PI * 7.0) - 1.0).abs() < 1e-12);
    // Linear in the polar angle: 2 pi times the integral of t sin t, which is pi, over the sphere
    let cone = vec![0.0, 0.0, PI, PI];
    let cone = IntensityDistribution::new(Photometry::C, vec![0.0, PI], whole, cone).unwrap();
    assert!((cone.flux() / (2.0 * PI * PI) - 1.0).abs() < 1e-12, "{}", cone.flux());
    assert!((cone.intensity(DVec3::X) - 0.5 * PI).abs() < 1e-12);
    assert_eq!(half.intensity(DVec3::new(0.0, 0.6, 0.8)), 0.0, "dark above");
}

#[test]
fn flux_is_the_integral_of_the_intensity_over_directions() {
    for photometry in ALL {
        let own = uneven(photometry);
        // Midpoints over the cosine of the angle from z, and the angle around it
        let n = 1500;
        let mut sum = 0.0;
        for i in 0..n {
            let z = 2.0 * (f64::from(i) + 0.5) / f64::from(n) - 1.0;
            let across = (1.0 - z * z).sqrt();
            for j in 0..n {
                let (y, x) = (TAU * (f64::from(j) + 0.5) / f64::from(n)).sin_cos();
                sum += own.intensity(DVec3::new(across * x, across * y, z));
            }
        }
        let integral = sum * 2.0 / f64::from(n) * TAU / f64::from(n);
        assert!((integral / own.flux() - 1.0).abs() < 1e-3, "{photometry:?}: {integral}");
    }
}

#[test]
fn directions_have_the_density_of_the_intensity_over_the_flux() {
    for photometry in ALL {
        let own = uneven(photometry);
        let mut rng = rng(2);
        // Shares of the samples in boxes of angles, against midpoints within them
        const BINS: usize = 12;
        let n = 400_000;
        let range = |nodes: &[f64]| [nodes[0], nodes[nodes.len() - 1]];
        let ranges = [range(own.polar()), range(own.azimuth())];
        let mut counts = [[0.0; BINS]; BINS];
        for _ in 0..n {
            let direction = own.sample([rng.next_f64(), rng.next_f64()]);
            assert!((direction.length() - 1.0).abs() < 1e-12);
            assert!(own.intensity(direction) > 0.0);
            let angles = own.angles(direction);
            let [i, j] = [0, 1].map(|k| {
                let [from, to] = ranges[k];
                ((BINS as f64 * (angles[k] - from) / (to - from)) as usize).min(BINS - 1)
            });
            counts[i][j] += 1.0;
        }
        let steps = 40;
        for (i, row) in counts.iter().enumerate() {
            for (j, count) in row.iter().enumerate() {
                let mut share = 0.0;
                let widths = ranges.map(|[from, to]| (to - from) / (BINS * steps) as f64);
                for a in 0..steps {
                    for b in 0..steps {
                        let at = |k: usize, bin: usize, step: usize| {
                            ranges[k][0] + widths[k] * ((bin * steps + step) as f64 + 0.5)
                        };
                        let polar = at(0, i, a);
                        let direction = own.direction(polar, at(1, j, b));
                        share += own.intensity(direction) * polar.sin() * widths[0] * widths[1];
                    }
                }
                let expected = share / own.flux() * f64::from(n);
                let error = expected.max(1.0).sqrt() + 2e-3 * expected;
                assert!((count - expected).abs() < 4.5 * error, "{i} {j}: {count} {expected}");
            }
        }
    }
}

#[test]
fn numbers_of_a_direction_are_those_that_sampled_it() {
    for photometry in ALL {
        let own = uneven(photometry);
        let mut rng = rng(3);
        for _ in 0..20_000 {
            let numbers = [rng.next_f64(), rng.next_f64()];
            let direction = own.sample(numbers);
            let again = own.numbers(direction).unwrap();
            let off = [0, 1].map(|k| (again[k] - numbers[k]).abs());
            // Azimuths near the pole lose digits.
            assert!(off[0] < 1e-9 && off[1] < 1e-6, "{numbers:?} {again:?}");
        }
        for corner in [[0.0, 0.0], [1.0 - 1e-16, 1.0 - 1e-16], [0.0, 1.0 - 1e-16]] {
            assert!(own.sample(corner).is_finite());
        }
    }
}

#[test]
fn intensity_at_nodes_is_the_given_value() {
    for photometry in ALL {
        let own = uneven(photometry);
        let columns = own.azimuth().len();
        for (i, polar) in own.polar().iter().enumerate().skip(1) {
            for (j, azimuth) in own.azimuth().iter().enumerate() {
                // From the inside, since rounding may leave the grid.
                let [polar, azimuth] = [(polar, 1.0), (azimuth, 0.3)]
                    .map(|(angle, middle)| angle + 1e-9 * (middle - angle));
                let found = own.intensity(own.direction(polar, azimuth));
                let expected = own.values()[i * columns + j];
                assert!((found - expected).abs() < 1e-4, "{photometry:?} {i} {j}");
            }
        }
    }
}

#[test]
fn axes_of_photometric_types_point_where_the_standard_says() {
    let of = |photometry| {
        let full = match photometry {
            Photometry::C => vec![0.0, TAU],
            _ => degrees(&[-90.0, 90.0]),
        };
        IntensityDistribution::new(photometry, vec![0.0, PI], full, vec![1.0; 4]).unwrap()
    };
    let right = 0.5 * PI;
    let near = |a: DVec3, b: DVec3| assert!((a - b).length() < 1e-12, "{a} {b}");
    let c = of(Photometry::C);
    near(c.direction(0.0, 0.0), DVec3::NEG_Z);
    near(c.direction(right, 0.0), DVec3::X);
    near(c.direction(right, right), DVec3::Y);
    // V = 90 and H = 90 degrees
    let a = of(Photometry::A);
    near(a.direction(right, 0.0), DVec3::NEG_Z);
    near(a.direction(PI, 0.0), DVec3::X);
    near(a.direction(right, right), DVec3::NEG_Y);
    let b = of(Photometry::B);
    near(b.direction(right, 0.0), DVec3::NEG_Z);
    near(b.direction(PI, 0.0), DVec3::NEG_Y);
    near(b.direction(right, right), DVec3::X);
}

#[test]
fn grids_that_are_not_valid_are_refused() {
    let new = |polar: &[f64], azimuth: &[f64], values: &[f64]| {
        IntensityDistribution::new(Photometry::C, polar.into(), azimuth.into(), values.into())
    };
    assert!(new(&[0.0, 1.0], &[0.0, TAU], &[1.0; 4]).is_some());
    assert!(new(&[0.0], &[0.0, TAU], &[1.0; 2]).is_none());
    assert!(new(&[1.0, 0.0], &[0.0, TAU], &[1.0; 4]).is_none());
    assert!(new(&[0.0, 4.0], &[0.0, TAU], &[1.0; 4]).is_none());
    assert!(new(&[0.0, 1.0], &[0.0, 7.0], &[1.0; 4]).is_none());
    assert!(new(&[0.0, 1.0], &[0.0, TAU], &[1.0; 3]).is_none());
    assert!(new(&[0.0, 1.0], &[0.0, TAU], &[1.0, 1.0, -1.0, 1.0]).is_none());
    assert!(new(&[0.0, 1.0], &[0.0, TAU], &[1.0, 1.0, f64::NAN, 1.0]).is_none());
}

#[test]
fn mirrored_distribution_has_the_intensity_of_the_mirrored_direction() {
    for photometry in ALL {
        let own = uneven(photometry);
        let mirrored = own.mirrored().unwrap();
        assert!((mirrored.flux() / own.flux() - 1.0).abs() < 1e-12, "{photometry:?}");
        let mut rng = rng(5);
        for _ in 0..1000 {
            let direction =
                DVec3::new(rng.next_f64() - 0.5, rng.next_f64() - 0.5, rng.next_f64() - 0.5);
            let direction = direction.normalize();
            let mirror = DVec3::new(direction.x, -direction.y, direction.z);
            let [a, b] = [own.intensity(direction), mirrored.intensity(mirror)];
            assert!((a - b).abs() < 1e-6 * own.peak(), "{photometry:?} {direction}: {a}, not {b}");
        }
    }
}
