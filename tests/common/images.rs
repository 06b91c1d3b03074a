//! Images by different ways, and whether they are the same.

use super::*;
use bdpm::film::Film;
use bdpm::reference::PathTracer;

/// Means and variances of the means, by pixel, luminance.
#[derive(Clone)]
pub struct Pixels {
    pub mean: Vec<f64>,
    pub variance: Vec<f64>,
}

impl Pixels {
    fn new(film: &Film) -> Self {
        let mut mean = vec![0.0; film.pixels()];
        film.for_each_pixel(|x, y, sums| {
            mean[film.index(x, y)] = luminance(sums.radiance) / film.iterations as f64;
        });
        Self { mean, variance: film.variance_of_mean().unwrap() }
    }

    /// By the path tracer, of so many paths in each pixel.
    pub fn traced(scene: &Scene, accel: &dyn Intersect, settings: &Settings, paths: u32) -> Self {
        let mut tracer = PathTracer::new(scene, accel, settings);
        (0..64).for_each(|_| tracer.iterate(paths / 64));
        Self::new(tracer.film())
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
            for _ in 0..iterations {
                assert!(renderer.iterate(Measure::Off).non_finite.is_empty());
            }
            Self::new(renderer.film())
        };
        let radius = settings.radius;
        let (large, small) =
            (at(radius, settings.seed), at(radius * 0.5f32.sqrt(), settings.seed + 1));
        let both = |of: fn(f64, f64) -> f64, a: &[f64], b: &[f64]| {
            a.iter().zip(b).map(|(&a, &b)| of(a, b)).collect()
        };
        Self {
            mean: both(|a, b| 2.0 * a - b, &small.mean, &large.mean),
            variance: both(|a, b| 4.0 * a + b, &small.variance, &large.variance),
        }
    }

    /// How far they are from others.
    pub fn against(&self, expected: &Self) -> Difference {
        let count = self.mean.len() as f64;
        let (mut off, mut variance, mut total, mut z2) = (0.0, 0.0, 0.0, 0.0);
        for i in 0..self.mean.len() {
            let own = self.variance[i] + expected.variance[i];
            let difference = self.mean[i] - expected.mean[i];
            // What is left of the bias at edges of light and objects.
            let allowed = 0.02 * expected.mean[i];
            // A black pixel has no variance, and nothing but 0 is no deviation then.
            let excess = (difference.abs() - allowed).max(0.0);
            if excess > 0.0 {
                if excess.powi(2) / own > 9.0 {
                    println!(
                        "pixel {i}: {} +- {}, {} +- {}",
                        self.mean[i],
                        self.variance[i].sqrt(),
                        expected.mean[i],
                        expected.variance[i].sqrt()
                    );
                }
                z2 += excess.powi(2) / own / count;
            }
            off += difference;
            variance += own;
            total += expected.mean[i];
        }
        Difference { off: off / total, error: variance.sqrt() / total, z2 }
    }
}

/// The difference of two images.
#[derive(Clone, Copy, Debug)]
pub struct Difference {
    /// Of the mean luminance, relative.
    pub off: f64,
    /// Its standard error.
    pub error: f64,
    /// Mean square of the pixels' deviations beyond 2 % over their standard error; about 1 or less.
    pub z2: f64,
}
