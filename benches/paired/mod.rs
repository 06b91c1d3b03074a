//! Two pieces of work in turn: on a machine whose speed changes from second to second, only what
//! runs side by side compares.
#![allow(dead_code)]

use std::fmt;
use std::time::{Duration, Instant};

/// Rounds of both.
const ROUNDS: usize = 41;

/// Time of one piece of work over that of the other.
#[derive(Clone, Copy, Debug)]
pub struct Ratio {
    /// Over all rounds.
    pub median: f64,
    /// Half of the rounds lie in between.
    pub quartiles: [f64; 2],
    /// Median time of each, seconds.
    pub seconds: [f64; 2],
}

/// Whether this is neither a test nor a profile.
pub fn measures() -> bool {
    let has = |name: &str| std::env::args().any(|argument| argument == name);
    has("--bench") && !has("--profile-time")
}

/// Time of the work.
pub fn timed<T>(work: impl FnOnce() -> T) -> Duration {
    let start = Instant::now();
    std::hint::black_box(work());
    start.elapsed()
}

/// The middle of all, or another quartile.
fn quartile(values: impl Iterator<Item = f64>, which: usize) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[which * (values.len() - 1) / 4]
}

impl Ratio {
    /// Ratio of two pieces of work that report their own times.
    pub fn new(one: impl FnMut() -> Duration, other: impl FnMut() -> Duration) -> Self {
        Self::of(ROUNDS, one, other)
    }

    /// The ratio from this number of rounds.
    pub fn of(
        rounds: usize,
        mut one: impl FnMut() -> Duration,
        mut other: impl FnMut() -> Duration,
    ) -> Self {
        let mut round = || [one().as_secs_f64(), other().as_secs_f64()];
        round();
        let rounds: Vec<[f64; 2]> = (0..rounds).map(|_| round()).collect();
        let ratios = || rounds.iter().map(|[one, other]| one / other);
        Self {
            median: quartile(ratios(), 2),
            quartiles: [1, 3].map(|which| quartile(ratios(), which)),
            seconds: [0, 1].map(|of| quartile(rounds.iter().map(|round| round[of]), 2)),
        }
    }
}

impl fmt::Display for Ratio {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.quartiles;
        write!(f, "{:.2} ({low:.2} to {high:.2})", self.median)
    }
}
