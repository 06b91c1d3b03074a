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

/// A light source; a mesh that emits has one per triangle.
#[derive(Clone, Debug, PartialEq)]
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
    Triangle {
        /// Its geometry.
        shape: Triangle,
        /// Emitted radiance, W/(m^2 sr).
        radiance: Rgb,
    },
    /// A triangle that emits by a texture.
    Textured(Box<TexturedTriangle>),
}

/// A point that emits into a cone: its full intensity within the inner angle, none outside the outer angle.
/// Between them it falls off with the square of a linear function of the cosine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// Position, scene units.
    pub position: Vec3,
    /// Unit vector along the axis.
    pub direction: Vec3,
    /// Radiant intensity along the axis, W/sr.
    pub intensity: Rgb,
    /// Cosine of the largest angle from the axis with the full intensity.
    pub cos_inner: f32,
    /// Cosine of the smallest angle without intensity; less than `cos_inner`.
    pub cos_outer: f32,
}

/// Parallel light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Directional {
    /// Unit vector along which the light travels.
    pub direction: Vec3,
    /// Irradiance of surfaces that face the light, W/m^2.
    pub irradiance: Rgb,
    /// Center of a sphere around the scene; [`Scene::new`](crate::Scene::new) sets it.
    pub center: Vec3,
    /// Radius of that sphere, scene units.
    pub radius: f32,
}

impl Spot {
    /// Power over the full intensity, sr: the solid angle of the inner cone, and a third of that of the
    /// falloff.
    pub fn solid_angle(&self) -> f32 {
        let [full, falloff] = self.solid_angles();
        full + falloff
    }

    /// Solid angle of the inner cone, and the equivalent solid angle of the falloff, sr.
    /// theory.md (12).
    fn solid_angles(&self) -> [f32; 2] {
        [TAU * (1.0 - self.cos_inner), TAU / 3.0 * (self.cos_inner - self.cos_outer)]
    }

    /// Share of the intensity in a direction at this cosine to the axis, in [0, 1].
    /// theory.md (12).
    #[inline]
    pub fn falloff(&self, cosine: f32) -> f32 {
        let share = (cosine - self.cos_outer) / (self.cos_inner - self.cos_outer);
        share.clamp(0.0, 1.0).powi(2)
    }

    /// Starts a light path in proportion to the intensity, from two uniform numbers.
    /// theory.md (13).
    fn emit(&self, prob: f32, [choice, around]: [f32; 2]) -> Emission {
        let [full, falloff] = self.solid_angles();
        // The rest of the number that chose is uniform again.
        let chosen = choice * (full + falloff);
        let cosine = if chosen < full {
            1.0 - chosen / full * (1.0 - self.cos_inner)
        } else {
            // The linear function t of the cosine has the density 3 t^2.
            let u = ((chosen - full) / falloff).min(1.0);
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
        let (wi, distance2) = toward(self.position, position);
        let share = self.falloff(-wi.dot(self.direction));
        let irradiance = self.intensity * (share / (distance2 * prob));
        (share > 0.0).then(|| LightSample::of_delta(self.position, wi, irradiance))
    }
}

impl Directional {
    /// Light along `direction` (a unit vector), for a scene that is built later.
    pub fn new(direction: Vec3, irradiance: Rgb) -> Self {
        Self { direction, irradiance, center: Vec3::ZERO, radius: 0.0 }
    }

    /// Area of the disc that contains all light that can meet the scene, scene units squared.
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
        // The target is on the disc where its light paths start.
        let along = (position - self.center).dot(self.direction) + self.radius;
        let target = position - along.max(self.radius) * self.direction;
        LightSample::of_delta(target, -self.direction, self.irradiance / prob)
    }
}

/// Unit vector from `position` to `target`, and the square of their distance.
fn toward(target: Vec3, position: Vec3) -> (Vec3, f32) {
    let to_light = target - position;
    let distance2 = to_light.length_squared();
    (to_light * distance2.sqrt().recip(), distance2)
}

impl Triangle {
    /// Starts a light path from a point that emits `radiance`, a function of its barycentric weights.
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

    /// Connects `position` with a point that emits `radiance`, a function of its barycentric weights; `None` from
    /// behind.
    pub(super) fn connect(
        &self,
        position: Vec3,
        radiance: impl FnOnce([f32; 2]) -> Rgb,
        prob: f32,
        rng: &mut Rng,
    ) -> Option<LightSample> {
        let random = rng.next_2d();
        let near = SphericalTriangle::if_near(self, position);
        let at = near.as_ref().map_or_else(|| uniform_triangle(random), |near| near.sample(random));
        let target = self.point(at) + self.normal * self.offset;
        let (wi, distance2) = toward(target, position);
        let cos_light = -wi.dot(self.normal);
        // The reciprocal of the density in solid angle.
        // theory.md (14) where it is near
        let inverse_pdf_w = near
            .map_or_else(|| cos_light * self.area() / distance2, |near| near.solid_angle())
            / prob;
        let irradiance = radiance(at) * inverse_pdf_w;
        let sample = LightSample { target, wi, irradiance, relative: 1.0, inverse_pdf_w };
        (cos_light > 0.0).then_some(sample)
    }

    /// Reciprocal of the density in solid angle with which [`Self::connect`] chooses the point `origin`, sr;
    /// `direction` leads from it to `position`.
    fn inverse_pdf_w(&self, origin: Vec3, direction: Vec3, position: Vec3) -> f32 {
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
            Self::Directional(light) => light.area() * light.irradiance,
            Self::Triangle { shape, radiance } => PI * shape.area() * *radiance,
            Self::Textured(panel) => PI * panel.shape.area() * panel.mean(),
        }
    }

    /// The triangle that emits; `None` for point and parallel lights.
    fn shape(&self) -> Option<&Triangle> {
        match self {
            Self::Triangle { shape, .. } => Some(shape),
            Self::Textured(panel) => Some(&panel.shape),
            Self::Point { .. } | Self::Spot(_) | Self::Directional(_) => None,
        }
    }

    /// Mean radiance of the surface, W/(m^2 sr); `None` without a surface.
    pub(super) fn mean_radiance(&self) -> Option<Rgb> {
        match self {
            Self::Triangle { radiance, .. } => Some(*radiance),
            Self::Textured(panel) => Some(panel.mean()),
            Self::Point { .. } | Self::Spot(_) | Self::Directional(_) => None,
        }
    }

    /// Returns true if no ray can hit the light: only connections and photons then carry its light.
    pub fn is_delta(&self) -> bool {
        self.shape().is_none()
    }

    /// Starts a light path from four uniform numbers; the light was chosen with probability `prob`. The first two
    /// numbers select a point on the surface, the last two a direction. Lights with only one of these use the first two.
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
            Self::Directional(light) => light.emit(prob, [a, b]),
            Self::Textured(panel) => panel.emit(prob, numbers),
        }
    }

    /// Returns true if the light emits anything.
    pub(in crate::scene) fn has_power(&self) -> bool {
        luminance(self.power()) > 0.0
    }

    /// Reciprocal of the density in solid angle of connections with the point `origin` of a triangle that is certain
    /// to be chosen, sr; `direction` leads from it to `position`. `None` if it cannot be connected.
    pub(super) fn inverse_pdf_w(&self, origin: Vec3, direction: Vec3, at: Vec3) -> Option<f32> {
        let inverse = self.shape()?.inverse_pdf_w(origin, direction, at);
        Some(inverse).filter(|&inverse| inverse > 0.0)
    }

    /// Luminance of the irradiance of a connection of `position` with `origin`, W/m^2, if the light is certain to be
    /// chosen and emits its mean radiance there. `direction` leads from `origin` to `position`.
    pub(super) fn irradiance(&self, origin: Vec3, direction: Vec3, position: Vec3) -> f32 {
        let distance2 = || origin.distance_squared(position);
        match self {
            Self::Point { intensity, .. } => luminance(*intensity) / distance2(),
            Self::Spot(spot) => {
                let share = spot.falloff(direction.dot(spot.direction));
                luminance(spot.intensity) * share / distance2()
            }
            Self::Directional(light) => luminance(light.irradiance),
            Self::Triangle { shape, radiance } => {
                luminance(*radiance) * shape.inverse_pdf_w(origin, direction, position)
            }
            Self::Textured(panel) => {
                luminance(panel.mean()) * panel.shape.inverse_pdf_w(origin, direction, position)
            }
        }
    }

    /// A point on the light to connect `position` with; the light was chosen with probability `prob`.
    pub(super) fn connect(&self, position: Vec3, prob: f32, rng: &mut Rng) -> Option<LightSample> {
        match self {
            Self::Point { position: target, intensity } => {
                let (wi, distance2) = toward(*target, position);
                let irradiance = *intensity * (distance2 * prob).recip();
                (distance2 > 0.0).then(|| LightSample::of_delta(*target, wi, irradiance))
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
    fn power_of_a_spot_is_the_integral_of_its_intensity() {
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
    fn light_paths_of_a_spot_follow_its_intensity() {
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
    fn parallel_light_has_uniform_irradiance_in_the_sphere() {
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
