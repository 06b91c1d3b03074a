//! Times of the phases at given counts, and their medians over iterations.

use crate::film::PhaseTimes;
use serde::{Deserialize, Serialize};
use std::time::Duration;

/// A part of an iteration whose time is measured by itself, as in Table 2.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Phase {
    /// Tracing light paths and building the photon map.
    Light,
    /// Tracing camera paths with their direct light.
    Camera,
    /// Look-ups and merging.
    Merge,
    /// The rest of the wall-clock time: what is not parallel, and threads that wait.
    Rest,
}

impl Phase {
    /// All of them; together they are the whole iteration.
    pub const ALL: [Self; 4] = [Self::Light, Self::Camera, Self::Merge, Self::Rest];

    /// Its name in files and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Light => "light",
            Self::Camera => "camera",
            Self::Merge => "merge",
            Self::Rest => "rest",
        }
    }

    /// Its share of the wall-clock time: busy thread time over `threads`.
    pub fn time(self, times: &PhaseTimes, threads: usize) -> Duration {
        let threads = u32::try_from(threads.max(1)).unwrap_or(u32::MAX);
        match self {
            Self::Light => times.light / threads,
            Self::Camera => times.camera / threads,
            Self::Merge => times.merge / threads,
            Self::Rest => {
                let busy = (times.light + times.camera + times.merge) / threads;
                times.wall.saturating_sub(busy)
            }
        }
    }
}

/// A measured time of one phase.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// The phase.
    pub phase: Phase,
    /// `N_F`.
    pub light_paths: f64,
    /// `N_B`, per pixel; where it differs between pixels, its mean.
    pub camera_paths: f64,
    /// The phase's share of an iteration's wall-clock time, seconds.
    pub seconds: f64,
    /// Standard error of `seconds`, if it is known.
    pub error: Option<f64>,
}

/// Collects the times of single iterations, any counts in any order.
#[derive(Clone, Debug)]
pub struct Recorder {
    threads: usize,
    sizes: Vec<Size>,
}

/// Times at one pair of counts, seconds, by phase.
#[derive(Clone, Debug)]
struct Size {
    light_paths: f64,
    camera_paths: f64,
    seconds: [Vec<f64>; Phase::ALL.len()],
}

impl Recorder {
    /// For iterations that run on so many threads.
    pub fn new(threads: usize) -> Self {
        Self { threads, sizes: Vec::new() }
    }

    /// Adds an iteration of `light_paths` light paths and `camera_paths` per pixel (or their mean).
    pub fn add(&mut self, light_paths: f64, camera_paths: f64, times: &PhaseTimes) {
        let same =
            |size: &Size| (size.light_paths, size.camera_paths) == (light_paths, camera_paths);
        let index = self.sizes.iter().position(same).unwrap_or_else(|| {
            self.sizes.push(Size { light_paths, camera_paths, seconds: Default::default() });
            self.sizes.len() - 1
        });
        for (phase, seconds) in Phase::ALL.into_iter().zip(&mut self.sizes[index].seconds) {
            seconds.push(phase.time(times, self.threads).as_secs_f64());
        }
    }

    /// The median time of every phase at all counts, with standard errors.
    pub fn samples(&self) -> Vec<Sample> {
        let all = Phase::ALL.into_iter().enumerate();
        all.flat_map(|(index, phase)| self.sizes.iter().map(move |size| (index, phase, size)))
            .map(|(index, phase, size)| {
                let (seconds, error) = median(&size.seconds[index]);
                let Size { light_paths, camera_paths, .. } = *size;
                Sample { phase, light_paths, camera_paths, seconds, error }
            })
            .collect()
    }
}

/// The median and its standard error: half the distance of the order statistics of ranks
/// `(n -+ sqrt n) / 2`, which the true median lies between with the probability of one sigma,
/// however the values are distributed. The error of a single value is unknown.
///
/// # Panics
/// Without values.
/// theory.md (79).
fn median(values: &[f64]) -> (f64, Option<f64>) {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let n = sorted.len();
    let middle = 0.5 * (sorted[(n - 1) / 2] + sorted[n / 2]);
    let low = (0.5 * (n as f64 - (n as f64).sqrt())) as usize;
    (middle, (n > 1).then(|| 0.5 * (sorted[n - 1 - low] - sorted[low])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_phases_add_up_to_the_wall_clock() {
        let times = PhaseTimes {
            light: Duration::from_millis(20),
            camera: Duration::from_millis(60),
            merge: Duration::from_millis(40),
            wall: Duration::from_millis(75),
        };
        let millis = Phase::ALL.map(|phase| phase.time(&times, 2).as_millis());
        assert_eq!(millis, [10, 30, 20, 15]);
        // Clocks of several threads may disagree by a little.
        let late = PhaseTimes { wall: Duration::from_millis(59), ..times };
        assert_eq!(Phase::Rest.time(&late, 2), Duration::ZERO);
    }

    #[test]
    fn iterations_at_the_same_counts_are_one_sample() {
        let mut recorder = Recorder::new(1);
        for (light_paths, millis) in [(10.0, 3), (20.0, 7), (10.0, 5), (10.0, 100)] {
            let light = Duration::from_millis(millis);
            let times = PhaseTimes { light, wall: light, ..PhaseTimes::default() };
            recorder.add(light_paths, 4.0, &times);
        }
        let samples = recorder.samples();
        assert_eq!(samples.len(), 8);
        let expected = Sample {
            phase: Phase::Light,
            light_paths: 10.0,
            camera_paths: 4.0,
            seconds: 0.005,
            error: Some(0.0485),
        };
        assert_eq!(samples[0], expected);
        assert_eq!((samples[1].seconds, samples[1].error), (0.007, None));
        assert!(samples.iter().filter(|s| s.phase == Phase::Rest).all(|s| s.seconds == 0.0));
    }

    #[test]
    fn the_error_of_the_median_is_its_standard_deviation() {
        let mut state = 1u64;
        let mut uniform = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        // Sums of 12: nearly normal, standard deviation 1.
        let mut normal = move || (0..12).map(|_| uniform()).sum::<f64>() - 6.0;
        for n in [5, 10, 30] {
            let (mut square, mut claimed) = (0.0, 0.0);
            for _ in 0..4000 {
                let values: Vec<f64> = (0..n).map(|_| normal()).collect();
                let (value, error) = median(&values);
                square += value * value / 4000.0;
                claimed += error.unwrap() / 4000.0;
            }
            let ratio = claimed / square.sqrt();
            assert!((0.85..1.15).contains(&ratio), "{n}: {ratio}");
        }
    }
}
