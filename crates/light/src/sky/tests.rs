//! Skies against Mitsuba and Radiance, by the values that `scripts/sky_reference.py` writes, and
//! their maps.

use super::*;
use bdpm_core::base::math::luminance;
use glam::Vec3;

/// A direction with +z up in the frame of this module.
fn upright(direction: [f64; 3]) -> DVec3 {
    let [x, y, z] = direction;
    DVec3::new(x, z, -y)
}

/// A Fibonacci lattice over the hemisphere.
fn lattice(index: usize, count: usize) -> DVec3 {
    let z = (index as f64 + 0.5) / count as f64;
    let (sin, cos) = (PI * (3.0 - 5_f64.sqrt()) * index as f64).sin_cos();
    let across = (1.0 - z * z).sqrt();
    upright([across * cos, across * sin, z])
}

/// The skies of a table: the words of each head line, and the rows of numbers after it.
fn tables(text: &str) -> Vec<(Vec<&str>, Vec<Vec<f64>>)> {
    let mut found: Vec<(Vec<&str>, Vec<Vec<f64>>)> = Vec::new();
    for line in text.lines() {
        let words: Vec<&str> = line.split('\t').collect();
        match words.iter().map(|word| word.parse()).collect::<std::result::Result<Vec<f64>, _>>() {
            Ok(numbers) => found.last_mut().unwrap().1.push(numbers),
            Err(_) => found.push((words, Vec::new())),
        }
    }
    found
}

fn numbers(words: &[&str]) -> Vec<f64> {
    words.iter().filter_map(|word| word.parse().ok()).collect()
}

#[test]
fn sky_and_sun_match_mitsuba_in_ten_thousand_directions() {
    let skies = tables(include_str!("../../../../tests/data/sky/mitsuba.tsv"));
    assert_eq!(skies.len(), 4);
    for (head, rows) in skies {
        let [turbidity, r, g, b, x, y, z] = numbers(&head)[..] else { panic!("{head:?}") };
        let toward = upright([x, y, z]).normalize();
        let albedo = DVec3::new(r, g, b).as_vec3();
        let model = HosekWilkie::new(turbidity, albedo, toward);
        let radiance = sun_irradiance(turbidity, toward.y.asin()) / cone(SUN_HALF_ANGLE) as f32;
        let sun = SunDisc { toward, half_angle: SUN_HALF_ANGLE, radiance };
        let sky = Sky {
            dome: Some((SkyModel::HosekWilkie(model), Rgb::ONE)),
            sun: Some(sun),
            ground: Rgb::ZERO,
        };
        assert_eq!(rows.len(), 2501);
        for (index, row) in rows.iter().enumerate() {
            let direction = if index < 2500 { lattice(index, 2500) } else { toward };
            let expected = DVec3::from_slice(row).as_vec3();
            let found = sky.radiance(direction);
            // Mitsuba keeps channels below 0. It rounds the solid angle of the sun in single
            // precision.
            let off = (found - expected.max(Rgb::ZERO)).abs();
            let share = if index < 2500 { 1e-3 } else { 5e-3 };
            let bound = share * expected.abs() + 1e-4 * luminance(expected).abs();
            assert!(off.cmple(bound).all(), "{head:?} {index}: {found} {expected}");
        }
    }
}

#[test]
fn skies_by_irradiance_match_radiance() {
    for (head, rows) in tables(include_str!("../../../../tests/data/sky/radiance.tsv")) {
        let (values, toward, solar) = match (head[0], &numbers(&head)[..]) {
            ("perez", &[direct, diffuse, x, y, z, solar]) => ([diffuse, direct], [x, y, z], solar),
            ("cie", &[kind, diffuse, x, y, z, solar]) => ([diffuse, kind], [x, y, z], solar),
            _ => panic!("{head:?}"),
        };
        let toward = upright(toward).normalize();
        let [diffuse, other] = values;
        let model = match head[0] {
            "perez" => {
                // gendaylit takes the first of January where it gets no date.
                let eccentricity = eccentricity(1.0);
                let condition = SkyCondition::new([diffuse, other], toward, eccentricity);
                LuminanceDistribution::perez(condition, diffuse, toward).unwrap()
            }
            _ => LuminanceDistribution::cie(other as u32, diffuse, toward).unwrap(),
        };
        let count = rows.len();
        let pairs = rows.iter().enumerate().map(|(index, row)| {
            (model.radiance(lattice(index, count)), row[0].max(0.0), lattice(index, count).y)
        });
        let pairs: Vec<_> = pairs.collect();
        // Their irradiance is a sum over patches of the sky, and ours the integral.
        let sum = |which: fn(&(f64, f64, f64)) -> f64| -> f64 {
            pairs.iter().map(|pair| which(pair) * pair.2).sum()
        };
        let scale = sum(|pair| pair.0) / sum(|pair| pair.1);
        assert!((scale - 1.0).abs() < 0.03, "{head:?}: {scale}");
        // The overcast sky of type 1 replaces the one of gensky, (1 + 2 sin)/3.
        let tolerance = if head[..2] == ["cie", "1"] { 0.21 } else { 0.01 };
        for (found, expected, height) in &pairs {
            let off = found / (scale * expected) - 1.0;
            assert!(off.abs() < tolerance, "{head:?} {height}: {found} {expected}");
        }
        if head[0] == "perez" {
            let radius = (0.5 * 0.533_f64).to_radians();
            assert!((solar * cone(radius) - other).abs() <= 2e-3 * other, "{solar} {other}");
        }
    }
}

#[test]
fn maps_have_the_irradiance_of_sky_and_sun() {
    // Near the horizon, high, across the first and last column, and around the zenith.
    for (toward, half_angle) in [
        (DVec3::new(1.0, 0.02, 0.3), SUN_HALF_ANGLE),
        (DVec3::new(0.3, 1.0, -0.5), SUN_HALF_ANGLE),
        (DVec3::new(1e-4, 0.5, 1.0), 0.1),
        (DVec3::new(1e-3, 1.0, 0.0), SUN_HALF_ANGLE),
    ] {
        let toward = toward.normalize();
        let model = LuminanceDistribution::cie(12, 50.0, toward).unwrap();
        let sun = SunDisc { toward, half_angle, radiance: Rgb::ONE / cone(half_angle) as f32 };
        let sky = Sky {
            dome: Some((SkyModel::Distribution(model), Rgb::splat(1e-6))),
            sun: Some(sun),
            ground: Rgb::ZERO,
        };
        let map = sky.environment(DMat3::IDENTITY, 0.0).unwrap();
        let with_sun = map.integral();
        let alone =
            Sky { sun: None, ..sky.clone() }.environment(DMat3::IDENTITY, 0.0).unwrap().integral();
        let off = (with_sun - alone) - Rgb::ONE;
        assert!(off.abs().max_element() < 2e-3, "{toward}: {off}");
        let center = map.radiance(toward.as_vec3());
        assert!((center / sun.radiance - Rgb::ONE).abs().max_element() < 1e-3, "{toward}");
        // Just outside of the disc there is no sun.
        let aside = toward.any_orthonormal_vector() * (1.1 * half_angle).tan();
        let outside = map.radiance((toward + aside).normalize().as_vec3());
        assert!(luminance(outside) < 1e-3, "{toward}: {outside}");
    }
}

#[test]
fn pixels_of_the_map_match_the_model() {
    let toward = DVec3::new(0.5, 0.7, -0.4).normalize();
    let model = HosekWilkie::new(3.0, Rgb::splat(0.3), toward);
    let sky =
        Sky { dome: Some((SkyModel::HosekWilkie(model), Rgb::ONE)), sun: None, ground: Rgb::ZERO };
    let mirror = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
    for to_sky in [DMat3::IDENTITY, mirror] {
        let map = sky.environment(to_sky, 0.0).unwrap();
        let count = 10_000;
        let off = |index: usize| {
            let direction = lattice(index, count);
            let ratio = map.radiance(direction.as_vec3()) / sky.radiance(to_sky * direction);
            (ratio - Vec3::ONE).abs().max_element()
        };
        let beyond: Vec<f64> =
            (0..count).filter(|i| off(*i) > 0.01).map(|i| lattice(i, count).y).collect();
        assert!(beyond.len() < count / 80, "{} {beyond:?}", beyond.len());
        assert!(beyond.iter().all(|height| *height < 0.025), "{beyond:?}");
    }
}

/// The traditional overcast sky: a third of the zenith's luminance at the horizon, and 7/9 pi of it
/// on the horizontal (Moon and Spencer 1942).
#[test]
fn traditional_overcast_sky_has_its_gradation() {
    let own = LuminanceDistribution::cie(16, 10.0, DVec3::Y).unwrap();
    let at = |y: f64| own.radiance(DVec3::new((1.0 - y * y).sqrt(), y, 0.0));
    assert!((at(1.0) / (10.0 * 9.0 / (7.0 * PI)) - 1.0).abs() < 1e-4, "{}", at(1.0));
    for y in [0.0, 0.2, 0.5, 0.9] {
        assert!((at(y) / at(1.0) - (1.0 + 2.0 * y) / 3.0).abs() < 1e-12, "{y}");
    }
    assert!(LuminanceDistribution::is_sunless(16) && !LuminanceDistribution::is_sunless(17));
    assert!(LuminanceDistribution::cie(17, 10.0, DVec3::Y).is_err());
}
