//! The Beckmann distribution of microfacet normals: slopes are normally distributed.
//!
//! Directions are local: the surface's normal is z. Walter et al. 2007 (distribution, masking),
//! Heitz and d'Eon 2014 (sampling by slopes).

use glam::Vec3;
use std::f32::consts::PI;

/// Microfacets of slope deviation `alpha / sqrt(2)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Beckmann {
    /// Width, above 0 up to 1.
    pub alpha: f32,
}

/// Maximum slope in widths: a share of 3e-9 of all slopes is steeper.
const STEEPEST: f64 = 4.2;

impl Beckmann {
    /// Density of normals `m` over the surface, 1/sr.
    /// theory.md (97), like the next functions.
    pub fn d(&self, m: Vec3) -> f32 {
        if m.z <= 0.0 {
            return 0.0;
        }
        let (alpha2, cos2) = (self.alpha * self.alpha, m.z * m.z);
        let slope2 = (m.x * m.x + m.y * m.y) / cos2;
        (-slope2 / alpha2).exp() / (PI * alpha2 * cos2 * cos2)
    }

    /// Share of the facets that is visible from `w`.
    pub fn g1(&self, w: Vec3) -> f32 {
        let across = (w.x * w.x + w.y * w.y).sqrt();
        // Slope of the direction over the width.
        let a = f64::from(w.z.abs()) / (f64::from(self.alpha) * f64::from(across)).max(1e-30);
        if a > STEEPEST {
            return 1.0;
        }
        let (erf, exp) = erf_and_exp(a);
        let lambda = 0.5 * (erf - 1.0) + 0.5 * exp / (a * PI_ROOT);
        (1.0 / (1.0 + lambda.max(0.0))) as f32
    }

    /// A visible normal as seen from `wo`. On the surface squeezed to width 1, let the viewer have
    /// the slope `a`. Slopes `p` toward the viewer have the density `(a + p) exp(-p^2)`; slopes
    /// across are normally distributed.
    pub fn sample_visible(&self, wo: Vec3, [u, v]: [f32; 2]) -> Vec3 {
        let squeezed = Vec3::new(self.alpha * wo.x, self.alpha * wo.y, wo.z);
        let across = squeezed.x.hypot(squeezed.y);
        let toward =
            if across > 1e-9 { [squeezed.x / across, squeezed.y / across] } else { [1.0, 0.0] };
        let a = (f64::from(squeezed.z) / f64::from(across).max(1e-30)).min(1e6);
        let low = -a.min(STEEPEST);
        let (erf_low, exp_low) = erf_and_exp(low);
        // The distribution of slopes toward the viewer, times a constant, and its density
        let below = |p: f64| {
            let (erf, exp) = erf_and_exp(p);
            let value = 0.5 * PI_ROOT * (erf - erf_low) - 0.5 * (exp - exp_low) / a;
            (value, (1.0 + p / a) * exp)
        };
        // From far above, slopes are normally distributed.
        let start = erf_inverse(erf_low + f64::from(u) * (1.0 - erf_low));
        let along = solve(f64::from(u) * below(STEEPEST).0, [low, STEEPEST], start, below);
        let beside = erf_inverse(f64::from(v) * 2.0 - 1.0);
        let [x, y] = toward;
        let slope = self.alpha
            * Vec3::new(
                along as f32 * x - beside as f32 * y,
                along as f32 * y + beside as f32 * x,
                0.0,
            );
        (slope + Vec3::Z).normalize()
    }
}

/// The root of pi.
const PI_ROOT: f64 = 1.772_453_850_905_516;

/// Solves `function(x) = value` for a rising function, which also returns its slope, by Newton's
/// method within shrinking bounds.
fn solve(
    value: f64,
    [mut low, mut high]: [f64; 2],
    start: f64,
    function: impl Fn(f64) -> (f64, f64),
) -> f64 {
    let mut x = start.clamp(low, high);
    for _ in 0..40 {
        let (own, slope) = function(x);
        let off = own - value;
        if off < 0.0 {
            low = x
        } else {
            high = x
        }
        let step = off / slope;
        let next = x - step;
        // Written so that NaN halves.
        x = if next > low && next < high { next } else { 0.5 * (low + high) };
        if step.abs() < 1e-6 || high - low < 1e-7 {
            break;
        }
    }
    x
}

/// The error function (Abramowitz and Stegun 1964, 7.1.26), within 1.5e-7, and `exp(-x^2)`, which
/// it needs.
fn erf_and_exp(x: f64) -> (f64, f64) {
    let exp = (-x * x).exp();
    let t = 1.0 / (1.0 + 0.327_591_1 * x.abs());
    let series = [1.061_405_429, -1.453_152_027, 1.421_413_741, -0.284_496_736, 0.254_829_592];
    let sum = series.iter().fold(0.0, |sum, factor| (sum + factor) * t);
    ((1.0 - sum * exp).copysign(x), exp)
}

/// `-ln(1 - erf(STEEPEST)^2)`.
const STEEPEST_LOG: f64 = 18.98;

/// The inverse of the error function up to [`STEEPEST`], within 3e-6 of the value (Giles,
/// *Approximating the erfinv Function*, 2012, single precision).
fn erf_inverse(x: f64) -> f64 {
    const CENTER: [f64; 9] = [
        2.81022636e-8,
        3.43273939e-7,
        -3.5233877e-6,
        -4.39150654e-6,
        2.1858087e-4,
        -1.25372503e-3,
        -4.17768164e-3,
        0.246640727,
        1.50140941,
    ];
    const TAIL: [f64; 9] = [
        -2.00214257e-4,
        1.00950558e-4,
        1.34934322e-3,
        -3.67342844e-3,
        5.73950773e-3,
        -7.6224613e-3,
        9.43887047e-3,
        1.00167406,
        2.83297682,
    ];
    // The series ends at slopes that are hardly steeper than the steepest.
    let w = (-((1.0 - x) * (1.0 + x)).max(1e-300).ln()).min(STEEPEST_LOG);
    let (series, at) = if w < 5.0 { (CENTER, w - 2.5) } else { (TAIL, w.sqrt() - 3.0) };
    let ratio = series.iter().fold(0.0, |sum, factor| sum * at + factor);
    (ratio * x).clamp(-STEEPEST, STEEPEST)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Stream, StreamKey};

    #[test]
    fn inverse_error_function_inverts() {
        for i in -4000..=4000 {
            let x = f64::from(i) / 1000.0;
            let (value, _) = erf_and_exp(x);
            let slope = 2.0 / PI_ROOT * (-x * x).exp();
            // Both functions are rounded: by 1.5e-7 of the value, and by 3e-6 of the argument.
            let tolerance = 3e-6 * x.abs().max(0.1) + 4e-7 / slope;
            let off = (erf_inverse(value) - x).abs();
            assert!(off < tolerance, "{x}: {off} {tolerance}");
        }
        let [low, high] = [-1.0, 1.0].map(erf_inverse);
        assert!((high - STEEPEST).abs() < 1e-3 && low == -high, "{high}");
    }

    #[test]
    fn facets_cover_the_surface_and_its_projection() {
        // integral D (m.n) dm = 1 and integral G1 max(0, w.m) D dm = w.n, over slopes, which have
        // the density exp(-s^2/alpha^2)/(pi alpha^2): s = alpha sqrt(-ln(1 - u)).
        for alpha in [0.1_f32, 0.3, 1.0] {
            let facets = Beckmann { alpha };
            for w in [Vec3::Z, Vec3::new(0.8, 0.0, 0.6), Vec3::new(0.0, 0.995, 0.0998)] {
                let w = w.normalize();
                let n = 300;
                let (mut area, mut projected) = (0.0, 0.0);
                for i in 0..n {
                    let u = (i as f32 + 0.5) / n as f32;
                    let tan = alpha * (-(1.0 - u).ln()).sqrt();
                    let slopes = (1.0 - u) * 1.0 / (PI * alpha * alpha);
                    for j in 0..n {
                        let (y, x) = (2.0 * PI * (j as f32 + 0.5) / n as f32).sin_cos();
                        let m = Vec3::new(tan * x, tan * y, 1.0).normalize();
                        let weight = facets.d(m) * m.z.powi(3) / slopes / (n * n) as f32;
                        area += m.z * weight;
                        projected += facets.g1(w) * w.dot(m).max(0.0) * weight;
                    }
                }
                assert!((area - 1.0).abs() < 1e-3, "{alpha}: {area}");
                assert!((projected / w.z - 1.0).abs() < 0.01, "{alpha} {w}: {projected}");
            }
        }
    }

    #[test]
    fn visible_normals_have_their_density() {
        // Means of 1/pdf over the visible part of a cap of normals give its solid angle.
        let mut rng = StreamKey::new(5, Stream::Test, 0).rng(0);
        for (alpha, wo) in [
            (0.05, Vec3::new(0.3, -0.2, 0.8)),
            (0.4, Vec3::new(0.3, -0.2, 0.8)),
            (0.4, Vec3::new(-0.9, 0.3, 0.1)),
            (1.0, Vec3::new(0.9, 0.0, 0.1)),
            (0.3, Vec3::Z),
        ] {
            let (facets, wo) = (Beckmann { alpha }, wo.normalize());
            let cap = 1.0 - 0.3 * (alpha * alpha).min(0.6); // cosine of its edge
            let steps = 400;
            let is_visible = |index: usize| {
                let [u, v] =
                    [index / steps, index % steps].map(|i| (i as f32 + 0.5) / steps as f32);
                let z = 1.0 - u * (1.0 - cap);
                let (sin, cos) = (2.0 * PI * v).sin_cos();
                let across = (1.0 - z * z).sqrt();
                wo.dot(Vec3::new(across * cos, across * sin, z)) > 0.0
            };
            let visible = (0..steps * steps).filter(|&index| is_visible(index)).count();
            let share = visible as f64 / (steps * steps) as f64;
            let expected = std::f64::consts::TAU * f64::from(1.0 - cap) * share;
            let n = 100_000;
            let (mut sum, mut square) = (0.0, 0.0);
            for _ in 0..n {
                let m = facets.sample_visible(wo, rng.next_2d());
                let pdf = facets.g1(wo) * wo.dot(m).max(0.0) * facets.d(m) / wo.z;
                let x = if m.z > cap { 1.0 / f64::from(pdf) } else { 0.0 };
                sum += x / f64::from(n);
                square += x * x / f64::from(n);
            }
            let error = ((square - sum * sum) / f64::from(n)).sqrt();
            assert!((sum - expected).abs() < 4.0 * error, "{alpha}: {sum} +- {error} {expected}");
            assert!(error < 0.05 * expected, "{alpha}: {error}");
        }
    }
}
