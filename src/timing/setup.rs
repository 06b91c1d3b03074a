//! What times were measured with, and what they may be used for.

use crate::base::error::{Error, Result};
use crate::pictures::{Metadata, Value};
use crate::settings::origin::Origin;
use crate::settings::{Direct, Roulette};
use serde::{Deserialize, Serialize};
use std::fmt;

/// All that times depend on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setup {
    /// The scene's name, for messages.
    pub scene: String,
    /// [`Scene::fingerprint`](crate::Scene::fingerprint), 16 hexadecimal digits.
    pub fingerprint: String,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Threads that rendered.
    pub threads: usize,
    /// The camera path is cut at its k-th diffuse vertex.
    pub merge_vertex: u32,
    /// How direct light is found.
    pub direct: Direct,
    /// How light paths end.
    pub light_roulette: Roulette,
    /// Whether camera paths may end before their cut.
    pub camera_roulette: Roulette,
    /// Merge radius, scene units.
    pub radius: f32,
    /// Name of the intersection backend.
    pub backend: String,
    /// Version of this program.
    pub version: String,
    /// `release` or `debug`.
    pub build: String,
    /// The processor's model, where the system tells.
    pub processor: Option<String>,
}

impl Setup {
    /// Of this program on this machine.
    pub fn new(origin: &Origin, threads: usize) -> Self {
        let Origin { version, scene, fingerprint, backend, settings } = origin;
        Self {
            scene: scene.clone(),
            fingerprint: format!("{fingerprint:016x}"),
            width: settings.width,
            height: settings.height,
            threads,
            merge_vertex: settings.merge_vertex,
            direct: settings.direct,
            light_roulette: settings.light_roulette,
            camera_roulette: settings.camera_roulette,
            radius: settings.radius,
            backend: backend.clone(),
            version: version.clone(),
            build: if cfg!(debug_assertions) { "debug" } else { "release" }.into(),
            processor: processor(),
        }
    }

    /// Number of pixels.
    pub fn pixels(&self) -> f64 {
        f64::from(self.width) * f64::from(self.height)
    }

    /// Refuses to use the times for an image of which `facts` are known by name, such as the
    /// attributes of a noise file. Threads, build and processor are not compared: no image tells.
    ///
    /// # Errors
    /// Names everything that differs, with both values.
    pub fn check_fits(&self, facts: &Metadata) -> Result<()> {
        let mut differences = Vec::new();
        let shown = |name: &str| match facts.get(name) {
            Some(Value::Text(text)) => text.clone(),
            Some(Value::Number(number)) => number.to_string(),
            None => "unknown".into(),
        };
        if shown("fingerprint") != self.fingerprint {
            let scene = shown("scene");
            differences.push(if scene == self.scene {
                format!("scene `{scene}` has changed")
            } else {
                format!("scene is `{}`, not `{scene}`", self.scene)
            });
        }
        let mut compare = |name: &str, this: String, that: String| {
            if this != that {
                differences.push(format!("{name} is {this}, not {that}"));
            }
        };
        let that = format!("{}x{}", shown("width"), shown("height"));
        compare("resolution", format!("{}x{}", self.width, self.height), that);
        compare("merge-vertex", self.merge_vertex.to_string(), shown("merge_vertex"));
        compare("direct", name(&self.direct), shown("direct"));
        compare("light-roulette", name(&self.light_roulette), shown("light_roulette"));
        compare("camera-roulette", name(&self.camera_roulette), shown("camera_roulette"));
        compare("radius", self.radius.to_string(), shown("radius"));
        compare("backend", self.backend.clone(), shown("backend"));
        if differences.is_empty() {
            return Ok(());
        }
        Err(Error::new(
            format!("these times are for something else: their {}", differences.join("; their ")),
            "measure the times of this scene with these settings: bdpm calibrate",
        ))
    }
}

/// One line.
impl fmt::Display for Setup {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { scene, width, height, threads, backend, build, version, .. } = self;
        let plural = if *threads == 1 { "" } else { "s" };
        write!(f, "{scene}, {width}x{height} pixels, {threads} thread{plural}")?;
        if let Some(processor) = &self.processor {
            write!(f, " of {processor}")?;
        }
        write!(f, ", {backend}, {build} build of version {version}")
    }
}

/// The name of a variant.
fn name(value: &impl Serialize) -> String {
    let value = serde_json::to_value(value).expect("a plain name");
    value.as_str().unwrap_or_default().to_owned()
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
    use crate::settings::{PartialSettings, Settings};

    pub fn setup() -> Setup {
        let none = PartialSettings::default();
        let settings = Settings::resolve(&none, &none, 2.0).unwrap();
        let origin = Origin {
            version: "1.2.3".into(),
            scene: "box".into(),
            fingerprint: 0xabc,
            backend: "bvh".into(),
            settings,
        };
        Setup::new(&origin, 3)
    }

    /// As `bdpm analyze` writes them.
    pub fn facts() -> Metadata {
        let text = |text: &str| Value::Text(text.into());
        Metadata::from([
            ("scene".into(), text("box")),
            ("fingerprint".into(), text("0000000000000abc")),
            ("backend".into(), text("bvh")),
            ("width".into(), Value::Number(512.0)),
            ("height".into(), Value::Number(512.0)),
            ("merge_vertex".into(), Value::Number(2.0)),
            ("direct".into(), text("connect")),
            ("light_roulette".into(), text("albedo")),
            ("camera_roulette".into(), text("weight")),
            ("radius".into(), Value::Number(0.01)),
        ])
    }

    #[test]
    fn every_difference_is_named_with_both_values() {
        setup().check_fits(&facts()).unwrap();
        let text = |text: &str| Value::Text(text.into());
        for (key, value, expected) in [
            ("fingerprint", text("0000000000000abd"), "scene `box` has changed"),
            ("backend", text("embree"), "backend is bvh, not embree"),
            ("width", Value::Number(64.0), "resolution is 512x512, not 64x512"),
            ("merge_vertex", Value::Number(1.0), "merge-vertex is 2, not 1"),
            ("direct", text("photon-map"), "direct is connect, not photon-map"),
            ("light_roulette", text("weight"), "light-roulette is albedo, not weight"),
            ("camera_roulette", text("albedo"), "camera-roulette is weight, not albedo"),
            ("radius", Value::Number(0.5), "radius is 0.01, not 0.5"),
        ] {
            let mut other = facts();
            other.insert(key.into(), value);
            let shown = setup().check_fits(&other).unwrap_err().to_string();
            assert!(shown.contains(&format!("their {expected}\nhelp: ")), "{shown}");
        }
        let shown = setup().check_fits(&Metadata::new()).unwrap_err().to_string();
        assert!(shown.contains("scene is `box`, not `unknown`; their resolution"), "{shown}");
        assert_eq!(shown.matches("; their ").count(), 7, "{shown}");
    }

    #[test]
    fn it_survives_a_file() {
        let text = serde_json::to_string(&setup()).unwrap();
        assert_eq!(serde_json::from_str::<Setup>(&text).unwrap(), setup());
        assert!(setup().to_string().starts_with("box, 512x512 pixels, 3 threads"), "{}", setup());
    }
}
