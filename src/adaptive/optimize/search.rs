//! Searches along one count.

/// Costs this close to each other, relatively, are equal: rounding errors do not decide.
const EQUAL: f64 = 1e-13;

/// What is minimized, within which limits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Criterion {
    /// Longest iteration, seconds.
    most_time: f64,
    /// Highest cost; the shortest iteration is looked for up to it, the least cost without it.
    most_cost: Option<f64>,
}

impl Criterion {
    pub(super) fn least_cost(most_time: f64) -> Self {
        Self { most_time, most_cost: None }
    }

    /// The shortest iteration whose cost exceeds `cost` by at most the fraction `slack`.
    pub(super) fn least_time(self, cost: f64, slack: f64) -> Self {
        Self { most_cost: Some(cost * (1.0 + slack.max(0.0)) * (1.0 + 10.0 * EQUAL)), ..self }
    }

    /// The least cost of iterations as short.
    pub(super) fn without_cost_limit(self) -> Self {
        Self { most_cost: None, ..self }
    }

    /// The iteration is short enough.
    pub(super) fn allows(&self, time: f64) -> bool {
        time <= self.most_time
    }

    pub(super) fn most_cost(&self) -> Option<f64> {
        self.most_cost
    }

    pub(super) fn score(&self, time: f64, variance: f64) -> Score {
        self.score_cost(time, time * variance)
    }

    fn score_cost(&self, time: f64, cost: f64) -> Score {
        let factor = |value, most| if value <= most { 0.0 } else { value / most };
        let excess =
            [factor(time, self.most_time), self.most_cost.map_or(0.0, |m| factor(cost, m))];
        Score { excess, value: if self.most_cost.is_some() { time } else { cost }, cost, time }
    }
}

/// How good counts are: first by the time above its limit, then by the cost above its limit, then
/// by the value. All sets of counts at least as good as others are convex where times and costs
/// are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Score {
    /// The factors by which time and cost exceed their limits; 0 within these.
    excess: [f64; 2],
    value: f64,
    pub(super) cost: f64,
    pub(super) time: f64,
}

impl Score {
    /// Within the limits of time and cost.
    pub(super) fn is_valid(&self) -> bool {
        self.excess == [0.0; 2]
    }

    /// The same counts by another criterion.
    pub(super) fn with_criterion(&self, criterion: &Criterion) -> Self {
        criterion.score_cost(self.time, self.cost)
    }

    /// Strictly better; among equals the shorter iteration is.
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

/// Two numbers from `low` to `high`, closer than the relative `width`, between which `holds` turns
/// from false to true; the same bound twice where it never turns.
pub(super) fn turn([low, high]: [f64; 2], width: f64, holds: impl Fn(f64) -> bool) -> [f64; 2] {
    if holds(low) {
        return [low, low];
    }
    if !holds(high) {
        return [high, high];
    }
    let (mut no, mut yes) = (low, high);
    while yes > no * (1.0 + width) {
        let middle = no * (yes / no).sqrt();
        *(if holds(middle) { &mut yes } else { &mut no }) = middle;
    }
    [no, yes]
}

/// Relative improvement for which another scan is made.
const WORTH_A_SCAN: f64 = 1e-5;

/// What is known of one whole number: a bound, and what it leads to if it could beat the incumbent.
pub(super) type Scanned<T> = (Score, Option<(Score, T)>);

/// The best of the whole numbers in `[least, most]`, going outward from `center` in both directions
/// until the bound says that nothing better follows.
///
/// After `dense` numbers the steps double, and again after as many: what is skipped then differs
/// little from its neighbors. A best that is noticeably better
/// than the one before starts another scan around it.
pub(super) fn scan<T>(
    [least, most]: [u32; 2],
    center: f64,
    dense: u32,
    mut incumbent: Option<(Score, T)>,
    at: impl Fn(u32, Option<&Score>) -> Scanned<T>,
) -> Option<(Score, T)> {
    let mut center = (center as u32).clamp(least, most);
    let mut before = None;
    loop {
        let mut best = center;
        for direction in [-1, 1] {
            // The center belongs to the way down.
            let mut number = i64::from(center) + direction.max(0);
            let mut visited = 0;
            while let Some(n) = u32::try_from(number).ok().filter(|n| (least..=most).contains(n)) {
                let (bound, found) = at(n, incumbent.as_ref().map(|(score, _)| score));
                if incumbent.as_ref().is_some_and(|(score, _)| !bound.beats(score)) {
                    break;
                }
                if let Some((score, result)) = found
                    && incumbent.as_ref().is_none_or(|(old, _)| score.beats(old))
                {
                    incumbent = Some((score, result));
                    best = n;
                }
                number += direction << (visited / dense);
                visited += 1;
            }
        }
        let score = incumbent.as_ref().map(|(score, _)| score.value);
        let improved = score.zip(before).is_none_or(|(now, old)| now < old * (1.0 - WORTH_A_SCAN));
        if best.abs_diff(center) <= dense || !improved {
            return incumbent;
        }
        (center, before) = (best, score);
    }
}
