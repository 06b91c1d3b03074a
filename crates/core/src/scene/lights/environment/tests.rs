//! Sampling of environments: densities, radiance and regions.

use super::*;
use crate::base::rng::{Stream, StreamKey};
use crate::scene::lights::{LightSample, Receiver};

/// An environment of very different pixels.
/// Largest corner of the box around the scene; the other is the origin.
const BOX: Vec3 = Vec3::new(2.0, 1.0, 3.0);

fn environment(turn_deg: f32) -> Environment {
    let (width, height) = (12, 7);
    let pixel = |i: u32| {
        let x = (i.wrapping_mul(2_654_435_761) >> 20) as f32 / 4096.0;
        Rgb::new(x, x * x, 0.3) * if i == 40 { 50.0 } else { 1.0 }
    };
    let mut map = Environment::new(width, height, (0..84).map(pixel).collect(), turn_deg);
    map.enclose(&Bounds { min: Vec3::ZERO, max: BOX });
    map
}

/// The environment with a finer inset across its last and first column, as bright as all the rest.
fn with_inset(turn_deg: f32) -> Environment {
    let map = environment(turn_deg);
    let pixel = |i: u32| {
        Rgb::new(1.0, 0.5, 0.2) * if i.is_multiple_of(5) { 0.0 } else { 3.0 + (i % 7) as f32 }
    };
    let grid = InsetGrid { first: [11, 2], replaced: [2, 3], size: [9, 8] };
    let inset = Inset { grid, radiance: (0..72).map(pixel).collect() };
    let pixels = map.pixels().collect();
    let mut map = Environment::with_inset(12, 7, pixels, turn_deg, Some(inset));
    map.enclose(&Bounds { min: Vec3::ZERO, max: BOX });
    map
}

/// Environments with and without an inset, at several turns.
fn environments() -> impl Iterator<Item = Environment> {
    [0.0, 35.0, -400.0].into_iter().flat_map(|turn| [environment(turn), with_inset(turn)])
}

#[test]
fn insets_replace_their_rectangle_and_nothing_else() {
    let (plain, map) = (environment(0.0), with_inset(0.0));
    let mut sum = DVec3::ZERO;
    let n = 1_000;
    for i in 0..n {
        for j in 0..n {
            let [u, v] = [i, j].map(|k| (k as f32 + 0.5) / n as f32);
            let y = 1.0 - 2.0 * v;
            let (sin, cos) = (TAU * (u - 0.5)).sin_cos();
            let across = (1.0 - y * y).sqrt();
            let direction = Vec3::new(across * sin, y, -across * cos);
            let (column, row) = (u * 12.0, y.acos() / PI * 7.0);
            let is_inside = (2.0..5.0).contains(&row) && !(1.0..11.0).contains(&column);
            let radiance = map.radiance(direction);
            if is_inside {
                let [x, y] = [(column + 1.0) % 12.0 / 2.0 * 9.0, (row - 2.0) / 3.0 * 8.0];
                let at_edge = [x, y].iter().any(|x| (x - x.round()).abs() < 1e-4);
                let expected = map.inset().unwrap().1.nth(y as usize * 9 + x as usize);
                assert!(at_edge || expected == Some(radiance), "{x} {y}");
            } else {
                let at_edge = [column, row].iter().any(|x| (x - x.round()).abs() < 1e-4);
                assert!(at_edge || radiance == plain.radiance(direction), "{column} {row}");
            }
            sum += radiance.as_dvec3();
        }
    }
    let integral = sum * (4.0 * std::f64::consts::PI / f64::from(n * n));
    let off = (integral / map.integral.as_dvec3() - 1.0).abs().max_element();
    assert!(off < 2e-3, "{integral} {}", map.integral);
}

#[test]
fn connections_with_a_region_lie_in_it() {
    for map in environments() {
        let mut rng = StreamKey::new(8, Stream::Test, 0).rng(0);
        let mut strayed = 0;
        for number in 0..20_000 {
            let region = number % REGIONS;
            let numbers = Environment::connection_numbers(Some(region), &mut rng);
            let mut sample = [LightSample::default()];
            map.connect_each(
                &[numbers],
                &[1.0],
                &[Receiver { position: Vec3::ONE, normal: None }],
                &mut sample,
            );
            strayed += usize::from(map.region(sample[0].wi) != region);
        }
        // By rounding at their edges
        assert!(strayed < 20, "{}: {strayed}", map.turn);
    }
}

#[test]
fn sampled_directions_have_their_pixels_radiance() {
    for map in environments() {
        let mut rng = StreamKey::new(7, Stream::Test, 0).rng(0);
        let (mut sum, mut square) = (Rgb::ZERO, Rgb::ZERO);
        let n = 100_000;
        let mut strayed = 0;
        for _ in 0..n {
            let sample = map.sample([rng.next_f64(), rng.next_f64()]);
            let EnvironmentSample { direction, irradiance: value, inverse_pdf_w } = sample;
            let radiance = luminance(value) / inverse_pdf_w;
            assert!((direction.length() - 1.0).abs() < 1e-5);
            // In proportion to the luminance, which is therefore always the same.
            let share = luminance(value) / luminance(map.integral);
            assert!((share - 1.0).abs() < 1e-3, "{share}");
            // The color is that of the pixel in this direction, but for rounding at its edges.
            let ratio = map.radiance(direction) / luminance(map.radiance(direction));
            let same =
                (ratio * luminance(value) - value).abs().max_element() < 1e-3 * value.max_element();
            let seen = luminance(map.radiance(direction));
            strayed += u32::from(!same || (radiance / seen - 1.0).abs() > 1e-3);
            sum += value / n as f32;
            square += value * value / n as f32;
        }
        assert!(strayed < 20, "{strayed}");
        let error = ((square - sum * sum) / n as f32).max(Rgb::ZERO).map(f32::sqrt);
        let off = (sum - map.integral).abs();
        assert!(off.cmple(4.0 * error + 1e-3 * map.integral).all(), "{sum} {}", map.integral);
    }
}

#[test]
fn sampled_pixels_and_densities_match_luminance_times_solid_angle() {
    let map = environment(35.0);
    let mut rng = StreamKey::new(9, Stream::Test, 0).rng(0);
    let (n, mut counts) = (200_000, [0.0; 84]);
    let (mut sum, mut square, mut strayed) = (0.0, 0.0, 0);
    for _ in 0..n {
        let sample = map.sample([rng.next_f64(), rng.next_f64()]);
        let EnvironmentSample { direction, inverse_pdf_w, .. } = sample;
        let at = map.locate(direction);
        let pixel = at.first + at.column;
        counts[pixel] += 1.0;
        sum += f64::from(inverse_pdf_w) / f64::from(n);
        square += f64::from(inverse_pdf_w).powi(2) / f64::from(n);
        // At their edges, directions may belong to the next pixel.
        strayed += u32::from((map.sight(direction).pdf_w * inverse_pdf_w - 1.0).abs() > 1e-5);
    }
    assert!(strayed < 20, "{strayed}");
    // All pixels have light: the mean of the reciprocal is the solid angle of the sphere.
    let error = ((square - sum * sum) / f64::from(n)).sqrt();
    assert!((sum - 4.0 * std::f64::consts::PI).abs() < 4.0 * error, "{sum} +- {error}");
    let prob = |pixel: usize| {
        let row = pixel / map.width as usize;
        let flux = luminance(map.pixels[pixel].radiance) * map.solid_angle(row as u32);
        f64::from(flux / luminance(map.integral))
    };
    let expected = (0..84).map(|pixel| prob(pixel) * f64::from(n));
    let chi_square: f64 = expected.zip(counts).map(|(e, count)| (count - e).powi(2) / e).sum();
    // 83 degrees of freedom: mean 83, standard deviation sqrt(2 * 83).
    assert!((chi_square - 83.0).abs() < 4.0 * 166_f64.sqrt(), "{chi_square}");
}

#[test]
fn directions_increase_with_their_random_numbers() {
    let map = environment(0.0);
    let number = |i: u32| f64::from(i) / 1000.0;
    for u in [0.1, 0.6] {
        let heights: Vec<f32> = (0..1000).map(|i| map.sample([u, number(i)]).direction.y).collect();
        assert!(heights.is_sorted_by(|one, next| one >= next));
        let longitude = |i: u32| {
            let direction = map.sample([number(i), u]).direction;
            direction.x.atan2(-direction.z)
        };
        let longitudes: Vec<f32> = (1..1000).map(longitude).collect();
        assert!(longitudes.is_sorted());
    }
}

#[test]
fn maps_without_light_in_most_pixels_are_sampled_where_they_have_light() {
    let mut pixels = vec![Rgb::ZERO; 64 * 32];
    let lit = [(0, 1.0), (64 * 9 + 63, 1e-9), (64 * 9 + 5, 1e20)];
    lit.iter().for_each(|&(pixel, radiance)| pixels[pixel] = Rgb::splat(radiance));
    let map = Environment::new(64, 32, pixels, 0.0);
    let numbers = [0.0, 1e-12, 0.4, 1.0 - 1e-10, 1.0_f64.next_down(), 1.0];
    for u in numbers {
        for v in numbers {
            let EnvironmentSample { direction, irradiance: value, inverse_pdf_w } =
                map.sample([u, v]);
            assert!(direction.is_finite() && value.is_finite());
            assert!(value.x > 0.0 && inverse_pdf_w > 0.0);
        }
    }
    assert_eq!(map.sight(Vec3::NEG_Y).pdf_w, 0.0);
}

#[test]
fn integral_matches_midpoint_rule_over_all_directions() {
    // By midpoints over the sphere, independent of the pixels' solid angles.
    let map = environment(35.0);
    let (n, mut sum) = (1200, glam::DVec3::ZERO);
    for i in 0..n {
        let y = 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
        for j in 0..n {
            let (sin, cos) = (TAU * (j as f32 + 0.5) / n as f32).sin_cos();
            let across = (1.0 - y * y).sqrt();
            let direction = Vec3::new(across * sin, y, across * cos);
            sum += map.radiance(direction).as_dvec3();
        }
    }
    let found = sum * 4.0 * std::f64::consts::PI / f64::from(n * n);
    let off = (found.as_vec3() / map.integral - Rgb::ONE).abs().max_element();
    // The bright pixel is 0.4 high in y: of its edges a midpoint rule misses up to 1/600 each.
    assert!(off < 5e-3, "{off}");
}

#[test]
fn columns_and_rows_have_their_documented_directions() {
    // One bright pixel of 8 by 4 at a time.
    for (index, direction) in [
        (3, Vec3::new(-0.1, 0.99, -0.1)),
        (4 + 8, Vec3::new(0.2, 0.3, -1.0)),
        (6 + 8, Vec3::new(1.0, 0.3, 0.2)),
        (1 + 16, Vec3::new(-1.0, -0.3, 0.2)),
        (24, Vec3::new(-0.1, -0.99, 0.2)),
    ] {
        let mut pixels = vec![Rgb::ZERO; 32];
        pixels[index] = Rgb::ONE;
        let map = Environment::new(8, 4, pixels.clone(), 0.0);
        assert_eq!(map.radiance(direction.normalize()), Rgb::ONE, "{index}");
        // Turned counterclockwise by a quarter, what was ahead (-z) is on the left (-x).
        let turned = Environment::new(8, 4, pixels, 90.0);
        let Vec3 { x, y, z } = direction;
        assert_eq!(turned.radiance(Vec3::new(z, y, -x).normalize()), Rgb::ONE, "{index}");
    }
}

#[test]
fn light_paths_carry_the_power_through_the_sphere() {
    let map = environment(10.0);
    let mut rng = StreamKey::new(8, Stream::Test, 0).rng(0);
    let n = 20_000;
    for _ in 0..n {
        let Emission { origin, direction, flux } = map.emit(0.25, [(); 4].map(|()| rng.next_f64()));
        let share = 0.25 * luminance(flux) / luminance(map.power());
        assert!((share - 1.0).abs() < 1e-3, "{share}");
        let from_center = origin - map.enclosure.center();
        let axis = from_center - from_center.dot(direction) * direction;
        assert!(axis.length() <= map.enclosure.radius() * 1.0001);
        let numbers = Environment::connection_numbers(None, &mut rng);
        let mut samples = [LightSample::default()];
        map.connect_each(
            &[numbers],
            &[0.25],
            &[Receiver { position: Vec3::splat(0.5), normal: None }],
            &mut samples,
        );
        let [sample] = samples;
        // Both start outside of the surfaces.
        for start in [origin, sample.target] {
            let is_inside = start.cmpge(Vec3::ZERO).all() && start.cmple(BOX).all();
            assert!(!is_inside, "{start}");
        }
    }
}

#[test]
fn light_of_a_sun_comes_from_its_own_solid_angle() {
    let even = Environment::new(64, 32, vec![Rgb::ONE; 64 * 32], 0.0);
    assert!((even.effective_solid_angle() / f64::from(4.0 * PI) - 1.0).abs() < 1e-4);
    let mut radiance = vec![Rgb::ZERO; 64 * 32];
    radiance[10 * 64 + 5] = Rgb::splat(7.0);
    let sun = Environment::new(64, 32, radiance, 0.0);
    let own = f64::from(sun.solid_angle(10));
    assert!((sun.effective_solid_angle() / own - 1.0).abs() < 1e-6);
    let black = Environment::new(2, 1, vec![Rgb::ZERO; 2], 0.0);
    assert_eq!(black.effective_solid_angle(), 0.0);
}

#[test]
fn finer_pixels_of_an_inset_count_by_their_own_solid_angle() {
    let map = with_inset(0.0);
    let grid = map.inset.unwrap();
    let [across, down] = [0, 1].map(|i| u64::from(grid.size[i]));
    let first = map.pixels.len() as u64 - across * down;
    let row_of = |index: u64| match index < first {
        true => index / u64::from(map.width),
        false => u64::from(map.height) + (index - first) / across,
    };
    let (mut integral, mut of_squares) = (0.0, 0.0);
    for (pixel, index) in map.pixels.iter().zip(0..) {
        let solid_angle = f64::from(map.solid_angle(row_of(index) as u32));
        let own = f64::from(luminance(pixel.radiance));
        integral += own * solid_angle;
        of_squares += own * own * solid_angle;
    }
    assert!((integral / f64::from(luminance(map.integral())) - 1.0).abs() < 1e-5);
    let expected = integral * integral / of_squares;
    assert!((map.effective_solid_angle() / expected - 1.0).abs() < 1e-9);
}
