//! Scene, settings and machine that times were measured with, and the images they may be used for.

use bdpm_core::base::error::{Error, Result};
use bdpm_core::image_io::{Metadata, Value};
use bdpm_core::settings::Settings;
use bdpm_core::settings::differences::Differences;
use bdpm_core::settings::provenance::Provenance;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;

/// Everything that times depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MeasurementSetup {
    /// The scene's name, for messages.
    pub scene: String,
    /// [`Scene::fingerprint`](bdpm_core::Scene::fingerprint), 16 hexadecimal digits.
    pub fingerprint: String,
    /// Threads that rendered.
    pub threads: usize,
    /// Name of the intersection backend.
    pub backend: String,
    /// Version of this program.
    pub version: String,
    /// `release` or `debug`.
    pub build: String,
    /// The processor's model, if the system reports it.
    pub processor: Option<String>,
    /// Settings by name, except [`INDEPENDENT`].
    #[serde(flatten)]
    settings: BTreeMap<String, serde_json::Value>,
}

/// Settings that times do not depend on, or depend on as the model describes.
const INDEPENDENT: [&str; 3] = ["light_paths", "camera_paths", "seed"];

/// Names of the settings that times depend on.
fn dependent() -> impl Iterator<Item = &'static str> {
    Settings::NAMES.iter().copied().filter(|name| !INDEPENDENT.contains(name))
}

impl MeasurementSetup {
    /// The setup of this program on this machine.
    pub fn new(provenance: &Provenance, threads: usize) -> Self {
        let Provenance { version, scene, fingerprint, backend, settings } = provenance;
        let mut all = settings.to_map();
        let settings =
            dependent().filter_map(|name| Some((name.to_owned(), all.remove(name)?))).collect();
        Self {
            scene: scene.clone(),
            fingerprint: format!("{fingerprint:016x}"),
            threads,
            backend: backend.clone(),
            version: version.clone(),
            build: if cfg!(debug_assertions) { "debug" } else { "release" }.into(),
            processor: processor(),
            settings,
        }
    }

    /// A setting as text, `unknown` if there is none.
    fn setting(&self, name: &str) -> String {
        match self.settings.get(name) {
            Some(serde_json::Value::String(text)) => text.clone(),
            // Written like the numbers of image files: whole ones without a decimal point.
            Some(other) => other.as_f64().unwrap_or(f64::NAN).to_string(),
            None => UNKNOWN.into(),
        }
    }

    /// `width` times `height` pixels, as text.
    fn resolution(&self) -> String {
        format!("{}x{}", self.setting("width"), self.setting("height"))
    }

    /// Number of pixels.
    pub fn pixels(&self) -> f64 {
        let side = |name| self.settings.get(name).and_then(serde_json::Value::as_f64);
        side("width").unwrap_or(0.0) * side("height").unwrap_or(0.0)
    }

    /// Refuses a setup from a file that another program or version wrote.
    ///
    /// # Errors
    /// Names a setting that is missing or unknown.
    pub fn validate(&self) -> Result<()> {
        let advice =
            "give a file that this version of bdpm wrote, or measure again: bdpm calibrate";
        if let Some(missing) = dependent().find(|name| !self.settings.contains_key(*name)) {
            return Err(Error::new(format!("the times do not say their {missing}"), advice));
        }
        if let Some(unknown) =
            self.settings.keys().find(|key| !dependent().any(|name| name == *key))
        {
            return Err(Error::new(format!("unknown setting `{unknown}` of the times"), advice));
        }
        Ok(())
    }

    /// Refuses to use the times for another image, given its metadata such as the attributes of a
    /// noise file. Threads, build and processor are not compared: images do not record them.
    ///
    /// # Errors
    /// Names everything that differs, with both values.
    pub fn check_fits(&self, facts: &Metadata) -> Result<()> {
        let mut differences = Differences::default();
        let shown = |name: &str| match facts.get(name) {
            Some(Value::Text(text)) => text.clone(),
            Some(Value::Number(number)) => number.to_string(),
            None => UNKNOWN.into(),
        };
        let this = (&*self.scene, self.fingerprint.clone());
        differences.compare_scenes(this, (&shown("scene"), shown("fingerprint")));
        let that = format!("{}x{}", shown("width"), shown("height"));
        differences.compare("resolution", self.resolution(), that);
        for name in dependent().filter(|name| !["width", "height"].contains(name)) {
            differences.compare(&name.replace('_', "-"), self.setting(name), shown(name));
        }
        differences.compare("backend", self.backend.clone(), shown("backend"));
        let problem = "these times are for something else";
        let advice = "measure the times of this scene with these settings: bdpm calibrate";
        differences.check(problem, "their", advice)
    }
}

/// Shown for values that a file does not have.
const UNKNOWN: &str = "unknown";

/// One line.
impl fmt::Display for MeasurementSetup {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, threads, backend, build, version, .. } = self;
        let plural = if *threads == 1 { "" } else { "s" };
        write!(f, "{scene}, {} pixels, {threads} thread{plural}", self.resolution())?;
        if let Some(processor) = &self.processor {
            write!(f, " of {processor}")?;
        }
        write!(f, ", {backend}, {build} build of version {version}")
    }
}

/// The processor's model (Linux on x86).
fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use bdpm_core::settings::PartialSettings;

    fn provenance() -> Provenance {
        let none = PartialSettings::default();
        Provenance {
            version: "1.2.3".into(),
            scene: "box".into(),
            fingerprint: 0xabc,
            backend: "bvh".into(),
            settings: Settings::resolve(&none, &none, 2.0).unwrap(),
        }
    }

    pub fn setup() -> MeasurementSetup {
        MeasurementSetup::new(&provenance(), 3)
    }

    /// Metadata as `bdpm analyze` writes it.
    pub fn facts() -> Metadata {
        provenance().to_metadata()
    }

    #[test]
    fn differences_are_named_with_both_values() {
        setup().check_fits(&facts()).unwrap();
        let text = |text: &str| Value::Text(text.into());
        for (key, value, expected) in [
            ("fingerprint", text("0000000000000abd"), "scene `box` has changed"),
            ("backend", text("embree"), "backend is bvh, not embree"),
            ("width", Value::Number(64.0), "resolution is 512x512, not 64x512"),
            ("merge_vertex", Value::Number(1.0), "merge-vertex is 2, not 1"),
            ("strategy", text("mis"), "strategy is single, not mis"),
            ("direct", text("photon-map"), "direct is connect, not photon-map"),
            ("radius", Value::Number(0.5), "radius is 0.01, not 0.5"),
            ("kernel", text("disc"), "kernel is area, not disc"),
        ] {
            let mut other = facts();
            other.insert(key.into(), value);
            let shown = setup().check_fits(&other).unwrap_err().to_string();
            assert!(shown.contains(&format!("their {expected}\nhelp: ")), "{shown}");
        }
        let shown = setup().check_fits(&Metadata::new()).unwrap_err().to_string();
        assert!(shown.contains("scene is `box`, not `unknown`; their resolution"), "{shown}");
        // The scene, the resolution, the backend and all other settings that times depend on.
        assert_eq!(shown.matches("their ").count(), 3 + dependent().count() - 2, "{shown}");
    }

    #[test]
    fn missing_and_unknown_settings_are_refused() {
        setup().validate().unwrap();
        let mut less = setup();
        less.settings.remove("radius");
        let shown = less.validate().unwrap_err().to_string();
        assert!(shown.contains("do not say their radius"), "{shown}");
        let mut more = setup();
        more.settings.insert("seed".into(), 1.into());
        let shown = more.validate().unwrap_err().to_string();
        assert!(shown.contains("unknown setting `seed`"), "{shown}");
    }

    #[test]
    fn setup_survives_a_file() {
        let text = serde_json::to_string(&setup()).unwrap();
        assert_eq!(serde_json::from_str::<MeasurementSetup>(&text).unwrap(), setup());
        assert!(setup().to_string().starts_with("box, 512x512 pixels, 3 threads"), "{}", setup());
    }
}
