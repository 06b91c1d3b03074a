//! The best numbers of light and camera paths.
//!
//! An iteration with `N_F` light paths and `n_p` camera paths in pixel `p` takes the time `tau` of
//! [`TimeModel`]. It leaves the variance `V_p = a_p/(N_F n_p) + b_p/n_p + f_p/N_F` of
//! [`Coefficients`] in the pixel: equation (1). After a time `T` of rendering the variance is
//! `tau V_p / T`, hence the best counts minimize the *cost* `tau * aggregate(V)`, equation (80) of
//! docs/explanation/theory.md.
//!
//! Both `tau` and every `V_p` are sums of products of powers of the counts, with coefficients of at
//! least 0 (posynomials). The logarithms of such sums are convex in the logarithms of the counts,
//! and so are those of their products, means, maxima and powers. So there is one minimum if counts
//! need not be whole: searches along one count inside searches along the other find it. It is a
//! lower bound of what whole numbers reach. Only the percentile of [`Objective::MaxRms`] is not
//! convex. Section 20 of docs/explanation/theory.md has the details.

pub mod compared;
pub mod measured;
mod objective;
mod per_pixel;
pub mod predict;
mod search;
mod uniform;

use crate::timing::TimeModel;
use bdpm_core::noise::Coefficients;
pub use objective::Objective;
use search::Criterion;
use serde::Serialize;
use std::borrow::Cow;
use std::ops::RangeInclusive;

/// Highest number of camera paths per pixel that is considered: far more than can pay.
pub const MAX_CAMERA_PATHS: u32 = 1 << 16;

/// Among counts whose cost exceeds the least by this fraction, the shortest iteration is chosen:
/// the optimum is flat, and a short iteration ends near the time that was asked for.
pub const NEAR_OPTIMUM: f64 = 0.01;

/// Fewest iterations that should fit in a rendering time. They average out the outliers of a single
/// one, and no coefficient of 0 leads to infinite counts.
const MIN_ITERATIONS: f64 = 16.0;

/// The counts to choose from.
#[derive(Clone, Debug, PartialEq)]
pub struct CountLimits {
    /// `N_F`; from 1.
    pub light_paths: RangeInclusive<u32>,
    /// Camera paths per pixel; from 1.
    pub camera_paths: RangeInclusive<u32>,
    /// Longest iteration, seconds; infinite for no limit. If even the fewest paths take longer, the
    /// fewest are chosen.
    pub iteration_time: f64,
}

/// Time and noise at some counts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Evaluated<C> {
    /// `N_F`.
    pub light_paths: u32,
    /// `N_B`.
    pub camera_paths: C,
    /// Time of one iteration, seconds.
    pub iteration_time: f64,
    /// Aggregate variance of one iteration, squared luminance.
    pub variance: f64,
    /// `iteration_time * variance`: variance after one second of rendering.
    pub cost: f64,
}

/// One number of camera paths for all pixels of the image.
pub type Uniform = Evaluated<u32>;

/// A number of camera paths for each pixel of the region, the lowest number outside.
pub type PerPixel = Evaluated<Vec<u32>>;

/// Pixels that a search for uniform counts looks at; of more, an even selection. A prime number, so
/// that the selection does not follow the rows of the image.
const MAX_PIXELS: usize = 4093;

/// The search for the best counts for the pixels of a region.
#[derive(Clone, Debug)]
pub struct Problem {
    /// Coefficients times the pixel's weight; the weights have mean 1.
    pixels: Vec<Coefficients>,
    mean: Coefficients,
    /// Pixels of the region that each of `pixels` stands for.
    each: f64,
    /// Pixels of the image outside the region.
    outside: f64,
    objective: Objective,
    time: TimeModel,
    /// Bounds of `N_F`.
    light_paths: [u32; 2],
    /// Bounds of the camera paths per pixel.
    camera_paths: [u32; 2],
    iteration_time: f64,
}

impl Problem {
    /// `coefficients` and `luminance` (W/(m^2 sr)) belong to the pixels of a region of the image of
    /// `time.pixels` pixels. Coefficients of single pixels are noisy: pool them over neighborhoods
    /// first. Negative coefficients count as 0.
    ///
    /// # Panics
    /// If the numbers of coefficients and luminances differ.
    pub fn new(
        coefficients: &[Coefficients],
        luminance: &[f64],
        objective: Objective,
        time: TimeModel,
        bounds: &CountLimits,
    ) -> Self {
        assert_eq!(coefficients.len(), luminance.len(), "each pixel has a luminance");
        let weights = objective.weights(luminance);
        let weigh = |(c, weight): (&Coefficients, f64)| c.clamped() * weight;
        let pixels: Vec<_> = coefficients.iter().zip(weights).map(weigh).collect();
        let count = pixels.len() as f64;
        let ordered = |range: &RangeInclusive<u32>| {
            let least = (*range.start()).max(1);
            [least, (*range.end()).max(least)]
        };
        Self {
            mean: pixels.iter().copied().sum::<Coefficients>() * (1.0 / count.max(1.0)),
            pixels,
            each: 1.0,
            outside: (time.pixels - count).max(0.0),
            objective,
            time,
            light_paths: ordered(&bounds.light_paths),
            camera_paths: ordered(&bounds.camera_paths),
            iteration_time: bounds.iteration_time,
        }
    }

    /// The problem if each of its values stands for this number of pixels with equal camera paths.
    #[must_use]
    pub fn of_squares(self, pixels: f64) -> Self {
        let covered = pixels * self.pixels.len() as f64;
        Self { each: pixels, outside: (self.time.pixels - covered).max(0.0), ..self }
    }

    /// Time, variance and cost of the same counts in every pixel.
    pub fn evaluate_uniform(&self, light_paths: u32, camera_paths: u32) -> Uniform {
        let (n_light, n_camera) = (f64::from(light_paths), f64::from(camera_paths));
        let iteration_time = self.time.iteration(n_light, n_camera);
        let variance = self.uniform_variance(n_light, n_camera);
        let cost = iteration_time * variance;
        Evaluated { light_paths, camera_paths, iteration_time, variance, cost }
    }

    /// Lowest time limit of an iteration that pays, seconds: the time of the best iteration with
    /// the fewest camera paths, but at most twice that of the fewest paths of both kinds. A shorter
    /// iteration saves light paths, but still pays for all camera paths.
    ///
    /// Twice is enough for a cost of at most twice the least at these camera paths: at `s N_F = t`
    /// it is `2 (t q + s p)`, and the least is `(sqrt(t q) + sqrt(s p))^2`.
    // theory.md (86)
    pub fn least_sensible_time(&self) -> f64 {
        let camera_paths = [self.camera_paths[0]; 2];
        let unlimited = Self { camera_paths, iteration_time: f64::INFINITY, ..self.clone() };
        let fewest = [self.light_paths[0], self.camera_paths[0]].map(f64::from);
        unlimited.uniform().iteration_time.min(2.0 * self.time.iteration(fewest[0], fewest[1]))
    }

    /// The problem with iterations of at most `seconds`, but no less than
    /// [`Self::least_sensible_time`].
    fn limited_to(&self, seconds: f64) -> Self {
        Self { iteration_time: seconds.max(self.least_sensible_time()), ..self.clone() }
    }

    /// Time, variance and cost of `camera_paths`, one number for each pixel of the region.
    ///
    /// # Panics
    /// If the numbers of `camera_paths` and of pixels differ.
    pub fn evaluate(&self, light_paths: u32, camera_paths: Vec<u32>) -> PerPixel {
        assert_eq!(camera_paths.len(), self.pixels.len(), "each pixel has a count");
        let n_light = f64::from(light_paths);
        let [base, per_path] = self.time_in_camera_paths(n_light);
        let paths: f64 = camera_paths.iter().map(|&n| f64::from(n)).sum();
        let iteration_time = base + per_path * paths;
        let variances =
            self.pixels.iter().zip(&camera_paths).map(|(c, &n)| c.variance(n_light, f64::from(n)));
        let variance = self.objective.aggregate(variances);
        let cost = iteration_time * variance;
        Evaluated { light_paths, camera_paths, iteration_time, variance, cost }
    }

    /// Seconds per iteration without camera paths in the region, and per camera path in each of
    /// `pixels`.
    // theory.md (82), `T_0` and `c`
    fn time_in_camera_paths(&self, n_light: f64) -> [f64; 2] {
        let TimeModel { fixed, light_path, camera_path, look_up, merge_pair, .. } = self.time;
        let per_path = camera_path + look_up + merge_pair * n_light;
        let outside = self.outside * f64::from(self.camera_paths[0]);
        [fixed + light_path * n_light + per_path * outside, per_path * self.each]
    }

    fn uniform_variance(&self, n_light: f64, n_camera: f64) -> f64 {
        match self.objective {
            // The mean variance is the variance of the mean coefficients.
            Objective::Pooled | Objective::Relative => self.mean.variance(n_light, n_camera),
            _ => {
                self.objective.aggregate(self.pixels.iter().map(|c| c.variance(n_light, n_camera)))
            }
        }
    }

    fn is_convex(&self) -> bool {
        self.objective.is_convex(self.pixels.len())
    }

    fn sampled(&self) -> Cow<'_, Self> {
        self.at_most(MAX_PIXELS)
    }

    /// The problem for at most `max_pixels` pixels, each standing for several.
    fn at_most(&self, max_pixels: usize) -> Cow<'_, Self> {
        let count = self.pixels.len();
        if count <= max_pixels {
            return Cow::Borrowed(self);
        }
        let pixels = (0..max_pixels).map(|i| self.pixels[i * count / max_pixels]).collect();
        let each = self.each * (count as f64 / max_pixels as f64);
        Cow::Owned(Self { pixels, each, ..*self })
    }

    /// Whether even the fewest paths take longer than allowed.
    fn is_infeasible(&self) -> bool {
        let [n_light, n_camera] = [self.light_paths[0], self.camera_paths[0]].map(f64::from);
        !self.criterion().allows(self.time.iteration(n_light, n_camera))
    }

    fn criterion(&self) -> Criterion {
        Criterion { longest: self.iteration_time, highest_cost: None }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_time_budget_keeps_the_light_paths_that_camera_paths_need() {
        // One camera path per pixel takes a second; ten seconds fit no 64 iterations of that.
        let time = TimeModel {
            fixed: 0.01,
            light_path: 1e-5,
            camera_path: 1.0 / 9.0,
            look_up: 0.0,
            merge_pair: 1e-9,
            pixels: 9.0,
        };
        let problem_of = |coefficients: Coefficients, iteration_time| {
            let (light_paths, camera_paths) = (2..=1 << 20, 1..=1 << 10);
            let bounds = CountLimits { light_paths, camera_paths, iteration_time };
            Problem::new(&[coefficients; 9], &[1.0; 9], Objective::Pooled, time, &bounds)
        };
        let problem = |time| problem_of(Coefficients { a: 1.0, b: 1e-3, f: 1e-2 }, time);
        let limit = 10.0 / 64.0;
        assert_eq!(problem(limit).uniform().light_paths, 2, "without a lowest limit");
        let least = problem(f64::INFINITY).least_sensible_time();
        let best = problem(limit.max(least)).uniform();
        // Along N_B = 1 by hand: sqrt(t p / (s q)).
        let expected = (1.01 * 1.01 / (1e-5 * 1e-3f64)).sqrt();
        assert_eq!(best.camera_paths, 1);
        assert!((f64::from(best.light_paths) / expected - 1.0).abs() < 1e-3, "{best:?} {expected}");
        assert!(best.cost < 1e-2 * problem(limit).uniform().cost);
        // Without noise of camera paths, light paths would take all time.
        let dark = problem_of(Coefficients { a: 0.0, b: 0.0, f: 1.0 }, f64::INFINITY);
        assert!((dark.least_sensible_time() / 2.02 - 1.0).abs() < 1e-3);
    }
}
