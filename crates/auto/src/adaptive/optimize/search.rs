//! Searches along one count, and the criterion by which they compare counts.

/// Costs this close to each other, relatively, are equal: rounding errors do not decide.
const EQUAL: f64 = 1e-13;

/// The quantity to minimize, and its limits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Criterion {
    /// Longest iteration, seconds.
    pub(super) longest: f64,
    /// Highest cost. With it the shortest iteration is sought, without it the least cost.
    pub(super) highest_cost: Option<f64>,
}

impl Criterion {
    /// The shortest iteration whose cost exceeds `cost` by at most the fraction `slack`.
    pub(super) fn least_time(self, cost: f64, slack: f64) -> Self {
        Self { highest_cost: Some(cost * (1.0 + slack.max(0.0)) * (1.0 + 10.0 * EQUAL)), ..self }
    }

    /// The iteration is short enough.
    pub(super) fn allows(&self, time: f64) -> bool {
        time <= self.longest
    }

    pub(super) fn score(&self, time: f64, variance: f64) -> Score {
        self.score_cost(time, time * variance)
    }

    fn score_cost(&self, time: f64, cost: f64) -> Score {
        let factor = |value, limit| if value <= limit { 0.0 } else { value / limit };
        let excess = [
            factor(time, self.longest),
            self.highest_cost.map_or(0.0, |limit| factor(cost, limit)),
        ];
        Score { excess, value: if self.highest_cost.is_some() { time } else { cost }, cost, time }
    }
}

/// How good counts are: first by the time above its limit, then by the cost above its limit, then
/// by the value.
///
/// The counts that are at least as good as some others form a convex set where times and costs are
/// convex.
#[derive(Clone, Copy, Debug)]
pub(super) struct Score {
    /// The factors by which time and cost exceed their limits; 0 within these.
    excess: [f64; 2],
    value: f64,
    pub(super) cost: f64,
    pub(super) time: f64,
}

impl Score {
    /// Time and cost are within their limits.
    pub(super) fn is_valid(&self) -> bool {
        self.excess == [0.0; 2]
    }

    /// Rates the same counts by another criterion.
    pub(super) fn with_criterion(&self, criterion: &Criterion) -> Self {
        criterion.score_cost(self.time, self.cost)
    }

    /// Strictly better; of equal scores the shorter iteration is.
    pub(super) fn beats(&self, other: &Self) -> bool {
        if self.excess != other.excess {
            return self.excess < other.excess;
        }
        let less = |a: f64, b: f64| a < b * (1.0 - EQUAL);
        less(self.value, other.value)
            || (!less(other.value, self.value) && less(self.time, other.time))
    }
}

/// Points of the coarse search where convexity does not lead to the minimum.
const COARSE: u32 = 24;

/// The best of the numbers from `low` to `high`, by golden sections in their logarithms down to a
/// relative width; the lowest of equals. Without convexity a coarse search comes first.
pub(super) fn minimize(
    [low, high]: [f64; 2],
    width: f64,
    convex: bool,
    score: impl Fn(f64) -> Score,
) -> f64 {
    const SECTION: f64 = 0.618_033_988_749_894_9;
    let scored = |ln: f64| {
        let x = ln.exp().clamp(low, high);
        (x, score(x))
    };
    let (mut left, mut right) = (low.ln(), high.ln());
    if !convex {
        let step = (right - left) / f64::from(COARSE);
        let start = left;
        let point = |i: u32| start + step * f64::from(i);
        let better = |i, j| if scored(point(j)).1.beats(&scored(point(i)).1) { j } else { i };
        let best = (0..=COARSE).reduce(better).unwrap_or(0);
        left = point(best.saturating_sub(1));
        right = point((best + 1).min(COARSE));
    }
    let lower = |left: f64, right: f64| right - SECTION * (right - left);
    let upper = |left: f64, right: f64| left + SECTION * (right - left);
    let mut inner = [scored(lower(left, right)), scored(upper(left, right))];
    while right - left > width {
        if inner[1].1.beats(&inner[0].1) {
            left = lower(left, right);
            inner = [inner[1], scored(upper(left, right))];
        } else {
            right = upper(left, right);
            inner = [scored(lower(left, right)), inner[0]];
        }
    }
    let points = [scored(left), inner[0], inner[1], scored(right)];
    points
        .into_iter()
        .reduce(|best, x| if x.1.beats(&best.1) { x } else { best })
        .map_or(low, |x| x.0)
}
