//! The best numbers of light and camera paths.
//!
//! An iteration with `N_F` light paths and `n_p` camera paths in pixel `p` takes the time `tau` of
//! [`TimeModel`] and leaves the variance `V_p = a_p/(N_F n_p) + b_p/n_p + f_p/N_F` of
//! [`Coefficients`] in the pixel: equation (1). After a time `T` of rendering the variance is `tau
// theory.md (80)
//! V_p / T`, hence the best counts minimize the *cost* `tau * aggregate(V)`.
//!
//! Both `tau` and every `V_p` are sums of products of powers of the counts, with coefficients of at
// theory.md, section 20
//! least 0 (posynomials). The logarithms of such sums are convex in the logarithms of the counts,
//! and so are those of their products, means, maxima and powers: without rounding to whole numbers
//! there is one minimum, searches along one count inside searches along the other find it, and it
//! is a lower bound of what whole numbers reach. Only the percentile of [`Objective::MaxRms`] is
//! not convex.

mod per_pixel;
mod pixel;
pub mod predict;
mod search;
mod fixed_light;
pub mod measured;
mod uniform;
mod integer;

use crate::film::radiance::luminance_weights;
use crate::noise::Coefficients;
use crate::timing::TimeModel;
use search::Criterion;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::ops::RangeInclusive;

/// What is made of the variances of the pixels: the aggregate that counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Objective {
    /// Mean variance, `mean_p V_p`.
    #[default]
    Pooled,
    /// Mean variance weighted by `1/(L_p^2 + 0.01 mean(L)^2)`: dark pixels count as much as bright
    /// ones.
    Relative,
    /// The paper's mean RMS, squared: `(mean_p sqrt(V_p))^2`.
    MeanRms,
    /// The 99.5th percentile of the variances; for fewer than 200 pixels their maximum.
    MaxRms,
}

impl Objective {
    /// Weights of the variances of pixels of these luminances, W/(m^2 sr); their mean is 1.
    fn weights(self, luminance: &[f64]) -> Vec<f64> {
        match self {
            Self::Relative => relative_weights(luminance),
            _ => vec![1.0; luminance.len()],
        }
    }

    /// The aggregate of weighted variances, squared luminance.
    /// theory.md, section 20 (table of A).
    fn aggregate(self, variances: impl ExactSizeIterator<Item = f64>) -> f64 {
        let count = variances.len().max(1) as f64;
        let root = |variance: f64| variance.max(0.0).sqrt();
        match self {
            Self::Pooled | Self::Relative => variances.sum::<f64>() / count,
            Self::MeanRms => (variances.map(root).sum::<f64>() / count).powi(2),
            Self::MaxRms => percentile(&mut variances.collect::<Vec<_>>()),
        }
    }
}

/// The counts to choose from.
#[derive(Clone, Debug, PartialEq)]
pub struct CountLimits {
    /// `N_F`; from 1.
    pub light_paths: RangeInclusive<u32>,
    /// Camera paths per pixel; from 1.
    pub camera_paths: RangeInclusive<u32>,
    /// Longest iteration, seconds; infinite for no limit. Where even the fewest paths take longer,
    /// the fewest are chosen.
    pub iteration_time: f64,
}

/// The same number of camera paths in every pixel of the image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Uniform {
    /// `N_F`.
    pub light_paths: u32,
    /// `N_B`.
    pub camera_paths: u32,
    /// Time of one iteration, seconds.
    pub iteration_time: f64,
    /// Aggregate variance of one iteration, squared luminance.
    pub variance: f64,
    /// `iteration_time * variance`: variance after one second of rendering.
    pub cost: f64,
}

/// A number of camera paths for each pixel of the region, the least number elsewhere.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PerPixel {
    /// `N_F`.
    pub light_paths: u32,
    /// Camera paths of each pixel of the region.
    pub camera_paths: Vec<u32>,
    /// Time of one iteration, seconds.
    pub iteration_time: f64,
    /// Aggregate variance of one iteration, squared luminance.
    pub variance: f64,
    /// `iteration_time * variance`: variance after one second of rendering.
    pub cost: f64,
}

/// Pixels that a search looks at; of more, an even selection. A prime number, so that the
/// selection does not follow the rows of the image.
const MOST_PIXELS: usize = 4093;

/// The same of one that may miss the best a little; prime as well.
const NEAR_PIXELS: usize = 1021;

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
    /// first. What is below 0 counts as 0.
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

    /// What the same counts everywhere lead to.
    pub fn evaluate_uniform(&self, light_paths: u32, camera_paths: u32) -> Uniform {
        let (n_light, n_camera) = (f64::from(light_paths), f64::from(camera_paths));
        let iteration_time = self.time.iteration(n_light, n_camera);
        let variance = self.uniform_variance(n_light, n_camera);
        let cost = iteration_time * variance;
        Uniform { light_paths, camera_paths, iteration_time, variance, cost }
    }

    /// Time of the best iteration with the fewest camera paths, but at most twice that of the fewest
    /// paths of both kinds, seconds. A shorter one saves light paths at the price of all that the
    /// camera paths cost: no limit should ask for it.
    ///
    /// Twice is enough for a cost of at most twice the least at these camera paths: at `s N_F = t` it
    /// is `2 (t q + s p)`, and the least is `(sqrt(t q) + sqrt(s p))^2`.
    /// theory.md (86).
    pub fn least_sensible_time(&self) -> f64 {
        let camera_paths = [self.camera_paths[0]; 2];
        let unlimited = Self { camera_paths, iteration_time: f64::INFINITY, ..self.clone() };
        let fewest = [self.light_paths[0], self.camera_paths[0]].map(f64::from);
        unlimited.uniform().iteration_time.min(2.0 * self.time.iteration(fewest[0], fewest[1]))
    }

    /// What a number of camera paths for each pixel of the region leads to.
    ///
    /// # Panics
    /// If there are not as many numbers as pixels.
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
        PerPixel { light_paths, camera_paths, iteration_time, variance, cost }
    }

    /// Seconds per iteration without camera paths in the region, and per camera path in each of
    /// `pixels`.
    /// theory.md (82), `T_0` and `c.
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

    /// The aggregate is convex in the logarithms of the counts.
    fn is_convex(&self) -> bool {
        self.objective != Objective::MaxRms || excluded(self.pixels.len()) == 0
    }

    /// The problem for at most [`MOST_PIXELS`] pixels, each standing for several.
    fn sampled(&self) -> Cow<'_, Self> {
        self.at_most(MOST_PIXELS)
    }

    /// The problem for at most so many pixels, each standing for several.
    fn at_most(&self, most: usize) -> Cow<'_, Self> {
        let count = self.pixels.len();
        if count <= most {
            return Cow::Borrowed(self);
        }
        let pixels = (0..most).map(|i| self.pixels[i * count / most]).collect();
        Cow::Owned(Self { pixels, each: count as f64 / most as f64, ..*self })
    }

    /// Even the fewest paths take longer than allowed.
    fn is_infeasible(&self) -> bool {
        let [n_light, n_camera] = [self.light_paths[0], self.camera_paths[0]].map(f64::from);
        !self.criterion().allows(self.time.iteration(n_light, n_camera))
    }

    fn criterion(&self) -> Criterion {
        Criterion::least_cost(self.iteration_time)
    }
}

/// [`luminance_weights`] scaled to the mean 1; all 1 for a black image.
/// theory.md, section 20 (`relative`).
fn relative_weights(luminance: &[f64]) -> Vec<f64> {
    let count = luminance.len() as f64;
    let weights = luminance_weights(luminance);
    let scale = count / weights.iter().sum::<f64>();
    // Neither 0/0 nor an infinite weight.
    let valid = scale.is_finite() && scale > 0.0;
    if valid { weights.iter().map(|w| w * scale).collect() } else { vec![1.0; luminance.len()] }
}

/// Values of `count` that lie above their 99.5th percentile.
fn excluded(count: usize) -> usize {
    count - (count * 199).div_ceil(200)
}

/// The value at the index `ceil(0.995 count) - 1` of the sorted values; 0 for none.
fn percentile(values: &mut [f64]) -> f64 {
    let above = excluded(values.len());
    match above {
        0 => values.iter().copied().fold(0.0, f64::max),
        _ => *values.select_nth_unstable_by(values.len() - above - 1, f64::total_cmp).1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_percentile_leaves_out_one_value_in_200() {
        for (count, expected) in [(0, 0.0), (1, 1.0), (199, 199.0), (200, 199.0), (1000, 995.0)] {
            let mut values: Vec<_> = (1..=count).rev().map(f64::from).collect();
            assert_eq!(percentile(&mut values), expected);
        }
    }

    #[test]
    fn relative_weights_prefer_dark_pixels_and_survive_black_ones() {
        let weights = relative_weights(&[0.0, 1.0, 2.0]);
        assert!((weights.iter().sum::<f64>() - 3.0).abs() < 1e-12);
        assert!((weights[0] / weights[1] - 101.0).abs() < 1e-9);
        assert_eq!(relative_weights(&[0.0; 3]), [1.0; 3]);
        assert!(relative_weights(&[]).is_empty());
    }

    #[test]
    fn objectives_are_written_in_kebab_case() {
        assert_eq!(serde_json::to_string(&Objective::MeanRms).unwrap(), "\"mean-rms\"");
        assert_eq!(Objective::default(), Objective::Pooled);
    }

    #[test]
    fn a_short_time_costs_camera_paths_and_not_the_light_paths_they_need() {
        // One camera path per pixel takes a second; ten seconds fit no 64 iterations of that.
        let coefficients = [Coefficients { a: 1.0, b: 1e-3, f: 1e-2 }; 9];
        let time = TimeModel {
            fixed: 0.01,
            light_path: 1e-5,
            camera_path: 1.0 / 9.0,
            look_up: 0.0,
            merge_pair: 1e-9,
            pixels: 9.0,
        };
        let problem = |iteration_time| {
            let (light_paths, camera_paths) = (2..=1 << 20, 1..=1 << 10);
            let bounds = CountLimits { light_paths, camera_paths, iteration_time };
            Problem::new(&coefficients, &[1.0; 9], Objective::Pooled, time, &bounds)
        };
        let limit = 10.0 / 64.0;
        assert_eq!(problem(limit).uniform().light_paths, 2, "what the bare limit leads to");
        let least = problem(f64::INFINITY).least_sensible_time();
        let best = problem(limit.max(least)).uniform();
        // Along N_B = 1 by hand: sqrt(t p / (s q)).
        let expected = (1.01 * 1.01 / (1e-5 * 1e-3f64)).sqrt();
        assert_eq!(best.camera_paths, 1);
        assert!((f64::from(best.light_paths) / expected - 1.0).abs() < 1e-3, "{best:?} {expected}");
        assert!(best.cost < 1e-2 * problem(limit).uniform().cost);
        // Without noise of camera paths, light paths would take all time.
        let coefficients = [Coefficients { a: 0.0, b: 0.0, f: 1.0 }; 9];
        let (light_paths, camera_paths) = (2..=1 << 20, 1..=1 << 10);
        let bounds = CountLimits { light_paths, camera_paths, iteration_time: f64::INFINITY };
        let dark = Problem::new(&coefficients, &[1.0; 9], Objective::Pooled, time, &bounds);
        assert!((dark.least_sensible_time() / 2.02 - 1.0).abs() < 1e-3);
    }
}
