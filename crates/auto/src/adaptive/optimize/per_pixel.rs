//! A number of camera paths for each pixel, by the rule `n_p = sqrt(s_p/lambda)`.
//!
//! At a fixed number of light paths the variance of a pixel is `V_p = d_p + s_p/n_p`. All solutions
//! belong to a *threshold* `lambda`: a camera path is spent where it reduces the sum of variances
//! by more than that.

use super::objective::above_percentile;
use super::search::{Criterion, Score, minimize};
use super::{Objective, PerPixel, Problem};
use crate::bisect::bisect;
use bdpm_core::noise::Coefficients;
use rayon::prelude::*;

/// An even selection of at most this many pixels decides about the threshold and the number of
/// light paths. A prime number, so that the selection does not follow the rows of the image.
const MAX_PIXELS: usize = 1021;

/// Relative width of the search for the number of light paths: the cost is flat.
const LIGHT_PATHS_WIDTH: f64 = 1e-2;

/// Relative widths of the search for the threshold, for up to [`FEW`] pixels and for more: the more
/// pixels, the less a single path counts.
const THRESHOLD_WIDTHS: [f64; 2] = [1e-7, 1e-4];

/// See [`THRESHOLD_WIDTHS`].
const FEW: usize = 256;

/// Pixels that a thread takes at once.
const CHUNK: usize = 512;

impl Problem {
    /// The shortest iteration among counts whose cost exceeds the least by at most about the
    /// fraction `slack`.
    ///
    /// The number of light paths and the threshold are those that are best if counts need not be
    /// whole; then each pixel's camera paths are rounded. The cost is within a few percent of the
    /// least where iterations have many paths, except for `max-rms`, which a selection of the
    /// pixels says little about. docs/measurements/optimum.md has the tested bounds.
    pub fn shortest_per_pixel(&self, slack: f64) -> PerPixel {
        if self.is_infeasible() {
            return self
                .evaluate(self.light_paths[0], vec![self.camera_paths[0]; self.pixels.len()]);
        }
        let sampled = self.at_most(MAX_PIXELS);
        let bounds = self.light_paths.map(f64::from);
        let best = |criterion: &Criterion| {
            let relaxed = |n| FixedLight::new(&sampled, criterion, n).relaxed();
            let convex = self.is_convex();
            let n_light = minimize(bounds, LIGHT_PATHS_WIDTH, convex, |n| relaxed(n).0);
            let (score, threshold) = relaxed(n_light);
            (n_light, score, threshold)
        };
        let mut criterion = sampled.criterion();
        let mut found = best(&criterion);
        criterion = criterion.least_time(found.1.cost, slack);
        let shortest = best(&criterion);
        if shortest.1.is_valid() {
            found = shortest;
        }
        let (n_light, _, threshold) = found;
        let [least, most] = self.light_paths;
        let below = (n_light as u32).clamp(least, most);
        let [below, above] = [below, below.saturating_add(1).min(most)].map(|light_paths| {
            let whole_image = FixedLight::new(self, &criterion, f64::from(light_paths));
            let rounded = self.evaluate(light_paths, whole_image.allocate(threshold));
            (criterion.score(rounded.iteration_time, rounded.variance), rounded)
        });
        if above.0.beats(&below.0) { above.1 } else { below.1 }
    }
}

/// A problem at a fixed number of light paths.
struct FixedLight<'a> {
    objective: Objective,
    convex: bool,
    criterion: &'a Criterion,
    pixels: Vec<Pixel>,
    /// Seconds per iteration without camera paths in the region.
    base: f64,
    /// Seconds per camera path in each pixel.
    per_path: f64,
    /// Bounds of the camera paths per pixel.
    bounds: [f64; 2],
    /// Up to the lowest threshold all pixels get as many paths as help, from the highest on the
    /// fewest.
    thresholds: [f64; 2],
}

impl<'a> FixedLight<'a> {
    fn new(problem: &Problem, criterion: &'a Criterion, n_light: f64) -> Self {
        // theory.md (82)
        let pixel = |c: &Coefficients| Pixel { rest: c.f / n_light, scaled: c.b + c.a / n_light };
        let pixels: Vec<_> = problem.pixels.iter().map(pixel).collect();
        let [base, per_path] = problem.time_in_camera_paths(n_light);
        let bounds = problem.camera_paths.map(f64::from);
        let objective = problem.objective;
        let variance = |n| objective.aggregate(pixels.iter().map(|p| p.variance(n)));
        let rates = |n| pixels.iter().map(move |p| p.rate(objective, n)).filter(|&rate| rate > 0.0);
        let thresholds = match objective {
            Objective::MaxRms => [variance(bounds[1]), variance(bounds[0])],
            _ => [
                rates(bounds[1]).fold(f64::INFINITY, f64::min),
                rates(bounds[0]).fold(0.0, f64::max),
            ],
        };
        let convex = problem.is_convex();
        Self { objective, convex, criterion, pixels, base, per_path, bounds, thresholds }
    }

    /// `[paths, sum]` at a threshold: the camera paths of all pixels, not rounded, and the sum of
    /// terms; for `max-rms` the threshold itself is the aggregate.
    fn totals(&self, threshold: f64) -> [f64; 2] {
        let [least, most] = self.bounds;
        let demand = |p: &Pixel| p.demand(self.objective, threshold, most).max(least);
        if self.objective == Objective::MaxRms {
            let mut counts: Vec<_> = self.pixels.iter().map(demand).collect();
            cap_above_percentile(&mut counts, f64::total_cmp);
            return [counts.iter().sum(), threshold];
        }
        let add = |[paths, sum]: [f64; 2], [n, term]: [f64; 2]| [paths + n, sum + term];
        let chunk = |pixels: &[Pixel]| {
            let pair = |p| {
                let n = demand(p);
                [n, p.term(self.objective, n)]
            };
            pixels.iter().map(pair).fold([0.0; 2], add)
        };
        // Summed in the same order by any number of threads.
        if self.pixels.len() <= CHUNK {
            return chunk(&self.pixels);
        }
        let chunks: Vec<_> = self.pixels.par_chunks(CHUNK).map(chunk).collect();
        chunks.into_iter().fold([0.0; 2], add)
    }

    fn time(&self, paths: f64) -> f64 {
        self.base + self.per_path * paths
    }

    fn score_by(&self, criterion: &Criterion, threshold: f64) -> Score {
        let [paths, sum] = self.totals(threshold);
        let count = self.pixels.len() as f64;
        let variance = match self.objective {
            Objective::Pooled | Objective::Relative => sum / count,
            Objective::MeanRms => (sum / count).powi(2),
            Objective::MaxRms => sum,
        };
        criterion.score(self.time(paths), variance)
    }

    fn score(&self, threshold: f64) -> Score {
        self.score_by(self.criterion, threshold)
    }

    /// The best threshold with its score, a lower bound for whole numbers. An infinite threshold
    /// stands for the fewest paths, where these are best or not even they are allowed.
    ///
    /// The minimum of the product of time and `sum^kappa` over the total of paths is where
    /// `per_path sum = kappa time threshold`. At higher thresholds more paths help.
    fn relaxed(&self) -> (Score, f64) {
        let [low, high] = self.thresholds;
        let width = THRESHOLD_WIDTHS[usize::from(self.pixels.len() > FEW)];
        let fewest = self.fewest();
        // Written so that a NaN ends here too.
        if !(low > 0.0 && low < high && self.criterion.allows(fewest.time)) {
            return (fewest, f64::INFINITY);
        }
        let best = match self.objective {
            Objective::MaxRms => {
                let criterion = Criterion { highest_cost: None, ..*self.criterion };
                minimize([low, high], width, self.convex, |v| self.score_by(&criterion, v))
            }
            objective => {
                let kappa = if objective == Objective::MeanRms { 2.0 } else { 1.0 };
                let more_paths_help = |threshold| {
                    let [paths, sum] = self.totals(threshold);
                    let time = self.time(paths);
                    // theory.md (83)
                    let gain = kappa * time * threshold;
                    self.criterion.allows(time) && gain > self.per_path * sum * (1.0 + 1e-12)
                };
                bisect([low, high], width, more_paths_help)[1]
            }
        };
        // The shortest iteration has the highest threshold that the cost allows.
        let chosen = match self.criterion.highest_cost {
            Some(limit) if self.score(best).cost <= limit => {
                bisect([best, high], width, |threshold| self.score(threshold).cost > limit)[0]
            }
            _ => best,
        };
        (self.score(chosen), chosen)
    }

    fn fewest(&self) -> Score {
        let [least, _] = self.bounds;
        let variance = self.objective.aggregate(self.pixels.iter().map(|p| p.variance(least)));
        self.criterion.score(self.time(least * self.pixels.len() as f64), variance)
    }

    /// Whole camera paths of each pixel. Rounding, and a threshold from a selection of the pixels,
    /// can make the iteration too long. The lowest higher threshold at which it is short enough is
    /// then used.
    fn allocate(&self, threshold: f64) -> Vec<u32> {
        let counts = self.counts(threshold);
        let highest = self.thresholds[1];
        if self.is_short_enough(&counts) || threshold >= highest {
            return counts;
        }
        let is_short_enough = |threshold| self.is_short_enough(&self.counts(threshold));
        let width = THRESHOLD_WIDTHS[usize::from(self.pixels.len() > FEW)];
        self.counts(bisect([threshold, highest], width, is_short_enough)[1])
    }

    fn is_short_enough(&self, counts: &[u32]) -> bool {
        let paths = counts.iter().map(|&n| f64::from(n)).sum();
        self.criterion.allows(self.time(paths))
    }

    /// All whole paths that gain more than the threshold.
    fn counts(&self, threshold: f64) -> Vec<u32> {
        let [least, most] = self.bounds;
        let count = |p: &Pixel| {
            let demand = p.demand(self.objective, threshold, most).max(least);
            let below = demand.floor();
            // theory.md (85)
            let takes_one_more = match self.objective {
                // Only a pixel above the threshold needs another path.
                Objective::MaxRms => below < most && p.variance(below) > threshold * (1.0 + 1e-12),
                // `s/(n (n + 1)) > lambda`; nearly so for `mean-rms`.
                _ => (below * (below + 1.0)).sqrt() < demand,
            };
            below as u32 + u32::from(takes_one_more)
        };
        let mut counts: Vec<_> = self.pixels.par_iter().with_min_len(4096).map(count).collect();
        if self.objective == Objective::MaxRms {
            cap_above_percentile(&mut counts, u32::cmp);
        }
        counts
    }
}

/// Reduces the counts of the pixels above the percentile, which the objective ignores, to the
/// highest count below it.
fn cap_above_percentile<T: Copy + PartialOrd>(
    counts: &mut [T],
    order: impl Fn(&T, &T) -> std::cmp::Ordering,
) {
    let above = above_percentile(counts.len());
    if above > 0 {
        let mut sorted = counts.to_vec();
        let cap = *sorted.select_nth_unstable_by(counts.len() - above - 1, order).1;
        counts.iter_mut().filter(|n| **n > cap).for_each(|n| *n = cap);
    }
}

/// A pixel at a fixed number of light paths, `V = rest + scaled/n`, squared luminance.
#[derive(Clone, Copy)]
struct Pixel {
    rest: f64,
    scaled: f64,
}

impl Pixel {
    fn variance(&self, n: f64) -> f64 {
        self.rest + self.scaled / n
    }

    /// The pixel's term in the sum that the aggregate is made of.
    fn term(&self, objective: Objective, n: f64) -> f64 {
        match objective {
            Objective::MeanRms => self.variance(n).sqrt(),
            _ => self.variance(n),
        }
    }

    /// Gain per camera path: minus the derivative of [`Self::term`]. For `max-rms` the variance, as
    /// only a pixel above the threshold needs another path.
    fn rate(&self, objective: Objective, n: f64) -> f64 {
        // theory.md (83)
        match objective {
            Objective::Pooled | Objective::Relative => self.scaled / (n * n),
            Objective::MeanRms if self.scaled == 0.0 => 0.0,
            Objective::MeanRms => self.scaled / (2.0 * n * n * self.variance(n).sqrt()),
            Objective::MaxRms => self.variance(n),
        }
    }

    /// The `n` from 0 to `most` at which [`Self::rate`] is `threshold`.
    fn demand(&self, objective: Objective, threshold: f64, most: f64) -> f64 {
        let Self { rest, scaled } = *self;
        if scaled == 0.0 || threshold == f64::INFINITY {
            return 0.0;
        }
        // theory.md (84)
        let n = match objective {
            Objective::Pooled | Objective::Relative => (scaled / threshold).sqrt(),
            Objective::MaxRms if threshold > rest => scaled / (threshold - rest),
            Objective::MaxRms => most,
            // rest n^4 + scaled n^3 = q^2, solved by Newton's method. Either summand alone gives a
            // number that is too high by at most 26 %. From there a convex function leads down.
            Objective::MeanRms => {
                let q = scaled / (2.0 * threshold);
                let start = (q / rest.sqrt()).sqrt().min((q / (2.0 * threshold)).cbrt()).min(most);
                (0..4).fold(start, |n, _| {
                    let square = n * n;
                    let excess = square * n * (rest * n + scaled) - q * q;
                    n - excess / (square * (4.0 * rest * n + 3.0 * scaled))
                })
            }
        };
        n.min(most)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adaptive::optimize::CountLimits;
    use crate::timing::TimeModel;
    use bdpm_core::base::rng::{Stream, StreamKey};

    #[test]
    fn relaxed_cost_is_a_tight_lower_bound_of_whole_counts() {
        for index in 0..400 {
            let mut rng = StreamKey::new(2, Stream::Test, 0).rng(index);
            let mut value = |most: f64| most * rng.next_f64().powi(3);
            let coefficients: Vec<_> = (0..4)
                .map(|_| Coefficients { a: value(100.0), b: value(5.0), f: value(5.0) })
                .collect();
            let time = TimeModel {
                fixed: value(5.0),
                light_path: value(0.1),
                camera_path: value(0.2),
                look_up: 0.0,
                merge_pair: value(0.01),
                pixels: 6.0,
            };
            let objectives = [Objective::Pooled, Objective::MeanRms, Objective::MaxRms];
            let objective = objectives[index as usize % 3];
            let iteration_time = f64::INFINITY;
            let bounds = CountLimits { light_paths: 1..=30, camera_paths: 1..=20, iteration_time };
            let problem = Problem::new(&coefficients, &[1.0; 4], objective, time, &bounds);
            let criterion = problem.criterion();
            for n_light in [1, 5, 30] {
                let fixed_light = FixedLight::new(&problem, &criterion, f64::from(n_light));
                let bound = fixed_light.relaxed().0.cost;
                for _ in 0..50 {
                    let counts: Vec<_> = (0..4).map(|_| 1 + value(20.0) as u32).collect();
                    let cost = problem.evaluate(n_light, counts).cost;
                    assert!(cost >= bound * (1.0 - 1e-10), "{index} {objective:?} {cost} {bound}");
                }
                // With so many paths that rounding does not matter, whole numbers reach the bound.
                let bounds = CountLimits { camera_paths: 1..=1_000_000, ..bounds.clone() };
                let time = TimeModel { fixed: 1e6, ..time };
                let large = Problem::new(&coefficients, &[1.0; 4], objective, time, &bounds);
                let fixed_light = FixedLight::new(&large, &criterion, f64::from(n_light));
                let (bound, threshold) = fixed_light.relaxed();
                let cost = large.evaluate(n_light, fixed_light.allocate(threshold)).cost;
                let ratio = cost / bound.cost;
                assert!((1.0 - 1e-10..1.001).contains(&ratio), "{index} {objective:?} {ratio}");
            }
        }
    }

    #[test]
    fn demand_has_the_requested_rate() {
        let values = [0.0, 1e-9, 1e-3, 1.0, 1e6];
        let pixels = values.iter().flat_map(|&rest| values.map(|scaled| Pixel { rest, scaled }));
        for pixel in pixels.filter(|p| p.scaled > 0.0) {
            for objective in [Objective::Pooled, Objective::MeanRms, Objective::MaxRms] {
                for n in [1.0, 1.5, 7.0, 1e3, 1e6] {
                    // Where `rest` is nearly all, the variance does not determine the count.
                    if objective == Objective::MaxRms && pixel.rest * n > 1e6 * pixel.scaled {
                        continue;
                    }
                    let rate = pixel.rate(objective, n);
                    let demand = pixel.demand(objective, rate, 1e9);
                    assert!((demand / n - 1.0).abs() < 1e-6, "{objective:?} {n} {demand}");
                }
            }
        }
    }
}
