//! A number of camera paths for each pixel.

use super::fixed_light::Slice;
use super::integer::Allocation;
use super::search::{Criterion, Score, minimize, scan};
use super::{NEAR_PIXELS, PerPixel, Problem, Uniform};

/// Relative width of the search for the number of light paths, which only has to lead near it.
const CENTER_WIDTH: f64 = 1e-2;

/// Pixels of all the numbers of light paths that are tried without gaps: the more pixels, the less
/// rounding matters.
const DENSE: usize = 512;

type Found = (Score, Allocation);

impl Problem {
    /// The counts of least cost; among equals the shortest iteration.
    ///
    /// Exact for small problems except for `max-rms` from 200 pixels on, whose percentile is not
    /// convex. With more pixels some numbers of light paths are skipped, and of more than 4093
    /// pixels an even selection leads to the number of light paths and to the gain that a camera
    /// path needs.
    pub fn per_pixel(&self) -> PerPixel {
        let found = self.best_per_pixel(None);
        // Where the search is not exact, it may not be worse than equal counts either.
        let Uniform { light_paths, camera_paths, cost, .. } = self.uniform();
        if cost < found.cost * (1.0 - 1e-12) && !self.is_infeasible() {
            return self.evaluate(light_paths, vec![camera_paths; self.pixels.len()]);
        }
        found
    }

    /// The shortest iteration among the counts whose cost exceeds the least by at most the fraction
    /// `slack`.
    pub fn shortest_per_pixel(&self, slack: f64) -> PerPixel {
        self.best_per_pixel(Some(slack))
    }

    /// Nearly [`Self::shortest_per_pixel`], much sooner: of more than 1021 pixels an even selection decides, and the
    /// number of light paths is that which is best if camera paths need not be whole. With many paths the cost is
    /// within a few percent of the least, but for `max-rms`.
    pub fn near_per_pixel(&self, slack: f64) -> PerPixel {
        if self.is_infeasible() {
            return self.evaluate(self.light_paths[0], self.fewest());
        }
        let sampled = self.at_most(NEAR_PIXELS);
        let bounds = self.light_paths.map(f64::from);
        let best = |criterion: &Criterion| {
            let relaxed = |n| Slice::new(&sampled, criterion, n).relaxed();
            let n_light = minimize(bounds, CENTER_WIDTH, self.is_convex(), |n| relaxed(n).0);
            let (score, thresholds) = relaxed(n_light);
            (n_light, score, thresholds)
        };
        let criterion = sampled.criterion();
        let mut found = best(&criterion);
        let criterion = criterion.least_time(found.1.cost, slack);
        let shortest = best(&criterion);
        if shortest.1.is_valid() {
            found = shortest;
        }
        let (n_light, _, thresholds) = found;
        let light_paths = (n_light.round() as u32).clamp(self.light_paths[0], self.light_paths[1]);
        let threshold = thresholds.map_or(f64::INFINITY, |[_, chosen]| chosen);
        let slice = Slice::new(self, &criterion, f64::from(light_paths));
        let camera_paths = slice.allocate(&Allocation { light_paths, threshold, extra: vec![] });
        self.evaluate(light_paths, camera_paths)
    }

    fn fewest(&self) -> Vec<u32> {
        vec![self.camera_paths[0]; self.pixels.len()]
    }

    fn best_per_pixel(&self, slack: Option<f64>) -> PerPixel {
        if self.is_infeasible() {
            return self.evaluate(self.light_paths[0], self.fewest());
        }
        let sampled = self.sampled();
        let criterion = sampled.criterion();
        let mut found = sampled.search_per_pixel(&criterion, None);
        if let (Some(slack), Some((score, allocation))) = (slack, &found) {
            let criterion = criterion.least_time(score.cost, slack);
            let incumbent = (score.with_criterion(&criterion), allocation.clone());
            found = sampled.search_per_pixel(&criterion, Some(incumbent));
        }
        let Some((_, mut allocation)) = found else {
            return self.evaluate(self.light_paths[0], self.fewest());
        };
        if sampled.pixels.len() < self.pixels.len() {
            allocation.extra.clear();
        }
        let slice = Slice::new(self, &criterion, f64::from(allocation.light_paths));
        self.evaluate(allocation.light_paths, slice.allocate(&allocation))
    }

    fn search_per_pixel(&self, criterion: &Criterion, incumbent: Option<Found>) -> Option<Found> {
        let slice = |n_light| Slice::new(self, criterion, n_light);
        let bounds = self.light_paths.map(f64::from);
        let center = minimize(bounds, CENTER_WIDTH, self.is_convex(), |n| slice(n).relaxed().0);
        let dense = (DENSE / self.pixels.len().max(1)).max(2) as u32;
        scan(self.light_paths, center, dense, incumbent, |n, incumbent| {
            slice(f64::from(n)).best(n, incumbent)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adaptive::optimize::{CountLimits, Objective};
    use crate::base::rng::{Stream, StreamKey};
    use crate::noise::Coefficients;
    use crate::timing::TimeModel;

    #[test]
    fn the_relaxation_is_below_all_whole_numbers_and_its_minimum_is_tight() {
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
                let bound = Slice::new(&problem, &criterion, f64::from(n_light)).relaxed().0.cost;
                for _ in 0..50 {
                    let counts: Vec<_> = (0..4).map(|_| 1 + value(20.0) as u32).collect();
                    let cost = problem.evaluate(n_light, counts).cost;
                    assert!(cost >= bound * (1.0 - 1e-10), "{index} {objective:?} {cost} {bound}");
                }
                // With so many paths that rounding does not matter, whole numbers reach the bound.
                let bounds = CountLimits { camera_paths: 1..=1_000_000, ..bounds.clone() };
                let fixed = TimeModel { fixed: 1e6, ..time };
                let large = Problem::new(&coefficients, &[1.0; 4], objective, fixed, &bounds);
                let slice = Slice::new(&large, &criterion, f64::from(n_light));
                if let (bound, Some((score, _))) = slice.best(n_light, None) {
                    let ratio = score.cost / bound.cost;
                    assert!((1.0 - 1e-10..1.001).contains(&ratio), "{index} {objective:?} {ratio}");
                }
            }
        }
    }
}
