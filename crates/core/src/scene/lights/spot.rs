//! Points that emit into a cone: their falloff, and light paths in proportion to it.

use super::emitter::toward;
use super::{Emission, LightSample};
use crate::base::math::{Rgb, sin_cos_turns, turns};
use glam::Vec3;
use serde::Serialize;
use std::f64::consts::TAU;

/// A point that emits into a cone: its full intensity within the inner angle, none outside the
/// outer angle. Between them it falls off by [`Self::falloff`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spot {
    /// Position, scene units.
    pub position: Vec3,
    /// Unit vector along the axis.
    pub direction: Vec3,
    /// Radiant intensity along the axis, W/sr.
    pub intensity: Rgb,
    /// Cosine of the largest angle from the axis with the full intensity. Single precision has only
    /// some hundred numbers within a narrow cone.
    pub cos_inner: f64,
    /// Cosine of the smallest angle without intensity; less than `cos_inner`.
    pub cos_outer: f64,
    /// Intensity between both angles. Only where it is not the default is it part of the
    /// fingerprint, so that other scenes keep theirs.
    #[serde(skip_serializing_if = "Falloff::is_default")]
    pub falloff: Falloff,
}

/// Intensity of a spot between its inner and its outer angle. `t` is 1 at the inner angle, 0 at the
/// outer one, and linear in the cosine between them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub enum Falloff {
    /// `t^2`, as glTF suggests.
    #[default]
    Quadratic,
    /// `t^2 (3 - 2 t)`, as in pbrt.
    Smoothstep,
    /// Linear in the angle, as in Mitsuba.
    LinearInAngle,
}

impl Falloff {
    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// The angle whose cosine is 1 less `versine`, radians.
fn angle(versine: f64) -> f64 {
    2.0 * (0.5 * versine).max(0.0).sqrt().min(1.0).asin()
}

/// Integral of `(c - a)/(c - b) sin a` over the angle `a` from `b` to `c`: `cos b - (sin c - sin
/// b)/(c - b)`, without its cancellation for narrow cones. theory.md (12)
fn linear_integral(b: f64, c: f64) -> f64 {
    let (middle, half) = (0.5 * (b + c), 0.5 * (c - b));
    // 1 less sin(half)/half
    let sinc = if half < 1e-3 { half * half / 6.0 } else { 1.0 - half.sin() / half };
    let versine = |angle: f64| 2.0 * (0.5 * angle).sin().powi(2);
    versine(middle) - versine(b) + middle.cos() * sinc
}

/// The number in a bracket at which an increasing function, given with its slope, has the value
/// `target`: Newton steps that stay within the bracket.
pub(super) fn inverted(
    target: f64,
    [mut low, mut high]: [f64; 2],
    start: f64,
    function: impl Fn(f64) -> [f64; 2],
) -> f64 {
    let mut at = start;
    for _ in 0..60 {
        let [value, slope] = function(at);
        if value > target {
            high = at;
        } else {
            low = at;
        }
        let next = at - (value - target) / slope;
        let next = if next > low && next < high { next } else { 0.5 * (low + high) };
        if (next - at).abs() <= 1e-14 {
            return next;
        }
        at = next;
    }
    at
}

impl Spot {
    /// Power over the full intensity, sr: the solid angle of the inner cone, and the equivalent one
    /// of the falloff.
    pub fn solid_angle(&self) -> f32 {
        let [full, falloff] = self.solid_angles();
        (full + falloff) as f32
    }

    /// Solid angle of the inner cone, and the equivalent solid angle of the falloff, sr.
    /// theory.md (12).
    fn solid_angles(&self) -> [f64; 2] {
        let [inner, outer] = self.versines();
        let falloff = match self.falloff {
            Falloff::Quadratic => (outer - inner) / 3.0,
            Falloff::Smoothstep => (outer - inner) / 2.0,
            Falloff::LinearInAngle => linear_integral(angle(inner), angle(outer)),
        };
        [TAU * inner, TAU * falloff]
    }

    /// 1 less the cosines of the inner and the outer angle.
    fn versines(&self) -> [f64; 2] {
        [1.0 - self.cos_inner, 1.0 - self.cos_outer]
    }

    /// 1 less the cosine of a direction to the axis, which unit vectors of single precision have
    /// only by their difference.
    fn versine(&self, direction: Vec3) -> f64 {
        0.5 * f64::from((direction - self.direction).length_squared())
    }

    /// Place of a direction in the falloff: 1 at the inner angle, 0 at the outer one, and linear in
    /// the cosine, or in the angle if the falloff is.
    fn place(&self, versine: f64) -> f64 {
        let ends = self.versines();
        let [at, inner, outer] = match self.falloff {
            Falloff::LinearInAngle => [versine, ends[0], ends[1]].map(angle),
            Falloff::Quadratic | Falloff::Smoothstep => [versine, ends[0], ends[1]],
        };
        ((outer - at) / (outer - inner)).clamp(0.0, 1.0)
    }

    /// Inverse of [`Self::place`].
    fn versine_at(&self, place: f64) -> f64 {
        let [inner, outer] = self.versines();
        match self.falloff {
            Falloff::LinearInAngle => {
                let [inner, outer] = [inner, outer].map(angle);
                2.0 * (0.5 * (outer - place * (outer - inner))).sin().powi(2)
            }
            Falloff::Quadratic | Falloff::Smoothstep => outer - place * (outer - inner),
        }
    }

    /// Share of the power of the falloff that is outside of this place.
    fn outside(&self, place: f64) -> f64 {
        match self.falloff {
            Falloff::Quadratic => place.powi(3),
            Falloff::Smoothstep => place.powi(3) * (2.0 - place),
            Falloff::LinearInAngle => {
                let [inner, outer] = self.versines().map(angle);
                let own = outer - place * (outer - inner);
                place * linear_integral(own, outer) / linear_integral(inner, outer)
            }
        }
    }

    /// The place outside of which there is this share of the power of the falloff.
    /// theory.md (13).
    fn place_with(&self, outside: f64) -> f64 {
        let start = outside.cbrt();
        match self.falloff {
            Falloff::Quadratic => start,
            Falloff::Smoothstep => inverted(outside, [0.0, 1.0], start, |t| {
                [t.powi(3) * (2.0 - t), t * t * (6.0 - 4.0 * t)]
            }),
            Falloff::LinearInAngle => {
                let [inner, outer] = self.versines().map(angle);
                let slope = (outer - inner) / linear_integral(inner, outer);
                inverted(outside, [0.0, 1.0], start, |t| {
                    [self.outside(t), slope * t * (outer - t * (outer - inner)).sin()]
                })
            }
        }
    }

    /// Share of the intensity in this direction, a unit vector, in [0, 1].
    /// theory.md (12).
    #[inline]
    pub fn share(&self, direction: Vec3) -> f32 {
        let t = self.place(self.versine(direction));
        let share = match self.falloff {
            Falloff::Quadratic => t * t,
            Falloff::Smoothstep => t * t * (3.0 - 2.0 * t),
            Falloff::LinearInAngle => t,
        };
        share as f32
    }

    /// Starts a light path in proportion to the intensity, from two uniform numbers.
    /// theory.md (13).
    pub(super) fn emit(&self, prob: f32, [choice, around]: [f32; 2]) -> Emission {
        let ([full, falloff], [inner, outer]) = (self.solid_angles(), self.versines());
        // The rest of the number that chose is uniform again.
        let chosen = f64::from(choice) * (full + falloff);
        let versine = if chosen < full {
            chosen / full * inner
        } else {
            let u = ((chosen - full) / falloff).min(1.0);
            self.versine_at(self.place_with(1.0 - u)).clamp(inner, outer)
        };
        let [sine, cosine] = [(versine * (2.0 - versine)).max(0.0).sqrt(), 1.0 - versine];
        let (sin, cos) = sin_cos_turns(around);
        let (tangent, bitangent) = self.direction.any_orthonormal_pair();
        let across = sine as f32 * (cos * tangent + sin * bitangent);
        Emission {
            origin: self.position,
            direction: across + cosine as f32 * self.direction,
            flux: self.intensity * (self.solid_angle() / prob),
        }
    }

    /// Inverse of [`Self::emit`]: the numbers that give this direction.
    pub(super) fn emission_numbers(&self, direction: Vec3) -> [f32; 2] {
        let ([full, falloff], [inner, _]) = (self.solid_angles(), self.versines());
        let versine = self.versine(direction);
        let chosen = if versine <= inner {
            full * versine / inner.max(f64::MIN_POSITIVE)
        } else {
            full + falloff * (1.0 - self.outside(self.place(versine)))
        };
        let (tangent, bitangent) = self.direction.any_orthonormal_pair();
        let around = turns(tangent.dot(direction), bitangent.dot(direction));
        [(chosen / (full + falloff)) as f32, around]
    }

    pub(super) fn connect(&self, position: Vec3, prob: f32) -> Option<LightSample> {
        let (wi, distance2) = toward(self.position, position);
        let share = self.share(-wi);
        let irradiance = self.intensity * (share / (distance2 * prob));
        (share > 0.0).then(|| LightSample::of_delta(self.position, wi, irradiance))
    }
}
