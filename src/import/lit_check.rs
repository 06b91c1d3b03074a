//! A quick look at a scene, as a user would look at its first picture: is what the camera sees lit?
//!
//! A path tracer of few pixels and paths that connects to lights through glass as if it were air: it is to
//! tell a lit scene from a dark one, and light that only comes through a bulb or a window is light.

use crate::accel::{Intersect, Ray};
use crate::base::math::{Rgb, luminance};
use crate::base::rng::{Rng, Stream, StreamKey};
use crate::image_io::auto_exposure;
use crate::scene::bsdf::{Lobe, LobeSet, Transport};
use crate::scene::{Scene, Surface, View};
use rayon::prelude::*;

/// Pixels that are looked at, about.
const PIXELS: f32 = 1000.0;
/// Paths of each.
const PATHS: u32 = 6;
/// Most segments of a path.
const SEGMENTS: u32 = 6;
/// Most surfaces that light is let through on its way to a connection.
const PANES: u32 = 16;
/// Of display white; pixels below are black to eyes: a fiftieth of the key of the preview's exposure.
const BLACK: f32 = 0.004;

/// Of display white, what the preview's exposure makes of it.
const EXPOSED: f32 = 0.2;

/// What a few pixels showed.
pub(super) struct LitCheck {
    pixels: Vec<Pixel>,
}

#[derive(Clone, Copy, Default)]
struct Pixel {
    radiance: Rgb,
    /// How many of its paths met a surface.
    met: u32,
    /// Sum of their squared distances, scene units squared.
    distance2: f32,
}

impl LitCheck {
    /// Looks at an image of `resolution` pixels, of its aspect ratio.
    pub fn new(scene: &Scene, accel: &dyn Intersect, [width, height]: [u32; 2]) -> Self {
        let shrink = (PIXELS / (width as f32 * height as f32)).sqrt();
        let [width, height] = [width, height].map(|n| ((n as f32 * shrink).ceil() as u32).max(1));
        let eye = Eye { scene, accel, view: scene.camera.view(width, height) };
        let key = StreamKey::new(0, Stream::LitCheck, 0);
        let pixel = |index: u32| {
            let mut rng = key.rng(index.into());
            let mut pixel = Pixel::default();
            (0..PATHS).for_each(|_| eye.look([index % width, index / width], &mut pixel, &mut rng));
            pixel
        };
        Self { pixels: (0..width * height).into_par_iter().map(pixel).collect() }
    }

    /// Of the pixels that show a surface, the share that is not black in a preview; 1 if none does.
    pub fn lit(&self) -> f64 {
        let radiances: Vec<Rgb> = self.pixels.iter().map(|pixel| pixel.radiance).collect();
        let least = BLACK / auto_exposure(&radiances);
        let seen = self.pixels.iter().filter(|pixel| pixel.met > 0);
        let lit = seen.clone().filter(|pixel| luminance(pixel.radiance) >= least).count();
        match seen.count() {
            0 => 1.0,
            seen => lit as f64 / seen as f64,
        }
    }

    /// Radiance of what is lit, W/(m^2 sr), by its geometric mean; `None` if nothing is.
    pub fn typical(&self) -> Option<f32> {
        let radiances: Vec<Rgb> = self.pixels.iter().map(|pixel| pixel.radiance).collect();
        let is_lit = radiances.iter().any(|radiance| luminance(*radiance) > 0.0);
        // Within what leaves room for the power of an environment.
        is_lit.then(|| (EXPOSED / auto_exposure(&radiances)).clamp(1e-12, 1e12))
    }

    /// Mean square of the distances of what is seen, scene units squared; 0 if there is nothing.
    pub fn distance2(&self) -> f32 {
        let met: u32 = self.pixels.iter().map(|pixel| pixel.met).sum();
        let sum: f32 = self.pixels.iter().map(|pixel| pixel.distance2).sum();
        sum / met.max(1) as f32
    }
}

struct Eye<'a> {
    scene: &'a Scene,
    accel: &'a dyn Intersect,
    view: View,
}

impl Eye<'_> {
    /// Adds a path to a pixel.
    fn look(&self, [x, y]: [u32; 2], pixel: &mut Pixel, rng: &mut Rng) {
        let [dx, dy] = rng.next_2d();
        let (mut ray, weight) = self.view.ray(x as f32 + dx, y as f32 + dy, rng.next_2d());
        let (mut radiance, mut throughput) = (Rgb::ZERO, Rgb::ONE);
        // Whether light at the end of the segment was not connected to at its beginning.
        let mut unconnected = true;
        for segment in 0..SEGMENTS {
            let hit = self.accel.closest_hit(&ray);
            if hit.is_miss() {
                if unconnected {
                    radiance +=
                        throughput * self.scene.lights().environment_radiance(ray.direction);
                }
                break;
            }
            if segment == 0 {
                pixel.met += 1;
                pixel.distance2 += hit.t * hit.t;
            }
            let surface = self.scene.surface(&ray, &hit);
            if unconnected && surface.front {
                radiance += throughput * surface.emission();
            }
            radiance += throughput * self.connection(&surface, rng);
            let at = surface.vertex(Transport::Radiance);
            let sample = surface.bsdf.sample(&at, Transport::Radiance, LobeSet::All, rng);
            let Some(sample) = sample.filter(|sample| surface.agrees(&at, sample.wi)) else {
                break;
            };
            unconnected = sample.lobe == Lobe::Delta;
            throughput *= sample.weight;
            ray = Ray::new(surface.start(sample.wi), sample.wi);
        }
        let radiance = radiance * (weight / PATHS as f32);
        if radiance.is_finite() {
            pixel.radiance += radiance;
        }
    }

    /// Radiance that a light adds by all lobes of finite density.
    fn connection(&self, surface: &Surface, rng: &mut Rng) -> Rgb {
        let bsdf = &surface.bsdf;
        if bsdf.spread().is_none() {
            return Rgb::ZERO;
        }
        let lights = self.scene.lights();
        let Some(light) = lights.connect(surface.receiver(), rng) else {
            return Rgb::ZERO;
        };
        let at = surface.vertex(Transport::Radiance);
        let value = bsdf.eval(&at, light.wi);
        if value == Rgb::ZERO
            || !surface.agrees(&at, light.wi)
            || self.is_blocked(Ray::segment(surface.start(light.wi), light.target))
        {
            return Rgb::ZERO;
        }
        value * light.irradiance * light.wi.dot(at.normal).abs()
    }

    /// Whether anything but glass lies on a segment.
    fn is_blocked(&self, mut ray: Ray) -> bool {
        for _ in 0..PANES {
            let hit = self.accel.closest_hit(&ray);
            if hit.is_miss() {
                return false;
            }
            let material = self.scene.placements()[hit.mesh as usize].material;
            if !self.scene.materials()[material as usize].bsdf.transmits() {
                return true;
            }
            ray.t_near = (hit.t * (1.0 + 1e-5)).max(f32::MIN_POSITIVE);
        }
        true
    }
}
