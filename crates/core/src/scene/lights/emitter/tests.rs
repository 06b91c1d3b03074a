//! Emission of spots and parallel light.

use super::*;
use crate::base::math::Bounds;
use crate::base::rng::{Stream, StreamKey};
use std::f64::consts::TAU;

fn spot() -> Spot {
    Spot {
        position: Vec3::new(1.0, 2.0, 3.0),
        direction: Vec3::new(2.0, -1.0, 2.0) / 3.0,
        intensity: Rgb::new(3.0, 2.0, 1.0),
        cos_inner: 0.9,
        cos_outer: 0.6,
        falloff: Falloff::Quadratic,
    }
}

const FALLOFFS: [Falloff; 3] = [Falloff::Quadratic, Falloff::Smoothstep, Falloff::LinearInAngle];

/// A direction at this cosine to the axis.
fn at_cosine(spot: &Spot, cosine: f32) -> Vec3 {
    let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
    cosine * spot.direction + sine * spot.direction.any_orthonormal_vector()
}

#[test]
fn power_of_a_spot_is_the_integral_of_its_intensity() {
    for falloff in FALLOFFS {
        // Midpoints over the cosine.
        let n = 100_000;
        let spot = Spot { falloff, ..spot() };
        let cosine = |i: i32| 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
        let shares = (0..n).map(|i| f64::from(spot.share(at_cosine(&spot, cosine(i)))));
        let integral = shares.sum::<f64>() * 2.0 / f64::from(n) * TAU;
        assert!((integral / f64::from(spot.solid_angle()) - 1.0).abs() < 1e-4, "{integral}");
        let power = Emitter::Spot(spot).power();
        assert!((power / spot.intensity - spot.solid_angle()).abs().max_element() < 1e-5);
    }
}

#[test]
fn light_paths_of_a_spot_follow_its_intensity() {
    for falloff in FALLOFFS {
        let spot = Spot { falloff, ..spot() };
        let emitter = Emitter::Spot(spot);
        let mut rng = StreamKey::new(5, Stream::Test, 0).rng(0);
        const BINS: usize = 16;
        let n = 400_000;
        let mut counts = [0.0; BINS];
        for _ in 0..n {
            let Emission { origin, direction, flux } =
                emitter.emit(0.5, [(); 4].map(|()| rng.next_f64()));
            assert_eq!((origin, flux), (spot.position, emitter.power() / 0.5));
            assert!((direction.length() - 1.0).abs() < 1e-5);
            let cos_outer = spot.cos_outer as f32;
            let place = (direction.dot(spot.direction) - cos_outer) / (1.0 - cos_outer);
            counts[((BINS as f32 * place) as usize).min(BINS - 1)] += 1.0;
        }
        for (bin, count) in counts.into_iter().enumerate() {
            // Midpoints within the bin.
            let cosine = |i: i32| {
                let place = (bin as f32 + (i as f32 + 0.5) / 64.0) / BINS as f32;
                spot.cos_outer as f32 + place * (1.0 - spot.cos_outer as f32)
            };
            let share = |i| f64::from(spot.share(at_cosine(&spot, cosine(i))));
            let mean: f64 = (0..64).map(|i| share(i) / 64.0).sum();
            let solid_angle = f64::from(spot.solid_angle());
            let share = TAU * (1.0 - spot.cos_outer) / BINS as f64 * mean / solid_angle;
            let expected = share * f64::from(n);
            let error = expected.max(1.0).sqrt();
            let off = (count - expected).abs();
            assert!(off < 4.5 * error, "{falloff:?} {bin}: {count} {expected}");
        }
    }
}

/// Also for cones of a thousandth of a degree, and falloffs of a millionth of their width.
#[test]
fn numbers_of_a_light_path_of_a_spot_are_those_that_started_it() {
    for falloff in FALLOFFS {
        for (inner, outer) in [(25.8, 53.1), (0.0, 80.0), (15.0, 15.001), (0.0, 0.01)] {
            let [cos_inner, cos_outer] =
                [inner, outer].map(|degrees: f64| degrees.to_radians().cos());
            let spot = Spot { falloff, cos_inner, cos_outer, ..spot() };
            for i in 1..40 {
                let choice = (i as f32 - 0.5) / 40.0;
                let direction = spot.emit(1.0, [choice, 0.3]).direction;
                let [own, around] = spot.emission_numbers(direction);
                // Directions of single precision have few digits of a narrow cone.
                let tolerance = if outer < 1.0 || outer - inner < 0.1 { 0.1 } else { 1e-4 };
                let off = (own - choice).abs();
                assert!(off < tolerance, "{falloff:?} {inner} {outer}: {own} {choice}");
                assert!((around - 0.3).abs() < 0.05, "{around}");
            }
        }
    }
}

/// Cosines of single precision would put all paths on some hundred cones around the axis.
#[test]
fn light_paths_of_a_narrow_spot_are_on_no_rings() {
    let [cos_inner, cos_outer] = [0.45, 0.5].map(|degrees: f64| degrees.to_radians().cos());
    let spot = Spot { cos_inner, cos_outer, ..spot() };
    let emitter = Emitter::Spot(spot);
    let mut rng = StreamKey::new(7, Stream::Test, 0).rng(0);
    let axis = spot.direction.as_dvec3().normalize();
    let (n, inner) = (20_000, 0.45_f64.to_radians().sin().powi(2));
    // Squared sines are uniform within the inner cone.
    let mut squares: Vec<f64> = (0..n)
        .map(|_| emitter.emit(1.0, [(); 4].map(|()| rng.next_f64())).direction.as_dvec3())
        .map(|direction| direction.cross(axis).length_squared() / inner)
        .filter(|square| *square < 1.0)
        .collect();
    squares.sort_unstable_by(f64::total_cmp);
    let share = squares.len() as f64 / f64::from(n);
    let of_inner = f64::from(spot.solid_angle());
    let expected = TAU * (1.0 - cos_inner) / of_inner;
    assert!((share - expected).abs() < 4.0 * (expected * (1.0 - expected) / f64::from(n)).sqrt());
    // Kolmogorov and Smirnov: 2.2 has a probability of 1e-4.
    let count = squares.len() as f64;
    let off = |(i, square): (usize, &f64)| (square - (i as f64 + 0.5) / count).abs();
    let largest = squares.iter().enumerate().map(off).fold(0.0, f64::max);
    assert!(largest * count.sqrt() < 2.2, "{largest}");
    let gaps = squares.windows(2).map(|two| two[1] - two[0]);
    let largest_gap = gaps.fold(0.0, f64::max);
    // Each of n gaps exceeds ln(n/p)/n, here .0011, with the probability p/n. Rings have gaps of
    // .002.
    assert!(largest_gap < (count / 1e-4).ln() / count, "{largest_gap}");
}

#[test]
fn parallel_light_has_uniform_irradiance_in_the_sphere() {
    let center = Vec3::new(3.0, 0.0, 1.0);
    let bounds = Bounds { min: center - 1.0, max: center + 1.0 };
    let light = Directional {
        enclosure: Enclosure::new(&bounds),
        ..Directional::new(Vec3::new(0.6, 0.0, -0.8), Rgb::splat(5.0))
    };
    let radius = light.enclosure.radius();
    let emitter = Emitter::Directional(light);
    let mut rng = StreamKey::new(6, Stream::Test, 0).rng(0);
    let n = 200_000;
    let (mut inner, mut flux_sum) = (0.0, 0.0);
    for _ in 0..n {
        let Emission { origin, direction, flux } =
            emitter.emit(1.0, [(); 4].map(|()| rng.next_f64()));
        assert_eq!(direction, light.direction);
        let from_center = origin - center;
        let axis = from_center - from_center.dot(direction) * direction;
        assert!(axis.length() <= radius + 1e-5);
        assert!(from_center.abs().max_element() > 1.0, "outside of the surfaces");
        if axis.length() < 1.0 {
            inner += 1.0;
            flux_sum += f64::from(flux.x) / f64::from(n);
        }
    }
    let share = f64::from(radius).powi(-2);
    let error = (share * (1.0 - share) / f64::from(n)).sqrt();
    assert!((inner / f64::from(n) - share).abs() < 4.0 * error, "{inner}");
    // Flux through a unit disc: irradiance times its area.
    let expected = 5.0 * std::f64::consts::PI;
    assert!((flux_sum / expected - 1.0).abs() < 4.0 * error / share, "{flux_sum}");
    // Connections from in front of, inside and behind the surfaces start before all of them.
    for position in [-5.0f32, 0.0, 5.0].map(|t| center + t * light.direction) {
        let sample = emitter.connect(position, 0.5, &mut rng).unwrap();
        assert_eq!((sample.wi, sample.irradiance), (-light.direction, Rgb::splat(10.0)));
        let from_center = sample.target - center;
        assert!(from_center.abs().max_element() > 1.0 && from_center.dot(light.direction) < 0.0);
        assert!((sample.target - position).dot(sample.wi) > 0.0);
    }
}
