//! A unidirectional path tracer: an independent way to the same image, to hold the renderer against.
//!
//! Simple and slow. It shares the scene and its intersections with the renderer and nothing of the
//! transport: one path after the other, no photons, no merging, hence no bias. Where a path meets a
//! surface with lobes of finite density it connects to a light; emission that it hits counts only
//! where no connection could have found it, at the camera and after lobes of a single direction.
//! Caustics of small lights take it very long; those of point lights it cannot find at all.

use crate::accel::{Intersect, Ray};
use crate::base::math::Rgb;
use crate::base::rng::{Rng, Stream, StreamKey};
use crate::film::radiance::Film;
use crate::scene::bsdf::{Lobe, Transport, Wanted};
use crate::scene::{Scene, Surface, View};
use crate::settings::Settings;
use rayon::prelude::*;

/// Segments after which Russian roulette begins.
const LEAST_SEGMENTS: u32 = 4;

/// Largest survival probability: paths end even between perfectly white walls.
const MAX_SURVIVAL: f32 = 0.98;

/// Adds iterations of one path per pixel to an image.
pub struct PathTracer<'a> {
    scene: &'a Scene,
    accel: &'a dyn Intersect,
    view: View,
    seed: u64,
    film: Film,
}

impl<'a> PathTracer<'a> {
    /// A black image. Of the settings only resolution and seed count.
    pub fn new(scene: &'a Scene, accel: &'a dyn Intersect, settings: &Settings) -> Self {
        let Settings { width, height, seed, .. } = *settings;
        let view = scene.camera.view(width, height);
        Self { scene, accel, view, seed, film: Film::new(width, height) }
    }

    /// The image so far.
    pub fn film(&self) -> &Film {
        &self.film
    }

    /// Traces `paths` paths in each pixel, whose mean is one iteration of the image, on the threads
    /// of the current rayon pool.
    pub fn iterate(&mut self, paths: u32) {
        let key = StreamKey::new(self.seed, Stream::Reference, self.film.iterations);
        let (width, _) = self.film.resolution();
        let Self { scene, accel, view, film, .. } = self;
        let tracer = Tracer { scene, accel: *accel, view: *view };
        film.sums.tiles_mut().into_par_iter().for_each(|(tile, sums)| {
            for (index, sums) in sums.iter_mut().enumerate() {
                let (x, y) = tile.pixel(index as u32);
                let mut rng = key.rng(u64::from(y) * u64::from(width) + u64::from(x));
                let values = (0..paths).map(|_| tracer.path(x, y, &mut rng).as_dvec3());
                sums.add(values.sum::<glam::DVec3>() / f64::from(paths.max(1)));
            }
        });
        film.iterations += 1;
    }
}

/// What paths are traced through.
struct Tracer<'a> {
    scene: &'a Scene,
    accel: &'a dyn Intersect,
    view: View,
}

impl Tracer<'_> {
    /// The contribution of one path to the pixel's value.
    fn path(&self, x: u32, y: u32, rng: &mut Rng) -> Rgb {
        let [dx, dy] = rng.next_2d();
        let (mut ray, weight) = self.view.ray(x as f32 + dx, y as f32 + dy, rng.next_2d());
        let (mut radiance, mut throughput) = (Rgb::ZERO, Rgb::ONE);
        // Whether light at the end of the segment was not connected to at its beginning.
        let mut unconnected = true;
        for segment in 0.. {
            let mut hit = self.accel.closest_hit(&ray);
            if segment == 0 {
                hit = self.scene.first_seen(self.accel, &ray, hit);
            }
            if hit.is_miss() {
                if unconnected {
                    radiance += throughput * self.scene.lights().beyond(ray.direction);
                }
                break;
            }
            let surface = self.scene.surface(&ray, &hit);
            if unconnected && surface.front {
                radiance += throughput * surface.emission();
            }
            // theory.md (96)
            radiance += throughput * self.connection(&surface, rng);
            let at = surface.vertex(Transport::Radiance);
            let bsdf = &surface.bsdf;
            let Some(sample) = bsdf.sample(&at, Transport::Radiance, Wanted::All, rng) else {
                break;
            };
            if !surface.agrees(&at, sample.wi) {
                break;
            }
            unconnected = sample.lobe == Lobe::Delta;
            throughput *= sample.weight;
            if segment >= LEAST_SEGMENTS {
                // theory.md, section 23
                let survival = throughput.max_element().min(MAX_SURVIVAL);
                if rng.next_1d() >= survival {
                    break;
                }
                throughput /= survival;
            }
            ray = Ray::new(surface.start(sample.wi), sample.wi);
        }
        weight * radiance
    }

    /// Radiance that a light adds by all lobes of finite density.
    fn connection(&self, surface: &Surface, rng: &mut Rng) -> Rgb {
        let bsdf = &surface.bsdf;
        if bsdf.spread().is_none() {
            return Rgb::ZERO;
        }
        let Some(light) = self.scene.lights().connect_by_power(surface.position, rng) else {
            return Rgb::ZERO;
        };
        let at = surface.vertex(Transport::Radiance);
        let value = bsdf.eval(&at, light.wi);
        if value == Rgb::ZERO
            || !surface.agrees(&at, light.wi)
            || self.accel.is_occluded(&Ray::segment(light.target, surface.start(light.wi)))
        {
            return Rgb::ZERO;
        }
        value * light.irradiance * light.wi.dot(at.normal).abs()
    }
}
