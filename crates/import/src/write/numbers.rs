//! Numbers as text that parses to the same bits, and inverses of functions in floating point.

use bdpm_core::base::math::Rgb;
use bdpm_core::scene::Scene;
use bdpm_core::scene::transform::normalized;
use glam::{DVec3, Vec3};

/// Number of neighbors to try on either side.
const NEAR: i64 = 256;

/// The shortest text that parses to the same bits.
pub(super) fn number(x: f32) -> String {
    let text = format!("{x:?}");
    match text.strip_suffix(".0") {
        // TOML has no whole number -0.
        Some(whole) if x != 0.0 || x.is_sign_positive() => whole.to_owned(),
        _ => text,
    }
}

pub(super) fn point(p: Vec3) -> String {
    let [x, y, z] = p.to_array().map(number);
    format!("[{x}, {y}, {z}]")
}

/// A position of a scene, in the coordinates of its file.
pub(super) fn position(p: Vec3, scene: &Scene) -> String {
    if scene.file_origin() == DVec3::ZERO {
        return point(p);
    }
    let [x, y, z] = scene.in_file(p).to_array();
    format!("[{x:?}, {y:?}, {z:?}]")
}

/// One number if all channels are the same.
pub(super) fn color(c: Rgb) -> String {
    if c == Rgb::splat(c.x) { number(c.x) } else { point(c) }
}

/// The number with the shortest text near `guess` that `map` maps to `value`.
pub(super) fn inverse(value: f32, guess: f32, map: impl Fn(f32) -> f32) -> Option<f32> {
    let near = (-NEAR..=NEAR).filter_map(|step| {
        let bits = u32::try_from(i64::from(guess.to_bits()) + step).ok()?;
        Some(f32::from_bits(bits)).filter(|x| x.is_finite())
    });
    let exact = near.filter(|x| map(*x).to_bits() == value.to_bits());
    // The nearest number among those of equal length.
    exact.min_by_key(|x| (number(*x).len(), x.to_bits().abs_diff(guess.to_bits())))
}

/// A vector that normalizes to `unit`, or `unit` if none is found. Unit vectors are rounded, so
/// that normalizing may change them.
pub(super) fn unnormalized(unit: Vec3) -> Vec3 {
    let mut lengths = (0..u16::MAX).map(|i| unit * (1.0 + f32::from(i) / 65_536.0));
    lengths.find(|v| normalized(*v) == unit).unwrap_or(unit)
}

/// Roughness or width of a GGX distribution, as keys of a material.
pub(super) fn roughness(alpha: f32) -> String {
    match inverse(alpha, alpha.sqrt(), |roughness| roughness * roughness) {
        Some(roughness) => format!("roughness = {}\n", number(roughness)),
        None => format!("alpha = {}\n", number(alpha)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_exact() {
        for (x, text) in [(0.1, "0.1"), (2.0, "2"), (-0.0, "-0.0"), (1e-9, "1e-9"), (1e20, "1e20")]
        {
            assert_eq!(number(x), text);
        }
        assert_eq!(color(Rgb::splat(0.5)), "0.5");
        assert_eq!(color(Rgb::new(1.0, 0.5, 0.0)), "[1, 0.5, 0]");
    }

    #[test]
    fn roughness_is_the_exact_root_if_one_exists() {
        for text in ["0", "0.1", "0.3", "0.8", "1"] {
            let roughness: f32 = text.parse().unwrap();
            assert_eq!(super::roughness(roughness * roughness), format!("roughness = {text}\n"));
        }
        let alpha = 0.2_f32.next_up();
        let written = super::roughness(alpha);
        let (key, value) = written.trim().split_once(" = ").unwrap();
        let value: f32 = value.parse().unwrap();
        assert_eq!(if key == "alpha" { value } else { value * value }, alpha);
    }

    #[test]
    fn unit_vectors_are_the_normalization_of_a_vector() {
        for i in 0..10_000_u16 {
            let angle = f32::from(i);
            let unit = normalized(Vec3::new(angle.sin(), (1.7 * angle).cos(), 0.3 * angle.cos()));
            assert_eq!(normalized(unnormalized(unit)), unit);
        }
    }
}
