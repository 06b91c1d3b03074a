//! The best counts beside their alternatives, with noise and times.

use super::measured::{Budget, MeasuredProblem};
use super::predict::Predicted;
use super::{NEAR_OPTIMUM, Problem};
use bdpm_core::film::counts::Counts;
use bdpm_core::settings::{MAX_LIGHT_PATHS, Settings};
use serde::Serialize;
use std::ops::RangeInclusive;

/// Noise and time at one choice of counts.
#[derive(Serialize)]
pub struct CountsRow {
    /// The choice.
    pub name: RowName,
    /// `N_F`.
    pub light_paths: u32,
    /// Mean number of camera paths over the pixels.
    pub camera_paths: f64,
    /// Minimum number of camera paths over the pixels.
    pub least_camera_paths: u32,
    /// Maximum number of camera paths over the pixels.
    pub most_camera_paths: u32,
    /// Time of one iteration, seconds.
    pub iteration_time: f64,
    /// Root of the objective for one iteration, luminance, W/(m^2 sr).
    pub rms: Predicted,
    /// RMS after the time, if one was given.
    pub rms_after: Option<Predicted>,
    /// Time to the target, seconds, if one was given.
    pub time_to_target: Option<Predicted>,
    /// Time for equal noise over that of the recommended counts.
    pub relative_time: Predicted,
}

/// A choice of counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum RowName {
    /// Least cost, the same counts everywhere.
    BestUniform,
    /// Shortest iteration within 1 % of the least cost, the same counts everywhere.
    Uniform,
    /// Shortest iteration within 1 % of the least cost with a number for each pixel.
    PerPixel,
    /// One camera path per pixel, with the best number of light paths for that.
    OneCameraPath,
    /// One camera path and one light path per pixel.
    OneEach,
}

/// The counts to compare.
pub struct ComparedCounts {
    all: Vec<(RowName, Counts)>,
    recommended: usize,
}

impl ComparedCounts {
    /// Finds the best counts; `pixels` are those of the image.
    pub fn new(
        measured: &MeasuredProblem,
        problem: &Problem,
        light_paths: &RangeInclusive<u32>,
        pixels: u32,
        per_pixel: bool,
    ) -> Self {
        let (best, shortest) = (problem.uniform(), problem.shortest_uniform(NEAR_OPTIMUM));
        let mut all = vec![
            (RowName::BestUniform, Counts::uniform(best.light_paths, best.camera_paths)),
            (RowName::Uniform, Counts::uniform(shortest.light_paths, shortest.camera_paths)),
        ];
        if per_pixel {
            let found = problem.shortest_per_pixel(NEAR_OPTIMUM);
            all.push((RowName::PerPixel, measured.whole_image(found)));
        }
        let recommended = all.len() - 1;
        all.push((RowName::OneCameraPath, measured.one_camera_path(light_paths.clone())));
        all.push((RowName::OneEach, Counts::uniform(pixels, 1)));
        Self { all, recommended }
    }

    /// The same with whole sets of light paths.
    #[must_use]
    pub fn in_whole_sets(mut self, settings: &Settings) -> Self {
        if settings.sobol_set == 1 {
            return self;
        }
        let allowed = settings.allowed_light_paths(MAX_LIGHT_PATHS);
        for (_, counts) in &mut self.all {
            counts.light_paths = allowed.nearest(counts.light_paths);
        }
        self
    }

    /// The shortest iteration whose cost is within 1 % of the least.
    pub fn recommended(&self) -> &Counts {
        &self.all[self.recommended].1
    }

    /// Noise and time at all counts, up to the end of `budget`.
    pub fn rows(&self, measured: &MeasuredProblem, budget: Budget) -> Vec<CountsRow> {
        let row = |(name, counts): &(RowName, Counts)| {
            let (iteration_time, rms) = (measured.model.at(counts), measured.rms(counts));
            let (rms_after, time_to_target) = match budget {
                Budget::Unbounded => (None, None),
                Budget::Time(time) => {
                    let scale = (iteration_time / time).sqrt();
                    (Some(rms.scaled(scale, scale)), None)
                }
                // tau (rms/target)^2, whose relative error is twice that of the RMS.
                // theory.md (77)
                Budget::Rms(target) => {
                    let scale = iteration_time * rms.value / (target * target);
                    (None, Some(rms.scaled(scale, 2.0 * scale)))
                }
            };
            CountsRow {
                name: *name,
                light_paths: counts.light_paths,
                camera_paths: counts.camera_paths.mean(),
                least_camera_paths: counts.camera_paths.least(),
                most_camera_paths: counts.camera_paths.most(),
                iteration_time,
                rms,
                rms_after,
                time_to_target,
                relative_time: measured.relative_time(self.recommended(), counts),
            }
        };
        self.all.iter().map(row).collect()
    }
}
