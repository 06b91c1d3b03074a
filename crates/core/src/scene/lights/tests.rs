//! The choice of lights, their densities and power.

use super::*;
use crate::base::math::Bounds;
use crate::base::rng::{Stream, StreamKey};
use crate::scene::Triangle;
use crate::scene::bsdf::Bsdf;
use std::f32::consts::PI;

fn point(x: f32, intensity: Rgb) -> Emitter {
    Emitter::Point { position: Vec3::new(x, 0.0, 0.0), intensity }
}

fn panel() -> Emitter {
    let shape = Triangle::new([Vec3::ZERO, 2.0 * Vec3::X, 3.0 * Vec3::Y], 0);
    Emitter::Triangle { shape, radiance: Rgb::new(0.5, 1.5, 1.0) }
}

#[test]
fn light_paths_carry_the_power_of_all_lights() {
    let red = point(1.0, Rgb::new(2.0, 0.1, 0.0));
    let lights = Lights::new(vec![red, panel(), point(2.0, Rgb::ZERO)]);
    assert_eq!(lights.emitters().len(), 2, "black lights are left out");
    // 4 pi I of the point, pi A Le of the triangle.
    let expected = 4.0 * PI * Rgb::new(2.0, 0.1, 0.0) + PI * 3.0 * Rgb::new(0.5, 1.5, 1.0);
    assert!((lights.power() - expected).length() < 1e-4);
    let mut rng = StreamKey::new(1, Stream::Test, 0).rng(0);
    let n = 200_000;
    let (mut sum, mut square) = (Rgb::ZERO, Rgb::ZERO);
    for _ in 0..n {
        let flux = lights.emit(&mut rng).flux;
        sum += flux / n as f32;
        square += flux * flux / n as f32;
    }
    let error = ((square - sum * sum) / n as f32).max(Rgb::ZERO).map(f32::sqrt);
    assert!((sum - expected).abs().cmple(4.0 * error + 1e-3).all(), "{sum} {expected} {error}");
}

#[test]
fn connections_to_a_triangle_have_its_form_factor() {
    // Irradiance from a small triangle far above: Le A cos cos' / d^2, to 1/d^2 of its size.
    let lights = Lights::new(vec![panel()]);
    let from = Vec3::new(20.0, 5.0, 60.0);
    let to_light = Vec3::new(2.0 / 3.0, 1.0, 0.0) - from;
    let cos_light = 60.0 / to_light.length();
    let expected = Rgb::new(0.5, 1.5, 1.0) * (3.0 * cos_light / to_light.length_squared());
    let mut rng = StreamKey::new(2, Stream::Test, 0).rng(0);
    let n = 20_000;
    let mut sum = Rgb::ZERO;
    for _ in 0..n {
        let sample = lights.connect(Receiver { position: from, normal: None }, &mut rng);
        sum += sample.expect("in front").irradiance / n as f32;
    }
    assert!((sum / expected - Rgb::ONE).abs().max_element() < 2e-3, "{sum} {expected}");
    let behind = Receiver { position: -from, normal: None };
    assert!(lights.connect(behind, &mut rng).is_none(), "dark from behind");
}

/// Number of [`all_kinds`].
const KINDS: usize = 10;

/// Lights of every kind.
fn all_kinds() -> Lights {
    let far = Vec3::new(0.0, 0.0, 5.0);
    let spot = emitter::Spot {
        position: far,
        direction: Vec3::new(0.6, 0.0, -0.8),
        intensity: Rgb::new(9.0, 20.0, 30.0),
        cos_inner: 0.8,
        cos_outer: 0.3,
        falloff: emitter::Falloff::Quadratic,
    };
    let sun = emitter::Directional {
        enclosure: enclosure::Enclosure::new(&Bounds {
            min: Vec3::splat(-4.6),
            max: Vec3::splat(4.6),
        }),
        ..emitter::Directional::new(Vec3::new(0.0, 0.6, -0.8), Rgb::new(1.0, 0.5, 0.2))
    };
    let texels = (0..64).map(|i| [4 * i, 255 - 3 * i, 40 + i, 255]).collect();
    let texture = std::sync::Arc::new(crate::scene::Texture::new(8, 8, texels));
    let corners = [Vec3::new(2.0, 2.0, 4.0), Vec3::new(2.0, 4.0, 4.0), Vec3::new(4.0, 2.0, 4.0)];
    let shape = Triangle::new(corners, 0);
    let uvs = [glam::Vec2::ZERO, glam::Vec2::X, glam::Vec2::Y];
    let black = crate::scene::Material::new("", Bsdf::diffuse(Rgb::ZERO));
    let picture = crate::scene::Material {
        emission: Rgb::splat(3.0),
        emission_texture: Some(texture),
        ..black
    };
    let picture = textured_emitter::TextureEmission::of(&picture, 1).unwrap().emitter(shape, uvs);
    let points = [point(1.0, Rgb::ONE), point(-3.0, Rgb::new(2.0, 0.1, 0.0))];
    let mut emitters = vec![panel(), Emitter::Spot(spot), Emitter::Directional(sun), picture];
    emitters.extend(points);
    let position = Vec3::new(-2.0, 1.0, 4.5);
    let lamp = luminaire::PointLuminaire { position, aimed: luminaire::tests::aimed() };
    emitters.push(Emitter::Luminaire(Box::new(lamp)));
    for (is_flat, center) in [(true, Vec3::new(3.0, 0.0, 4.0)), (false, Vec3::new(0.0, 3.0, 4.0))] {
        let opening = luminaire::tests::opening(is_flat, center);
        emitters.push(Emitter::Opening(Box::new(opening)));
    }
    let mut lights = Lights::new(emitters);
    let pixels = (0..32).map(|i| Rgb::new(0.1 * i as f32, 0.5, 0.2)).collect();
    let mut map = Environment::new(8, 4, pixels, 20.0);
    map.enclose(&crate::base::math::Bounds { min: Vec3::splat(-5.0), max: Vec3::splat(5.0) });
    lights.set_environment(Some(map));
    lights
}

/// Learns from lights that are visible at random from each part of space.
fn learned(mut lights: Lights) -> Lights {
    let mut rng = StreamKey::new(6, Stream::Test, 0).rng(0);
    let slots = lights.visibility_slots();
    let receiver = |_| {
        let position = Vec3::from([(); 3].map(|()| 6.0 * rng.next_1d() - 3.0));
        let normal = crate::base::math::uniform_sphere(rng.next_2d());
        Receiver { position, normal: Some(normal) }
    };
    let receivers: Vec<Receiver> = (0..20_000).map(receiver).collect();
    let mut tests = Vec::new();
    for (&at, &slot) in receivers.iter().zip(slots.iter().cycle()) {
        lights.add_visibility_tests(&[(slot, at)], std::slice::from_mut(&mut rng), &mut tests);
    }
    let tests: Vec<_> = tests
        .into_iter()
        .map(|test| (test, rng.next_1d() < 0.3 + 0.1 * test.at.position.x))
        .collect();
    let visibility = Visibility::learn(&lights, &receivers, &tests);
    lights.set_visibility(Some(Arc::new(visibility)));
    lights
}

/// Lights whose densities of emission depend on a guide, which is taught more starts from one side
/// of the environment, from some lights and in some directions.
fn guided(mut lights: Lights) -> (Lights, Arc<Guide>) {
    let mut rng = StreamKey::new(5, Stream::Test, 0).rng(0);
    let sample = |_| {
        let start = Guide::even().start(primary_sample(&mut rng));
        let place = start.place;
        let square = if place[0] < 0.4 || place[1] * place[2] > 0.7 { 9.0 } else { 0.5 };
        guide::GuideSample { start, square }
    };
    let guide =
        Arc::new(Guide::learn(&(0..50_000).map(sample).collect::<Vec<_>>(), &Guide::even()));
    assert!(guide.cell_count() > 10);
    lights.set_weighted_guide(Some(Arc::clone(&guide)));
    (lights, guide)
}

#[test]
fn ratios_of_connection_and_emission_densities_are_reciprocal() {
    assert_reciprocal_densities(&all_kinds());
}

#[test]
fn ratios_of_densities_with_learned_visibility_are_reciprocal() {
    assert_reciprocal_densities(&learned(all_kinds()));
}

#[test]
fn ratios_of_densities_with_a_guide_are_reciprocal() {
    assert_reciprocal_densities(&guided(all_kinds()).0);
}

#[test]
fn rays_of_guided_light_paths_have_the_density_of_their_numbers() {
    let (lights, guide) = guided(all_kinds());
    let mut rng = StreamKey::new(9, Stream::Test, 0).rng(0);
    let (mut found, mut strayed, mut least, mut most) = ([0; KINDS], 0, f32::MAX, 0.0f32);
    for _ in 0..20_000 {
        let [_, numbers @ ..] = guide.start(primary_sample(&mut rng)).place;
        let index = (rng.next_f64() * KINDS as f64) as usize;
        let emission = lights.emit_chosen(index, 1.0, numbers);
        let density = lights.guide_density(index, [emission.origin, emission.direction]);
        let [from, to] = lights.by_power.interval(index);
        let mut extent = guide::Extent { low: [from; 5], high: [to; 5] };
        let used = match lights.emitters.get(index) {
            Some(emitter) if emitter.is_delta() => 2,
            _ => 4,
        };
        for side in 1..5 {
            let u = numbers[side - 1];
            (extent.low[side], extent.high[side]) = if side <= used { (u, u) } else { (0.0, 1.0) };
        }
        let expected = guide.mean_density(extent) as f32;
        // By rounding at the edges of cells
        strayed += u32::from((density / expected - 1.0).abs() > 1e-5);
        found[index] += 1;
        (least, most) = (least.min(density), most.max(density));
    }
    assert!(found.iter().all(|&found| found > 100), "{found:?}");
    assert!(strayed < 40 && most > 1.5 * least, "{strayed}, {least} to {most}");
}

#[test]
fn learned_visibility_keeps_the_mean_irradiance() {
    let (plain, learned) = (all_kinds(), learned(all_kinds()));
    let mut rng = StreamKey::new(7, Stream::Test, 0).rng(0);
    for x in [-1.5, 0.5, 2.0] {
        let at = Receiver { position: Vec3::new(x, 0.3, 0.2), normal: Some(Vec3::Z) };
        let mut moments = |lights: &Lights| {
            let n = 100_000;
            let (mut sum, mut square) = (0.0, 0.0);
            for _ in 0..n {
                let sample = lights.connect(at, &mut rng);
                let own = sample.map_or(0.0, |s| luminance(s.irradiance) * s.wi.z.max(0.0));
                sum += f64::from(own) / f64::from(n);
                square += f64::from(own).powi(2) / f64::from(n);
            }
            (sum, ((square - sum * sum) / f64::from(n)).sqrt())
        };
        let ((mean, error), (other, other_error)) = (moments(&plain), moments(&learned));
        let off = (mean - other) / error.hypot(other_error);
        assert!(off.abs() < 4.0 && error < 0.02 * mean, "{x}: {mean} {other}, {off}");
    }
}

fn assert_reciprocal_densities(lights: &Lights) {
    let mut rng = StreamKey::new(4, Stream::Test, 0).rng(0);
    let (mut found, mut strayed) = ([0; KINDS], 0);
    for _ in 0..20_000 {
        let mut somewhere = || 6.0 * rng.next_1d() - 3.0;
        let position = Vec3::new(somewhere(), somewhere(), somewhere());
        let normal = crate::base::math::uniform_sphere(rng.next_2d());
        let at = Receiver { position, normal: Some(normal) };
        let choice = lights.by_estimate.choose(at, rng.next_f64());
        let Some((index, prob)) = choice else { continue };
        let Some(sample) = lights.connect_chosen(ChosenLight { index, prob, at }, &mut rng) else {
            continue;
        };
        let cos = sample.wi.dot(normal);
        // Grazing light on and from panels loses digits.
        if cos < 1e-2 || sample.relative < 1e-2 {
            continue;
        }
        let l = luminance(sample.irradiance) * cos / (lights.total_power() * sample.relative);
        let emission = [sample.target, -sample.wi];
        let inverse = lights.connection_over_emission(index, emission, at, normal);
        let off = (l * inverse - 1.0).abs();
        assert!(off < 2e-3, "{index} {position} {normal}: {l} {inverse}");
        found[index] += 1;
        // Rays can hit the other lights.
        let pdf_w = match lights.emitters.get(index) {
            None => lights.environment_sight(sample.wi, at).1,
            Some(emitter) if emitter.is_delta() => {
                assert_eq!(sample.inverse_pdf_w, 0.0);
                continue;
            }
            Some(_) => lights.connection_pdf_w(index, sample.target, at),
        };
        let off = (pdf_w * sample.inverse_pdf_w - 1.0).abs();
        // At their edges, directions may belong to the next pixel of the environment.
        strayed += u32::from(off > 2e-3);
    }
    assert!(found.iter().all(|&found| found > 100), "{found:?}");
    assert!(strayed < 5, "{strayed}");
    // All light paths, but those of textures, start with the flux that the ratio assumes.
    let numbers = |rng: &mut Rng| [(); 4].map(|()| rng.next_f64());
    for _ in 0..5000 {
        let (index, prob) = lights.choose_by_power(rng.next_f64());
        let flux = luminance(lights.emit_chosen(index, prob, numbers(&mut rng)).flux);
        let textured = matches!(lights.emitters.get(index), Some(Emitter::Textured(_)));
        assert!(textured || (flux / lights.total_power() - 1.0).abs() < 2e-3, "{index} {flux}");
    }
}

#[test]
fn guided_light_paths_carry_the_power_of_all_lights() {
    let (lights, guide) = guided(all_kinds());
    let mut rng = StreamKey::new(10, Stream::Test, 0).rng(0);
    let n = 200_000;
    let (mut sum, mut square) = (glam::DVec3::ZERO, glam::DVec3::ZERO);
    let mut toward = [glam::DVec3::ZERO; 2];
    for _ in 0..n {
        let (_, emission) = lights.emit_guided(&guide, primary_sample(&mut rng));
        let flux = emission.flux.as_dvec3();
        sum += flux / f64::from(n);
        square += flux * flux / f64::from(n);
        toward[0] += flux * f64::from(emission.direction.z) / f64::from(n);
        let plain = lights.emit(&mut rng);
        toward[1] += plain.flux.as_dvec3() * f64::from(plain.direction.z) / f64::from(n);
    }
    let error = ((square - sum * sum) / f64::from(n)).map(f64::sqrt);
    let power = lights.power().as_dvec3();
    // A texture's mean is known to a thousandth.
    assert!((sum - power).abs().cmple(4.0 * error + 1e-3 * power).all(), "{sum} {power}");
    let off = (toward[0] - toward[1]).abs();
    assert!(off.cmple(6.0 * error + 1e-3 * power).all(), "{toward:?} {error}");
}

#[test]
fn each_of_many_emitters_is_chosen_with_its_probability() {
    // Powers 1, 2, 3, 1, 2, 3, ...: each third of the choices by residue has 1/6, 2/6, 3/6.
    let count = 300_000;
    let emitter = |i: usize| point(i as f32, Rgb::splat(1.0 + (i % 3) as f32));
    let lights = Lights::new((0..count).map(emitter).collect());
    let mut rng = StreamKey::new(3, Stream::Test, 0).rng(0);
    let mut chosen = [0.0; 3];
    let n = 300_000.0;
    for _ in 0..n as usize {
        let (index, prob) = lights.by_power.choose(rng.next_f64());
        let power = power_weight(&lights.emitters[index]);
        let class = (power / (4.0 * std::f64::consts::PI)).round() as usize - 1;
        chosen[class] += 1.0;
        let share = (class + 1) as f64 / (2.0 * count as f64);
        assert!((f64::from(prob) / share - 1.0).abs() < 1e-5, "{prob} {share}");
    }
    for (class, chosen) in chosen.into_iter().enumerate() {
        let share = (class + 1) as f64 / 6.0;
        let error = (share * (1.0 - share) * n).sqrt();
        assert!((chosen - share * n).abs() < 4.0 * error, "{class}: {chosen}");
    }
}

/// It is the only light that can be chosen, whatever was learned. A lamp beside it shares choices.
#[test]
fn a_sole_environment_is_always_chosen() {
    let of = |emitters| {
        let mut lights = Lights::new(emitters);
        let mut map = Environment::new(8, 4, vec![Rgb::new(0.3, 0.5, 0.2); 32], 20.0);
        map.enclose(&crate::base::math::Bounds { min: Vec3::splat(-5.0), max: Vec3::splat(5.0) });
        lights.set_environment(Some(map));
        lights
    };
    let at = Receiver { position: Vec3::new(0.5, 0.5, 2.0), normal: Some(Vec3::NEG_Z) };
    for lights in [of(vec![]), learned(of(vec![]))] {
        for u in [0.0, 0.3, 0.999] {
            assert_eq!(lights.by_estimate.choose(at, u), Some((0, 1.0)));
        }
        assert_eq!(lights.by_estimate.prob(0, at), 1.0);
    }
    for lights in [of(vec![panel()]), learned(of(vec![panel()]))] {
        let [lamp, sky] = [0, 1].map(|index| lights.by_estimate.prob(index, at));
        assert!(lamp > 0.0 && sky > 0.0 && (lamp + sky - 1.0).abs() < 1e-5, "{lamp} {sky}");
    }
}
