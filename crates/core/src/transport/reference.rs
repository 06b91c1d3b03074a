//! A unidirectional path tracer: an independent estimator of the same image, to test the renderer
//! with.
//!
//! It is simple, slow and unbiased. It shares the scene and its intersections with the renderer,
//! and none of the transport: no photons and no merging. Caustics of small lights converge very
//! slowly, and it cannot sample those of point lights. [`path_walker`](super::path_walker) follows
//! the paths.

use super::path_walker::{PathVisitor, radiance};
use crate::accel::{Hit, Intersect, Ray};
use crate::base::math::Rgb;
use crate::base::rng::{Rng, Stream, StreamKey};
use crate::film::radiance::Film;
use crate::scene::{LightSample, Receiver, Scene, View};
use crate::settings::Settings;
use glam::Vec3;
use rayon::prelude::*;

/// Segments before Russian roulette starts.
const MIN_SEGMENTS: u32 = 4;

/// Maximum survival probability: paths end even between perfectly white walls.
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
    /// Starts a black image. Only resolution and seed of the settings matter.
    pub fn new(scene: &'a Scene, accel: &'a dyn Intersect, settings: &Settings) -> Self {
        let Settings { width, height, seed, .. } = *settings;
        let view = scene.camera.view(width, height);
        Self { scene, accel, view, seed, film: Film::new(width, height) }
    }

    /// The image so far.
    pub fn film(&self) -> &Film {
        &self.film
    }

    /// Adds an iteration, the mean of `paths` paths in each pixel, on the threads of the current
    /// rayon pool.
    pub fn iterate(&mut self, paths: u32) {
        let key = StreamKey::new(self.seed, Stream::Reference, self.film.iterations);
        let (width, _) = self.film.resolution();
        let Self { scene, accel, view, film, .. } = self;
        let (scene, accel) = (*scene, *accel);
        film.sums.tiles_mut().into_par_iter().for_each(|(tile, sums)| {
            for (index, sums) in sums.iter_mut().enumerate() {
                let (x, y) = tile.pixel(index as u32);
                let mut rng = key.rng(u64::from(y) * u64::from(width) + u64::from(x));
                let path = |_| {
                    let [dx, dy] = rng.next_2d();
                    let (x, y) = (x as f32 + dx, y as f32 + dy);
                    let (ray, weight) = scene.camera_ray(view, x, y, rng.next_2d());
                    let radiance = radiance(scene, accel, ray, &mut rng, &mut Visitor(scene));
                    (weight * radiance).as_dvec3()
                };
                let values = (0..paths).map(path);
                sums.add(values.sum::<glam::DVec3>() / f64::from(paths.max(1)));
            }
        });
        film.iterations += 1;
    }
}

struct Visitor<'a>(&'a Scene);

impl PathVisitor for Visitor<'_> {
    fn hit(&mut self, accel: &dyn Intersect, ray: &Ray, segment: u32) -> Hit {
        let hit = accel.closest_hit(ray);
        if segment == 0 { self.0.first_visible(accel, ray, hit) } else { hit }
    }

    fn sample_light(&self, at: Receiver, rng: &mut Rng) -> Option<LightSample> {
        self.0.lights().connect_by_power(at.position, rng)
    }

    fn is_blocked(&self, accel: &dyn Intersect, end: Vec3, light: &LightSample) -> bool {
        accel.is_occluded(&Ray::segment(light.target, end))
    }

    /// theory.md, section 23
    fn survival(&self, segment: u32, throughput: Rgb) -> Option<f32> {
        (segment >= MIN_SEGMENTS).then(|| throughput.abs().max_element().min(MAX_SURVIVAL))
    }
}
