//! Images by different ways, and whether they are the same.

use super::*;
use bdpm::film::radiance::Film;
use bdpm::transport::reference::PathTracer;
use std::sync::Arc;

/// Means over iterations with their errors, luminance.
#[derive(Clone)]
pub struct Pixels {
    pub mean: Vec<f64>,
    /// Standard errors of the means.
    pub variance: Vec<f64>,
    /// Variance of the sum of the means; pixels share light paths.
    pub variance_of_sum: f64,
}

/// Everything that an image is made from.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    pub scene: &'a Arc<Scene>,
    pub accel: &'a Arc<dyn Intersect>,
    pub settings: &'a Settings,
    /// The pixels that count; all if there is none.
    pub region: &'a [usize],
}

impl Subject<'_> {
    /// By the path tracer, of so many paths in each pixel.
    pub fn traced(&self, paths: u32) -> Pixels {
        const ITERATIONS: u32 = 64;
        let mut tracer = PathTracer::new(self.scene, &**self.accel, self.settings);
        let mut last = Last::default();
        self.pixels((0..ITERATIONS).map(|_| {
            tracer.iterate(paths / ITERATIONS);
            last.of(tracer.film())
        }))
    }

    /// By the renderer.
    pub fn rendered(&self, settings: Settings, iterations: u64) -> Pixels {
        let mut images = images(self.renderer(settings));
        self.pixels((0..iterations).map(|_| images()))
    }

    /// By the renderer, without the merge bias that falls as the squared radius: from that of the
    /// settings and one that is smaller by a root of two. Both take the same paths, so that most of
    /// what the difference would add to the noise cancels.
    pub fn extrapolated(&self, iterations: u64) -> Pixels {
        let large = self.renderer(self.settings.clone());
        let Settings { radius, caustic_radius, .. } = *self.settings;
        let [radius, caustic_radius] = [radius, caustic_radius].map(|r| 0.5f32.sqrt() * r);
        let small = Settings { radius, caustic_radius, guide: 0, ..self.settings.clone() };
        let small = self.renderer(small).guided(large.guide().cloned());
        let [mut large, mut small] = [large, small].map(images);
        self.pixels((0..iterations).map(|_| {
            let pairs = small().into_iter().zip(large());
            pairs.map(|(small, large)| 2.0 * small - large).collect()
        }))
    }

    fn renderer(&self, settings: Settings) -> Renderer {
        Renderer::new(self.scene, self.accel, settings).unwrap()
    }

    /// From the images of iterations, which are independent.
    fn pixels(&self, images: impl Iterator<Item = Vec<f64>>) -> Pixels {
        let mut samples: Vec<Vec<f64>> = Vec::new();
        let mut sums = Vec::new();
        for image in images {
            let image = inside(self.region, &image);
            sums.push(image.iter().sum());
            samples.resize(image.len(), Vec::new());
            samples.iter_mut().zip(image).for_each(|(samples, value)| samples.push(value));
        }
        let each: Vec<_> = samples.iter().map(|samples| Estimate::from_samples(samples)).collect();
        Pixels {
            mean: each.iter().map(|pixel| pixel.mean).collect(),
            variance: each.iter().map(|pixel| pixel.error.powi(2)).collect(),
            variance_of_sum: Estimate::from_samples(&sums).error.powi(2),
        }
    }
}

/// The images of one iteration after the other.
fn images(mut renderer: Renderer) -> impl FnMut() -> Vec<f64> {
    let mut last = Last::default();
    move || {
        assert!(renderer.iterate(Measure::Off).non_finite.is_empty());
        last.of(renderer.film())
    }
}

/// The values of a region's pixels; all if there is none.
pub fn inside(region: &[usize], values: &[f64]) -> Vec<f64> {
    match region {
        [] => values.to_vec(),
        _ => region.iter().map(|&i| values[i]).collect(),
    }
}

impl Pixels {
    /// Compares these pixels with expected ones.
    pub fn against(&self, expected: &Self) -> Difference {
        let sum = |pixels: &Self| pixels.mean.iter().sum::<f64>();
        let (found, total) = (sum(self), sum(expected));
        let ratio = found / total;
        let count = self.mean.len() as f64;
        let error = (self.variance_of_sum + expected.variance_of_sum).sqrt() / total;
        let (mut z2, mut errors) = (0.0, 0.0);
        for i in 0..self.mean.len() {
            // Light paths that all pixels share move them together, and so does a pixel that is far
            // off.
            let wanted = ratio * expected.mean[i];
            let own = self.variance[i] + ratio * ratio * expected.variance[i];
            let variance = own + (error * expected.mean[i]).powi(2);
            errors += variance.sqrt();
            // Allow for the bias that is left at edges of light and objects. A black pixel has no
            // variance; only 0 is no deviation then.
            let excess = ((self.mean[i] - wanted).abs() - 0.02 * wanted).max(0.0);
            if excess > 0.0 {
                z2 += excess.powi(2) / variance / count;
            }
        }
        Difference { off: ratio - 1.0, error, pixel_error: errors / total, z2 }
    }
}

/// Sums over the iterations so far by pixel, luminance.
#[derive(Default)]
struct Last(Vec<f64>);

impl Last {
    /// The image of the last iteration alone.
    fn of(&mut self, film: &Film) -> Vec<f64> {
        let sums = film.sums.map_rows(|pixel| luminance(pixel.radiance));
        self.0.resize(sums.len(), 0.0);
        let image = sums.iter().zip(&self.0).map(|(sum, before)| sum - before).collect();
        self.0 = sums;
        image
    }
}

/// The difference of two images.
#[derive(Clone, Copy, Debug)]
pub struct Difference {
    /// Relative deviation of the mean luminance.
    pub off: f64,
    /// Its standard error.
    pub error: f64,
    /// Mean standard error of the pixels' deviations, over the mean luminance.
    pub pixel_error: f64,
    /// Mean square of the pixels' deviations beyond 2 % of the value, over their variance, after
    /// the mean luminance was made the same; about 1 or less.
    pub z2: f64,
}

impl std::fmt::Display for Difference {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { off, error, pixel_error, z2 } = self;
        write!(f, "{off:+.4} +- {error:.4}, z^2 {z2:.2}, a pixel +- {pixel_error:.3}")
    }
}
