//! The files of an experiment: results so far, and the measurement under way.

use super::measurement::Measurement;
use bdpm_auto::timing::measure::TimeSample;
use bdpm_auto::timing::setup::MeasurementSetup;
use bdpm_core::base::atomic::{sweep, write_atomically};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::input::read_as;
use bdpm_core::noise::file::NoiseFile;
use bdpm_core::noise::image::Statistic;
use bdpm_core::scene::Region;
use bdpm_core::settings::Settings;
use bdpm_job::output::checkpoint::Checkpoint;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// The state of an experiment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// Scene, settings and machine. An experiment is continued only under equal conditions.
    pub conditions: Conditions,
    /// The complete measurements, in order.
    pub done: Vec<Measured>,
    /// Rendering time of the measurement under way, seconds.
    pub under_way: f64,
}

/// Everything that an experiment depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Conditions {
    /// Scene, machine and program.
    pub setup: MeasurementSetup,
    /// The intersection backend with its version.
    pub accel: String,
    /// Settings of the image; the counts are not used.
    pub settings: Settings,
    /// The paper's red box.
    pub region: Region,
    /// Rendering time for all measurements, seconds.
    pub time: f64,
}

/// A complete measurement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// Purpose and counts.
    pub measurement: Measurement,
    /// Iterations whose noise was measured.
    pub iterations: u64,
    /// Rendering time, seconds.
    pub seconds: f64,
    /// Pooled RMS of one iteration over the region, sampled.
    pub pooled_rms: Statistic,
    /// Mean RMS of one iteration over the region, sampled, as in the paper.
    pub mean_rms: Statistic,
    /// Times of the phases, if there were production iterations.
    pub times: Vec<TimeSample>,
}

/// The folder of an experiment's files.
#[derive(Clone, Debug)]
pub struct Folder(PathBuf);

impl Folder {
    /// Creates the folder if it is missing. Call this before reading anything in it.
    ///
    /// # Errors
    /// If it cannot be created, or contains files that the scene was read from; names it.
    pub fn new(path: &Path) -> Result<Self> {
        let failed = |e| Error::io("make the folder", path, e);
        fs::create_dir_all(path).map_err(failed)?;
        for entry in path.read_dir().map_err(failed)?.flatten() {
            if let Some(read) = read_as(&entry.path()) {
                let problem =
                    format!("the folder contains {}, an input of the scene", read.display());
                return Err(Error::new(problem, "use another folder for the experiment").at(path));
            }
        }
        sweep(path);
        Ok(Self(path.into()))
    }

    /// Path of a file in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    fn experiment(&self) -> PathBuf {
        self.path("experiment.json")
    }

    fn checkpoint(&self) -> PathBuf {
        self.path("under-way.ckpt")
    }

    fn noise(&self, measurement: &Measurement) -> PathBuf {
        self.path(&format!("{}.exr", measurement.name()))
    }

    /// Opens the experiment in this folder, or begins a new one.
    ///
    /// # Errors
    /// If the folder has another experiment, or its file cannot be read.
    pub fn open(&self, conditions: Conditions) -> Result<Experiment> {
        let path = self.experiment();
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                return Ok(Experiment { conditions, done: Vec::new(), under_way: 0.0 });
            }
            Err(e) => return Err(Error::io("read", &path, e)),
        };
        let found: Experiment = serde_json::from_str(&text).map_err(|e| {
            let problem = format!("this is not an experiment under way: {e}");
            Error::new(problem, "use another folder").at(&path)
        })?;
        let known = Measurement::all();
        let in_order =
            found.done.iter().zip(&known).all(|(done, known)| done.measurement == *known);
        let mut differences = Vec::new();
        compare("", &json(&found.conditions), &json(&conditions), &mut differences);
        if found.done.len() > known.len() || !in_order {
            differences.push("list of measurements is another one".into());
        }
        if differences.is_empty() {
            return Ok(found);
        }
        Err(Error::new(
            format!("cannot continue this experiment: its {}", differences.join("; its ")),
            "continue with the scene and settings that it was begun with, or use another folder",
        )
        .at(&path))
    }

    /// Saves the state.
    ///
    /// # Errors
    /// If it cannot be written; names the file.
    pub fn save(&self, experiment: &Experiment) -> Result<()> {
        let text = serde_json::to_string_pretty(experiment).expect("plain numbers and texts");
        write_atomically(&self.experiment(), |file| writeln!(file, "{text}"))
    }

    /// Saves the sums of the measurement under way.
    ///
    /// # Errors
    /// If they cannot be written; names the file.
    pub fn save_under_way(&self, sums: &Checkpoint) -> Result<()> {
        sums.save(&self.checkpoint())
    }

    /// Loads the sums of the measurement under way, if there are any.
    ///
    /// # Errors
    /// If the file cannot be read or is damaged; names it.
    pub fn under_way(&self) -> Result<Option<Checkpoint<'static>>> {
        let path = self.checkpoint();
        path.exists().then(|| Checkpoint::load(&path)).transpose()
    }

    /// Removes the sums of the measurement under way, if there are any.
    ///
    /// # Errors
    /// If the file cannot be removed; names it.
    pub fn remove_under_way(&self) -> Result<()> {
        let path = self.checkpoint();
        match fs::remove_file(&path) {
            Err(e) if e.kind() != std::io::ErrorKind::NotFound => {
                Err(Error::io("remove", &path, e))
            }
            _ => Ok(()),
        }
    }

    /// Saves the noise of every pixel.
    ///
    /// # Errors
    /// If it cannot be written; names the file.
    pub fn save_noise(&self, measurement: &Measurement, noise: &NoiseFile) -> Result<()> {
        noise.write(&self.noise(measurement))
    }

    /// Loads the noise of every pixel of a complete measurement.
    ///
    /// # Errors
    /// If it cannot be read; names the file.
    pub fn load_noise(&self, measurement: &Measurement) -> Result<NoiseFile> {
        NoiseFile::read(&self.noise(measurement))
    }
}

fn json(value: &impl Serialize) -> Value {
    serde_json::to_value(value).expect("plain numbers and texts")
}

/// Collects the leaves in which `this` and `that` differ, with both values.
fn compare(name: &str, this: &Value, that: &Value, differences: &mut Vec<String>) {
    match (this, that) {
        (Value::Object(these), Value::Object(those)) => {
            for (key, value) in these {
                compare(key, value, those.get(key).unwrap_or(&Value::Null), differences);
            }
        }
        _ if this != that => {
            let name = name.replace('_', "-");
            differences.push(format!("{name} is {this}, not {that}"));
        }
        _ => {}
    }
}
