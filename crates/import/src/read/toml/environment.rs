//! `[environment]` of a scene file.

use super::numbers::NonNegative;
use crate::environment::from_file;
use crate::warnings::Warning;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::Environment;
use bdpm_core::settings::FixedArray;
use serde::Deserialize;
use std::path::Path;

/// `[environment]`
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentTable {
    /// EXR or HDR file, relative to the scene file's folder.
    file: Option<String>,
    /// Factor of the file, or a constant radiance from all directions.
    radiance: Option<NonNegative>,
    #[serde(default)]
    turn_deg: f32,
    /// EXR or HDR file of a finer map in place of a rectangle of pixels.
    inset_file: Option<String>,
    /// First column, first row, number of columns and of rows of that rectangle.
    inset: Option<FixedArray<u32, 4>>,
}

impl EnvironmentTable {
    /// Reads the map. Warnings report corrected pixels.
    pub fn environment(&self, folder: &Path, warnings: &mut Vec<Warning>) -> Result<Environment> {
        if !self.turn_deg.is_finite() {
            return Err(Error::new("`turn_deg` is not finite", "give an angle in degrees"));
        }
        let scale = self.radiance.map_or(Rgb::ONE, |radiance| radiance.0);
        let is_pair = self.inset_file.is_some() == self.inset.is_some();
        if !is_pair || (self.inset.is_some() && self.file.is_none()) {
            let advice = "give all of `file`, `inset_file` and `inset`, or no inset";
            return Err(Error::new("the inset of the environment is incomplete", advice));
        }
        match &self.file {
            Some(file) => {
                let path = folder.join(file);
                let inset = self.inset_file.as_ref().zip(self.inset);
                let inset = inset.map(|(file, FixedArray(place))| (folder.join(file), place));
                from_file(&path, scale, self.turn_deg, inset, warnings)
            }
            None if self.radiance.is_some() => Ok(Environment::new(1, 1, vec![scale], 0.0)),
            None => {
                let advice = "give an .exr or .hdr file, or the radiance from all directions";
                Err(Error::new("the environment needs `file` or `radiance`", advice))
            }
        }
    }
}
