//! The time of an iteration: measured phase by phase, fitted by a model, and kept in files.
//!
//! 1. [`measure`] lists the counts to measure at and collects the times of single iterations as
//!    [`TimeSample`](measure::TimeSample)s. [`criterion`] reads them from Criterion's output.
//! 2. [`fit`](mod@fit) turns the samples into a [`TimeModel`] by `least_squares`.
//! 3. [`calibrate`] does both for a scene.
//! 4. [`file`](mod@file) keeps model, samples and the [`setup`] in a file, and reads it back.

pub mod calibrate;
pub mod criterion;
pub mod file;
pub mod fit;
pub(crate) mod least_squares;
pub mod measure;
pub mod setup;

pub use file::Timings;

use bdpm_core::base::error::{Error, Result};
use bdpm_core::film::counts::Counts;
use serde::{Deserialize, Serialize};

/// `tau(N_F, n) = fixed + light_path N_F + (camera_path + look_up) sum_p n_p
/// + merge_pair N_F sum_p n_p`, in seconds, `n_p` being the camera paths of pixel `p`.
///
/// All coefficients depend on scene, strategy, radius, resolution and machine. In a file it is a
/// JSON object with exactly these keys.
// theory.md (76)
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeModel {
    /// Seconds per iteration that no count changes.
    pub fixed: f64,
    /// Seconds per light path traced and put in the photon map; the paper's alpha.
    pub light_path: f64,
    /// Seconds per camera path traced, with its direct light; with `look_up` the paper's beta.
    pub camera_path: f64,
    /// Seconds per camera path for looking up the photon map.
    pub look_up: f64,
    /// Seconds per pair of a light path and a camera path for merging; the paper's gamma.
    pub merge_pair: f64,
    /// Pixels of the image that the model was fitted for.
    pub pixels: f64,
}

/// Names of the coefficients, in the order of [`TimeModel::seconds`].
const COEFFICIENTS: [&str; 5] = ["fixed", "light_path", "camera_path", "look_up", "merge_pair"];

impl TimeModel {
    /// From the coefficients in the order of [`Self::seconds`].
    fn new([fixed, light_path, camera_path, look_up, merge_pair]: [f64; 5], pixels: f64) -> Self {
        Self { fixed, light_path, camera_path, look_up, merge_pair, pixels }
    }

    /// The coefficients: per iteration, light path, camera path, look-up, and pair.
    fn seconds(&self) -> [f64; 5] {
        [self.fixed, self.light_path, self.camera_path, self.look_up, self.merge_pair]
    }

    /// The model of a machine that takes `scale` times as long.
    #[must_use]
    pub fn scaled(&self, scale: f64) -> Self {
        Self::new(self.seconds().map(|seconds| scale * seconds), self.pixels)
    }

    /// Refuses numbers that cannot be times.
    ///
    /// # Errors
    /// Names the key.
    pub fn validate(&self) -> Result<()> {
        for (name, value) in COEFFICIENTS.into_iter().zip(self.seconds()) {
            // Written so that NaN fails.
            if !(value >= 0.0 && value.is_finite()) {
                return Err(Error::new(
                    format!("the timing {name} is {value} seconds"),
                    format!("give {name} as a number of seconds of at least 0"),
                ));
            }
        }
        if !(self.pixels >= 1.0 && self.pixels.is_finite()) {
            return Err(Error::new(
                format!("the timings are for {} pixels", self.pixels),
                "give the number of pixels of the image they were measured with",
            ));
        }
        if self.iteration(1.0, 1.0) == 0.0 {
            return Err(Error::new(
                "all timings are 0",
                format!("give at least one of {}", COEFFICIENTS.join(", ")),
            ));
        }
        Ok(())
    }

    /// Seconds per iteration at `n_light` light paths and `n_camera` camera paths in each pixel.
    pub fn iteration(&self, n_light: f64, n_camera: f64) -> f64 {
        let [base, per_light_path] = self.in_light_paths(n_camera);
        base + per_light_path * n_light
    }

    /// Seconds of an iteration at these counts.
    pub fn at(&self, counts: &Counts) -> f64 {
        self.iteration(f64::from(counts.light_paths), counts.camera_paths.mean())
    }

    /// Seconds of an iteration by cause: `fixed`, light paths, camera paths, and merging with its
    /// look-ups. The last three are the paper's `tau_FMCRT`, `tau_BMCRT` and `tau_merge` (Table 2).
    pub fn parts(&self, n_light: f64, n_camera: f64) -> [f64; 4] {
        let camera_paths = self.pixels * n_camera;
        [
            self.fixed,
            self.light_path * n_light,
            self.camera_path * camera_paths,
            (self.look_up + self.merge_pair * n_light) * camera_paths,
        ]
    }

    /// Seconds per iteration without light paths, and seconds per light path, at `n_camera` camera
    /// paths in each pixel.
    pub fn in_light_paths(&self, n_camera: f64) -> [f64; 2] {
        let camera_paths = self.pixels * n_camera;
        [
            self.fixed + (self.camera_path + self.look_up) * camera_paths,
            self.light_path + self.merge_pair * camera_paths,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn iteration_time_is_the_sum_of_its_parts() {
        let model = TimeModel::new([0.5, 2.0, 3.0, 4.0, 5.0], 10.0);
        assert_eq!(model.iteration(7.0, 2.0), 0.5 + 14.0 + 7.0 * 20.0 + 5.0 * 7.0 * 20.0);
        assert_eq!(model.parts(7.0, 2.0), [0.5, 14.0, 60.0, 80.0 + 700.0]);
    }
}
