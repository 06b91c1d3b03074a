//! Images by different ways, and whether they are the same.

use super::*;
use bdpm::image::film::Film;
use bdpm::transport::reference::PathTracer;

/// Means over iterations with their errors, luminance.
#[derive(Clone)]
pub struct Pixels {
    pub mean: Vec<f64>,
    /// Of the means.
    pub variance: Vec<f64>,
    /// Of the sum of the means, which share light paths.
    pub variance_of_sum: f64,
}

/// What images are made of.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    pub scene: &'a Scene,
    pub accel: &'a dyn Intersect,
    pub settings: &'a Settings,
    /// The pixels that count; all if there is none.
    pub region: &'a [usize],
}

impl Subject<'_> {
    /// By the path tracer, of so many paths in each pixel.
    pub fn traced(&self, paths: u32) -> Pixels {
        let mut tracer = PathTracer::new(self.scene, self.accel, self.settings);
        let mut totals = Totals::default();
        for _ in 0..64 {
            tracer.iterate(paths / 64);
            totals.add(tracer.film(), self.region);
        }
        Pixels::new(tracer.film(), &totals.each, self.region)
    }

    /// By the renderer.
    pub fn rendered(&self, settings: Settings, iterations: u64) -> Pixels {
        let mut renderer = Renderer::new(self.scene, self.accel, settings).unwrap();
        let mut totals = Totals::default();
        for _ in 0..iterations {
            assert!(renderer.iterate(Measure::Off).non_finite.is_empty());
            totals.add(renderer.film(), self.region);
        }
        Pixels::new(renderer.film(), &totals.each, self.region)
    }

    /// By the renderer, without the merge bias that falls as the squared radius: from that of the
    /// settings and one that is smaller by a root of two.
    pub fn extrapolated(&self, iterations: u64) -> Pixels {
        let Settings { radius, seed, .. } = *self.settings;
        let at = |radius: f32, seed: u64| {
            self.rendered(
                Settings { radius, caustic_radius: radius, seed, ..self.settings.clone() },
                iterations,
            )
        };
        let (large, small) = (at(radius, seed), at(radius * 0.5f32.sqrt(), seed + 1));
        let pairs = |a: &[f64], b: &[f64], of: fn(f64, f64) -> f64| {
            a.iter().zip(b).map(|(&a, &b)| of(a, b)).collect()
        };
        Pixels {
            mean: pairs(&small.mean, &large.mean, |a, b| 2.0 * a - b),
            variance: pairs(&small.variance, &large.variance, |a, b| 4.0 * a + b),
            variance_of_sum: 4.0 * small.variance_of_sum + large.variance_of_sum,
        }
    }
}

impl Pixels {
    /// Of the film after iterations whose sums over the region are `totals`.
    fn new(film: &Film, totals: &[f64], region: &[usize]) -> Self {
        let variance_of_sum = Estimate::from_samples(totals).error.powi(2);
        let inside = |values: Vec<f64>| match region {
            [] => values,
            _ => region.iter().map(|&i| values[i]).collect(),
        };
        let scale = 1.0 / film.iterations as f64;
        let mean = sums(film).into_iter().map(|sum| scale * sum).collect();
        let variance = film.variance_of_mean().unwrap();
        Self { mean: inside(mean), variance: inside(variance), variance_of_sum }
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

/// Sums over the region of one iteration after the other.
#[derive(Default)]
struct Totals {
    sum: f64,
    each: Vec<f64>,
}

impl Totals {
    fn add(&mut self, film: &Film, region: &[usize]) {
        let sums = sums(film);
        let sum = match region {
            [] => sums.iter().sum::<f64>(),
            _ => region.iter().map(|&i| sums[i]).sum(),
        };
        self.each.push(sum - self.sum);
        self.sum = sum;
    }
}

/// Sums over the iterations by pixel, luminance.
fn sums(film: &Film) -> Vec<f64> {
    let mut all = vec![0.0; film.pixels()];
    film.for_each_pixel(|x, y, sums| all[film.index(x, y)] = luminance(sums.radiance));
    all
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
