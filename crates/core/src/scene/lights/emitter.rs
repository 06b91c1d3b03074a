//! The kinds of light sources: their power, the light paths that they emit, and connections to
//! them.

use super::cluster::Cluster;
use super::enclosure::Enclosure;
use super::luminaire::{OpeningEmitter, PointLuminaire};
use super::solid_angle::SphericalTriangle;
pub use super::spot::{Falloff, Spot};
use super::triangle_points::TrianglePoint;
use super::{Emission, LightSample, below_one};
use crate::base::math::{
    Bounds, Rgb, cosine_hemisphere, cosine_hemisphere_inverse, luminance, uniform_sphere,
    uniform_sphere_inverse, uniform_triangle, uniform_triangle_inverse,
};
use crate::base::rng::Draw;
use crate::scene::{TexturedTriangle, Triangle};
use glam::Vec3;
use serde::Serialize;
use std::f32::consts::PI;
use std::slice;

/// A light source; a mesh that emits has one per triangle.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub enum Emitter {
    /// An isotropic point.
    Point {
        /// Position, scene units.
        position: Vec3,
        /// Radiant intensity, W/sr.
        intensity: Rgb,
    },
    /// A point that emits into a cone.
    Spot(Spot),
    /// Parallel light from far away, such as the sun's.
    Directional(Directional),
    /// A triangle that emits uniform radiance from its front.
    #[serde(skip)]
    Triangle {
        /// Its geometry.
        shape: Triangle,
        /// Emitted radiance, W/(m^2 sr).
        radiance: Rgb,
    },
    /// A triangle that emits by a texture.
    #[serde(skip)]
    Textured(Box<TexturedTriangle>),
    /// A point with the intensity distribution of a luminaire.
    Luminaire(Box<PointLuminaire>),
    /// The luminous opening of a luminaire.
    #[serde(skip)]
    Opening(Box<OpeningEmitter>),
}

/// Parallel light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Directional {
    /// Unit vector along which the light travels.
    pub direction: Vec3,
    /// Irradiance of surfaces that face the light, W/m^2.
    pub irradiance: Rgb,
    /// The space around the scene; [`Scene::new`](crate::Scene::new) sets it.
    #[serde(skip)]
    pub enclosure: Enclosure,
}

impl Directional {
    /// Light along `direction` (a unit vector), for a scene that is built later.
    pub fn new(direction: Vec3, irradiance: Rgb) -> Self {
        Self { direction, irradiance, enclosure: Enclosure::default() }
    }

    fn emit(&self, prob: f32, across: [f64; 2]) -> Emission {
        Emission {
            origin: self.enclosure.start(-self.direction, across),
            direction: self.direction,
            flux: self.irradiance * (self.enclosure.disc() / prob),
        }
    }

    fn connect(&self, position: Vec3, prob: f32) -> LightSample {
        let toward = -self.direction;
        let target = position + self.enclosure.exit(position, toward) * toward;
        LightSample::of_delta(target, toward, self.irradiance / prob)
    }
}

/// Unit vector from `position` to `target`, and the square of their distance.
#[inline(always)] // part of a vector loop
pub(super) fn toward(target: Vec3, position: Vec3) -> (Vec3, f32) {
    let to_light = target - position;
    let distance2 = to_light.length_squared();
    (to_light * distance2.sqrt().recip(), distance2)
}

impl Triangle {
    /// Barycentric weights of the second and third corner, of the point of the plane next to
    /// `point`.
    pub(super) fn weights(&self, point: Vec3) -> [f32; 2] {
        let from_corner = point - self.origin;
        // The cross product with the normal leaves out what is off the plane.
        let inverse = self.edge1.cross(self.edge2).dot(self.normal).recip();
        [from_corner.cross(self.edge2), self.edge1.cross(from_corner)]
            .map(|area| area.dot(self.normal) * inverse)
    }

    /// Starts a light path from a point that emits `radiance`, a function of its barycentric
    /// weights.
    pub(super) fn emit(
        &self,
        radiance: impl FnOnce([f32; 2]) -> Rgb,
        prob: f32,
        [a, b, c, d]: [f32; 4],
    ) -> Emission {
        let at = uniform_triangle([a, b]);
        Emission {
            origin: self.point(at) + self.normal * self.offset,
            direction: cosine_hemisphere(self.normal, [c, d]),
            flux: radiance(at) * (PI * self.area() / prob),
        }
    }

    /// Inverse of [`Self::emit`]: the numbers that give a light path from `point`, near the
    /// triangle, along `direction`.
    fn emission_numbers(&self, point: Vec3, direction: Vec3) -> [f32; 4] {
        let [a, b] = uniform_triangle_inverse(self.weights(point));
        let [c, d] = cosine_hemisphere_inverse(self.normal, direction);
        [a, b, c, d]
    }

    /// Reciprocal of the density in solid angle with which [`Self::point_to_light`] chooses the
    /// point `origin`, sr; `direction` leads from it to `position`.
    pub(super) fn inverse_pdf_w(&self, origin: Vec3, direction: Vec3, position: Vec3) -> f32 {
        SphericalTriangle::if_near(self, position).map_or_else(
            || direction.dot(self.normal) * self.area() / origin.distance_squared(position),
            |near| near.solid_angle(),
        )
    }
}

impl Emitter {
    /// Radiant power, W; that of parallel light is the part that meets the sphere around the scene.
    pub fn power(&self) -> Rgb {
        match self {
            Self::Point { intensity, .. } => 4.0 * PI * *intensity,
            Self::Spot(spot) => spot.solid_angle() * spot.intensity,
            Self::Directional(light) => light.enclosure.disc() * light.irradiance,
            Self::Triangle { shape, radiance } => PI * shape.area() * *radiance,
            Self::Textured(panel) => PI * panel.shape.area() * panel.mean(),
            Self::Luminaire(lamp) => lamp.aimed.power(),
            Self::Opening(lamp) => lamp.opening.aimed().power(),
        }
    }

    /// The triangles whose fronts emit; none for points and parallel light.
    pub fn triangles(&self) -> &[Triangle] {
        match self {
            Self::Triangle { shape, .. } => slice::from_ref(shape),
            Self::Textured(panel) => slice::from_ref(&panel.shape),
            Self::Opening(lamp) => lamp.triangles(),
            Self::Point { .. } | Self::Spot(_) | Self::Directional(_) | Self::Luminaire(_) => &[],
        }
    }

    /// The emitter of the back of a triangle's front, which this is; others are equal.
    pub(in crate::scene) fn flipped(&self) -> Self {
        match self {
            Self::Triangle { shape, radiance } => {
                Self::Triangle { shape: shape.flipped(), radiance: *radiance }
            }
            Self::Textured(panel) => Self::Textured(Box::new(panel.flipped())),
            Self::Point { .. }
            | Self::Spot(_)
            | Self::Directional(_)
            | Self::Luminaire(_)
            | Self::Opening(_) => self.clone(),
        }
    }

    /// Parallel light; `None` for all that has a position.
    pub fn parallel(&self) -> Option<&Directional> {
        match self {
            Self::Directional(light) => Some(light),
            Self::Point { .. }
            | Self::Spot(_)
            | Self::Triangle { .. }
            | Self::Textured(_)
            | Self::Luminaire(_)
            | Self::Opening(_) => None,
        }
    }

    /// A box around the points from which light starts; `None` for parallel light.
    pub(crate) fn bounds(&self) -> Option<Bounds> {
        Cluster::of(self).map(|cluster| cluster.bounds)
    }

    /// A point from which light starts, off the surface; `None` for parallel light.
    pub fn position(&self) -> Option<Vec3> {
        let center = |shape: &Triangle| {
            shape.origin + (shape.edge1 + shape.edge2) / 3.0 + shape.offset * shape.normal
        };
        match self {
            Self::Point { position, .. } => Some(*position),
            Self::Spot(spot) => Some(spot.position),
            Self::Directional(_) => None,
            Self::Triangle { shape, .. } => Some(center(shape)),
            Self::Textured(panel) => Some(center(&panel.shape)),
            Self::Luminaire(lamp) => Some(lamp.position),
            Self::Opening(lamp) => lamp.triangles().first().map(center),
        }
    }

    /// Mean radiance of the surface in a unit direction, W/(m^2 sr); `None` without a surface.
    pub(super) fn hit_radiance(&self, direction: Vec3) -> Option<Rgb> {
        match self {
            Self::Triangle { radiance, .. } => Some(*radiance),
            Self::Textured(panel) => Some(panel.mean()),
            Self::Opening(lamp) => Some(lamp.opening.radiance(direction)),
            Self::Point { .. } | Self::Spot(_) | Self::Directional(_) | Self::Luminaire(_) => None,
        }
    }

    /// Returns true if no ray can hit the light: only connections and photons then carry its light.
    pub fn is_delta(&self) -> bool {
        match self {
            Self::Point { .. } | Self::Spot(_) | Self::Directional(_) | Self::Luminaire(_) => true,
            Self::Triangle { .. } | Self::Textured(_) | Self::Opening(_) => false,
        }
    }

    /// Starts a light path from four uniform numbers; the light was chosen with probability `prob`.
    /// The first two numbers select a point on the surface, the last two a direction. Lights with
    /// only one of these use the first two.
    pub(super) fn emit(&self, prob: f32, at: [f64; 4]) -> Emission {
        let numbers @ [a, b, ..] = at.map(below_one);
        match self {
            Self::Point { position, intensity } => Emission {
                origin: *position,
                direction: uniform_sphere([a, b]),
                flux: *intensity * (4.0 * PI / prob),
            },
            Self::Triangle { shape, radiance } => shape.emit(|_| *radiance, prob, numbers),
            Self::Spot(spot) => spot.emit(prob, [a, b]),
            Self::Directional(light) => light.emit(prob, [at[0], at[1]]),
            Self::Textured(panel) => panel.emit(prob, numbers),
            Self::Luminaire(lamp) => lamp.emit(prob, [at[0], at[1]]),
            Self::Opening(lamp) => lamp.emit(prob, at),
        }
    }

    /// Inverse of [`Self::emit`]: the numbers that start a light path at `origin` along
    /// `direction`; `None` for those that it does not use.
    pub(super) fn emission_numbers(&self, origin: Vec3, direction: Vec3) -> [Option<f64>; 4] {
        let two = |[a, b]: [f32; 2]| [Some(a.into()), Some(b.into()), None, None];
        let four = |shape: &Triangle| {
            shape.emission_numbers(origin, direction).map(|number| Some(f64::from(number)))
        };
        match self {
            Self::Point { .. } => two(uniform_sphere_inverse(direction)),
            Self::Spot(spot) => two(spot.emission_numbers(direction)),
            Self::Directional(light) => {
                let [a, b] = light.enclosure.numbers(-light.direction, origin);
                [Some(a), Some(b), None, None]
            }
            Self::Triangle { shape, .. } => four(shape),
            Self::Textured(panel) => four(&panel.shape),
            Self::Luminaire(lamp) => lamp.emission_numbers(direction),
            Self::Opening(lamp) => lamp.emission_numbers(origin, direction),
        }
    }

    /// The largest luminance of surfaces that reflect all of it, and of its own surface,
    /// W/(m^2 sr). Two factors stand for what a uniform surface, and one that is not, can have
    /// above its mean. Points are at least the root of `near2` away.
    pub(crate) fn brightest(&self, [uniform, varying]: [f64; 2], near2: f64) -> f64 {
        let of = |radiance: Rgb| f64::from(luminance(radiance));
        let pi = std::f64::consts::PI;
        match self {
            Self::Triangle { radiance, .. } => uniform * of(*radiance),
            Self::Textured(panel) => varying * of(panel.seen_mean()),
            Self::Directional(light) => of(light.irradiance) / pi,
            Self::Point { intensity, .. } => of(*intensity) / (pi * near2),
            Self::Spot(spot) => of(spot.intensity) / (pi * near2),
            Self::Luminaire(_) | Self::Opening(_) => {
                varying * of(self.power()) / (4.0 * pi * pi * near2)
            }
        }
    }

    /// Returns true if the light emits anything.
    pub(in crate::scene) fn has_power(&self) -> bool {
        luminance(self.power()) > 0.0
    }

    /// Reciprocal of the density in solid angle of connections with the point `origin` of a surface
    /// that is certain to be chosen, sr; `direction` leads from it to `position`. `None` if it
    /// cannot be connected.
    pub(super) fn inverse_pdf_w(&self, origin: Vec3, direction: Vec3, at: Vec3) -> Option<f32> {
        let inverse = match self {
            Self::Triangle { shape, .. } => shape.inverse_pdf_w(origin, direction, at),
            Self::Textured(panel) => panel.shape.inverse_pdf_w(origin, direction, at),
            Self::Opening(lamp) => lamp.inverse_pdf_w(origin, direction, at)?,
            Self::Point { .. } | Self::Spot(_) | Self::Directional(_) | Self::Luminaire(_) => {
                return None;
            }
        };
        Some(inverse).filter(|&inverse| inverse > 0.0)
    }

    /// Luminance of the irradiance of a connection of `position` with `origin`, W/m^2, if the light
    /// is certain to be chosen and emits its mean radiance there. `direction` leads from `origin`
    /// to `position`.
    pub(super) fn irradiance(&self, origin: Vec3, direction: Vec3, position: Vec3) -> f32 {
        let distance2 = || origin.distance_squared(position);
        match self {
            Self::Point { intensity, .. } => luminance(*intensity) / distance2(),
            Self::Spot(spot) => {
                let share = spot.share(direction);
                luminance(spot.intensity) * share / distance2()
            }
            Self::Directional(light) => luminance(light.irradiance),
            Self::Triangle { shape, radiance } => {
                luminance(*radiance) * shape.inverse_pdf_w(origin, direction, position)
            }
            Self::Textured(panel) => {
                luminance(panel.mean()) * panel.shape.inverse_pdf_w(origin, direction, position)
            }
            Self::Luminaire(lamp) => luminance(lamp.aimed.intensity(direction)) / distance2(),
            Self::Opening(lamp) => {
                let inverse = lamp.inverse_pdf_w(origin, direction, position);
                luminance(lamp.opening.radiance(direction)) * inverse.unwrap_or(0.0)
            }
        }
    }

    /// The triangle that is all of the light, which [`Self::connect_point`] connects; `None` for
    /// others.
    pub(super) fn lone_triangle(&self) -> Option<&Triangle> {
        match self {
            Self::Triangle { shape, .. } => Some(shape),
            Self::Textured(panel) => Some(&panel.shape),
            Self::Point { .. }
            | Self::Spot(_)
            | Self::Directional(_)
            | Self::Luminaire(_)
            | Self::Opening(_) => None,
        }
    }

    /// Connects a point of [`Self::lone_triangle`]; the light was chosen with probability `prob`.
    pub(super) fn connect_point(&self, point: &TrianglePoint, prob: f32) -> Option<LightSample> {
        match self {
            Self::Triangle { radiance, .. } => point.sample(*radiance, prob),
            Self::Textured(panel) => panel.connect_point(point, prob),
            Self::Point { .. }
            | Self::Spot(_)
            | Self::Directional(_)
            | Self::Luminaire(_)
            | Self::Opening(_) => None,
        }
    }

    /// A point on the light to connect `position` with; the light was chosen with probability
    /// `prob`.
    pub(super) fn connect(
        &self,
        position: Vec3,
        prob: f32,
        rng: &mut impl Draw,
    ) -> Option<LightSample> {
        match self {
            Self::Point { position: target, intensity } => {
                let (wi, distance2) = toward(*target, position);
                let irradiance = *intensity * (distance2 * prob).recip();
                (distance2 > 0.0).then(|| LightSample::of_delta(*target, wi, irradiance))
            }
            Self::Triangle { shape, .. } => {
                self.connect_point(&shape.point_to_light(position, rng.next_2d()), prob)
            }
            Self::Textured(panel) => {
                self.connect_point(&panel.shape.point_to_light(position, rng.next_2d()), prob)
            }
            Self::Spot(spot) => spot.connect(position, prob),
            Self::Directional(light) => Some(light.connect(position, prob)),
            Self::Luminaire(lamp) => lamp.connect(position, prob),
            Self::Opening(lamp) => lamp.connect(position, prob, rng),
        }
    }
}

#[cfg(test)]
mod tests;
