//! Areas of discs that straight edges cut.
//!
//! The part of a disc of radius `rho` in a polygon has the area `w pi rho^2` plus [`chord`] of each
//! edge. The center of the disc is the origin, and `w` is the winding number of the polygon around
//! it. Edges that the disc does not meet add nothing. (Each edge adds a triangle with the center
//! where it is in the disc, and a sector where it is outside. The sectors of whole edges add up to
//! `w pi rho^2`.)

use std::f32::consts::{FRAC_PI_2, PI};

/// Contribution of an edge to the area of a disc of squared radius `rho2` on its left.
///
/// The center is `h` to the left of the edge's line, and the edge runs from `s0` to `s1` along it,
/// counted from the foot of the center. With the center on the line, it counts as on its left.
/// Error below 1e-6 `rho2`.
#[inline(always)] // part of vector loops
pub fn chord(h: f32, [s0, s1]: [f32; 2], rho2: f32) -> f32 {
    let half = (rho2 - h * h).max(0.0).sqrt();
    let c0 = s0.max(-half).min(half);
    let c1 = s1.max(-half).min(half);
    let length = c1 - c0;
    let angle = angle(h * h + c0 * c1, h.abs() * length);
    0.5 * (h * length - rho2 * if h >= 0.0 { angle } else { -angle })
}

/// The part of a disc of squared radius `rho2` to the left of a line, the center at `h` to its
/// left.
#[inline(always)] // part of vector loops
pub fn half_plane(h: f32, rho2: f32) -> f32 {
    (if h >= 0.0 { PI } else { 0.0 }) * rho2 + chord(h, [f32::MIN, f32::MAX], rho2)
}

/// Angle in [0, pi] of the vector `(x, y)`, for `y >= 0`, within 4e-7; 0 of the zero vector.
///
/// The polynomial is that of Abramowitz and Stegun, 4.4.49.
#[inline(always)] // part of vector loops
pub fn angle(x: f32, y: f32) -> f32 {
    let (low, high) = (x.abs().min(y), x.abs().max(y));
    let t = low / high.max(f32::MIN_POSITIVE);
    let t2 = t * t;
    let mut p = 0.002_866_225_7;
    p = p * t2 - 0.016_165_737;
    p = p * t2 + 0.042_909_614;
    p = p * t2 - 0.075_289_64;
    p = p * t2 + 0.106_562_64;
    p = p * t2 - 0.142_089;
    p = p * t2 + 0.199_935_51;
    p = p * t2 - 0.333_331_46;
    let mut angle = t + t * t2 * p;
    angle = if y > x.abs() { FRAC_PI_2 - angle } else { angle };
    if x < 0.0 { PI - angle } else { angle }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts;

    #[test]
    fn angles_are_close() {
        for i in 0..=200_000 {
            let turn = consts::PI * f64::from(i) / 200_000.0;
            let (y, x) = turn.sin_cos();
            for scale in [1e-12, 1.0, 1e12] {
                let found = angle((scale * x) as f32, (scale * y.max(0.0)) as f32);
                assert!((f64::from(found) - turn).abs() < 4e-7, "{turn}: {found}");
            }
        }
        assert_eq!(angle(0.0, 0.0), 0.0);
    }

    #[test]
    fn a_line_cuts_a_segment_off() {
        for i in -1200..=1200 {
            let h = f64::from(i) / 1000.0;
            let inner = h.clamp(-1.0, 1.0);
            let expected = consts::PI - inner.acos() + inner * (1.0 - inner * inner).sqrt();
            let found = f64::from(half_plane(h as f32, 1.0));
            assert!((found - expected).abs() < 1e-6, "{h}: {found}, not {expected}");
        }
    }

    #[test]
    fn a_square_around_the_center_and_one_beside_it() {
        let square = |x: f32, y: f32| {
            // Left of its four edges, counterclockwise, of a unit square with the center at (x, y).
            [(y, -x, 1.0 - x), (1.0 - x, -y, 1.0 - y), (1.0 - y, x - 1.0, x), (x, y - 1.0, y)]
        };
        let area = |x: f32, y: f32, rho2: f32| {
            let edges = square(x, y);
            let inside = edges.iter().all(|&(h, ..)| h >= 0.0);
            let start = if inside { PI * rho2 } else { 0.0 };
            edges.iter().fold(start, |sum, &(h, s0, s1)| sum + chord(h, [s0, s1], rho2))
        };
        assert!((area(0.5, 0.5, 0.25) - PI / 4.0).abs() < 1e-6);
        assert!((area(0.5, 0.5, 2.0) - 1.0).abs() < 1e-6);
        assert!((area(0.0, 0.5, 0.04) - PI * 0.02).abs() < 1e-6);
        assert!((area(1e-4, 1e-4, 0.25) - PI / 16.0 - 1e-4).abs() < 1e-6);
        assert!((area(-1e-6, 0.5, 0.04) - PI * 0.02).abs() < 1e-6);
        assert!(area(-2.0, 0.5, 1.0).abs() < 1e-6);
    }
}
