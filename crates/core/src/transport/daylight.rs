//! Daylight coefficients of meters: the illuminance by each direction of the sky, of unit radiance,
//! and by each group of positions of the sun, of unit irradiance. theory.md (5h)
//!
//! Camera paths start at a meter and choose directions by the BSDFs alone, since the sky is large.
//! Where one leaves the scene, its weight belongs to that direction. At every surface with lobes of
//! finite density it is connected with a random position of the sun, also through panes. Light of
//! the sun that arrives straight at the meter is not part of it: [`straight_sun`]. Connections do
//! not find the sun in mirrors and through curved glass. Paths that leave the scene from there are
//! counted as if the light of the sun came evenly from its patch of the sky.

use super::path_walker::survives;
use crate::accel::{Intersect, Ray};
use crate::base::math::{Rgb, cosine_hemisphere, luminance};
use crate::base::rng::Rng;
use crate::scene::bsdf::{Lobe, LobeSet, Transport};
use crate::scene::{MediumState, Meter, Scene, Surface};
use glam::Vec3;
use std::f32::consts::PI;

/// Segments before roulette.
const MIN_SEGMENTS: u32 = 4;

/// Maximum survival probability: paths end even between white walls.
const MAX_SURVIVAL: f32 = 0.97;

/// Cosine between two directions above which a ray was not turned: flat panes keep directions but
/// for rounding.
const STRAIGHT: f32 = 1.0 - 1e-5;

/// Connections with the sun at each surface.
const SUNS_PER_VERTEX: usize = 2;

/// What coefficients are for.
pub struct DaylightTargets<'a> {
    /// The bin of a direction in which a path leaves the scene; `None` without light from there.
    pub sky: &'a (dyn Fn(Vec3) -> Option<usize> + Sync),
    /// Groups of unit vectors toward the sun. None is empty.
    pub suns: &'a [Vec<Vec3>],
    /// The group of the suns in a bin of the sky, and the solid angle of the bin, sr.
    pub suns_of_bin: &'a (dyn Fn(usize) -> Option<(usize, f32)> + Sync),
}

/// Sums over paths from one meter. Divided by their number they are coefficients.
#[derive(Clone, Debug, Default)]
pub struct DaylightSums {
    /// For each bin of the sky: illuminance by its radiance.
    pub sky: Vec<f32>,
    /// For each group of suns: illuminance, but that which arrives straight, by the irradiance of a
    /// surface that faces the sun.
    pub suns: Vec<f32>,
}

impl DaylightSums {
    /// Sums for this number of bins and of groups.
    pub fn new(bins: usize, groups: usize) -> Self {
        Self { sky: vec![0.0; bins], suns: vec![0.0; groups] }
    }

    /// Adds `side * side` paths from a meter. Their first directions are stratified.
    pub fn add(
        &mut self,
        (scene, accel): (&Scene, &dyn Intersect),
        meter: &Meter,
        targets: &DaylightTargets,
        side: u32,
        rng: &mut Rng,
    ) {
        for cell in 0..side * side {
            let [u, v] = rng.next_2d();
            let at = [(cell % side) as f32 + u, (cell / side) as f32 + v].map(|x| x / side as f32);
            let direction = cosine_hemisphere(meter.normal, at);
            self.add_path(scene, accel, Ray::new(meter.position, direction), targets, rng);
        }
    }

    fn add_path(
        &mut self,
        scene: &Scene,
        accel: &dyn Intersect,
        mut ray: Ray,
        targets: &DaylightTargets,
        rng: &mut Rng,
    ) {
        let mut throughput = Rgb::splat(PI);
        // The direction that connections with the sun take from the last surface, or from the
        // meter.
        let mut connected = ray.direction;
        for segment in 0u32.. {
            let hit = accel.closest_hit(&ray);
            if hit.is_miss() {
                self.leave(ray.direction, connected, luminance(throughput), targets);
                return;
            }
            let surface = scene.surface(&ray, &hit);
            if !targets.suns.is_empty() {
                for _ in 0..SUNS_PER_VERTEX {
                    self.connect((scene, accel), &surface, throughput, targets.suns, rng);
                }
            }
            let at = surface.vertex(Transport::Radiance);
            let sample = surface.bsdf.sample(&at, Transport::Radiance, LobeSet::All, rng);
            let Some(sample) = sample.filter(|sample| surface.agrees(&at, sample.wi)) else {
                return;
            };
            throughput *= sample.weight;
            if segment >= MIN_SEGMENTS {
                let survival = throughput.max_element().clamp(0.0, MAX_SURVIVAL);
                if !survives(Some(survival), &mut throughput, rng) {
                    return;
                }
            }
            if sample.lobe != Lobe::Delta {
                connected = sample.wi;
            }
            ray = Ray::new(surface.start(sample.wi), sample.wi);
        }
    }

    /// Adds a path that leaves the scene in a direction: to the sky there, and to the sun if a
    /// mirror or a lens turned the ray since it was `connected` last.
    fn leave(&mut self, direction: Vec3, connected: Vec3, weight: f32, targets: &DaylightTargets) {
        let Some(bin) = (targets.sky)(direction) else { return };
        self.sky[bin] += weight;
        if direction.dot(connected) < STRAIGHT
            && let Some((group, solid_angle)) = (targets.suns_of_bin)(bin)
        {
            self.suns[group] += weight / solid_angle;
        }
    }

    /// Connects a surface with one position of the sun of one group.
    fn connect(
        &mut self,
        (scene, accel): (&Scene, &dyn Intersect),
        surface: &Surface,
        throughput: Rgb,
        groups: &[Vec<Vec3>],
        rng: &mut Rng,
    ) {
        let [choice, member] = rng.next_2d();
        let group = ((choice * groups.len() as f32) as usize).min(groups.len() - 1);
        let suns = &groups[group];
        let toward = suns[((member * suns.len() as f32) as usize).min(suns.len() - 1)];
        let at = surface.vertex(Transport::Radiance);
        if surface.bsdf.spread().is_none() || !surface.agrees(&at, toward) {
            return;
        }
        let value = surface.bsdf.eval(&at, toward) * toward.dot(at.normal).abs();
        if value == Rgb::ZERO {
            return;
        }
        let start = surface.start(toward);
        let Some(sight) = scene.sight_along(accel, start, toward, MediumState::default()) else {
            return;
        };
        let number = groups.len() as f32 / SUNS_PER_VERTEX as f32;
        self.suns[group] += number * luminance(throughput * value * sight.transmitted);
    }
}

/// Illuminance of a meter by the sun straight from this direction, also through panes, over the
/// irradiance of a surface that faces it.
pub fn straight_sun(scene: &Scene, accel: &dyn Intersect, meter: &Meter, toward: Vec3) -> f32 {
    let cos = toward.dot(meter.normal);
    if cos <= 0.0 {
        return 0.0;
    }
    let sight = scene.sight_along(accel, meter.position, toward, MediumState::default());
    sight.map_or(0.0, |sight| cos * luminance(sight.transmitted))
}
