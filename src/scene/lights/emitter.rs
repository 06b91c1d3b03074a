//! The kinds of light sources: their power, the light paths that they emit, and connections to them.

use super::solid_angle::SphericalTriangle;
use super::{Emission, LightSample, below_one};
use crate::base::math::{
    Rgb, cosine_hemisphere, luminance, sin_cos_turns, uniform_disc, uniform_sphere,
    uniform_triangle,
};
use crate::base::rng::Rng;
use crate::scene::{TexturedTriangle, Triangle};
use glam::Vec3;
use std::f32::consts::{PI, TAU};

/// The smallest unit that emits.
#[derive(Clone, Debug, PartialEq)]
pub enum Emitter {
    /// An isotropic point.
    Point {
        /// Where it is.
        position: Vec3,
        /// Radiant intensity, W/sr.
        intensity: Rgb,
    },
    /// A point that emits into a cone.
    Spot(Spot),
    /// Parallel light from far away, such as the sun's.
    Directional(Directional),
    /// A triangle that emits the same radiance from each point of its front to all sides.
    Triangle {
        /// Its geometry.
        shape: Triangle,
        /// Emitted radiance, W/(m^2 sr).
        radiance: Rgb,
    },
    /// A triangle that emits by a picture.
    Textured(Box<TexturedTriangle>),
}

/// A point that emits into a cone: all of its intensity within the inner angle, none beyond the outer
/// one, and in between the square of the cosine's share of the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Where it is.
    pub position: Vec3,
    /// Unit vector along the axis.
    pub direction: Vec3,
    /// Radiant intensity along the axis, W/sr.
    pub intensity: Rgb,
    /// Cosine of the angle from the axis up to which it is the same.
    pub cos_inner: f32,
    /// Cosine of the angle from which on it is 0; less than `cos_inner`.
    pub cos_outer: f32,
}

/// Parallel light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Directional {
    /// Unit vector along which it travels.
    pub direction: Vec3,
    /// Irradiance of surfaces that face it, W/m^2.
    pub irradiance: Rgb,
    /// Center of a sphere around the scene; [`Scene::new`](crate::Scene::new) sets it.
    pub center: Vec3,
    /// Radius of that sphere, scene units.
    pub radius: f32,
}

impl Spot {
    /// Solid angle of the cone that holds as much light at the full intensity, sr: the falloff has a
    /// third of its solid angle.
    pub fn solid_angle(&self) -> f32 {
        let [full, falloff] = self.solid_angles();
        full + falloff
    }

    /// Of the full intensity, and of what the falloff is worth.
    /// theory.md (12).
    fn solid_angles(&self) -> [f32; 2] {
        [TAU * (1.0 - self.cos_inner), TAU / 3.0 * (self.cos_inner - self.cos_outer)]
    }

    /// Share of the intensity in a direction at this cosine to the axis.
    /// theory.md (12).
    #[inline]
    pub fn falloff(&self, cosine: f32) -> f32 {
        let share = (cosine - self.cos_outer) / (self.cos_inner - self.cos_outer);
        share.clamp(0.0, 1.0).powi(2)
    }

    /// Starts a light path in proportion to the intensity, of two uniform numbers.
    /// theory.md (13).
    fn emit(&self, prob: f32, [choice, around]: [f32; 2]) -> Emission {
        let [full, falloff] = self.solid_angles();
        // What is left of the choice is uniform again.
        let place = choice * (full + falloff);
        let cosine = if place < full {
            1.0 - place / full * (1.0 - self.cos_inner)
        } else {
            // The share of the way has the density 3 t^2.
            let u = ((place - full) / falloff).min(1.0);
            self.cos_outer + (1.0 - u).cbrt() * (self.cos_inner - self.cos_outer)
        };
        let sine = (1.0 - cosine * cosine).max(0.0).sqrt();
        let (sin, cos) = sin_cos_turns(around);
        let (tangent, bitangent) = self.direction.any_orthonormal_pair();
        Emission {
            origin: self.position,
            direction: sine * (cos * tangent + sin * bitangent) + cosine * self.direction,
            flux: self.intensity * (self.solid_angle() / prob),
        }
    }

    fn connect(&self, position: Vec3, prob: f32) -> Option<LightSample> {
        let to_light = self.position - position;
        let distance2 = to_light.length_squared();
        let wi = to_light * distance2.sqrt().recip();
        let share = self.falloff(-wi.dot(self.direction));
        (share > 0.0).then(|| LightSample {
            target: self.position,
            wi,
            irradiance: self.intensity * (share / (distance2 * prob)),
            relative: 1.0,
            inverse_pdf_w: 0.0,
        })
    }
}

impl Directional {
    /// Along `direction` (a unit vector), for a scene that is put together later.
    pub fn new(direction: Vec3, irradiance: Rgb) -> Self {
        Self { direction, irradiance, center: Vec3::ZERO, radius: 0.0 }
    }

    /// Area of the disc that all light passes that may meet the scene.
    fn area(&self) -> f32 {
        PI * self.radius * self.radius
    }

    fn emit(&self, prob: f32, across: [f32; 2]) -> Emission {
        let [u, v] = uniform_disc(across);
        let (right, up) = self.direction.any_orthonormal_pair();
        let across = u * right + v * up - self.direction;
        Emission {
            origin: self.center + self.radius * across,
            direction: self.direction,
            flux: self.irradiance * (self.area() / prob),
        }
    }

    fn connect(&self, position: Vec3, prob: f32) -> LightSample {
        // From the disc where its light paths start.
        let along = (position - self.center).dot(self.direction) + self.radius;
        LightSample {
            target: position - along.max(self.radius) * self.direction,
            wi: -self.direction,
            irradiance: self.irradiance / prob,
            relative: 1.0,
            inverse_pdf_w: 0.0,
        }
    }
}

impl Triangle {
    /// Connects `position` with a point that emits `radiance` of its barycentric weights; `None` from
    /// behind.
    pub(in crate::scene) fn connect(
        &self,
        position: Vec3,
        radiance: impl FnOnce([f32; 2]) -> Rgb,
        prob: f32,
        rng: &mut Rng,
    ) -> Option<LightSample> {
        let random = rng.next_2d();
        let near = SphericalTriangle::is_near(self, position)
            .then(|| SphericalTriangle::new(self, position))
            .flatten();
        let at = near.as_ref().map_or_else(|| uniform_triangle(random), |seen| seen.sample(random));
        let target = self.point(at) + self.normal * self.offset;
        let to_light = target - position;
        let distance2 = to_light.length_squared();
        let wi = to_light * distance2.sqrt().recip();
        let cos_light = -wi.dot(self.normal);
        // The reciprocal of the density in solid angle.
        // theory.md (14) where it is near
        let seen =
            near.map_or_else(|| cos_light * self.area() / distance2, |near| near.solid_angle());
        let irradiance = radiance(at) * (seen / prob);
        let inverse_pdf_w = seen / prob;
        (cos_light > 0.0).then_some(LightSample {
            target,
            wi,
            irradiance,
            relative: 1.0,
            inverse_pdf_w,
        })
    }

    /// The reciprocal of the density in solid angle with which [`Self::connect`] chooses a point `origin`, from
    /// which `direction` leads to `position`, sr.
    fn seen(&self, origin: Vec3, direction: Vec3, position: Vec3) -> f32 {
        let near = SphericalTriangle::is_near(self, position)
            .then(|| SphericalTriangle::new(self, position))
            .flatten();
        near.map_or_else(
            || direction.dot(self.normal) * self.area() / origin.distance_squared(position),
            |near| near.solid_angle(),
        )
    }
}

impl Emitter {
    /// Radiant power, W; of parallel light what meets the sphere around the scene.
    pub fn power(&self) -> Rgb {
        match self {
            Self::Point { intensity, .. } => 4.0 * PI * *intensity,
            Self::Spot(spot) => spot.solid_angle() * spot.intensity,
            Self::Directional(light) => light.area() * light.irradiance,
            Self::Triangle { shape, radiance } => PI * shape.area() * *radiance,
            Self::Textured(panel) => PI * panel.shape.area() * panel.mean(),
        }
    }

    /// Whether no ray can hit it: light from it is found by connections and photons only.
    pub fn is_delta(&self) -> bool {
        !matches!(self, Self::Triangle { .. } | Self::Textured(_))
    }

    /// Starts a light path of four uniform numbers, if it was chosen with probability `prob`: the first two are of the
    /// place on a surface, the last two of the direction; a light that has one of these alone takes the first.
    pub(in crate::scene) fn emit(&self, prob: f32, at: [f64; 4]) -> Emission {
        let [a, b, c, d] = at.map(below_one);
        match self {
            Self::Point { position, intensity } => Emission {
                origin: *position,
                direction: uniform_sphere([a, b]),
                flux: *intensity * (4.0 * PI / prob),
            },
            Self::Triangle { shape, radiance } => {
                let point = shape.point(uniform_triangle([a, b]));
                Emission {
                    origin: point + shape.normal * shape.offset,
                    direction: cosine_hemisphere(shape.normal, [c, d]),
                    flux: *radiance * (PI * shape.area() / prob),
                }
            }
            Self::Spot(spot) => spot.emit(prob, [a, b]),
            Self::Directional(light) => light.emit(prob, [a, b]),
            Self::Textured(panel) => panel.emit(prob, [a, b, c, d]),
        }
    }

    /// Whether it emits anything.
    pub(in crate::scene) fn has_power(&self) -> bool {
        luminance(self.power()) > 0.0
    }

    /// Of triangles the reciprocal of the density in solid angle of connections with a point `origin`, from which
    /// `direction` leads to `position`, if it is certain to be chosen, sr.
    pub(in crate::scene) fn seen(
        &self,
        origin: Vec3,
        direction: Vec3,
        position: Vec3,
    ) -> Option<f32> {
        let shape = match self {
            Self::Triangle { shape, .. } => shape,
            Self::Textured(panel) => &panel.shape,
            Self::Point { .. } | Self::Spot(_) | Self::Directional(_) => return None,
        };
        Some(shape.seen(origin, direction, position)).filter(|&seen| seen > 0.0)
    }

    /// Luminance of the irradiance that a connection of `position` with `origin` carries if the emitter is
    /// certain to be chosen and emits its mean radiance there, W/m^2; `direction` leads to `position`.
    pub(in crate::scene) fn irradiance(
        &self,
        origin: Vec3,
        direction: Vec3,
        position: Vec3,
    ) -> f32 {
        let distance2 = || origin.distance_squared(position);
        match self {
            Self::Point { intensity, .. } => luminance(*intensity) / distance2(),
            Self::Spot(spot) => {
                let share = spot.falloff(direction.dot(spot.direction));
                luminance(spot.intensity) * share / distance2()
            }
            Self::Directional(light) => luminance(light.irradiance),
            Self::Triangle { shape, radiance } => {
                luminance(*radiance) * shape.seen(origin, direction, position)
            }
            Self::Textured(panel) => {
                luminance(panel.mean()) * panel.shape.seen(origin, direction, position)
            }
        }
    }

    /// A point on it to connect `position` with, if it was chosen with probability `prob`.
    pub(in crate::scene) fn connect(
        &self,
        position: Vec3,
        prob: f32,
        rng: &mut Rng,
    ) -> Option<LightSample> {
        match self {
            Self::Point { position: target, intensity } => {
                let to_light = *target - position;
                let distance2 = to_light.length_squared();
                (distance2 > 0.0).then(|| LightSample {
                    target: *target,
                    wi: to_light * distance2.sqrt().recip(),
                    irradiance: *intensity * (distance2 * prob).recip(),
                    relative: 1.0,
                    inverse_pdf_w: 0.0,
                })
            }
            Self::Triangle { shape, radiance } => shape.connect(position, |_| *radiance, prob, rng),
            Self::Spot(spot) => spot.connect(position, prob),
            Self::Directional(light) => Some(light.connect(position, prob)),
            Self::Textured(panel) => panel.connect(position, prob, rng),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{Stream, StreamKey};

    fn spot() -> Spot {
        Spot {
            position: Vec3::new(1.0, 2.0, 3.0),
            direction: Vec3::new(2.0, -1.0, 2.0) / 3.0,
            intensity: Rgb::new(3.0, 2.0, 1.0),
            cos_inner: 0.9,
            cos_outer: 0.6,
        }
    }

    #[test]
    fn a_spots_power_is_the_integral_of_its_intensity() {
        // Midpoints over the cosine.
        let n = 100_000;
        let spot = spot();
        let integral: f64 = (0..n)
            .map(|i| f64::from(spot.falloff(2.0 * (i as f32 + 0.5) / n as f32 - 1.0)))
            .sum::<f64>()
            * 2.0
            / f64::from(n)
            * std::f64::consts::TAU;
        assert!((integral / f64::from(spot.solid_angle()) - 1.0).abs() < 1e-4, "{integral}");
        let power = Emitter::Spot(spot).power();
        assert!((power / spot.intensity - spot.solid_angle()).abs().max_element() < 1e-5);
    }

    #[test]
    fn a_spots_light_paths_follow_its_intensity() {
        let spot = spot();
        let emitter = Emitter::Spot(spot);
        let mut rng = StreamKey::new(5, Stream::Test, 0).rng(0);
        const BINS: usize = 16;
        let n = 400_000;
        let mut counts = [0.0; BINS];
        for _ in 0..n {
            let Emission { origin, direction, flux } =
                emitter.emit(0.5, [(); 4].map(|()| rng.next_f64()));
            assert_eq!((origin, flux), (spot.position, emitter.power() / 0.5));
            assert!((direction.length() - 1.0).abs() < 1e-5);
            let place = (direction.dot(spot.direction) - spot.cos_outer) / (1.0 - spot.cos_outer);
            counts[((BINS as f32 * place) as usize).min(BINS - 1)] += 1.0;
        }
        for (bin, count) in counts.into_iter().enumerate() {
            // Midpoints within the bin.
            let cosine = |i: i32| {
                let place = (bin as f32 + (i as f32 + 0.5) / 64.0) / BINS as f32;
                spot.cos_outer + place * (1.0 - spot.cos_outer)
            };
            let mean: f32 = (0..64).map(|i| spot.falloff(cosine(i)) / 64.0).sum();
            let share = TAU * (1.0 - spot.cos_outer) / BINS as f32 * mean / spot.solid_angle();
            let expected = f64::from(share) * f64::from(n);
            let error = expected.max(1.0).sqrt();
            assert!((count - expected).abs() < 4.5 * error, "{bin}: {count} {expected}");
        }
    }

    #[test]
    fn parallel_light_meets_every_point_of_the_sphere_alike() {
        let light = Directional {
            center: Vec3::new(3.0, 0.0, 1.0),
            radius: 2.0,
            ..Directional::new(Vec3::new(0.6, 0.0, -0.8), Rgb::splat(5.0))
        };
        let emitter = Emitter::Directional(light);
        let mut rng = StreamKey::new(6, Stream::Test, 0).rng(0);
        let n = 200_000;
        let (mut inner, mut flux_sum) = (0.0, 0.0);
        for _ in 0..n {
            let Emission { origin, direction, flux } =
                emitter.emit(1.0, [(); 4].map(|()| rng.next_f64()));
            assert_eq!(direction, light.direction);
            let from_center = origin - light.center;
            let axis = from_center - from_center.dot(direction) * direction;
            assert!(axis.length() <= 2.0 + 1e-5);
            assert!((from_center.dot(direction) + 2.0).abs() < 1e-5, "outside of the sphere");
            if axis.length() < 1.0 {
                inner += 1.0;
                flux_sum += f64::from(flux.x) / f64::from(n);
            }
        }
        let error = (0.25 * 0.75 / f64::from(n)).sqrt();
        assert!((inner / f64::from(n) - 0.25).abs() < 4.0 * error, "{inner}");
        // Flux through a unit disc: irradiance times its area.
        let expected = 5.0 * std::f64::consts::PI;
        assert!((flux_sum / expected - 1.0).abs() < 4.0 * error / 0.25, "{flux_sum}");
        // Connections from in front of, inside and behind the sphere start outside of it.
        for position in [-5.0f32, 0.0, 5.0].map(|t| light.center + t * light.direction) {
            let sample = emitter.connect(position, 0.5, &mut rng).unwrap();
            assert_eq!((sample.wi, sample.irradiance), (-light.direction, Rgb::splat(10.0)));
            let ahead = (sample.target - light.center).dot(light.direction);
            assert!(ahead <= -2.0 + 1e-5 && (sample.target - position).dot(sample.wi) > 1.9);
        }
    }
}
