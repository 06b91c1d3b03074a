//! A number of camera paths for each pixel.

use super::search::{Goal, Score, minimize, scan};
use super::slice::Slice;
use super::whole::Allocation;
use super::{PerPixel, Problem, Uniform};

/// Relative width of the search for the number of light paths, which only has to lead near it.
const CENTER_WIDTH: f64 = 1e-4;

/// Pixels of all the numbers of light paths that are tried without gaps: the more pixels, the less
/// rounding matters.
const DENSE: usize = 4096;

type Found = (Score, Allocation);

impl Problem {
    /// The counts of least cost; among equals the shortest iteration.
    ///
    /// Exact for small problems except for `max-rms` from 200 pixels on, whose percentile is not
    /// convex. With more pixels some numbers of light paths are skipped, and of more than 8191 pixels
    /// an even selection leads to the number of light paths and to the gain that a camera path needs.
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

    fn best_per_pixel(&self, slack: Option<f64>) -> PerPixel {
        let fewest = || vec![self.camera_paths[0]; self.pixels.len()];
        if self.is_infeasible() {
            return self.evaluate(self.light_paths[0], fewest());
        }
        let sampled = self.sampled();
        let goal = sampled.goal();
        let mut found = sampled.search_per_pixel(&goal, None);
        if let (Some(slack), Some((score, allocation))) = (slack, &found) {
            let goal = goal.least_time(score.cost, slack);
            let incumbent = (score.with_goal(&goal), allocation.clone());
            found = sampled.search_per_pixel(&goal, Some(incumbent));
        }
        let Some((_, mut allocation)) = found else {
            return self.evaluate(self.light_paths[0], fewest());
        };
        if sampled.pixels.len() < self.pixels.len() {
            allocation.extra.clear();
        }
        let slice = Slice::new(self, &goal, f64::from(allocation.light_paths));
        self.evaluate(allocation.light_paths, slice.allocate(&allocation))
    }

    fn search_per_pixel(&self, goal: &Goal, incumbent: Option<Found>) -> Option<Found> {
        let slice = |n_light| Slice::new(self, goal, n_light);
        let bounds = self.light_paths.map(f64::from);
        let center = minimize(bounds, CENTER_WIDTH, self.is_convex(), |n| slice(n).relaxed().0);
        let dense = (DENSE / self.pixels.len().max(1)).max(2) as u32;
        scan(self.light_paths, center, dense, incumbent, |n, incumbent| {
            slice(f64::from(n)).best(n, incumbent)
        })
    }
}
