//! Sines and angles in double precision without branches and calls, for vector loops.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// Sum of `coefficients[i] * x^i`.
#[inline(always)] // part of vector loops, as the functions below
fn polynomial<const N: usize>(x: f64, coefficients: [f64; N]) -> f64 {
    let mut sum = 0.0;
    for coefficient in coefficients.into_iter().rev() {
        sum = sum * x + coefficient;
    }
    sum
}

/// Sine and cosine of an angle in [0, 2 pi], within 1e-11: series on the eighth of a turn to each
/// side of the nearest quarter. The sine of a small angle, and the difference of its cosine from 1,
/// keep their relative accuracy.
#[inline(always)]
pub fn sin_cos(angle: f64) -> (f64, f64) {
    // Adding 1.5 * 2^52 rounds to the nearest integer and leaves it in the lowest bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let rounded = angle / FRAC_PI_2 + ROUND;
    let quarter = rounded.to_bits();
    let x = angle - (rounded - ROUND) * FRAC_PI_2;
    let x2 = x * x;
    let sines = [-1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362_880.0, -1.0 / 39_916_800.0];
    let cosines =
        [-0.5, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40_320.0, -1.0 / 3_628_800.0, 1.0 / 479_001_600.0];
    let (sin, cos) = (x + x * x2 * polynomial(x2, sines), 1.0 + x2 * polynomial(x2, cosines));
    let (s, c) = if quarter & 1 == 0 { (sin, cos) } else { (cos, sin) };
    // Sines of the quarters 2 and 3 and cosines of 1 and 2 are negative.
    let signs = [quarter & 2, quarter.wrapping_add(1) & 2].map(|bit| bit << 62);
    (f64::from_bits(s.to_bits() ^ signs[0]), f64::from_bits(c.to_bits() ^ signs[1]))
}

/// Angle in [0, pi] between the first axis and the point `(x, y)`, whose `y` is not negative, with
/// a relative error of at most 3e-11; 0 at the origin.
#[inline(always)]
pub fn upper_angle(y: f64, x: f64) -> f64 {
    /// Of the arc tangent over its argument in powers of the argument's square: least squares on
    /// Chebyshev points up to the tangent of an eighth of pi.
    const ARC: [f64; 7] = [
        0.999_999_999_979_128_4,
        -0.333_333_321_278_887_6,
        0.199_998_858_992_887_05,
        -0.142_816_392_746_657_44,
        0.110_410_543_329_563_94,
        -0.084_591_100_615_751_3,
        0.047_129_990_120_335_97,
    ];
    const TAN_EIGHTH: f64 = 0.414_213_562_373_095_05;
    let (small, large) = (y.min(x.abs()), y.max(x.abs()));
    // Above an eighth of pi, the angle is turned back by a quarter of pi.
    let is_wide = small > TAN_EIGHTH * large;
    let (sine, cosine) = if is_wide { (small - large, small + large) } else { (small, large) };
    let tangent = sine / cosine.max(f64::MIN_POSITIVE);
    let arc = tangent * polynomial(tangent * tangent, ARC);
    let arc = if is_wide { arc + FRAC_PI_4 } else { arc };
    let arc = if y > x.abs() { FRAC_PI_2 - arc } else { arc };
    if x < 0.0 { PI - arc } else { arc }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sines_and_cosines_are_within_their_bound() {
        for i in 0..=1 << 20 {
            let angle = 2.0 * PI * f64::from(i) / f64::from(1 << 20);
            let (sin, cos) = sin_cos(angle);
            let error = (sin - angle.sin()).abs().max((cos - angle.cos()).abs());
            assert!(error < 1e-11, "{angle}: {error:e}");
        }
        for digits in 1..12 {
            let angle = 10f64.powi(-digits);
            let (sin, cos) = sin_cos(angle);
            assert!((sin / angle.sin() - 1.0).abs() < 1e-12, "{angle}");
            let versine = 2.0 * (angle / 2.0).sin().powi(2);
            assert!((1.0 - cos - versine).abs() < 1e-12 * versine + f64::EPSILON, "{angle}");
        }
    }

    #[test]
    fn angles_are_within_their_bound() {
        for i in 0..=1 << 20 {
            let (y, x) = (PI * f64::from(i) / f64::from(1 << 20)).sin_cos();
            let y = y.max(0.0);
            for scale in [1.0, 1e-9, 3e8] {
                let expected = y.atan2(x);
                let off = (upper_angle(scale * y, scale * x) - expected).abs();
                assert!(off <= 3e-11 * expected, "{i}: {off:e}");
            }
        }
        assert_eq!(upper_angle(0.0, 0.0), 0.0);
        assert!((upper_angle(1e-7, 3.0) / (1e-7 / 3.0) - 1.0).abs() < 3e-11);
    }
}
