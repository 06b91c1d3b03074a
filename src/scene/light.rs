//! Light sources: emission of light paths, and connection from a vertex.

use crate::math::{Rgb, cosine_hemisphere, luminance, uniform_sphere, uniform_triangle};
use crate::rng::Rng;
use crate::scene::Triangle;
use glam::Vec3;
use std::f32::consts::PI;

/// The smallest unit that emits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Emitter {
    /// An isotropic point.
    Point {
        /// Where it is.
        position: Vec3,
        /// Radiant intensity, W/sr.
        intensity: Rgb,
    },
    /// A triangle that emits the same radiance from each point of its front to all sides.
    Triangle {
        /// Its geometry.
        shape: Triangle,
        /// Emitted radiance, W/(m^2 sr).
        radiance: Rgb,
    },
}

impl Emitter {
    /// Radiant power, W.
    pub fn power(&self) -> Rgb {
        match self {
            Self::Point { intensity, .. } => 4.0 * PI * *intensity,
            Self::Triangle { shape, radiance } => PI * shape.area() * *radiance,
        }
    }
}

/// The start of a light path.
#[derive(Clone, Copy, Debug)]
pub struct Emission {
    /// Start point, already off its surface.
    pub origin: Vec3,
    /// Unit direction.
    pub direction: Vec3,
    /// Flux that the path carries, W: emitted radiance (or intensity) times the cosine, divided by
    /// the path's density. Its mean over paths is the power of all lights.
    pub flux: Rgb,
}

/// A point on a light, as seen from a vertex.
#[derive(Clone, Copy, Debug)]
pub struct LightSample {
    /// Where to aim the shadow ray, already off the light's surface.
    pub target: Vec3,
    /// Unit vector from the vertex to the light.
    pub wi: Vec3,
    /// Irradiance on a surface that faces `wi` if nothing is in between, divided by the
    /// sample's density, W/m^2.
    pub irradiance: Rgb,
}

/// All emitters of a scene, chosen in proportion to the luminance of their power.
#[derive(Clone, Debug, Default)]
pub struct Lights {
    emitters: Vec<Emitter>,
    /// Probability of choosing each emitter.
    prob: Vec<f32>,
    /// Upper end of each emitter's share of [0, 1].
    cumulative: Vec<f32>,
}

impl Lights {
    /// Emitters without power are left out.
    pub fn new(mut emitters: Vec<Emitter>) -> Self {
        let power = |e: &Emitter| f64::from(luminance(e.power()));
        emitters.retain(|e| power(e) > 0.0);
        let total: f64 = emitters.iter().map(power).sum();
        let prob: Vec<f32> = emitters.iter().map(|e| (power(e) / total) as f32).collect();
        let cumulative = emitters
            .iter()
            .scan(0.0, |sum, e| {
                *sum += power(e) / total;
                Some(*sum as f32)
            })
            .collect();
        Self { emitters, prob, cumulative }
    }

    /// All emitters with power.
    pub fn emitters(&self) -> &[Emitter] {
        &self.emitters
    }

    /// Radiant power of all lights, W.
    pub fn power(&self) -> Rgb {
        self.emitters.iter().map(Emitter::power).sum()
    }

    /// The emitter that holds `u` of [0, 1), and its probability.
    #[inline]
    fn choose(&self, u: f32) -> (&Emitter, f32) {
        let last = self.emitters.len() - 1;
        let index = self.cumulative.partition_point(|&end| end <= u).min(last);
        (&self.emitters[index], self.prob[index])
    }

    /// Starts a light path.
    ///
    /// # Panics
    /// If there are no lights.
    #[inline]
    pub fn emit(&self, rng: &mut Rng) -> Emission {
        let (emitter, prob) = self.choose(rng.next_1d());
        match emitter {
            Emitter::Point { position, intensity } => Emission {
                origin: *position,
                direction: uniform_sphere(rng.next_2d()),
                flux: *intensity * (4.0 * PI / prob),
            },
            Emitter::Triangle { shape, radiance } => {
                let point = shape.point(uniform_triangle(rng.next_2d()));
                Emission {
                    origin: point + shape.normal * shape.offset,
                    direction: cosine_hemisphere(shape.normal, rng.next_2d()),
                    flux: *radiance * (PI * shape.area() / prob),
                }
            }
        }
    }

    /// Chooses a point on a light to connect `position` with; `None` where that point cannot light
    /// it.
    ///
    /// # Panics
    /// If there are no lights.
    #[inline]
    pub fn connect(&self, position: Vec3, rng: &mut Rng) -> Option<LightSample> {
        let (emitter, prob) = self.choose(rng.next_1d());
        match emitter {
            Emitter::Point { position: target, intensity } => {
                let to_light = *target - position;
                let distance2 = to_light.length_squared();
                (distance2 > 0.0).then(|| LightSample {
                    target: *target,
                    wi: to_light / distance2.sqrt(),
                    irradiance: *intensity / (distance2 * prob),
                })
            }
            Emitter::Triangle { shape, radiance } => {
                let target =
                    shape.point(uniform_triangle(rng.next_2d())) + shape.normal * shape.offset;
                let to_light = target - position;
                let distance2 = to_light.length_squared();
                let wi = to_light / distance2.sqrt();
                let cos_light = -wi.dot(shape.normal);
                (cos_light > 0.0).then(|| LightSample {
                    target,
                    wi,
                    irradiance: *radiance * (cos_light * shape.area() / (distance2 * prob)),
                })
            }
        }
    }
}
