//! A scalar path tracer for tests and quick looks at a scene, which need no speed: one path at a time, without photons.

use super::bsdf::{Lobe, LobeSet, Transport};
use super::lights::LightSample;
use super::{Scene, Surface};
use crate::accel::{Hit, Intersect, Ray};
use crate::base::math::Rgb;
use crate::base::rng::Rng;

/// Decisions along a path.
pub trait PathVisitor {
    /// Maximum number of segments.
    const MAX_SEGMENTS: u32 = u32::MAX;

    /// Finds the hit at the end of a segment.
    fn hit(&mut self, accel: &dyn Intersect, ray: &Ray, segment: u32) -> Hit;

    /// Samples a light source for connections with a surface.
    fn sample_light(&self, surface: &Surface, rng: &mut Rng) -> Option<LightSample>;

    /// Tests whether something blocks the light from a surface.
    fn is_blocked(&self, accel: &dyn Intersect, surface: &Surface, light: &LightSample) -> bool;

    /// Survival probability after a segment; `None` without roulette.
    fn survival(&self, segment: u32, throughput: Rgb) -> Option<f32>;
}

/// Estimates the radiance that arrives along `ray` by one path.
///
/// The path connects to a light source at every surface with lobes of finite density. Emission that it hits counts
/// where no connection could have found it: on the first segment and after lobes of a single direction.
pub fn radiance<V: PathVisitor>(
    scene: &Scene,
    accel: &dyn Intersect,
    mut ray: Ray,
    rng: &mut Rng,
    visitor: &mut V,
) -> Rgb {
    let (mut radiance, mut throughput) = (Rgb::ZERO, Rgb::ONE);
    let mut is_unconnected = true;
    for segment in 0..V::MAX_SEGMENTS {
        let hit = visitor.hit(accel, &ray, segment);
        if hit.is_miss() {
            if is_unconnected {
                radiance += throughput * scene.lights().environment_radiance(ray.direction);
            }
            break;
        }
        let surface = scene.surface(&ray, &hit);
        if is_unconnected {
            radiance += throughput * surface.emission();
        }
        // theory.md (96)
        radiance += throughput * connected(accel, &surface, rng, visitor);
        let at = surface.vertex(Transport::Radiance);
        let sample = surface.bsdf.sample(&at, Transport::Radiance, LobeSet::All, rng);
        let Some(sample) = sample.filter(|sample| surface.agrees(&at, sample.wi)) else { break };
        is_unconnected = sample.lobe == Lobe::Delta;
        throughput *= sample.weight;
        if let Some(survival) = visitor.survival(segment, throughput) {
            if rng.next_1d() >= survival {
                break;
            }
            throughput /= survival;
        }
        ray = Ray::new(surface.start(sample.wi), sample.wi);
    }
    radiance
}

/// Radiance that a light source adds by all lobes of finite density.
fn connected(
    accel: &dyn Intersect,
    surface: &Surface,
    rng: &mut Rng,
    visitor: &impl PathVisitor,
) -> Rgb {
    if surface.bsdf.spread().is_none() {
        return Rgb::ZERO;
    }
    let Some(light) = visitor.sample_light(surface, rng) else { return Rgb::ZERO };
    let at = surface.vertex(Transport::Radiance);
    let value = surface.bsdf.eval(&at, light.wi);
    if value == Rgb::ZERO
        || !surface.agrees(&at, light.wi)
        || visitor.is_blocked(accel, surface, &light)
    {
        return Rgb::ZERO;
    }
    value * light.irradiance * light.wi.dot(at.normal).abs()
}
