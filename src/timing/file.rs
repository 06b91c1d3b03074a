//! Times in files: what `bdpm calibrate` writes, what Criterion left, or bare coefficients.

use super::fit::{Fit, Point, TimeErrors};
use super::model::TimeModel;
use super::setup::Setup;
use crate::base::atomic::write_atomically;
use crate::base::error::{Error, Result};
use crate::base::input::read_text;
use crate::image_io::Metadata;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A time model with all that is known about it. In a file it is a JSON object with these keys, or
/// the [`TimeModel`] alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Timings {
    /// The coefficients.
    pub model: TimeModel,
    /// Their standard errors, if the model was fitted.
    pub errors: Option<TimeErrors>,
    /// What was measured, beside what the fit says.
    pub points: Vec<Point>,
    /// Coefficients that could not be told apart.
    pub notes: Vec<String>,
    /// What was measured with; unknown for a bare model.
    pub setup: Option<Setup>,
}

impl From<TimeModel> for Timings {
    /// Times of which nothing else is known.
    fn from(model: TimeModel) -> Self {
        Self { model, errors: None, points: Vec::new(), notes: Vec::new(), setup: None }
    }
}

impl Timings {
    /// Measured with `setup`.
    pub fn new(fit: Fit, setup: Setup) -> Self {
        let Fit { model, errors, points, notes } = fit;
        Self { model, errors: Some(errors), points, notes, setup: Some(setup) }
    }

    /// Reads a folder that Criterion wrote, a file that [`Self::save`] wrote, or a file with the six
    /// keys of a [`TimeModel`].
    ///
    /// # Errors
    /// If it is none of these; names the file.
    pub fn load(path: &Path) -> Result<Self> {
        if path.is_dir() {
            return Self::from_criterion(path);
        }
        Self::parse(&read_text(path)?).map_err(|e| e.at(path))
    }

    /// Reads the text of a file.
    ///
    /// # Errors
    /// Names the key.
    pub fn parse(text: &str) -> Result<Self> {
        let advice = "give a file that bdpm calibrate wrote, or a JSON object with the keys fixed, \
                      light_path, camera_path, look_up, merge_pair (seconds) and pixels";
        let json: serde_json::Value = from_json(text, advice)?;
        if json.get("model").is_none() {
            return Ok(TimeModel::parse(text)?.into());
        }
        let timings: Self = from_json(text, advice)?;
        timings.model.validate()?;
        timings.setup.as_ref().map_or(Ok(()), Setup::validate)?;
        Ok(timings)
    }

    /// Writes a JSON file.
    ///
    /// # Errors
    /// If it cannot be written; names it.
    pub fn save(&self, path: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self).expect("plain numbers and texts") + "\n";
        write_atomically(path, |file| file.write_all(text.as_bytes()))
    }

    /// Refuses to use the times for an image of `width` times `height` pixels of which `facts` are
    /// known, as [`Setup::check_fits`]; of a bare model only the number of pixels can be compared.
    ///
    /// # Errors
    /// Names everything that differs, with both values.
    pub fn check_fits(&self, facts: &Metadata, width: u32, height: u32) -> Result<()> {
        if let Some(setup) = &self.setup {
            return setup.check_fits(facts);
        }
        let pixels = f64::from(width) * f64::from(height);
        if self.model.pixels == pixels {
            return Ok(());
        }
        Err(Error::new(
            format!("these times are for {} pixels, not {pixels}", self.model.pixels),
            "measure the times of this scene with these settings: bdpm calibrate",
        ))
    }
}

/// Reads JSON that is to be times.
pub(super) fn from_json<T: serde::de::DeserializeOwned>(text: &str, advice: &str) -> Result<T> {
    serde_json::from_str(text).map_err(|e| Error::new(format!("these are no timings: {e}"), advice))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::timing::sample::Phase;
    use crate::timing::setup::tests::{facts, setup};

    const BARE: &str = r#"{"fixed":0.5,"light_path":2e-7,"camera_path":3,"look_up":4,
                           "merge_pair":5,"pixels":262144}"#;

    fn full() -> Timings {
        let point = Point {
            phase: Phase::Light,
            light_paths: 1000.0,
            camera_paths: 1.0,
            measured: 0.1,
            error: None,
            fitted: 0.2,
        };
        Timings {
            errors: Some(TimeErrors { fixed: Some(0.01), ..TimeErrors::default() }),
            points: vec![point],
            notes: vec!["a note".into()],
            setup: Some(setup()),
            ..Timings::parse(BARE).unwrap()
        }
    }

    #[test]
    fn a_file_keeps_everything() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("times.json");
        full().save(&path).unwrap();
        assert_eq!(Timings::load(&path).unwrap(), full());
        let bare = Timings::parse(BARE).unwrap();
        assert_eq!((bare.model, bare.errors), (full().model, None));
    }

    #[test]
    fn other_files_are_refused_by_name() {
        let good = serde_json::to_string(&full()).unwrap();
        for (text, problem, advice) in [
            (good.replace("\"notes\"", "\"nodes\""), "unknown field `nodes`", "bdpm calibrate"),
            (good.replace("\"light\"", "\"dark\""), "unknown variant `dark`", "bdpm calibrate"),
            (good.replace("\"look_up\":4.0", "\"look_up\":-4"), "look_up is -4", "at least 0"),
            (BARE.replace("\"fixed\"", "\"fixd\""), "unknown field `fixd`", "keys fixed"),
            (BARE.replace('}', ""), "no timings: EOF", "bdpm calibrate wrote, or"),
            ("[]".into(), "no timings", "keys fixed"),
        ] {
            let shown = Timings::parse(&text).unwrap_err().to_string();
            let (found, help) = shown.split_once("\nhelp: ").unwrap();
            assert!(found.contains(problem) && help.contains(advice), "{shown}");
        }
    }

    #[test]
    fn a_bare_model_is_compared_by_its_pixels() {
        let bare = Timings::parse(BARE).unwrap();
        bare.check_fits(&Metadata::new(), 512, 512).unwrap();
        let shown = bare.check_fits(&Metadata::new(), 512, 256).unwrap_err().to_string();
        assert!(shown.contains("for 262144 pixels, not 131072\nhelp: "), "{shown}");
        full().check_fits(&facts(), 512, 512).unwrap();
        assert!(full().check_fits(&Metadata::new(), 512, 512).is_err());
    }
}
