//! Images by different ways, and whether they are the same.

use super::*;
use bdpm::film::Film;
use bdpm::reference::PathTracer;

/// Means over iterations with their errors, luminance.
#[derive(Clone)]
pub struct Pixels {
    pub mean: Vec<f64>,
    /// Of the means.
    pub variance: Vec<f64>,
    /// Of the sum of all pixels, which share light paths.
    pub variance_of_sum: f64,
}

impl Pixels {
    /// The film after iterations whose sums over all pixels are `totals`.
    fn new(film: &Film, totals: &[f64]) -> Self {
        let mut mean = vec![0.0; film.pixels()];
        film.for_each_pixel(|x, y, sums| {
            mean[film.index(x, y)] = luminance(sums.radiance) / film.iterations as f64;
        });
        let variance_of_sum = Estimate::from_samples(totals).error.powi(2);
        Self { mean, variance: film.variance_of_mean().unwrap(), variance_of_sum }
    }

    /// By the path tracer, of so many paths in each pixel.
    pub fn traced(scene: &Scene, accel: &dyn Intersect, settings: &Settings, paths: u32) -> Self {
        let mut tracer = PathTracer::new(scene, accel, settings);
        let mut totals = Totals::default();
        for _ in 0..64 {
            tracer.iterate(paths / 64);
            totals.add(tracer.film());
        }
        Self::new(tracer.film(), &totals.each)
    }

    /// By the renderer, without the merge bias that falls as the squared radius: from that of the
    /// settings and one that is smaller by a root of two.
    pub fn extrapolated(
        scene: &Scene,
        accel: &dyn Intersect,
        settings: &Settings,
        iterations: u64,
    ) -> Self {
        let at = |radius: f32, seed: u64| {
            let settings = Settings { radius, seed, ..settings.clone() };
            let mut renderer = Renderer::new(scene, accel, settings).unwrap();
            let mut totals = Totals::default();
            for _ in 0..iterations {
                assert!(renderer.iterate(Measure::Off).non_finite.is_empty());
                totals.add(renderer.film());
            }
            Self::new(renderer.film(), &totals.each)
        };
        let Settings { radius, seed, .. } = *settings;
        let (large, small) = (at(radius, seed), at(radius * 0.5f32.sqrt(), seed + 1));
        let pairs = |a: &[f64], b: &[f64], of: fn(f64, f64) -> f64| {
            a.iter().zip(b).map(|(&a, &b)| of(a, b)).collect()
        };
        Self {
            mean: pairs(&small.mean, &large.mean, |a, b| 2.0 * a - b),
            variance: pairs(&small.variance, &large.variance, |a, b| 4.0 * a + b),
            variance_of_sum: 4.0 * small.variance_of_sum + large.variance_of_sum,
        }
    }

    /// How far they are from others.
    pub fn against(&self, expected: &Self) -> Difference {
        let sum = |pixels: &Self| pixels.mean.iter().sum::<f64>();
        let (found, total) = (sum(self), sum(expected));
        let ratio = found / total;
        let count = self.mean.len() as f64;
        let mut z2 = 0.0;
        for i in 0..self.mean.len() {
            // Light paths that all pixels share move them together.
            let wanted = ratio * expected.mean[i];
            let variance = self.variance[i] + ratio * ratio * expected.variance[i];
            // What is left of the bias at edges of light and objects. A black pixel has no variance,
            // and nothing but 0 is no deviation then.
            let excess = ((self.mean[i] - wanted).abs() - 0.02 * wanted).max(0.0);
            if excess > 0.0 {
                z2 += excess.powi(2) / variance / count;
            }
        }
        let error = (self.variance_of_sum + expected.variance_of_sum).sqrt() / total;
        Difference { off: ratio - 1.0, error, z2 }
    }
}

/// Sums over all pixels of one iteration after the other.
#[derive(Default)]
struct Totals {
    sum: f64,
    each: Vec<f64>,
}

impl Totals {
    fn add(&mut self, film: &Film) {
        let sum = film.mean_luminance() * (film.pixels() as f64 * film.iterations as f64);
        self.each.push(sum - self.sum);
        self.sum = sum;
    }
}

/// The difference of two images.
#[derive(Clone, Copy, Debug)]
pub struct Difference {
    /// Of the mean luminance, relative.
    pub off: f64,
    /// Its standard error.
    pub error: f64,
    /// Mean square of the pixels' deviations beyond 2 % of the value, over their variance, after the
    /// mean luminance was made the same; about 1 or less.
    pub z2: f64,
}
