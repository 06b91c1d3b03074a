//! Whole camera paths at a fixed number of light paths.
//!
//! The terms of the aggregate are convex in each count, hence spending path after path where it
// theory.md (85)
//! gains most gives the least sum for every total of paths (marginal allocation; Fox 1966). So the
//! paths are sorted by gain, and the best total is looked for. For the maximum the same holds with
//! the variance in place of the gain.

use super::MOST_PIXELS;
use super::Objective;
use super::fixed_light::{Slice, cap_excluded};
use super::pixel::Pixel;
use super::search::{Scanned, Score, turn};
use rayon::prelude::*;

/// Relative width to which the window of the sweep is known.
const WINDOW_WIDTH: f64 = 1e-4;

/// First relative step by which the window grows to take in what rounding moves.
const STEP_OUT: f64 = 1e-3;

/// Most paths in the window, beside some per pixel. Only what is flat over a wide range needs more.
const MOST_STEPS: f64 = 4096.0;

/// Thresholds that are tried for the percentile, and how far beyond the best ones without rounding.
const SCAN_STEPS: i32 = 32;
const SCAN_MARGIN: f64 = 1.3;

/// A solution in whole numbers.
#[derive(Clone)]
pub(super) struct Allocation {
    pub(super) light_paths: u32,
    /// Each camera path gains more than this, those in `extra` aside.
    pub(super) threshold: f64,
    /// Pixels with one camera path more, where equal gains do not all fit in.
    pub(super) extra: Vec<u32>,
}

/// A camera path of a pixel.
#[derive(Clone, Copy)]
struct Step {
    gain: f64,
    pixel: u32,
}

impl Slice<'_> {
    /// The best whole numbers that beat `incumbent`, if they can.
    ///
    /// Exact unless the percentile leaves pixels out or the window had to be narrowed.
    pub(super) fn best(&self, light_paths: u32, incumbent: Option<&Score>) -> Scanned<Allocation> {
        let (bound, relaxed) = self.relaxed();
        if !bound.is_valid() || incumbent.is_some_and(|old| !bound.beats(old)) {
            return (bound, None);
        }
        let allocation = |threshold, extra| Allocation { light_paths, threshold, extra };
        let Some(thresholds @ [_, threshold]) = relaxed else {
            return (bound, Some((bound, allocation(f64::INFINITY, Vec::new()))));
        };
        let percentile = self.objective() == Objective::MaxRms && !self.problem.is_convex();
        let (score, threshold, extra) = if percentile {
            self.scan_percentile(thresholds)
        } else {
            let [from, to] = self.window(threshold, incumbent);
            self.sweep(from, to)
        };
        let found = score.is_valid().then(|| (score, allocation(threshold, extra)));
        (bound, found)
    }

    /// All whole paths that gain more than the threshold.
    pub(super) fn counts(&self, threshold: f64) -> Vec<u32> {
        let objective = self.objective();
        let [least, most] = self.bounds;
        let count = |p: &Pixel| {
            let n = p.demand(objective, threshold, most).floor().max(least);
            // The whole path after the last one may gain enough, as gains exceed rates; and the
            // last one may not by rounding errors.
            if n < most && p.gain(objective, n) > threshold {
                n as u32 + 1
            } else if n > least && p.gain(objective, n - 1.0) <= threshold {
                n as u32 - 1
            } else {
                n as u32
            }
        };
        let pixels = self.pixels.par_iter().with_min_len(MOST_PIXELS);
        let mut counts: Vec<_> = pixels.map(count).collect();
        if objective == Objective::MaxRms {
            cap_excluded(&mut counts, u32::cmp);
        }
        counts
    }

    /// The counts of an allocation, found for this slice or for some of its pixels. Of the latter
    /// the time is not known exactly: the threshold rises until the iteration is short enough.
    pub(super) fn allocate(&self, allocation: &Allocation) -> Vec<u32> {
        let mut threshold = allocation.threshold;
        let mut counts = self.counts(threshold);
        let mut factor = 1.0 + STEP_OUT;
        while !self.criterion.allows(self.time(total(&counts))) && threshold < self.thresholds[1] {
            threshold = (threshold * factor).min(self.thresholds[1]);
            factor *= factor;
            counts = self.counts(threshold);
        }
        allocation.extra.iter().for_each(|&pixel| counts[pixel as usize] += 1);
        counts
    }

    fn score_counts(&self, counts: &[u32]) -> Score {
        let variances = self.pixels.iter().zip(counts).map(|(p, &n)| p.variance(f64::from(n)));
        self.criterion.score(self.time(total(counts)), self.problem.objective.aggregate(variances))
    }

    /// Thresholds `[from, to]`, falling, between which the best whole numbers lie: totals of paths
    /// outside are excluded by what they reach without rounding.
    fn window(&self, relaxed: f64, incumbent: Option<&Score>) -> [f64; 2] {
        let [low, high] = self.thresholds;
        let level = self.criterion.most_cost().unwrap_or_else(|| {
            let rounded = self.score_counts(&self.counts(relaxed));
            let rounded = rounded.is_valid().then_some(rounded.cost);
            // Rounding down is always short enough.
            let down = self.score_counts(&self.counts_below(relaxed)).cost;
            let costs = [rounded, incumbent.map(|score| score.cost)];
            costs.into_iter().flatten().fold(down, f64::min)
        });
        let cannot_win = |threshold| self.score(threshold).cost > level;
        let can_win = |threshold| {
            let score = self.score(threshold);
            self.criterion.allows(score.time) && score.cost <= level
        };
        let mut from = turn([relaxed, high], WINDOW_WIDTH, cannot_win)[1];
        let mut to = turn([low, relaxed], WINDOW_WIDTH, can_win)[0];
        // Rounding may have moved the totals into the window.
        let [[fewest, _], [most, _]] = [self.totals(from), self.totals(to)];
        let mut factor = 1.0 + STEP_OUT;
        while from < high && total(&self.counts(from)) > fewest {
            from = (from * factor).min(high);
            factor *= factor;
        }
        let mut factor = 1.0 + STEP_OUT;
        while to > low && total(&self.counts(to)) < most {
            to = (to / factor).max(low);
            factor *= factor;
        }
        let most_steps = MOST_STEPS + 4.0 * self.pixels.len() as f64;
        while total(&self.counts(to)) - total(&self.counts(from)) > most_steps {
            from = relaxed * (from / relaxed).sqrt();
            to = relaxed * (to / relaxed).sqrt();
        }
        [from, to]
    }

    /// The counts at a threshold without rounding, rounded down.
    fn counts_below(&self, threshold: f64) -> Vec<u32> {
        let [least, most] = self.bounds;
        let demand = |n: f64| n.max(least) as u32;
        self.pixels.iter().map(|p| demand(p.demand(self.objective(), threshold, most))).collect()
    }

    /// Spends the camera paths of the window one by one, the highest gain first; returns the best
    /// score with its threshold and the pixels whose equal gains are partly spent.
    fn sweep(&self, from: f64, to: f64) -> (Score, f64, Vec<u32>) {
        let objective = self.objective();
        let (start, end) = (self.counts(from), self.counts(to));
        let steps = self.steps(&start, &end);
        let terms = |counts: &'_ [u32]| -> Vec<f64> {
            let term = |(p, &n): (&Pixel, &u32)| p.term(objective, f64::from(n));
            self.pixels.iter().zip(counts).map(term).collect()
        };
        let mut paths = total(&start);
        let mut sum: f64 = terms(&start).iter().sum();
        let least_maximum = terms(&end).into_iter().fold(0.0, f64::max);
        let mut best: Option<(Score, usize)> = None;
        for spent in 0..=steps.len() {
            let next = steps.get(spent).map_or(0.0, |step| step.gain);
            let aggregate =
                if objective == Objective::MaxRms { next.max(least_maximum) } else { sum };
            let score = self.criterion.score(self.time(paths), self.variance(aggregate));
            if best.is_none_or(|(old, _)| score.beats(&old)) {
                best = Some((score, spent));
            }
            paths += 1.0;
            sum -= next;
        }
        let (score, spent) = best.unwrap_or((self.fewest(), 0));
        // All steps before `equal` gain more than the threshold, those from it up to `spent` as
        // much.
        let threshold = steps.get(spent).map_or(to, |step| step.gain);
        let equal = steps[..spent].partition_point(|step| step.gain > threshold);
        (score, threshold, steps[equal..spent].iter().map(|step| step.pixel).collect())
    }

    /// The camera paths between two allocations, by falling gain.
    fn steps(&self, start: &[u32], end: &[u32]) -> Vec<Step> {
        let objective = self.objective();
        let mut steps = Vec::new();
        for (pixel, (&start, &end)) in (0..).zip(start.iter().zip(end)) {
            let gain = |n| self.pixels[pixel as usize].gain(objective, f64::from(n));
            steps.extend((start..end).map(|n| Step { gain: gain(n), pixel }));
        }
        steps.sort_unstable_by(|a, b| b.gain.total_cmp(&a.gain).then(a.pixel.cmp(&b.pixel)));
        steps
    }

    /// Tries thresholds around the best ones without rounding.
    fn scan_percentile(&self, [first, last]: [f64; 2]) -> (Score, f64, Vec<u32>) {
        let start = first / SCAN_MARGIN;
        let ratio = last * SCAN_MARGIN / start;
        let scored = |step| {
            let threshold = start * ratio.powf(f64::from(step) / f64::from(SCAN_STEPS));
            (self.score_counts(&self.counts(threshold)), threshold)
        };
        let steps = (0..=SCAN_STEPS).map(scored);
        let best = steps.reduce(|best, other| if other.0.beats(&best.0) { other } else { best });
        let (score, threshold) = best.unwrap_or((self.fewest(), f64::INFINITY));
        (score, threshold, Vec::new())
    }
}

fn total(counts: &[u32]) -> f64 {
    counts.iter().map(|&n| f64::from(n)).sum()
}
