//! Counts that are equal in every pixel.

use super::search::{Criterion, Score, minimize};
use super::{Problem, Uniform};
use std::ops::RangeInclusive;

/// Relative width of the search along a line: the cost is flat enough to be exact to rounding.
const LINE_WIDTH: f64 = 1e-7;

/// Relative width of the search across lines, which only has to lead near the minimum.
const CENTER_WIDTH: f64 = 1e-4;

/// Whole numbers on either side of the center that are tried at most. The bound ends the search
/// long before, unless the cost is flat.
const MAX_NEIGHBORS: usize = 1024;

/// The counts `[N_F, N_B]` with their score.
type ScoredCounts = (Score, [u32; 2]);

impl Problem {
    /// The counts of least cost; of equal costs the shortest iteration.
    ///
    /// Exact for up to 4093 pixels, and for any number with the objectives `pooled` and `relative`.
    /// The exception is `max-rms` from 200 pixels on, whose percentile is not convex.
    pub fn uniform(&self) -> Uniform {
        self.best_uniform(None)
    }

    /// The shortest iteration among the counts whose cost exceeds the least by at most the fraction
    /// `slack`.
    pub fn shortest_uniform(&self, slack: f64) -> Uniform {
        self.best_uniform(Some(slack))
    }

    /// The numbers of light paths whose cost, at `camera_paths` camera paths in each pixel, exceeds
    /// the least cost at that number by at most the fraction `slack`.
    pub fn flat_range(&self, camera_paths: u32, slack: f64) -> RangeInclusive<u32> {
        let sampled = self.sampled();
        let criterion = sampled.criterion();
        let score = |n| sampled.score(&criterion, f64::from(n), f64::from(camera_paths));
        let lines = Lines { problem: &sampled, criterion: &criterion };
        let (_, best) = lines.rounded(lines.relaxed(f64::from(camera_paths)).1, camera_paths);
        let least = score(best[0]);
        let flat = |n| {
            let score = score(n);
            score.is_valid() == least.is_valid() && score.cost <= least.cost * (1.0 + slack)
        };
        // The flat numbers adjoin the best on both sides: halve the distance to one that is not.
        let end = |bound: u32| {
            let (mut inside, mut outside) = (i64::from(best[0]), i64::from(bound));
            if flat(bound) {
                return bound;
            }
            while inside.abs_diff(outside) > 1 {
                let middle = (inside + outside) / 2;
                *(if flat(middle as u32) { &mut inside } else { &mut outside }) = middle;
            }
            inside as u32
        };
        end(self.light_paths[0])..=end(self.light_paths[1])
    }

    fn best_uniform(&self, slack: Option<f64>) -> Uniform {
        let [n_light, n_camera] = if self.is_infeasible() {
            [self.light_paths[0], self.camera_paths[0]]
        } else {
            let sampled = self.sampled();
            let criterion = sampled.criterion();
            let (score, mut counts) = sampled.search_uniform(&criterion, None);
            if let Some(slack) = slack {
                let criterion = criterion.least_time(score.cost, slack);
                let incumbent = (score.with_criterion(&criterion), counts);
                counts = sampled.search_uniform(&criterion, Some(incumbent)).1;
            }
            counts
        };
        self.evaluate_uniform(n_light, n_camera)
    }

    fn score(&self, criterion: &Criterion, n_light: f64, n_camera: f64) -> Score {
        let variance = self.uniform_variance(n_light, n_camera);
        criterion.score(self.time.iteration(n_light, n_camera), variance)
    }

    fn search_uniform(
        &self,
        criterion: &Criterion,
        incumbent: Option<ScoredCounts>,
    ) -> ScoredCounts {
        let lines = Lines { problem: self, criterion };
        let bounds = self.camera_paths.map(f64::from);
        let center = minimize(bounds, CENTER_WIDTH, self.is_convex(), |n| lines.relaxed(n).0);
        let best = lines.best_near(center, incumbent);
        let fewest = [self.light_paths[0], self.camera_paths[0]];
        best.unwrap_or_else(|| {
            let [n_light, n_camera] = fewest.map(f64::from);
            (self.score(criterion, n_light, n_camera), fewest)
        })
    }
}

/// Searches along the number of light paths, each at a constant number of camera paths.
///
/// Time and mean variance are `T + t x` and `q + p/x` in the number `x` of light paths. So the cost
/// is convex in `x`, and the best whole number is beside the best `x`. The other objectives are
/// convex in `ln x`.
// theory.md (81)
struct Lines<'a> {
    problem: &'a Problem,
    criterion: &'a Criterion,
}

impl Lines<'_> {
    /// The best number of light paths, not rounded.
    fn relaxed(&self, n_camera: f64) -> (Score, f64) {
        let score = |n_light| self.problem.score(self.criterion, n_light, n_camera);
        let bounds = self.problem.light_paths.map(f64::from);
        let n_light = minimize(bounds, LINE_WIDTH, self.problem.is_convex(), score);
        (score(n_light), n_light)
    }

    /// The better of the whole numbers of light paths beside `n_light`.
    fn rounded(&self, n_light: f64, n_camera: u32) -> ScoredCounts {
        let [least, most] = self.problem.light_paths;
        let below = (n_light as u32).clamp(least, most);
        let scored = |n_light: u32| {
            let [light, camera] = [n_light, n_camera].map(f64::from);
            (self.problem.score(self.criterion, light, camera), [n_light, n_camera])
        };
        let (below, above) = (scored(below), scored(below.saturating_add(1).min(most)));
        if above.0.beats(&below.0) { above } else { below }
    }

    /// The best counts for any whole number of camera paths, if they beat `incumbent`. Goes outward
    /// from `center` in both directions until the bound, the score without rounding, says that
    /// nothing better follows.
    fn best_near(&self, center: f64, incumbent: Option<ScoredCounts>) -> Option<ScoredCounts> {
        let mut best = incumbent;
        let mut visit = |numbers: &mut dyn Iterator<Item = u32>| {
            for n_camera in numbers.take(MAX_NEIGHBORS) {
                let (bound, n_light) = self.relaxed(f64::from(n_camera));
                if best.is_some_and(|(score, _)| !bound.beats(&score)) {
                    break;
                }
                let found = self.rounded(n_light, n_camera);
                let beats = |(score, _): ScoredCounts| found.0.beats(&score);
                if found.0.is_valid() && best.is_none_or(beats) {
                    best = Some(found);
                }
            }
        };
        let [least, most] = self.problem.camera_paths;
        let center = (center as u32).clamp(least, most);
        visit(&mut (least..=center).rev());
        visit(&mut (center..=most).skip(1));
        best
    }
}
