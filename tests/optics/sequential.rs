//! Exact rays through a prescription, surface after surface, in f64 and independent of the
//! renderer.
//!
//! Millimeters; light goes along +z, the first vertex is the origin.

use crate::make_scenes::lens::{Surface, depths};
use glam::{DVec2, DVec3, dvec3};

/// A ray of light.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub origin: DVec3,
    /// Unit direction.
    pub direction: DVec3,
    /// Share of the light that is left after Fresnel's formula.
    pub share: f64,
}

impl Ray {
    pub fn between(from: DVec3, to: DVec3) -> Self {
        Self { origin: from, direction: (to - from).normalize(), share: 1.0 }
    }

    pub fn at_depth(&self, z: f64) -> DVec3 {
        self.origin + (z - self.origin.z) / self.direction.z * self.direction
    }

    /// Through all surfaces, unless a rim or the stop is in its way.
    pub fn through(mut self, lens: &[Surface]) -> Option<Self> {
        let mut before = 1.0;
        for (surface, depth) in lens.iter().zip(depths(lens)) {
            if surface.radius == 0.0 {
                self.origin = self.at_depth(depth);
            } else {
                self.refract(surface.radius, depth, before / surface.index)?;
            }
            if self.origin.truncate().length() > 0.5 * surface.diameter {
                return None;
            }
            before = surface.index;
        }
        Some(self)
    }

    /// At the sphere of `radius` whose vertex is at `depth`; `ratio` of the indices before and
    /// behind.
    fn refract(&mut self, radius: f64, depth: f64, ratio: f64) -> Option<()> {
        let center = dvec3(0.0, 0.0, depth + radius);
        let to = self.origin - center;
        let along = to.dot(self.direction);
        let root = (along * along - to.length_squared() + radius * radius).sqrt();
        let point = self.origin + (-along - radius.signum() * root) * self.direction;
        // Against the light.
        let normal = (point - center) / radius;
        let cos = -self.direction.dot(normal);
        let cos_t = (1.0 - ratio * ratio * (1.0 - cos * cos)).sqrt();
        if !(root + cos_t).is_finite() {
            return None;
        }
        let s = (ratio * cos - cos_t) / (ratio * cos + cos_t);
        let p = (cos - ratio * cos_t) / (cos + ratio * cos_t);
        self.share *= 1.0 - 0.5 * (s * s + p * p);
        self.direction = (ratio * self.direction + (ratio * cos - cos_t) * normal).normalize();
        self.origin = point;
        Some(())
    }
}

/// Height and slope of a paraxial ray behind the last surface, from those before the first.
pub fn paraxial(lens: &[Surface], mut height: f64, mut slope: f64) -> [f64; 2] {
    let mut before = 1.0;
    for surface in lens {
        if surface.radius != 0.0 {
            let power = (surface.index - before) / surface.radius;
            slope = (before * slope - height * power) / surface.index;
        }
        before = surface.index;
        height += surface.thickness * slope;
    }
    [height, slope]
}

/// Behind the last surface, where a point at `distance` before the first is sharp, and how much
/// larger its image is (negative: upside down).
pub fn image(lens: &[Surface], distance: f64) -> [f64; 2] {
    let [height, slope] = paraxial(lens, distance, 1.0);
    [-height / slope, 1.0 / slope]
}

/// Arriving light of a small Lambertian emitter that faces the lens.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// For an emitter of radiance 1 and area 1.
    pub energy: f64,
    pub place: DVec2,
    /// Mean square of the distance from the mean place.
    pub spread: f64,
}

/// On the plane at `depth`, from the point `from`.
pub fn arrival(lens: &[Surface], from: DVec3, depth: f64) -> Arrival {
    let n = 400;
    let (radius, rim) = (0.5 * lens[0].diameter, lens[0].sag());
    let cell = 2.0 * radius / f64::from(n);
    let mut hits = Vec::new();
    for i in 0..n * n {
        let place = |i: i32| cell * (f64::from(i) + 0.5) - radius;
        let on_rim = dvec3(place(i % n), place(i / n), rim);
        // The first surface bulges before the plane of its rim.
        if on_rim.truncate().length() < radius
            && let Some(ray) = Ray::between(from, on_rim).through(lens)
        {
            let across = on_rim - from;
            let cos = across.z / across.length();
            let weight = ray.share * cos * cos * cell * cell / across.length_squared();
            hits.push((ray.at_depth(depth).truncate(), weight));
        }
    }
    let energy: f64 = hits.iter().map(|(_, weight)| weight).sum();
    let place = hits.iter().map(|(at, weight)| at * weight).sum::<DVec2>() / energy;
    let square = |at: DVec2| at.distance_squared(place);
    let spread = hits.iter().map(|(at, weight)| square(*at) * weight).sum::<f64>() / energy;
    Arrival { energy, place, spread }
}
