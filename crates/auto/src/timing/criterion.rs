//! Reads the times that `cargo bench --bench tau` measured: Criterion's own estimates, and a
//! sidecar file that says what was measured.
//!
//! The folder `tau` of Criterion's output holds `bdpm.json`, the [`Sidecar`]. For each of its
//! entries it holds `ID/new/estimates.json`, which Criterion wrote.

use super::file::{Timings, from_json};
use super::fit::fit;
use super::measure::{Phase, TimeSample};
use super::setup::MeasurementSetup;
use bdpm_core::base::atomic::write_atomically;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::input::read_text;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// The group of all benchmarks, a folder of Criterion's output.
pub const GROUP: &str = "tau";

/// The sidecar's name.
const SIDECAR: &str = "bdpm.json";

/// Advice of all errors.
const ADVICE: &str = "run cargo bench --bench tau";

/// Facts about a run of the benchmarks that Criterion does not record.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Sidecar {
    /// Start of the benchmarks, seconds since 1970. Older estimates belong to another run.
    begun: f64,
    /// Whether all benchmarks have run.
    completed: bool,
    /// Scene, settings and machine.
    pub setup: MeasurementSetup,
    /// The benchmarks.
    pub entries: Vec<Entry>,
}

/// A benchmark: one phase at one size.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Entry {
    /// Folder of the benchmark beside the sidecar, such as `light/1000x1`.
    pub id: String,
    /// The phase.
    pub phase: Phase,
    /// `N_F`.
    pub light_paths: u32,
    /// `N_B`.
    pub camera_paths: u32,
}

impl Sidecar {
    /// Writes the sidecar of a run that begins now. Creates `folder` if it is missing.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn begin(folder: &Path, setup: MeasurementSetup, entries: Vec<Entry>) -> Result<Self> {
        let begun = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let sidecar = Self { begun: begun.as_secs_f64(), completed: false, setup, entries };
        std::fs::create_dir_all(folder).map_err(|e| Error::io("make the folder", folder, e))?;
        sidecar.write(folder)?;
        Ok(sidecar)
    }

    /// Records that all benchmarks have run.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn complete(mut self, folder: &Path) -> Result<()> {
        self.completed = true;
        self.write(folder)
    }

    fn write(&self, folder: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self).expect("plain numbers and texts") + "\n";
        write_atomically(&folder.join(SIDECAR), |file| file.write_all(text.as_bytes()))
    }
}

impl Timings {
    /// Reads and fits the times that `cargo bench --bench tau` measured, from `target/criterion` or
    /// the folder `tau` in it.
    ///
    /// # Errors
    /// If there are no times, the benchmarks did not end, or an estimate is missing, damaged or
    /// from another run; names the file.
    pub fn from_criterion(folder: &Path) -> Result<Self> {
        let folder = match folder.join(SIDECAR).exists() {
            true => folder.to_owned(),
            false => folder.join(GROUP),
        };
        let path = folder.join(SIDECAR);
        if !path.exists() {
            return Err(Error::new("there are no times in this folder", ADVICE).at(path));
        }
        let sidecar: Sidecar = from_json(&read_text(&path)?, ADVICE).map_err(|e| e.at(&path))?;
        sidecar.setup.validate().map_err(|e| e.at(&path))?;
        if !sidecar.completed {
            return Err(Error::new("the benchmarks did not all run", ADVICE).at(path));
        }
        let read = |entry| sample(&folder, entry, sidecar.begun);
        let samples: Vec<TimeSample> = sidecar.entries.iter().map(read).collect::<Result<_>>()?;
        let fit = fit(&samples, sidecar.setup.pixels()).map_err(|e| e.at(path))?;
        Ok(Self { setup: Some(sidecar.setup), ..fit })
    }
}

/// The entries of Criterion's `estimates.json` that are read.
#[derive(Deserialize)]
struct Estimates {
    /// The median, because short loads of other programs do not change it.
    median: Estimate,
}

/// Nanoseconds.
#[derive(Deserialize)]
struct Estimate {
    point_estimate: f64,
    standard_error: f64,
}

fn sample(folder: &Path, entry: &Entry, begun: f64) -> Result<TimeSample> {
    let path: PathBuf = folder.join(&entry.id).join("new").join("estimates.json");
    let refuse = |problem: &str| Error::new(problem, ADVICE).at(&path);
    if !path.exists() {
        return Err(refuse("this estimate is missing"));
    }
    let text = read_text(&path)?;
    let written = path.metadata().and_then(|file| file.modified());
    let written = written.map_err(|e| Error::io("read", &path, e))?;
    // Some file systems round times to two seconds. Runs are minutes apart.
    let written = written.duration_since(UNIX_EPOCH).unwrap_or_default() + Duration::from_secs(2);
    if written.as_secs_f64() < begun {
        return Err(refuse("this estimate is older than the last run of the benchmarks"));
    }
    let Estimates { median } = from_json(&text, ADVICE).map_err(|e| e.at(&path))?;
    let (seconds, error) = (1e-9 * median.point_estimate, 1e-9 * median.standard_error);
    // Written so that NaN fails.
    if !(seconds > 0.0 && seconds.is_finite() && error >= 0.0 && error.is_finite()) {
        return Err(refuse(&format!("the estimate {seconds} +- {error} s is not a time")));
    }
    let (light_paths, camera_paths) = (entry.light_paths.into(), entry.camera_paths.into());
    Ok(TimeSample { phase: entry.phase, light_paths, camera_paths, seconds, error: Some(error) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::timing::setup::tests::setup;
    use std::fs::{self, File};

    /// Writes exact times, such as `1 ms + 1 us N_F` for the light phase, as Criterion does.
    fn bench(home: &Path) {
        let sizes = [(1000, 1), (10_000, 1), (1000, 4), (10_000, 4)];
        let size = |phase: Phase, (n, m): (u32, u32)| Entry {
            id: format!("{}/{n}x{m}", phase.name()),
            phase,
            light_paths: n,
            camera_paths: m,
        };
        let entries = Phase::ALL.into_iter().flat_map(|p| sizes.map(|s| size(p, s))).collect();
        let folder = home.join(GROUP);
        let sidecar = Sidecar::begin(&folder, setup(), entries).unwrap();
        for entry in &sidecar.entries {
            let pixels = setup().pixels();
            let (n, m) = (f64::from(entry.light_paths), f64::from(entry.camera_paths) * pixels);
            let seconds = match entry.phase {
                Phase::Light => 1e-3 + 1e-6 * n,
                Phase::Camera => 2e-3 + 1e-7 * m,
                Phase::Merge => 3e-3 + 1e-8 * m + 1e-12 * m * n,
                Phase::Rest => 4e-3,
            };
            let json = format!(
                r#"{{"mean":{{}},"median":{{"point_estimate":{},"standard_error":1000.0}}}}"#,
                1e9 * seconds
            );
            let new = folder.join(&entry.id).join("new");
            fs::create_dir_all(&new).unwrap();
            fs::write(new.join("estimates.json"), json).unwrap();
        }
        sidecar.complete(&folder).unwrap();
    }

    #[test]
    fn criterion_run_is_read_from_either_folder() {
        let home = tempfile::tempdir().unwrap();
        bench(home.path());
        let timings = Timings::from_criterion(home.path()).unwrap();
        assert_eq!(Timings::load(&home.path().join("tau")).unwrap(), timings);
        assert_eq!((timings.setup, timings.points.len()), (Some(setup()), 16));
        let model = timings.model;
        for (found, expected) in [
            (model.fixed, 1e-2),
            (model.light_path, 1e-6),
            (model.camera_path, 1e-7),
            (model.look_up, 1e-8),
            (model.merge_pair, 1e-12),
        ] {
            assert!((found / expected - 1.0).abs() < 1e-6, "{model:?}");
        }
    }

    #[test]
    fn missing_stale_and_damaged_estimates_are_refused_by_name() {
        let home = tempfile::tempdir().unwrap();
        let refused = |file: &str, problem: &str| {
            let shown = Timings::from_criterion(home.path()).unwrap_err().to_string();
            let expected = format!("\nhelp: {ADVICE}");
            assert!(shown.contains(problem) && shown.ends_with(&expected), "{shown}");
            assert!(shown.contains(file), "{shown}");
        };
        refused("tau/bdpm.json", "there are no times in this folder");
        let folder = home.path().join(GROUP);
        let sidecar = folder.join(SIDECAR);
        let estimate = folder.join("camera/1000x4/new/estimates.json");
        let here = "camera/1000x4/new/estimates.json";
        bench(home.path());
        let (good_sidecar, good) =
            (fs::read_to_string(&sidecar).unwrap(), fs::read_to_string(&estimate).unwrap());

        let unfinished = good_sidecar.replace("\"completed\": true", "\"completed\": false");
        fs::write(&sidecar, unfinished).unwrap();
        refused("bdpm.json", "the benchmarks did not all run");
        fs::write(&sidecar, &good_sidecar[..good_sidecar.len() / 2]).unwrap();
        refused("bdpm.json", "these are not timings: EOF");
        fs::write(&sidecar, good_sidecar.replace("\"threads\"", "\"treads\"")).unwrap();
        refused("bdpm.json", "missing field `threads`");
        fs::write(&sidecar, &good_sidecar).unwrap();

        let file = File::options().write(true).open(&estimate).unwrap();
        file.set_modified(SystemTime::now() - Duration::from_secs(3600)).unwrap();
        refused(here, "older than the last run");
        fs::remove_file(&estimate).unwrap();
        refused(here, "this estimate is missing");
        for (from, to, problem) in [
            ("\"median\"", "\"medium\"", "missing field `median`"),
            ("}}", "", "these are not timings: EOF"),
            ("\"point_estimate\":", "\"point_estimate\":-", "is not a time"),
            ("1000.0", "-1", "is not a time"),
            ("1000.0", "null", "invalid type: null"),
        ] {
            fs::write(&estimate, good.replace(from, to)).unwrap();
            refused(here, problem);
        }
        fs::write(&estimate, good).unwrap();
        Timings::from_criterion(home.path()).unwrap();
    }
}
