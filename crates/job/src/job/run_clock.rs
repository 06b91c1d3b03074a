//! Times of a run.

use super::status::TimeForecast;
use std::mem;
use std::time::{Duration, Instant};

/// Wall-clock times of what a run does between and after its iterations.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spent {
    /// Choices of path counts, and the promise.
    pub choices: Duration,
    /// Paths of the audit, and its comparisons with the image.
    pub audit: Duration,
    /// Estimates of noise and bias.
    pub estimates: Duration,
    /// Denoising and its error.
    pub denoising: Duration,
}

/// Times of a run and their forecasts.
pub(super) struct RunClock {
    /// Start of the job, before the pilot.
    pub start: Instant,
    first_iteration: Instant,
    pub min_iterations: u64,
    /// Forecasts at times that grow by 2 %.
    pub forecasts: Vec<TimeForecast>,
    /// Time of the latest estimate of the noise, seconds, and its duration.
    pub last_estimate: f64,
    pub estimate_time: f64,
    /// Time of the latest iteration without that of new areas, seconds.
    pub latest_iteration: f64,
    /// Times between and after the iterations.
    pub spent: Spent,
    /// Time that the stop conditions leave out for the caller's work at the end.
    reserve: Duration,
}

impl RunClock {
    /// A clock for a run that started at `start` and renders its first iteration now. The stop
    /// conditions leave out `reserve` for the caller.
    pub fn new(start: Instant, min_iterations: u64, reserve: Duration) -> Self {
        Self {
            start,
            first_iteration: Instant::now(),
            min_iterations,
            forecasts: Vec::new(),
            last_estimate: 0.0,
            estimate_time: 0.0,
            latest_iteration: 0.0,
            spent: Spent::default(),
            reserve,
        }
    }

    /// Time since the first iteration, seconds.
    pub fn rendering_time(&self) -> f64 {
        self.first_iteration.elapsed().as_secs_f64()
    }

    /// Leaves out `reserve` of the time instead of the present reserve, and returns the new `end`
    /// of the iterations.
    pub fn replace_reserve(&mut self, end: Duration, reserve: Duration) -> Duration {
        let all = end + mem::replace(&mut self.reserve, reserve);
        all.saturating_sub(reserve)
    }
}

/// Maximum share of the time by which an iteration may end after it.
const MOST_LATE: f64 = 0.01;

/// Whether to render another iteration that takes about `next` seconds if `left` seconds of `all`
/// are left: at least half of it must be within the time, and it must not end much later.
// theory.md (92)
pub(super) fn has_time(left: f64, next: f64, all: f64) -> bool {
    0.5 * next <= left && next <= left + MOST_LATE * all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn iteration_starts_only_if_half_of_it_is_within_the_time() {
        let cases = [(3.0, 2.0, true), (1.0, 2.0, true), (0.9, 2.0, false), (-1.0, 0.5, false)];
        for (left, next, starts) in cases {
            assert_eq!(has_time(left, next, 120.0), starts, "{left} {next}");
        }
        // .5 s late is too late for 20 s.
        assert!(!has_time(3.5, 4.0, 20.0) && has_time(3.9, 4.0, 20.0));
    }

    #[test]
    fn measured_reserve_replaces_the_assumed_one() {
        // 30 s with 4 s assumed for files; then measured as 6 s, as 1 s, and as more than all.
        let mut clock = RunClock::new(Instant::now(), 1, Duration::from_secs(4));
        let mut end = Duration::from_secs(26);
        for (measured, expected) in [(6, 24), (1, 29), (40, 0)] {
            end = clock.replace_reserve(end, Duration::from_secs(measured));
            assert_eq!(end, Duration::from_secs(expected));
        }
    }
}
