//! Provenance of an image, in checkpoints and in the metadata of image files.

use super::Settings;
use super::differences::Differences;
use bdpm_base::error::{Error, Result};
use bdpm_image::{Metadata, Value};
use serde::{Deserialize, Serialize};

/// Program, scene and settings of an image; a run that continues it must agree.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Version of this program. Another version may draw other random numbers.
    pub version: String,
    /// The scene's name, for messages.
    pub scene: String,
    /// `Scene::fingerprint`.
    pub fingerprint: u64,
    /// Name of the intersection backend: another one may decide otherwise about rays that graze an
    /// edge.
    pub backend: String,
    /// Settings of the image.
    pub settings: Settings,
}

/// Use of an image that another run began.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Reuse {
    /// Continue its iterations.
    Resume,
    /// Repeat its plan.
    Plan,
    /// Merge it with other parts of one image.
    Merge,
}

impl Provenance {
    /// Converts to the metadata of an image file.
    pub fn to_metadata(&self) -> Metadata {
        let Self { version, scene, fingerprint, backend, settings } = self;
        let mut facts = Metadata::from([
            ("version".into(), Value::Text(version.clone())),
            ("scene".into(), Value::Text(scene.clone())),
            ("fingerprint".into(), Value::Text(format!("{fingerprint:016x}"))),
            ("backend".into(), Value::Text(backend.clone())),
        ]);
        for (name, value) in settings.to_map() {
            let value = match value {
                serde_json::Value::String(text) => Value::Text(text),
                // Seeds may have more digits than a number keeps.
                serde_json::Value::Number(number) if name == "seed" => {
                    Value::Text(number.to_string())
                }
                other => Value::Number(other.as_f64().unwrap_or(f64::NAN)),
            };
            facts.insert(name, value);
        }
        facts
    }

    /// Reads the metadata that [`Self::to_metadata`] made. Other entries are ignored.
    ///
    /// # Errors
    /// If an entry is missing or invalid; names it.
    pub fn from_metadata(facts: &Metadata) -> Result<Self> {
        let broken = |name: &str| {
            Error::new(
                format!("the file does not say how it was made: no valid attribute bdpm.{name}"),
                "give an .exr file that bdpm wrote",
            )
        };
        let text = |name: &str| match facts.get(name) {
            Some(Value::Text(text)) => Ok(text.clone()),
            _ => Err(broken(name)),
        };
        let mut settings = serde_json::Map::new();
        for &name in Settings::NAMES {
            let value = match facts.get(name).ok_or_else(|| broken(name))? {
                Value::Text(text) if name == "seed" => {
                    text.parse::<u64>().map_err(|_| broken(name))?.into()
                }
                Value::Text(text) => text.clone().into(),
                // Counts are written as whole numbers, which is what they are read as.
                &Value::Number(x) if x.fract() == 0.0 && (0.0..9e15).contains(&x) => {
                    (x as u64).into()
                }
                &Value::Number(x) => x.into(),
            };
            settings.insert(name.into(), value);
        }
        let settings: Settings = serde_json::from_value(settings.into())
            .map_err(|e| broken(&format!("settings ({e})")))?;
        settings.validate()?;
        let fingerprint = u64::from_str_radix(&text("fingerprint")?, 16);
        Ok(Self {
            version: text("version")?,
            scene: text("scene")?,
            fingerprint: fingerprint.map_err(|_| broken("fingerprint"))?,
            backend: text("backend")?,
            settings,
        })
    }

    /// Refuses to reuse an image of this provenance for an image of the provenance `other`.
    ///
    /// # Errors
    /// Names every difference, with both values.
    pub fn check_agrees(&self, other: &Self, reuse: Reuse) -> Result<()> {
        let mut differences = Differences::default();
        let [this, that] = [self, other].map(|it| (&*it.scene, it.fingerprint));
        differences.compare_scenes(this, that);
        differences.compare("program version", &self.version, &other.version);
        differences.compare("backend", &self.backend, &other.backend);
        let (these, those) = (self.settings.to_map(), other.settings.to_map());
        for (name, value) in &these {
            differences.compare(&name.replace('_', "-"), value, &those[name]);
        }
        let (problem, advice) = match reuse {
            Reuse::Resume => (
                "cannot continue this image",
                "resume with the scene and settings that it was begun with, or start a new image",
            ),
            Reuse::Merge => (
                "this is no part of the same image",
                "merge parts of one scene with the same settings, by one version of bdpm",
            ),
            Reuse::Plan => (
                "this plan is for another image",
                "give the scene and settings that it was made for, or render without a plan",
            ),
        };
        differences.check(problem, "its", advice)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Direct, PartialSettings};

    fn origin() -> Provenance {
        let none = PartialSettings::default();
        let typical = Settings::resolve(&none, &none, 1.0).unwrap();
        let settings = Settings { light_paths: 100, radius: 0.1, seed: u64::MAX, ..typical };
        Provenance {
            version: "1.2.3".into(),
            scene: "box".into(),
            fingerprint: 0x1234_5678_9abc_def0,
            backend: "bvh".into(),
            settings,
        }
    }

    #[test]
    fn metadata_keeps_the_provenance() {
        let facts = origin().to_metadata();
        assert_eq!(Provenance::from_metadata(&facts).unwrap(), origin());
        assert_eq!(origin().settings.to_map().len(), Settings::NAMES.len());
        for name in facts.keys() {
            let mut others = facts.clone();
            others.remove(name);
            let shown = Provenance::from_metadata(&others).unwrap_err().to_string();
            assert!(shown.contains(name.as_str()), "{name}: {shown}");
        }
        let mut wrong = facts;
        wrong.insert("width".into(), Value::Number(1.5));
        assert!(Provenance::from_metadata(&wrong).is_err());
    }

    #[test]
    fn differences_are_named_with_both_values() {
        let begun = origin();
        begun.check_agrees(&begun, Reuse::Resume).unwrap();
        let mut other = begun.clone();
        other.scene = "sphere".into();
        begun.check_agrees(&other, Reuse::Plan).expect("a renamed scene is the same scene");
        other.fingerprint = 1;
        other.backend = "embree".into();
        other.settings.radius = 0.2;
        other.settings.light_paths = 50;
        other.settings.direct = Direct::PhotonMap;
        let shown = begun.check_agrees(&other, Reuse::Plan).unwrap_err().to_string();
        assert!(shown.starts_with("this plan is for another image"), "{shown}");
        assert!(shown.contains("without a plan") && !shown.contains("resume"), "{shown}");
        let shown = begun.check_agrees(&other, Reuse::Resume).unwrap_err().to_string();
        assert!(shown.contains("start a new image") && !shown.contains("plan"), "{shown}");
        for part in [
            "scene is `box`, not `sphere`",
            "backend is bvh, not embree",
            "radius is 0.1, not 0.2",
            "light-paths is 100, not 50",
            "direct is \"connect\", not \"photon-map\"",
        ] {
            assert!(shown.contains(part), "{part}: {shown}");
        }
        assert!(!shown.contains("seed") && !shown.contains("version"), "{shown}");
    }
}
