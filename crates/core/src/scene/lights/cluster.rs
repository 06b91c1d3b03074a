//! Bounds of a set of emitters in position and direction, for the light tree (Conty Estevez and
//! Kulla 2018, Section 4).

use super::emitter::Emitter;
use crate::base::math::{Bounds, Rgb, luminance};
use crate::scene::Triangle;
use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Bounds of a cluster of emitters, and its intensity.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cluster {
    pub(super) bounds: Bounds,
    pub(super) beam: Beam,
    /// Luminance of the radiant intensity along the axes of its emitters, W/sr.
    pub(super) intensity: f32,
    /// Sum of the emitters' axes, each as long as its intensity. If all emitters face a direction
    /// and shine by its cosine, the intensity there is the dot product with the sum. Isotropic
    /// emitters contribute 0.
    pub(super) net: Vec3,
    /// Mean intensity over all directions, W/sr.
    pub(super) mean: f32,
}

/// The directions into which a cluster shines: its emitters' axes are within `spread` of `axis`,
/// and each emitter shines within `reach` of its own axis (Section 4.1).
#[derive(Clone, Copy, Debug)]
pub(super) struct Beam {
    pub(super) axis: Vec3,
    /// Radians, up to pi.
    pub(super) spread: f32,
    /// Radians, up to pi/2.
    pub(super) reach: f32,
}

impl Beam {
    /// Nearly the smallest beam that contains both.
    fn with(self, other: Self) -> Self {
        let (wide, narrow) =
            if self.spread >= other.spread { (self, other) } else { (other, self) };
        let reach = wide.reach.max(narrow.reach);
        // Exact also for small angles, unlike the arc cosine.
        let (difference, sum) = (wide.axis - narrow.axis, wide.axis + narrow.axis);
        let between = 2.0 * difference.length().atan2(sum.length());
        if (between + narrow.spread).min(PI) <= wide.spread {
            return Self { reach, ..wide };
        }
        let spread = 0.5 * (wide.spread + between + narrow.spread);
        if spread >= PI {
            return Self { spread: PI, reach, ..wide };
        }
        // The axis of the wide beam turns toward that of the narrow one.
        let across = narrow.axis - wide.axis.dot(narrow.axis) * wide.axis;
        let across = across.normalize_or(wide.axis.any_orthonormal_vector());
        let (sin, cos) = (spread - wide.spread).sin_cos();
        Self { axis: (cos * wide.axis + sin * across).normalize(), spread, reach }
    }

    /// Measure of the directions of the beam, weighted with the cosine outside the spread:
    /// `M_Omega` of Equation 1. theory.md (19).
    fn measure(&self) -> f32 {
        let Self { spread, reach, .. } = *self;
        let outer = (spread + reach).min(PI);
        let (sin, cos) = spread.sin_cos();
        TAU * (1.0 - cos)
            + FRAC_PI_2
                * (2.0 * outer * sin - (spread - 2.0 * outer).cos() - 2.0 * spread * sin + cos)
    }
}

impl Cluster {
    /// `None` for parallel light, which has no position.
    pub(super) fn of(emitter: &Emitter) -> Option<Self> {
        let at = |position| Bounds::EMPTY.with(position);
        let panel = |shape: &Triangle, radiance: Rgb| {
            let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|uv| shape.point(uv));
            let front = Beam { axis: shape.normal, spread: 0.0, reach: FRAC_PI_2 };
            let bounds = corners.into_iter().fold(Bounds::EMPTY, Bounds::with);
            (bounds, front, shape.area() * radiance)
        };
        let (bounds, beam, intensity) = match emitter {
            Emitter::Point { position, intensity } => {
                let all = Beam { axis: Vec3::Z, spread: PI, reach: FRAC_PI_2 };
                (at(*position), all, *intensity)
            }
            Emitter::Spot(spot) => {
                // Spots wider than the reach of the estimate may shine anywhere.
                let spread = if spot.cos_outer < 0.0 { PI } else { 0.0 };
                let reach = spot.cos_outer.max(0.0).acos() as f32;
                let cone = Beam { axis: spot.direction, spread, reach };
                (at(spot.position), cone, spot.intensity)
            }
            Emitter::Triangle { shape, radiance } => panel(shape, *radiance),
            Emitter::Textured(lamp) => panel(&lamp.shape, lamp.mean()),
            Emitter::Luminaire(lamp) => {
                let (beam, intensity) = lamp.aimed.beam();
                (at(lamp.position), beam, intensity)
            }
            Emitter::Opening(lamp) => {
                let (beam, intensity) = lamp.opening.aimed().beam();
                let corners = lamp.triangles().iter().flat_map(|triangle| {
                    [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|uv| triangle.point(uv))
                });
                (corners.fold(Bounds::EMPTY, Bounds::with), beam, intensity)
            }
            Emitter::Directional(_) => return None,
        };
        let intensity = luminance(intensity);
        let all_around = beam.spread >= PI;
        // A fourth is the mean of a cosine over the sphere, where it is positive.
        let (net, mean) = if all_around {
            (Vec3::ZERO, intensity)
        } else {
            (intensity * beam.axis, 0.25 * intensity)
        };
        Some(Self { bounds, beam, intensity, net, mean })
    }

    pub(super) fn with(self, other: Self) -> Self {
        Self {
            bounds: self.bounds.with(other.bounds.min).with(other.bounds.max),
            beam: self.beam.with(other.beam),
            intensity: self.intensity + other.intensity,
            net: self.net + other.net,
            mean: self.mean + other.mean,
        }
    }

    /// Cost of the cluster (Equation 2), with the square of its diameter as its size: the area of a
    /// box around lamps in a row would be 0. theory.md (19).
    pub(super) fn cost(&self) -> f32 {
        let size = (self.bounds.max - self.bounds.min).length_squared();
        self.intensity * self.beam.measure() * size
    }
}
