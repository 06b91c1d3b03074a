//! A quick estimate of whether light reaches the surfaces that the camera sees.
//!
//! It traces few paths in few pixels and connects to lights through glass as if it were air. So it
//! distinguishes lit scenes from dark ones also where all light passes a bulb or a window.

use bdpm_core::accel::{Hit, Intersect, Ray};
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::base::rng::{Rng, Stream, StreamKey};
use bdpm_core::image_io::auto_exposure;
use bdpm_core::scene::{LightSample, Receiver, Scene};
use bdpm_core::transport::path_walker::{self, PathVisitor};
use glam::Vec3;
use rayon::prelude::*;

/// Approximate number of pixels.
const PIXELS: f32 = 1000.0;
/// Paths per pixel.
const PATHS: u32 = 6;
/// Maximum number of segments of a path.
const SEGMENTS: u32 = 6;
/// Maximum number of glass surfaces that a connection passes through.
const PANES: u32 = 16;
/// Share of display white below which a pixel looks black: a fiftieth of the key of the preview's
/// exposure.
const BLACK: f32 = 0.004;

/// Share of display white of the geometric mean in an exposed preview.
const EXPOSED: f32 = 0.2;

/// Estimates of a few pixels.
pub(super) struct LitCheck {
    pixels: Vec<Pixel>,
}

#[derive(Clone, Copy, Default)]
struct Pixel {
    radiance: Rgb,
    /// Number of its paths that met a surface.
    met: u32,
    /// Sum of the squared distances to these surfaces, scene units squared.
    distance2: f32,
}

impl LitCheck {
    /// Traces the paths for an image of this resolution. Only its aspect ratio matters.
    pub fn new(scene: &Scene, accel: &dyn Intersect, [width, height]: [u32; 2]) -> Self {
        let shrink = (PIXELS / (width as f32 * height as f32)).sqrt();
        let [width, height] = [width, height].map(|n| ((n as f32 * shrink).ceil() as u32).max(1));
        let view = scene.camera.view(width, height);
        let key = StreamKey::new(0, Stream::LitCheck, 0);
        let pixel = |index: u32| {
            let mut rng = key.rng(index.into());
            let mut pixel = Pixel::default();
            let [x, y] = [index % width, index / width].map(|pixel| pixel as f32);
            for _ in 0..PATHS {
                let [dx, dy] = rng.next_2d();
                let (ray, weight) = view.ray(x + dx, y + dy, rng.next_2d());
                if weight == 0.0 {
                    continue;
                }
                let eye = &mut Eye { scene, pixel: &mut pixel };
                let radiance = path_walker::radiance(scene, accel, ray, &mut rng, eye);
                let radiance = radiance * (weight / PATHS as f32);
                if radiance.is_finite() {
                    pixel.radiance += radiance;
                }
            }
            pixel
        };
        Self { pixels: (0..width * height).into_par_iter().map(pixel).collect() }
    }

    /// Share of the pixels with a surface that are not black in a preview; 1 if no pixel shows a
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

    /// Geometric mean of the radiance of lit pixels, W/(m^2 sr); `None` if none is lit.
    pub fn typical_radiance(&self) -> Option<f32> {
        let radiances: Vec<Rgb> = self.pixels.iter().map(|pixel| pixel.radiance).collect();
        let is_lit = radiances.iter().any(|radiance| luminance(*radiance) > 0.0);
        // Within what leaves room for the power of an environment.
        is_lit.then(|| (EXPOSED / auto_exposure(&radiances)).clamp(1e-12, 1e12))
    }

    /// Mean square of the distances of the surfaces, scene units squared; 0 without surfaces.
    pub fn mean_distance2(&self) -> f32 {
        let met: u32 = self.pixels.iter().map(|pixel| pixel.met).sum();
        let sum: f32 = self.pixels.iter().map(|pixel| pixel.distance2).sum();
        sum / met.max(1) as f32
    }
}

/// Looks at one pixel.
struct Eye<'a> {
    scene: &'a Scene,
    pixel: &'a mut Pixel,
}

impl PathVisitor for Eye<'_> {
    const MAX_SEGMENTS: u32 = SEGMENTS;

    fn hit(&mut self, accel: &dyn Intersect, ray: &Ray, segment: u32) -> Hit {
        let hit = accel.closest_hit(ray);
        if segment == 0 && !hit.is_miss() {
            self.pixel.met += 1;
            self.pixel.distance2 += hit.t * hit.t;
        }
        hit
    }

    fn sample_light(&self, at: Receiver, rng: &mut Rng) -> Option<LightSample> {
        self.scene.lights().connect(at, rng)
    }

    /// Tests whether anything but glass blocks the light.
    fn is_blocked(&self, accel: &dyn Intersect, end: Vec3, light: &LightSample) -> bool {
        let mut ray = Ray::segment(end, light.target);
        for _ in 0..PANES {
            let hit = accel.closest_hit(&ray);
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

    fn survival(&self, _: u32, _: Rgb) -> Option<f32> {
        None
    }
}
