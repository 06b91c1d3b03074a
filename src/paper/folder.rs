//! The files of an experiment: what was measured so far, and what is under way.

use super::part::Part;
use crate::base::atomic::{sweep, write_atomically};
use crate::base::error::{Error, Result};
use crate::base::input::read_as;
use crate::noise::file::NoiseFile;
use crate::noise::image::Statistic;
use crate::output::checkpoint::Checkpoint;
use crate::scene::Region;
use crate::settings::Settings;
use crate::timing::sample::Sample;
use crate::timing::setup::Setup;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

/// An experiment, as far as it has come.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// What is measured, with what. Only what agrees in all of this is continued.
    pub identity: Identity,
    /// The parts that are complete, in order.
    pub done: Vec<Measured>,
    /// Rendering time spent on the part after those, seconds.
    pub under_way: f64,
}

/// All that an experiment depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Identity {
    /// Scene, machine and program.
    pub setup: Setup,
    /// The intersection backend with its version.
    pub accel: String,
    /// Everything else that determines the image; the counts are not used.
    pub settings: Settings,
    /// The paper's red box.
    pub region: Region,
    /// Rendering time for all parts, seconds.
    pub time_budget: f64,
}

/// A part that is complete.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// What was measured.
    pub part: Part,
    /// Iterations whose noise was measured.
    pub iterations: u64,
    /// Rendering time, seconds.
    pub seconds: f64,
    /// Pooled RMS of one iteration over the region, sampled.
    pub pooled_rms: Statistic,
    /// Mean RMS of one iteration over the region, sampled; the paper's.
    pub mean_rms: Statistic,
    /// Times of the phases, where production iterations were among them.
    pub times: Vec<Sample>,
}

/// Where an experiment keeps its files.
#[derive(Clone, Debug)]
pub struct Folder(PathBuf);

impl Folder {
    /// Makes the folder if there is none; before anything in it is read.
    ///
    /// # Errors
    /// If it cannot be made, or holds files of the scene, which was read; names it.
    pub fn new(path: &Path) -> Result<Self> {
        let failed = |e| Error::io("make the folder", path, e);
        fs::create_dir_all(path).map_err(failed)?;
        for entry in path.read_dir().map_err(failed)?.flatten() {
            if let Some(read) = read_as(&entry.path()) {
                let problem = format!("the folder holds {}, which was read", read.display());
                return Err(Error::new(problem, "give a folder of its own as --output").at(path));
            }
        }
        sweep(path);
        Ok(Self(path.into()))
    }

    /// A file in it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    fn experiment(&self) -> PathBuf {
        self.path("experiment.json")
    }

    fn checkpoint(&self) -> PathBuf {
        self.path("under-way.ckpt")
    }

    fn noise(&self, part: &Part) -> PathBuf {
        self.path(&format!("{}.exr", part.name()))
    }

    /// The experiment that was begun here, or a new one.
    ///
    /// # Errors
    /// If there is another one, or its file cannot be read.
    pub fn open(&self, identity: Identity) -> Result<Experiment> {
        let path = self.experiment();
        let text = match fs::read_to_string(&path) {
            Ok(text) => text,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                return Ok(Experiment { identity, done: Vec::new(), under_way: 0.0 });
            }
            Err(e) => return Err(Error::io("read", &path, e)),
        };
        let found: Experiment = serde_json::from_str(&text).map_err(|e| {
            let problem = format!("this is no experiment under way: {e}");
            Error::new(problem, "give another folder as --output").at(&path)
        })?;
        let known = Part::all();
        let in_order = found.done.iter().zip(&known).all(|(done, part)| done.part == *part);
        let mut differences = Vec::new();
        compare("", &json(&found.identity), &json(&identity), &mut differences);
        if found.done.len() > known.len() || !in_order {
            differences.push("list of parts is another one".into());
        }
        if differences.is_empty() {
            return Ok(found);
        }
        Err(Error::new(
            format!("cannot continue this experiment: its {}", differences.join("; its ")),
            "continue with what it was begun with, or give another folder as --output",
        )
        .at(&path))
    }

    /// Keeps what was measured.
    ///
    /// # Errors
    /// If it cannot be written; names the file.
    pub fn save(&self, experiment: &Experiment) -> Result<()> {
        let text = serde_json::to_string_pretty(experiment).expect("plain numbers and texts");
        write_atomically(&self.experiment(), |file| writeln!(file, "{text}"))
    }

    /// Keeps the sums of the part that is under way.
    ///
    /// # Errors
    /// If they cannot be written; names the file.
    pub fn save_under_way(&self, sums: &Checkpoint) -> Result<()> {
        sums.save(&self.checkpoint())
    }

    /// The sums of the part that is under way, if there are any.
    ///
    /// # Errors
    /// If the file cannot be read or is damaged; names it.
    pub fn under_way(&self) -> Result<Option<Checkpoint<'static>>> {
        let path = self.checkpoint();
        path.exists().then(|| Checkpoint::load(&path)).transpose()
    }

    /// Removes them, if there are any.
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

    /// Keeps the noise of every pixel.
    ///
    /// # Errors
    /// If it cannot be written; names the file.
    pub fn save_noise(&self, part: &Part, noise: &NoiseFile) -> Result<()> {
        noise.write(&self.noise(part))
    }

    /// The noise of every pixel in a part that is complete.
    ///
    /// # Errors
    /// If it cannot be read; names the file.
    pub fn load_noise(&self, part: &Part) -> Result<NoiseFile> {
        NoiseFile::read(&self.noise(part))
    }
}

fn json(value: &impl Serialize) -> Value {
    serde_json::to_value(value).expect("plain numbers and texts")
}

/// Names the leaves in which `this` and `that` differ, with both values.
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
