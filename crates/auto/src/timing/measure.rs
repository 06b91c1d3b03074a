//! Measured times: at which counts, and the medians of the phases over iterations.

use bdpm_core::film::PhaseTimes;
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
    /// All phases; together they are the whole iteration.
    pub const ALL: [Self; 4] = [Self::Light, Self::Camera, Self::Merge, Self::Rest];

    /// The phase's name in files and tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Light => "light",
            Self::Camera => "camera",
            Self::Merge => "merge",
            Self::Rest => "rest",
        }
    }

    /// The phase's share of the wall-clock time: busy thread time over `threads`.
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

/// Numbers of light paths to measure at.
const LIGHT_PATHS: [u32; 4] = [1000, 10_000, 100_000, 1_000_000];

/// Numbers of camera paths per pixel to measure at: few, so that iterations are short.
const CAMERA_PATHS: [u32; 3] = [1, 2, 4];

/// Counts of an iteration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SampleSize {
    /// `N_F`.
    pub light_paths: u32,
    /// `N_B`, in every pixel.
    pub camera_paths: u32,
}

/// The counts at which `phase` is measured for an image of `pixels` pixels: counts that the phase
/// depends on vary, the others are small.
pub fn sizes_of(phase: Phase, pixels: usize) -> Vec<SampleSize> {
    let size = |light_paths, camera_paths| SampleSize { light_paths, camera_paths };
    // More than a few light paths per pixel take long and are no good choice for the image.
    let most = (4 * pixels).max(10_000);
    let light = LIGHT_PATHS.into_iter().filter(|&n| n as usize <= most);
    let [few, _, many] = CAMERA_PATHS;
    match phase {
        Phase::Light => light.map(|n| size(n, few)).collect(),
        Phase::Camera => CAMERA_PATHS.map(|n| size(LIGHT_PATHS[0], n)).into(),
        // These depend on both counts: measure at pairs of them, but for the largest.
        Phase::Merge | Phase::Rest => {
            let many = light.clone().filter(|&n| n < LIGHT_PATHS[3]).map(|n| size(n, many));
            light.map(|n| size(n, few)).chain(many).collect()
        }
    }
}

/// The counts at which the phases are measured, each pair once.
pub fn sizes(pixels: usize) -> Vec<SampleSize> {
    let mut all = Vec::new();
    for size in Phase::ALL.into_iter().flat_map(|phase| sizes_of(phase, pixels)) {
        if !all.contains(&size) {
            all.push(size);
        }
    }
    all
}

/// A measured time of one phase.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TimeSample {
    /// The phase.
    pub phase: Phase,
    /// `N_F`.
    pub light_paths: f64,
    /// `N_B`, per pixel; where it differs between pixels, its mean.
    pub camera_paths: f64,
    /// Share of the phase in an iteration's wall-clock time, seconds.
    pub seconds: f64,
    /// Standard error of `seconds`, if it is known.
    pub error: Option<f64>,
}

/// Collects the times of single iterations, any counts in any order.
#[derive(Clone, Debug)]
pub struct Recorder {
    threads: usize,
    groups: Vec<SizeTimes>,
}

/// Times at one pair of counts, seconds, by phase.
#[derive(Clone, Debug)]
struct SizeTimes {
    light_paths: f64,
    camera_paths: f64,
    seconds: [Vec<f64>; Phase::ALL.len()],
}

impl Recorder {
    /// For iterations that run on `threads` threads.
    pub fn new(threads: usize) -> Self {
        Self { threads, groups: Vec::new() }
    }

    /// Adds an iteration of `light_paths` light paths and `camera_paths` per pixel (or their mean).
    pub fn add(&mut self, light_paths: f64, camera_paths: f64, times: &PhaseTimes) {
        let same = |group: &SizeTimes| {
            (group.light_paths, group.camera_paths) == (light_paths, camera_paths)
        };
        let index = self.groups.iter().position(same).unwrap_or_else(|| {
            self.groups.push(SizeTimes { light_paths, camera_paths, seconds: Default::default() });
            self.groups.len() - 1
        });
        for (phase, seconds) in Phase::ALL.into_iter().zip(&mut self.groups[index].seconds) {
            seconds.push(phase.time(times, self.threads).as_secs_f64());
        }
    }

    /// The median time of every phase at all counts, with standard errors.
    pub fn samples(&self) -> Vec<TimeSample> {
        let of_phase = |phase: Phase| {
            self.groups.iter().map(move |group| {
                let (seconds, error) = median(&group.seconds[phase as usize]);
                let SizeTimes { light_paths, camera_paths, .. } = *group;
                TimeSample { phase, light_paths, camera_paths, seconds, error }
            })
        };
        Phase::ALL.into_iter().flat_map(of_phase).collect()
    }
}

/// The median and its standard error: half the distance of the order statistics of ranks
/// `(n -+ sqrt n) / 2`, which the true median lies between with the probability of one sigma,
/// however the values are distributed. The error of a single value is unknown.
///
/// # Panics
/// Without values.
// theory.md (79)
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
    use crate::timing::fit::fit;

    #[test]
    fn phase_times_add_up_to_the_wall_clock_time() {
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
    fn iterations_at_equal_counts_become_one_sample() {
        let mut recorder = Recorder::new(1);
        for (light_paths, millis) in [(10.0, 3), (20.0, 7), (10.0, 5), (10.0, 100)] {
            let light = Duration::from_millis(millis);
            let times = PhaseTimes { light, wall: light, ..PhaseTimes::default() };
            recorder.add(light_paths, 4.0, &times);
        }
        let samples = recorder.samples();
        assert_eq!(samples.len(), 8);
        let expected = TimeSample {
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
    fn error_of_the_median_is_its_standard_deviation() {
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

    #[test]
    fn sizes_determine_all_coefficients() {
        for pixels in [1, 192, 16_384, 512 * 512, 3840 * 2160] {
            let sample = |phase| {
                move |size: SampleSize| TimeSample {
                    phase,
                    light_paths: f64::from(size.light_paths),
                    camera_paths: f64::from(size.camera_paths),
                    seconds: 1.0,
                    error: Some(0.1),
                }
            };
            let of = |phase| sizes_of(phase, pixels).into_iter().map(sample(phase));
            let all: Vec<TimeSample> = Phase::ALL.into_iter().flat_map(of).collect();
            assert_eq!(fit(&all, pixels as f64).unwrap().notes, Vec::<String>::new());
        }
        assert_eq!(sizes(512 * 512).len(), 8);
        assert_eq!(sizes(192).len(), 5);
    }
}
