//! Times in files and tables. A file is the output of `bdpm calibrate` or a bare [`TimeModel`], a
//! folder is Criterion's.

use super::fit::{FittedTime, TimeErrors};
use super::setup::MeasurementSetup;
use super::{COEFFICIENTS, TimeModel};
use bdpm_core::base::atomic::write_atomically;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::input::read_text;
use bdpm_core::image_io::Metadata;
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::path::Path;

/// A time model and how it was measured. In a file it is a JSON object with these keys, or the
/// [`TimeModel`] alone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Timings {
    /// The coefficients.
    pub model: TimeModel,
    /// Standard errors of the coefficients, if the model was fitted.
    pub errors: Option<TimeErrors>,
    /// Measured times beside the fitted ones.
    pub points: Vec<FittedTime>,
    /// Coefficients that the measured sizes do not distinguish.
    pub notes: Vec<String>,
    /// Scene, settings and machine; unknown for a bare model.
    pub setup: Option<MeasurementSetup>,
}

impl From<TimeModel> for Timings {
    /// A bare model.
    fn from(model: TimeModel) -> Self {
        Self { model, errors: None, points: Vec::new(), notes: Vec::new(), setup: None }
    }
}

impl Timings {
    /// Reads a folder that Criterion wrote, a file that [`Self::save`] wrote, or a file with the
    /// six keys of a [`TimeModel`].
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
            let model: TimeModel = from_json(text, advice)?;
            model.validate()?;
            return Ok(model.into());
        }
        let timings: Self = from_json(text, advice)?;
        timings.model.validate()?;
        timings.setup.as_ref().map_or(Ok(()), MeasurementSetup::validate)?;
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

    /// Refuses to use the times for another image, given its metadata and size in pixels, as
    /// [`MeasurementSetup::check_fits`]. Of a bare model only the number of pixels can be compared.
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

    /// Setup, measured times and coefficients as text.
    pub fn text(&self) -> String {
        let setup = self.setup.iter().fold(String::new(), |_, setup| format!("{setup}\n\n"));
        format!("{setup}{}\n{}", self.points_table(), self.coefficients_table())
    }

    /// The five coefficients with their standard errors, a line each.
    pub fn coefficients_table(&self) -> String {
        const UNITS: [&str; 5] =
            ["iteration", "light path", "camera path", "camera path", "light path and camera path"];
        let mut text = String::new();
        let errors = self.errors.unwrap_or_default().seconds();
        let columns = self.model.seconds().into_iter().zip(errors).zip(UNITS);
        for (name, ((value, error), unit)) in COEFFICIENTS.into_iter().zip(columns) {
            let error = error.map_or(String::new(), |error| format!("+- {error:.1e}"));
            let row = format!("{name:<11} {value:>10.3e} {error:<10} s per {unit}");
            writeln!(text, "{row}").expect("strings take everything");
        }
        for note in &self.notes {
            writeln!(text, "note: {note}").expect("strings take everything");
        }
        text
    }

    /// Measured and fitted times, a line each; the residual also as a share of the whole iteration.
    fn points_table(&self) -> String {
        let mut text = format!(
            "{:<7} {:>8} {:>4} {:>12}    {:<10} {:>10} {:>10} {:>13}\n",
            "phase", "N_F", "N_B", "seconds", "", "fitted", "residual", "of iteration"
        );
        for point in &self.points {
            let error = point.error.map_or(String::new(), |error| format!("+- {error:.2e}"));
            let residual = point.measured - point.fitted;
            let iteration = self.model.iteration(point.light_paths, point.camera_paths);
            // The time of a phase may be too small for a clock.
            let share = |whole: f64| match 100.0 * residual / whole {
                share if share.is_finite() => format!("{share:+.1} %"),
                _ => String::new(),
            };
            writeln!(
                text,
                "{:<7} {:>8} {:>4} {:>12.4e} {error:<13} {:>10.3e} {:>10} {:>13}",
                point.phase.name(),
                point.light_paths,
                point.camera_paths,
                point.measured,
                point.fitted,
                share(point.fitted),
                share(iteration),
            )
            .expect("strings take everything");
        }
        text
    }
}

/// Reads JSON that holds times.
pub(super) fn from_json<T: serde::de::DeserializeOwned>(text: &str, advice: &str) -> Result<T> {
    serde_json::from_str(text)
        .map_err(|e| Error::new(format!("these are not timings: {e}"), advice))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::timing::measure::Phase;
    use crate::timing::setup::tests::{facts, setup};

    const BARE: &str = r#"{"fixed":0.5,"light_path":2e-7,"camera_path":3,"look_up":4,
                           "merge_pair":5,"pixels":262144}"#;

    fn full() -> Timings {
        let point = FittedTime {
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
    fn file_keeps_everything() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("times.json");
        full().save(&path).unwrap();
        assert_eq!(Timings::load(&path).unwrap(), full());
        let bare = Timings::parse(BARE).unwrap();
        assert_eq!((bare.model, bare.errors), (full().model, None));
    }

    #[test]
    fn damaged_files_are_refused_by_name() {
        let good = serde_json::to_string(&full()).unwrap();
        for (text, problem, advice) in [
            (good.replace("\"notes\"", "\"nodes\""), "unknown field `nodes`", "bdpm calibrate"),
            (good.replace("\"light\"", "\"dark\""), "unknown variant `dark`", "bdpm calibrate"),
            (good.replace("\"look_up\":4.0", "\"look_up\":-4"), "look_up is -4", "at least 0"),
            (BARE.replace("\"fixed\"", "\"fixd\""), "unknown field `fixd`", "keys fixed"),
            (BARE.replace('}', ""), "not timings: EOF", "bdpm calibrate wrote, or"),
            ("[]".into(), "not timings", "keys fixed"),
            (BARE.replace("\"look_up\":4", "\"look_up\":-4"), "look_up is -4", "give look_up"),
            (BARE.replace("\"fixed\":0.5", "\"fixed\":null"), "not timings", "keys fixed"),
            (BARE.replace("\"fixed\":0.5,", ""), "missing field `fixed`", "keys fixed"),
            (BARE.replace("\"fixed\":0.5", "\"fixed\":1e999"), "not timings", "keys fixed"),
            (BARE.replace(":262144", ":0"), "0 pixels", "number of pixels"),
        ] {
            let shown = Timings::parse(&text).unwrap_err().to_string();
            let (found, help) = shown.split_once("\nhelp: ").unwrap();
            assert!(found.contains(problem) && help.contains(advice), "{shown}");
        }
    }

    #[test]
    fn model_with_nan_is_refused_by_name() {
        let nan = TimeModel { merge_pair: f64::NAN, ..full().model };
        assert!(nan.validate().unwrap_err().to_string().contains("merge_pair is NaN"));
    }

    #[test]
    fn bare_model_is_compared_by_its_pixels() {
        let bare = Timings::parse(BARE).unwrap();
        bare.check_fits(&Metadata::new(), 512, 512).unwrap();
        let shown = bare.check_fits(&Metadata::new(), 512, 256).unwrap_err().to_string();
        assert!(shown.contains("for 262144 pixels, not 131072\nhelp: "), "{shown}");
        full().check_fits(&facts(), 512, 512).unwrap();
        assert!(full().check_fits(&Metadata::new(), 512, 512).is_err());
    }
}
