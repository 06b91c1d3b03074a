//! A scalar path tracer for tests and quick looks at a scene, which need no speed: one path at a
//! time, without photons.

use crate::accel::{Hit, Intersect, Ray};
use crate::base::math::Rgb;
use crate::base::rng::Rng;
use crate::scene::bsdf::{Lobe, LobeSet, Transport};
use crate::scene::lights::LightSample;
use crate::scene::{Flight, Media, Medium, MediumState, Receiver, Scene, Surface};
use glam::Vec3;

/// Decisions along a path.
pub trait PathVisitor {
    /// Maximum number of segments.
    const MAX_SEGMENTS: u32 = u32::MAX;

    /// Finds the hit at the end of a segment.
    fn hit(&mut self, accel: &dyn Intersect, ray: &Ray, segment: u32) -> Hit;

    /// Samples a light source for connections with a point on a surface or in a medium.
    fn sample_light(&self, at: Receiver, rng: &mut Rng) -> Option<LightSample>;

    /// Returns true if something blocks the light to a point, where shadow rays end.
    fn is_blocked(&self, accel: &dyn Intersect, end: Vec3, light: &LightSample) -> bool;

    /// Survival probability after a segment; `None` without roulette.
    fn survival(&self, segment: u32, throughput: Rgb) -> Option<f32>;
}

/// Estimates the radiance that arrives along `ray` by one path.
///
/// The path connects to a light source in media, and at every surface with lobes of finite density.
/// Emission that it hits counts where no connection could have found it: on the first segment and
/// after lobes of a single direction.
pub fn radiance<V: PathVisitor>(
    scene: &Scene,
    accel: &dyn Intersect,
    mut ray: Ray,
    rng: &mut Rng,
    visitor: &mut V,
) -> Rgb {
    let (mut radiance, mut throughput) = (Rgb::ZERO, Rgb::ONE);
    let (mut is_unconnected, mut wavelength) = (true, None);
    let start = |media: &Media| media.at(scene, accel, ray.origin);
    let mut within = scene.media().map_or(MediumState::default(), start);
    for segment in 0..V::MAX_SEGMENTS {
        let mut hit = visitor.hit(accel, &ray, segment);
        if let Some(media) = scene.media() {
            let walk = &mut Walk { ray: &mut ray, throughput: &mut throughput, within };
            let scattering = walk.through_media(scene, accel, media, &mut hit, rng);
            within = walk.within;
            if let Some(medium) = scattering {
                let at = InMedium { position: ray.origin, medium, within };
                let connected = at.connected((scene, accel), ray.direction, rng, visitor);
                radiance += throughput * connected;
                ray.direction = medium.scatter(ray.direction, rng);
                is_unconnected = false;
                if !survives(visitor.survival(segment, throughput), &mut throughput, rng) {
                    break;
                }
                continue;
            }
        }
        if hit.is_miss() {
            if is_unconnected {
                radiance += throughput * scene.lights().environment_radiance(ray.direction);
            }
            break;
        }
        let mut surface = scene.surface(&ray, &hit);
        throughput *= surface.disperse(&mut wavelength, rng);
        if is_unconnected {
            radiance += throughput * surface.emission();
        }
        // theory.md (96)
        radiance += throughput * connected((scene, accel), &surface, within, rng, visitor);
        let at = surface.vertex(Transport::Radiance);
        let sample = surface.bsdf.sample(&at, Transport::Radiance, LobeSet::All, rng);
        let Some(sample) = sample.filter(|sample| surface.agrees(&at, sample.wi)) else { break };
        is_unconnected = sample.lobe == Lobe::Delta;
        throughput *= sample.weight;
        if !survives(visitor.survival(segment, throughput), &mut throughput, rng) {
            break;
        }
        if let Some(media) = scene.media() {
            within = media.after(within, &surface, sample.wi);
        }
        ray = Ray::new(surface.start(sample.wi), sample.wi);
    }
    radiance
}

/// Plays roulette, if there is a survival probability.
pub(super) fn survives(survival: Option<f32>, throughput: &mut Rgb, rng: &mut Rng) -> bool {
    let Some(survival) = survival else { return true };
    if rng.next_1d() >= survival {
        return false;
    }
    *throughput /= survival;
    true
}

/// A path on its way to a hit.
struct Walk<'a> {
    ray: &'a mut Ray,
    throughput: &'a mut Rgb,
    within: MediumState,
}

impl Walk<'_> {
    /// Goes on to the next surface that is no index-matched boundary, or to the point where a
    /// medium scatters the path. Returns that medium; the ray then starts there, and the throughput
    /// includes the scattering coefficient.
    fn through_media<'m>(
        &mut self,
        scene: &Scene,
        accel: &dyn Intersect,
        media: &'m Media,
        hit: &mut Hit,
        rng: &mut Rng,
    ) -> Option<&'m Medium> {
        loop {
            if let Some(medium) = media.medium(self.within) {
                match medium.travel(hit.t, *self.throughput, rng) {
                    Flight::Arrives { weight } => *self.throughput *= weight,
                    Flight::Scatters { distance, weight } => {
                        *self.throughput *= weight * medium.scattering;
                        self.ray.origin += distance * self.ray.direction;
                        return Some(medium);
                    }
                }
            }
            if !media.is_index_matched(hit.mesh) {
                return None;
            }
            let surface = scene.surface(self.ray, hit);
            self.within = media.cross(self.within, hit.mesh, surface.front);
            self.ray.origin = surface.start(self.ray.direction);
            *hit = accel.closest_hit(self.ray);
        }
    }
}

/// A point in a medium.
struct InMedium<'a> {
    position: Vec3,
    medium: &'a Medium,
    within: MediumState,
}

impl InMedium<'_> {
    /// Radiance that a light source adds to a path that arrives along `direction`, over the
    /// scattering coefficient.
    fn connected(
        &self,
        (scene, accel): (&Scene, &dyn Intersect),
        direction: Vec3,
        rng: &mut Rng,
        visitor: &impl PathVisitor,
    ) -> Rgb {
        let Self { position, medium, within } = *self;
        let light = visitor.sample_light(Receiver { position, normal: None }, rng);
        let Some(light) = light else { return Rgb::ZERO };
        if visitor.is_blocked(accel, position, &light) {
            return Rgb::ZERO;
        }
        // Light flies against the path.
        let phase = medium.phase(-light.wi, -direction);
        let left = transmittance(scene, accel, within, [position, light.target]);
        phase * light.irradiance * left
    }
}

/// Transmittance of all media between two points, of which the first is in this state.
fn transmittance(
    scene: &Scene,
    accel: &dyn Intersect,
    within: MediumState,
    segment: [Vec3; 2],
) -> Rgb {
    scene.media().map_or(Rgb::ONE, |media| media.transmittance(scene, accel, within, segment))
}

/// Radiance that a light source adds by all lobes of finite density. The path arrives in the state
/// `within`.
fn connected(
    (scene, accel): (&Scene, &dyn Intersect),
    surface: &Surface,
    within: MediumState,
    rng: &mut Rng,
    visitor: &impl PathVisitor,
) -> Rgb {
    if surface.bsdf.spread().is_none() {
        return Rgb::ZERO;
    }
    let light = visitor.sample_light(surface.receiver(), rng);
    let Some(light) = light else { return Rgb::ZERO };
    let at = surface.vertex(Transport::Radiance);
    let value = surface.bsdf.eval(&at, light.wi);
    let start = surface.start(light.wi);
    if value == Rgb::ZERO
        || !surface.agrees(&at, light.wi)
        || visitor.is_blocked(accel, start, &light)
    {
        return Rgb::ZERO;
    }
    let within = scene.media().map_or(within, |media| media.after(within, surface, light.wi));
    let left = transmittance(scene, accel, within, [start, light.target]);
    value * light.irradiance * left * light.wi.dot(at.normal).abs()
}
