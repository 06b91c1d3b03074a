//! What bounds a set of emitters in place and direction, for the tree that chooses among them (Conty
//! Estevez and Kulla 2018, Section 4).

use super::emitter::Emitter;
use crate::base::math::{Bounds, Rgb, luminance};
use crate::scene::Triangle;
use glam::Vec3;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Where a cluster of emitters is and where it shines.
#[derive(Clone, Copy, Debug)]
pub(in crate::scene) struct Cluster {
    pub(in crate::scene) bounds: Bounds,
    pub(in crate::scene) beam: Beam,
    /// Luminance of the radiant intensity along the axes of its emitters, W/sr.
    pub(in crate::scene) intensity: f32,
    /// Sum of the emitters' axes, each of the length of its intensity: where all emitters face a direction and shine
    /// by its cosine, the intensity there is the product with it. 0 for those that shine alike all around.
    pub(in crate::scene) net: Vec3,
    /// The intensity's mean over all directions.
    pub(in crate::scene) mean: f32,
}

/// The directions into which a cluster shines: its emitters' axes are within `spread` of `axis`, and
/// each shines within `reach` of its own (Section 4.1).
#[derive(Clone, Copy, Debug)]
pub(in crate::scene) struct Beam {
    pub(in crate::scene) axis: Vec3,
    /// Radians, up to pi.
    pub(in crate::scene) spread: f32,
    /// Radians, up to pi/2.
    pub(in crate::scene) reach: f32,
}

impl Beam {
    /// The smallest that holds both, nearly.
    fn with(self, other: Self) -> Self {
        let (wide, narrow) =
            if self.spread >= other.spread { (self, other) } else { (other, self) };
        let reach = wide.reach.max(narrow.reach);
        // Exact also for small angles, which their cosine is not.
        let (difference, sum) = (wide.axis - narrow.axis, wide.axis + narrow.axis);
        let between = 2.0 * difference.length().atan2(sum.length());
        if (between + narrow.spread).min(PI) <= wide.spread {
            return Self { reach, ..wide };
        }
        let spread = 0.5 * (wide.spread + between + narrow.spread);
        if spread >= PI {
            return Self { spread: PI, reach, ..wide };
        }
        // The wide one's axis turns toward the narrow one's.
        let across = narrow.axis - wide.axis.dot(narrow.axis) * wide.axis;
        let across = across.normalize_or(wide.axis.any_orthonormal_vector());
        let (sin, cos) = (spread - wide.spread).sin_cos();
        Self { axis: (cos * wide.axis + sin * across).normalize(), spread, reach }
    }

    /// The measure of the directions that it shines into, weighted with the cosine beyond the spread:
    /// `M_Omega` of Equation 1.
    /// theory.md (19).
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
    /// `None` for light from afar, which has no place.
    pub(in crate::scene) fn of(emitter: &Emitter) -> Option<Self> {
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
                // Annulus the reach of the estimate's heights, anywhere.
                let spread = if spot.cos_outer < 0.0 { PI } else { 0.0 };
                let reach = spot.cos_outer.max(0.0).acos();
                let cone = Beam { axis: spot.direction, spread, reach };
                (at(spot.position), cone, spot.intensity)
            }
            Emitter::Triangle { shape, radiance } => panel(shape, *radiance),
            Emitter::Textured(lamp) => panel(&lamp.shape, lamp.mean()),
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

    pub(in crate::scene) fn with(self, other: Self) -> Self {
        Self {
            bounds: self.bounds.with(other.bounds.min).with(other.bounds.max),
            beam: self.beam.with(other.beam),
            intensity: self.intensity + other.intensity,
            net: self.net + other.net,
            mean: self.mean + other.mean,
        }
    }

    /// What it costs to have it as one cluster (Equation 2), with the square of its
    /// diameter as its size: the area of a box around lamps in a row would be 0.
    /// theory.md (19).
    pub(in crate::scene) fn cost(&self) -> f32 {
        let size = (self.bounds.max - self.bounds.min).length_squared();
        self.intensity * self.beam.measure() * size
    }
}
