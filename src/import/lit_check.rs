//! A quick check whether light reaches the surfaces that the camera sees.
//!
//! It traces few paths of few pixels and connects them to lights through glass as if that were air.
//! It must only distinguish lit scenes from dark ones, and light through a bulb or a window counts
//! as light.

use crate::accel::{Intersect, Ray};
use crate::base::math::{Rgb, luminance};
use crate::base::rng::{Rng, Stream, StreamKey};
use crate::image_io::auto_exposure;
use crate::scene::bsdf::{Lobe, Transport, Wanted};
use crate::scene::{Scene, Surface, View};
use rayon::prelude::*;

/// Approximate number of pixels.
const PIXELS: f32 = 1000.0;
/// Paths per pixel.
const PATHS: u32 = 6;
/// Maximum number of segments of a path.
const SEGMENTS: u32 = 6;
/// Maximum number of transmitting surfaces along a connection to a light.
const PANES: u32 = 16;
/// Luminance below which a pixel looks black, relative to display white: a fiftieth of the key of
/// the preview's exposure.
const BLACK: f32 = 0.004;

/// Key of the preview's exposure, relative to display white.
const EXPOSED: f32 = 0.2;

/// Results of a few pixels.
pub(super) struct LitCheck {
    pixels: Vec<Pixel>,
}

#[derive(Clone, Copy, Default)]
struct Pixel {
    radiance: Rgb,
    /// Number of its paths that met a surface.
    met: u32,
    /// Sum of the squared distances of these surfaces, scene units squared.
    distance2: f32,
}

impl LitCheck {
    /// Checks an image with the aspect ratio of `resolution`.
    pub fn new(scene: &Scene, accel: &dyn Intersect, [width, height]: [u32; 2]) -> Self {
        let shrink = (PIXELS / (width as f32 * height as f32)).sqrt();
        let [width, height] = [width, height].map(|n| ((n as f32 * shrink).ceil() as u32).max(1));
        let tracer = CheckTracer { scene, accel, view: scene.camera.view(width, height) };
        let key = StreamKey::new(0, Stream::LitCheck, 0);
        let pixel = |index: u32| {
            let mut rng = key.rng(index.into());
            let mut pixel = Pixel::default();
            (0..PATHS).for_each(|_| {
                tracer.add_path([index % width, index / width], &mut pixel, &mut rng)
            });
            pixel
        };
        Self { pixels: (0..width * height).into_par_iter().map(pixel).collect() }
    }

    /// Share of the pixels with a surface that are not black in a preview; 1 if no pixel has a
    /// surface.
    pub fn lit_share(&self) -> f64 {
        let radiances: Vec<Rgb> = self.pixels.iter().map(|pixel| pixel.radiance).collect();
        let least = BLACK / auto_exposure(&radiances);
        let seen = self.pixels.iter().filter(|pixel| pixel.met > 0);
        let lit = seen.clone().filter(|pixel| luminance(pixel.radiance) >= least).count();
        match seen.count() {
            0 => 1.0,
            seen => lit as f64 / seen as f64,
        }
    }

    /// Geometric mean of the radiance of lit pixels, W/(m^2 sr); `None` if no pixel is lit.
    pub fn typical_radiance(&self) -> Option<f32> {
        let radiances: Vec<Rgb> = self.pixels.iter().map(|pixel| pixel.radiance).collect();
        let is_lit = radiances.iter().any(|radiance| luminance(*radiance) > 0.0);
        // The bounds leave room for the power of an environment.
        is_lit.then(|| (EXPOSED / auto_exposure(&radiances)).clamp(1e-12, 1e12))
    }

    /// Mean squared distance of the visible surfaces, scene units squared; 0 if there are none.
    pub fn mean_distance2(&self) -> f32 {
        let met: u32 = self.pixels.iter().map(|pixel| pixel.met).sum();
        let sum: f32 = self.pixels.iter().map(|pixel| pixel.distance2).sum();
        sum / met.max(1) as f32
    }
}

struct CheckTracer<'a> {
    scene: &'a Scene,
    accel: &'a dyn Intersect,
    view: View,
}

impl CheckTracer<'_> {
    /// Adds a path to a pixel.
    fn add_path(&self, [x, y]: [u32; 2], pixel: &mut Pixel, rng: &mut Rng) {
        let [dx, dy] = rng.next_2d();
        let (mut ray, weight) = self.view.ray(x as f32 + dx, y as f32 + dy, rng.next_2d());
        let (mut radiance, mut throughput) = (Rgb::ZERO, Rgb::ONE);
        // Whether the start of the segment was not connected to lights, so that emission at its end
        // counts.
        let mut unconnected = true;
        for segment in 0..SEGMENTS {
            let hit = self.accel.closest_hit(&ray);
            if hit.is_miss() {
                if unconnected {
                    radiance += throughput * self.scene.lights().beyond(ray.direction);
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
            let sample = surface.bsdf.sample(&at, Transport::Radiance, Wanted::All, rng);
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

    /// Radiance by a connection to a light, of all lobes of finite density.
    fn connection(&self, surface: &Surface, rng: &mut Rng) -> Rgb {
        let bsdf = &surface.bsdf;
        if bsdf.spread().is_none() {
            return Rgb::ZERO;
        }
        let lights = self.scene.lights();
        let Some(light) = lights.connect(surface.position, surface.lit_side(), rng) else {
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

    /// Whether anything but glass is on a segment.
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
