//! Two pieces of work in turn: on a machine whose speed changes from second to second, only what
//! runs side by side compares.
#![allow(dead_code)]

use std::time::{Duration, Instant};

/// Rounds of both.
const ROUNDS: usize = 41;

/// How long one takes over how long the other does.
#[derive(Clone, Copy, Debug)]
pub struct Ratio {
    /// Over all rounds.
    pub median: f64,
    /// Half of the rounds lie in between.
    pub quartiles: [f64; 2],
    /// Median time of the first, seconds.
    pub seconds: f64,
}

/// Each round's time of `one` over that of `other`.
pub fn ratio(mut one: impl FnMut() -> Duration, mut other: impl FnMut() -> Duration) -> Ratio {
    one();
    other();
    let mut rounds: Vec<(f64, f64)> =
        (0..ROUNDS).map(|_| (one().as_secs_f64(), other().as_secs_f64())).collect();
    rounds.sort_by(|a, b| (a.0 / a.1).total_cmp(&(b.0 / b.1)));
    let at = |share: usize| rounds[share * (ROUNDS - 1) / 4];
    let of = |(one, other): (f64, f64)| one / other;
    let mut seconds: Vec<f64> = rounds.iter().map(|round| round.0).collect();
    seconds.sort_by(f64::total_cmp);
    Ratio {
        median: of(at(2)),
        quartiles: [of(at(1)), of(at(3))],
        seconds: seconds[ROUNDS / 2],
    }
}

/// How long it takes.
pub fn timed(work: impl FnOnce()) -> Duration {
    let start = Instant::now();
    work();
    start.elapsed()
}

impl std::fmt::Display for Ratio {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [low, high] = self.quartiles;
        write!(f, "{:.2} ({low:.2} to {high:.2})", self.median)
    }
}
