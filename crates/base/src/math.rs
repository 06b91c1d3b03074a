//! Frames, sampling warps with their densities, and small vector helpers.

use glam::Vec3;
use std::f32::consts::{FRAC_1_PI, FRAC_PI_2, FRAC_PI_4, LN_2, LOG2_E, PI, TAU};

/// Linear Rec. 709 color: radiance, flux, albedo or throughput per channel.
pub type Rgb = Vec3;

/// Weight of each channel of a linear Rec. 709 color in its luminance.
/// theory.md (4).
pub const LUMINANCE: Rgb = Rgb::new(0.2126, 0.7152, 0.0722);

/// Luminance Y of a linear Rec. 709 color; the scalar of all noise statistics.
#[inline]
pub fn luminance(color: Rgb) -> f32 {
    LUMINANCE.dot(color)
}

/// An axis-aligned box; empty until a point is added.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates.
    pub min: Vec3,
    /// Largest coordinates.
    pub max: Vec3,
}

impl Bounds {
    /// The box that holds nothing.
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// The smallest box that also holds `point`.
    #[must_use]
    #[inline]
    pub fn with(self, point: Vec3) -> Self {
        Self { min: self.min.min(point), max: self.max.max(point) }
    }

    /// Longest side, scene units: the *scene size*; 0 for an empty box.
    #[inline]
    pub fn longest_side(&self) -> f32 {
        (self.max - self.min).max_element().max(0.0)
    }

    /// Midpoint of the box.
    #[inline]
    pub fn center(&self) -> Vec3 {
        0.5 * (self.min + self.max)
    }

    /// Radius of a sphere around the center that holds all of the box, with room for rounding.
    #[inline]
    pub fn enclosing_radius(&self) -> f32 {
        0.5 * (self.max - self.min).length() * (1.0 + 1e-4)
    }
}

/// An orthonormal basis around a normal: directions to and from coordinates with the normal as z.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    tangent: Vec3,
    bitangent: Vec3,
    normal: Vec3,
}

impl Frame {
    /// The frame of a unit normal.
    #[inline]
    pub fn new(normal: Vec3) -> Self {
        let (tangent, bitangent) = orthonormal_pair(normal);
        Self { tangent, bitangent, normal }
    }

    /// The frame of a unit normal with x along `tangent`, of any length; that of [`Self::new`] if
    /// the tangent is along the normal.
    #[inline]
    pub fn with_tangent(normal: Vec3, tangent: Vec3) -> Self {
        match tangent.reject_from_normalized(normal).try_normalize() {
            None => Self::new(normal),
            Some(tangent) => Self { tangent, bitangent: normal.cross(tangent), normal },
        }
    }

    /// Local coordinates of a direction.
    #[inline]
    pub fn to_local(&self, w: Vec3) -> Vec3 {
        Vec3::new(w.dot(self.tangent), w.dot(self.bitangent), w.dot(self.normal))
    }

    /// The direction of local coordinates, of unit length again despite rounding.
    #[inline]
    pub fn to_world(&self, w: Vec3) -> Vec3 {
        (w.x * self.tangent + w.y * self.bitangent + w.z * self.normal).normalize()
    }
}

/// A unit vector in 32 bits, within 1e-4 radians: the sphere folded onto an octahedron, and that
/// onto a square.
#[inline]
pub fn pack_direction(w: Vec3) -> u32 {
    let [x, y] = fold([w.x, w.y].map(|c| c / (w.x.abs() + w.y.abs() + w.z.abs())), w.z);
    let code = |c: f32| u32::from((c * 32767.0).round() as i16 as u16);
    code(x) << 16 | code(y)
}

/// The direction of [`pack_direction`].
#[inline]
pub fn unpack_direction(packed: u32) -> Vec3 {
    let number = |code: u32| f32::from(code as u16 as i16) / 32767.0;
    let [x, y] = [number(packed >> 16), number(packed)];
    let z = 1.0 - x.abs() - y.abs();
    let [x, y] = fold([x, y], z);
    Vec3::new(x, y, z).normalize()
}

/// Swaps the inside and the outside of the square `|x| + |y| = 1` where `z` is negative.
#[inline]
fn fold([x, y]: [f32; 2], z: f32) -> [f32; 2] {
    if z >= 0.0 {
        return [x, y];
    }
    [(1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)]
}

/// Sine and cosine of an angle in full turns, in [0, 1], within 1.1e-7, without a branch or a call.
///
/// Polynomials on the eighth of a turn to each side of the nearest quarter, with the coefficients
/// of the Cephes library (Moshier 1992).
#[inline(always)] // part of vector loops
pub fn sin_cos_turns(turns: f32) -> (f32, f32) {
    // Adding 1.5 * 2^23 rounds to the nearest integer and leaves it in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    let rounded = 4.0 * turns + ROUND;
    let quarter = rounded.to_bits();
    let x = (4.0 * turns - (rounded - ROUND)) * FRAC_PI_2;
    let x2 = x * x;
    let sin = x + x * x2 * (-1.666_665_5e-1 + x2 * (8.332_161e-3 + x2 * -1.951_529_6e-4));
    let cos =
        1.0 - 0.5 * x2 + x2 * x2 * (4.166_664_6e-2 + x2 * (-1.388_731_6e-3 + x2 * 2.443_315_7e-5));
    let (s, c) = if quarter & 1 == 0 { (sin, cos) } else { (cos, sin) };
    // Sines of the quarters 2 and 3 and cosines of 1 and 2 are negative.
    let signs = [quarter & 2, quarter.wrapping_add(1) & 2].map(|bit| bit << 30);
    (f32::from_bits(s.to_bits() ^ signs[0]), f32::from_bits(c.to_bits() ^ signs[1]))
}

/// `exp(-x)` for `x` from 0 on, within 2e-7 of the value, without a branch or a call; 0 within
/// rounding from 87 on.
#[inline(always)] // part of vector loops
pub fn exp_minus(x: f32) -> f32 {
    const ROUND: f32 = 12_582_912.0; // as above
    let y = (x * LOG2_E).min(126.0);
    let rounded = y + ROUND;
    let power = rounded.to_bits().wrapping_sub(ROUND.to_bits());
    // 2^-y = 2^-power 2^rest, with a rest of at most a half
    let rest = ((rounded - ROUND) - y) * LN_2;
    let series = 1.0
        + rest
            * (1.0
                + rest
                    * (0.5
                        + rest
                            * (1.0 / 6.0
                                + rest
                                    * (1.0 / 24.0 + rest * (1.0 / 120.0 + rest * (1.0 / 720.0))))));
    f32::from_bits(127_u32.wrapping_sub(power) << 23) * series
}

/// Uniform direction on the unit sphere; pdf in solid angle `1/(4 pi)`.
/// theory.md (8).
#[inline(always)] // part of vector loops
pub fn uniform_sphere([u, v]: [f32; 2]) -> Vec3 {
    let z = 1.0 - 2.0 * u;
    let r = (1.0 - z * z).max(0.0).sqrt();
    let (sin, cos) = sin_cos_turns(v);
    Vec3::new(r * cos, r * sin, z)
}

/// Two unit vectors that are orthogonal to each other and to a unit normal (Duff et al. 2017);
/// those of `glam`, whose function may remain a call.
#[inline(always)] // part of vector loops
fn orthonormal_pair(n: Vec3) -> (Vec3, Vec3) {
    let sign = 1.0_f32.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (
        Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        Vec3::new(b, sign + n.y * n.y * a, -n.y),
    )
}

/// Direction around the unit normal `n` with pdf in solid angle `cos(theta)/pi`.
/// theory.md (9).
#[inline(always)] // part of vector loops
pub fn cosine_hemisphere(n: Vec3, [u, v]: [f32; 2]) -> Vec3 {
    let (tangent, bitangent) = orthonormal_pair(n);
    let r = u.sqrt();
    let (sin, cos) = sin_cos_turns(v);
    // 1 - u is exact for u in [0, 1) and never 0, so the direction never grazes the surface.
    tangent * (r * cos) + bitangent * (r * sin) + n * (1.0 - u).sqrt()
}

/// Density of [`cosine_hemisphere`] in solid angle, 1/sr; 0 below the surface.
#[inline]
pub fn cosine_hemisphere_pdf_w(cos_theta: f32) -> f32 {
    cos_theta.max(0.0) * FRAC_1_PI
}

/// Point of the unit disc, uniform over its area: concentric circles of squares (Shirley and Chiu
/// 1997).
#[inline]
pub fn uniform_disc(u: [f32; 2]) -> [f32; 2] {
    let [x, y] = u.map(|u| 2.0 * u - 1.0);
    if x == 0.0 && y == 0.0 {
        return [0.0; 2];
    }
    let (r, angle) = if x.abs() > y.abs() {
        (x, FRAC_PI_4 * (y / x))
    } else {
        (y, FRAC_PI_2 - FRAC_PI_4 * (x / y))
    };
    let (sin, cos) = angle.sin_cos();
    [r * cos, r * sin]
}

/// [`uniform_disc`] in double precision, for discs around whole scenes.
#[inline]
pub fn uniform_wide_disc(u: [f64; 2]) -> [f64; 2] {
    let [x, y] = u.map(|u| 2.0 * u - 1.0);
    let (r, ratio) = if x.abs() > y.abs() { (x, y / x) } else { (y, x / y) };
    if r == 0.0 {
        return [0.0; 2];
    }
    let (sin, cos) = (std::f64::consts::FRAC_PI_4 * ratio).sin_cos();
    if x.abs() > y.abs() { [r * cos, r * sin] } else { [r * sin, r * cos] }
}

/// Barycentric weights of the second and third vertex, uniform over a triangle's area.
/// theory.md (10).
#[inline(always)] // part of vector loops
pub fn uniform_triangle([u, v]: [f32; 2]) -> [f32; 2] {
    let s = u.sqrt();
    [s * (1.0 - v), s * v]
}

/// Inverse of [`uniform_sphere`]: the numbers that give a unit direction.
#[inline]
pub fn uniform_sphere_inverse(direction: Vec3) -> [f32; 2] {
    [0.5 * (1.0 - direction.z), turns(direction.x, direction.y)]
}

/// Inverse of [`cosine_hemisphere`]: the numbers that give a unit direction around the unit normal
/// `n`.
#[inline]
pub fn cosine_hemisphere_inverse(n: Vec3, direction: Vec3) -> [f32; 2] {
    let (tangent, bitangent) = n.any_orthonormal_pair();
    let [x, y] = [tangent, bitangent].map(|axis| axis.dot(direction));
    [x * x + y * y, turns(x, y)]
}

/// Inverse of [`uniform_wide_disc`]: the numbers that give a point.
#[inline]
pub fn uniform_disc_inverse([x, y]: [f64; 2]) -> [f64; 2] {
    let radius = x.hypot(y);
    if radius == 0.0 {
        return [0.5; 2];
    }
    let angle = |across: f64, along: f64| (across / along).atan() / std::f64::consts::FRAC_PI_4;
    let [x, y] = if x.abs() > y.abs() {
        let r = radius.copysign(x);
        [r, r * angle(y, x)]
    } else {
        let r = radius.copysign(y);
        [r * angle(x, y), r]
    };
    [0.5 * (x + 1.0), 0.5 * (y + 1.0)]
}

/// Inverse of [`uniform_triangle`]: the numbers that give barycentric weights.
#[inline]
pub fn uniform_triangle_inverse([b, c]: [f32; 2]) -> [f32; 2] {
    let s = b + c;
    [s * s, if s > 0.0 { c / s } else { 0.5 }]
}

/// The angle of the vector `(x, y)`, in turns of [0, 1].
#[inline]
pub fn turns(x: f32, y: f32) -> f32 {
    let turns = y.atan2(x) / TAU;
    if turns < 0.0 { turns + 1.0 } else { turns }
}

/// Area of the disc of the merge kernel, scene units squared.
#[inline]
pub fn disc_area(radius: f32) -> f32 {
    PI * radius * radius
}

/// Volume of a ball.
#[inline]
pub fn ball_volume(radius: f32) -> f32 {
    4.0 / 3.0 * PI * radius.powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::{Stream, StreamKey};

    const N: u64 = 400_000;

    /// Mean of `f` over uniform pairs, with its standard error.
    fn mean(f: impl Fn([f32; 2]) -> f64) -> (f64, f64) {
        let mut rng = StreamKey::new(7, Stream::Test, 0).rng(0);
        let (mut sum, mut square) = (0.0, 0.0);
        for _ in 0..N {
            let x = f(rng.next_2d());
            sum += x;
            square += x * x;
        }
        let n = N as f64;
        (sum / n, ((square / n - (sum / n).powi(2)) / n).sqrt())
    }

    #[track_caller]
    fn assert_close((mean, error): (f64, f64), expected: f64) {
        assert!((mean - expected).abs() < 4.0 * error + 1e-7, "{mean} +- {error}, not {expected}");
    }

    #[test]
    fn sphere_moments() {
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            assert_close(mean(|u| f64::from(uniform_sphere(u).dot(axis))), 0.0);
            assert_close(mean(|u| f64::from(uniform_sphere(u).dot(axis)).powi(2)), 1.0 / 3.0);
        }
    }

    #[test]
    fn inverses_return_the_numbers() {
        let mut rng = StreamKey::new(8, Stream::Test, 0).rng(0);
        for _ in 0..20_000 {
            let u = rng.next_2d();
            let n = uniform_sphere(rng.next_2d());
            let found = [
                uniform_sphere_inverse(uniform_sphere(u)),
                cosine_hemisphere_inverse(n, cosine_hemisphere(n, u)),
                uniform_triangle_inverse(uniform_triangle(u)),
            ];
            for (mapping, found) in found.into_iter().enumerate() {
                // Near their poles and corners, mappings lose the digits of the second number.
                let is_near = u[0] < 1e-3 || u[0] > 1.0 - 1e-3;
                let off = [0, 1].map(|i| (found[i] - u[i]).abs());
                assert!(off[0] < 2e-5 && (off[1] < 2e-4 || is_near), "{mapping}: {u:?} {found:?}");
            }
        }
        assert_eq!(uniform_triangle_inverse([0.0; 2]), [0.0, 0.5]);
    }

    #[test]
    fn wide_discs_are_those_of_single_precision_with_more_digits() {
        let mut rng = StreamKey::new(8, Stream::Test, 1).rng(0);
        for _ in 0..20_000 {
            let u = rng.next_2d();
            let exact = uniform_wide_disc(u.map(f64::from));
            let single = uniform_disc(u).map(f64::from);
            assert!((0..2).all(|i| (exact[i] - single[i]).abs() < 1e-6), "{u:?}");
            let found = uniform_disc_inverse(exact);
            assert!((0..2).all(|i| (found[i] - f64::from(u[i])).abs() < 1e-14), "{u:?} {found:?}");
        }
        assert_eq!(uniform_disc_inverse([0.0; 2]), [0.5; 2]);
        assert_eq!(uniform_wide_disc([0.5; 2]), [0.0; 2]);
    }

    #[test]
    fn cosine_hemisphere_moments_match_its_pdf() {
        for n in [Vec3::X, -Vec3::Z, Vec3::new(0.6, 0.0, -0.8), Vec3::ONE.normalize()] {
            let cos = |u| f64::from(cosine_hemisphere(n, u).dot(n));
            assert_close(mean(cos), 2.0 / 3.0);
            assert_close(mean(|u| cos(u).powi(2)), 0.5);
            let side = n.any_orthonormal_vector();
            assert_close(mean(|u| f64::from(cosine_hemisphere(n, u).dot(side))), 0.0);
            // The mean of 1/pdf over directions is the solid angle where the pdf is positive. Its
            // variance is infinite at the horizon: stop at cos = 0.1, which leaves 2 pi 0.9.
            let inverse = |u| {
                let c = cos(u);
                if c < 0.1 { 0.0 } else { 1.0 / f64::from(cosine_hemisphere_pdf_w(c as f32)) }
            };
            assert_close(mean(inverse), 0.9 * std::f64::consts::TAU);
        }
    }

    #[test]
    fn sines_and_cosines_are_within_their_bound() {
        for i in 0..=1 << 20 {
            let turns = i as f32 / (1 << 20) as f32;
            let (sin, cos) = sin_cos_turns(turns);
            let (s, c) = (std::f64::consts::TAU * f64::from(turns)).sin_cos();
            let error = (f64::from(sin) - s).abs().max((f64::from(cos) - c).abs());
            assert!(error < 1.1e-7, "{turns}: {error:e}");
        }
    }

    #[test]
    fn exponentials_are_within_their_bound() {
        for i in 0..=1_000_000 {
            let x = i as f32 * 8.7e-5;
            let expected = (-f64::from(x)).exp();
            let off = f64::from(exp_minus(x)) / expected - 1.0;
            // The product with the logarithm is rounded, too.
            assert!(off.abs() < 2e-7 + 1e-7 * f64::from(x), "{x}: {off:e}");
        }
        assert!(exp_minus(1e30) < 1e-37);
    }

    #[test]
    fn packed_directions_are_within_their_bound() {
        let mut rng = StreamKey::new(8, Stream::Test, 0).rng(0);
        let axes = [Vec3::X, Vec3::Y, Vec3::Z, Vec3::new(0.6, -0.8, 0.0)];
        let all = (0..100_000).map(|_| uniform_sphere(rng.next_2d()));
        for w in all.chain(axes).chain(axes.map(|w| -w)) {
            let off = (unpack_direction(pack_direction(w)) - w).length();
            assert!(off < 1e-4, "{w}: {off}");
        }
        assert_eq!(unpack_direction(pack_direction(-Vec3::Z)), -Vec3::Z);
    }

    #[test]
    fn triangle_samples_have_uniform_moments() {
        assert_close(mean(|u| f64::from(uniform_triangle(u)[0])), 1.0 / 3.0);
        assert_close(mean(|u| f64::from(uniform_triangle(u)[1])), 1.0 / 3.0);
        let product = mean(|u| f64::from(uniform_triangle(u)[0] * uniform_triangle(u)[1]));
        assert_close(product, 1.0 / 12.0);
    }

    #[test]
    fn orthonormal_pairs_are_those_of_glam() {
        let mut rng = StreamKey::new(9, Stream::Test, 0).rng(0);
        let axes = [Vec3::X, Vec3::Z, -Vec3::Z, Vec3::new(0.6, -0.8, 0.0)];
        for n in (0..1000).map(|_| uniform_sphere(rng.next_2d())).chain(axes) {
            assert_eq!(orthonormal_pair(n), n.any_orthonormal_pair());
        }
    }

    #[test]
    fn extreme_random_numbers_give_unit_vectors() {
        let largest = 1.0 - f32::EPSILON / 2.0;
        for u in [0.0, largest, 0.5] {
            for v in [0.0, largest, 0.5] {
                assert!((uniform_sphere([u, v]).length() - 1.0).abs() < 1e-6);
                let d = cosine_hemisphere(Vec3::Y, [u, v]);
                assert!((d.length() - 1.0).abs() < 1e-6 && d.y > 0.0);
            }
        }
    }
}
