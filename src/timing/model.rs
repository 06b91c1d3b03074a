//! Time of one iteration as a function of the numbers of paths.

use crate::base::error::{Error, Result};
use serde::{Deserialize, Serialize};

/// `tau(N_F, n) = fixed + light_path N_F + (camera_path + look_up) sum_p n_p
/// + merge_pair N_F sum_p n_p`, in seconds, `n_p` being the camera paths of pixel `p`.
///
/// All coefficients depend on scene, strategy, radius, resolution and machine. In a file it is a
/// JSON object with exactly these keys.
/// theory.md (76).
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
    /// Pixels of the image that it was fitted for.
    pub pixels: f64,
}

impl TimeModel {
    /// The same with so many times the times.
    #[must_use]
    pub fn scaled(&self, scale: f64) -> Self {
        let Self { fixed, light_path, camera_path, look_up, merge_pair, pixels } = *self;
        Self {
            fixed: scale * fixed,
            light_path: scale * light_path,
            camera_path: scale * camera_path,
            look_up: scale * look_up,
            merge_pair: scale * merge_pair,
            pixels,
        }
    }

    /// Reads a JSON object with exactly the six keys.
    ///
    /// # Errors
    /// If it is not a valid model; names the key.
    pub fn parse(text: &str) -> Result<Self> {
        let model: Self = serde_json::from_str(text).map_err(|e| {
            Error::new(
                format!("these are no timings: {e}"),
                "give a JSON object with the keys fixed, light_path, camera_path, look_up, \
                 merge_pair (seconds) and pixels",
            )
        })?;
        model.validate()?;
        Ok(model)
    }

    /// Refuses what cannot be times.
    ///
    /// # Errors
    /// Names the key.
    pub fn validate(&self) -> Result<()> {
        for (name, value) in [
            ("fixed", self.fixed),
            ("light_path", self.light_path),
            ("camera_path", self.camera_path),
            ("look_up", self.look_up),
            ("merge_pair", self.merge_pair),
        ] {
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
                "give at least one of fixed, light_path, camera_path, look_up, merge_pair",
            ));
        }
        Ok(())
    }

    /// Seconds per iteration at `n_light` light paths and `n_camera` camera paths in each pixel.
    pub fn iteration(&self, n_light: f64, n_camera: f64) -> f64 {
        let [base, per_light_path] = self.in_light_paths(n_camera);
        base + per_light_path * n_light
    }

    /// Seconds of an iteration by what takes them: `fixed`, light paths, camera paths, merging with
    /// its look-ups. The last three are the paper's `tau_FMCRT`, `tau_BMCRT` and `tau_merge`
    /// (Table 2).
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

    const GOOD: &str = r#"{"fixed":0.5,"light_path":2,"camera_path":3,"look_up":4,
                           "merge_pair":5,"pixels":10}"#;

    #[test]
    fn the_time_is_the_sum_of_its_parts() {
        let model = TimeModel::parse(GOOD).unwrap();
        assert_eq!(model.iteration(7.0, 2.0), 0.5 + 14.0 + 7.0 * 20.0 + 5.0 * 7.0 * 20.0);
        assert_eq!(model.parts(7.0, 2.0), [0.5, 14.0, 60.0, 80.0 + 700.0]);
        let text = serde_json::to_string(&model).unwrap();
        assert_eq!(TimeModel::parse(&text).unwrap(), model);
    }

    #[test]
    fn what_cannot_be_times_is_refused_by_name() {
        for (from, to, expected) in [
            ("\"look_up\":4", "\"look_up\":-4", "look_up is -4"),
            ("\"fixed\":0.5", "\"fixed\":null", "no timings"),
            ("\"fixed\":0.5,", "", "fixed"),
            ("\"fixed\"", "\"fixd\"", "unknown field `fixd`"),
            ("\"fixed\":0.5", "\"fixed\":1e999", "no timings"),
            ("\"pixels\":10", "\"pixels\":0", "0 pixels"),
            ("}", "", "no timings"),
        ] {
            let shown = TimeModel::parse(&GOOD.replace(from, to)).unwrap_err().to_string();
            assert!(shown.contains(expected) && shown.contains("help: give"), "{to}: {shown}");
        }
        let nan = TimeModel { merge_pair: f64::NAN, ..TimeModel::parse(GOOD).unwrap() };
        assert!(nan.validate().unwrap_err().to_string().contains("merge_pair is NaN"));
    }
}
