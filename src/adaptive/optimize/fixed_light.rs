//! The best camera paths of each pixel at a fixed number of light paths.
//!
// theory.md (82)
//! With `s = b + a/N_F` and `d = f/N_F` the variance of a pixel is `V = d + s/n`. All solutions,
//! whole or not, belong to a *threshold*: a camera path is spent where it gains more than that.

use super::pixel::Pixel;
use super::search::{Criterion, Score, minimize, turn};
use super::{Objective, Problem, excluded};
use rayon::prelude::*;

/// Relative widths of the search for the best threshold, at which the cost is flat: for few pixels,
/// where single paths count, and for many.
const WIDTHS: [f64; 2] = [1e-7, 1e-4];

/// Pixels that a thread takes at once.
const CHUNK: usize = 512;

/// Few pixels.
const FEW: usize = 256;

/// A problem at a fixed number of light paths.
pub(super) struct Slice<'a> {
    pub(super) problem: &'a Problem,
    pub(super) criterion: &'a Criterion,
    pub(super) pixels: Vec<Pixel>,
    /// Seconds per iteration without camera paths in the region.
    base: f64,
    /// Seconds per camera path in each pixel.
    per_path: f64,
    /// Bounds of the camera paths per pixel.
    pub(super) bounds: [f64; 2],
    /// All paths up to the highest threshold are the fewest, from the lowest on the most that help.
    pub(super) thresholds: [f64; 2],
}

impl<'a> Slice<'a> {
    pub(super) fn new(problem: &'a Problem, criterion: &'a Criterion, n_light: f64) -> Self {
        let pixel = |c: &crate::noise::Coefficients| Pixel {
            rest: c.f / n_light,
            scaled: c.b + c.a / n_light,
        };
        let pixels: Vec<_> = problem.pixels.iter().map(pixel).collect();
        let [base, per_path] = problem.time_in_camera_paths(n_light);
        let bounds = problem.camera_paths.map(f64::from);
        let objective = problem.objective;
        let variance = |n| problem.objective.aggregate(pixels.iter().map(|p| p.variance(n)));
        let rates = |n| pixels.iter().map(move |p| p.rate(objective, n)).filter(|&rate| rate > 0.0);
        let thresholds = match objective {
            Objective::MaxRms => [variance(bounds[1]), variance(bounds[0])],
            _ => [
                rates(bounds[1]).fold(f64::INFINITY, f64::min),
                rates(bounds[0]).fold(0.0, f64::max),
            ],
        };
        Self { problem, criterion, pixels, base, per_path, bounds, thresholds }
    }

    pub(super) fn objective(&self) -> Objective {
        self.problem.objective
    }

    /// `[paths, sum]` at a threshold: the camera paths of all pixels, not rounded, and the sum of
    /// terms; for `max-rms` the threshold itself is the aggregate.
    pub(super) fn totals(&self, threshold: f64) -> [f64; 2] {
        let objective = self.objective();
        let [least, most] = self.bounds;
        let demand = |p: &Pixel| p.demand(objective, threshold, most).max(least);
        if objective == Objective::MaxRms {
            let mut counts: Vec<_> = self.pixels.iter().map(demand).collect();
            cap_excluded(&mut counts, f64::total_cmp);
            return [counts.iter().sum(), threshold];
        }
        let add = |[paths, sum]: [f64; 2], [n, term]: [f64; 2]| [paths + n, sum + term];
        let part = |pixels: &[Pixel]| {
            let pair = |p| {
                let n = demand(p);
                [n, p.term(objective, n)]
            };
            pixels.iter().map(pair).fold([0.0; 2], add)
        };
        // Summed in the same order by any number of threads.
        if self.pixels.len() <= CHUNK {
            return part(&self.pixels);
        }
        let parts: Vec<_> = self.pixels.par_chunks(CHUNK).map(part).collect();
        parts.into_iter().fold([0.0; 2], add)
    }

    pub(super) fn time(&self, paths: f64) -> f64 {
        self.base + self.per_path * paths
    }

    /// The aggregate made of a sum of terms.
    pub(super) fn variance(&self, sum: f64) -> f64 {
        let count = self.pixels.len() as f64;
        match self.objective() {
            Objective::Pooled | Objective::Relative => sum / count,
            Objective::MeanRms => (sum / count).powi(2),
            Objective::MaxRms => sum,
        }
    }

    pub(super) fn score(&self, threshold: f64) -> Score {
        let [paths, sum] = self.totals(threshold);
        self.criterion.score(self.time(paths), self.variance(sum))
    }

    /// The score that no whole numbers beat, with the thresholds of the least cost and of the criterion;
    /// `None` for these where the fewest paths are best, or not even they are allowed.
    ///
    /// The minimum of the product of time and `sum^k` over the total of paths is where
    /// `per_path sum = k time threshold`. Below, at higher thresholds, more paths help.
    /// theory.md (83).
    pub(super) fn relaxed(&self) -> (Score, Option<[f64; 2]>) {
        let [low, high] = self.thresholds;
        let width = WIDTHS[usize::from(self.pixels.len() > FEW)];
        let fewest = self.fewest();
        // Written so that a NaN ends here too.
        if !(low > 0.0 && low < high && self.criterion.allows(fewest.time)) {
            return (fewest, None);
        }
        let best = match self.objective() {
            Objective::MaxRms => {
                let criterion = self.criterion.without_cost_limit();
                let score = |v| {
                    let [paths, variance] = self.totals(v);
                    criterion.score(self.time(paths), variance)
                };
                minimize([low, high], width, self.problem.is_convex(), score)
            }
            objective => {
                let power = if objective == Objective::MeanRms { 2.0 } else { 1.0 };
                let more_help = |threshold| {
                    let [paths, sum] = self.totals(threshold);
                    let time = self.time(paths);
                    // theory.md (83)
                    let gain = power * time * threshold;
                    self.criterion.allows(time) && gain > self.per_path * sum * (1.0 + 1e-12)
                };
                turn([low, high], width, more_help)[1]
            }
        };
        // The shortest iteration has the highest threshold that the cost allows.
        let chosen = match self.criterion.most_cost() {
            Some(most) if self.score(best).cost <= most => {
                turn([best, high], width, |threshold| self.score(threshold).cost > most)[0]
            }
            _ => best,
        };
        (self.score(chosen), Some([best, chosen]))
    }

    pub(super) fn fewest(&self) -> Score {
        let [least, _] = self.bounds;
        let variance =
            self.problem.objective.aggregate(self.pixels.iter().map(|p| p.variance(least)));
        self.criterion.score(self.time(least * self.pixels.len() as f64), variance)
    }
}

/// With the percentile the most demanding pixels do not count; they get what the most demanding one
/// that does gets, instead of nothing.
pub(super) fn cap_excluded<T: Copy + PartialOrd>(
    counts: &mut [T],
    order: impl Fn(&T, &T) -> std::cmp::Ordering,
) {
    let above = excluded(counts.len());
    if above > 0 {
        let mut sorted = counts.to_vec();
        let cap = *sorted.select_nth_unstable_by(counts.len() - above - 1, order).1;
        counts.iter_mut().filter(|n| **n > cap).for_each(|n| *n = cap);
    }
}
