//! `bdpm info IMAGE.exr`: what an image states about itself. Its pixels are not read.

use super::error_text::error_text;
use super::json;
use bdpm::Settings;
use bdpm::base::error::{Error, Result};
use bdpm::image_io::{ExrSummary, Metadata, NOISY, Value, read_exr_summary};
use bdpm::load::counted;
use bdpm::output::light_layers::LIGHTS;
use bdpm::output::recorded_error::{POOLED_RMS, RecordedDenoisedError, RecordedError};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Number};
use std::fmt::Write;
use std::path::Path;

/// Whether a path names an image instead of a scene.
pub fn is_image(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr"))
}

#[derive(Serialize)]
struct ImageReport<'a> {
    image: String,
    #[serde(flatten)]
    file: &'a ExrSummary,
    layers: Vec<LayerReport<'a>>,
    /// What this program wrote, or `None` for images of other programs.
    bdpm: Option<Origin>,
}

#[derive(Serialize)]
struct LayerReport<'a> {
    /// Name; empty for the image itself.
    name: &'a str,
    channels: Vec<&'a str>,
}

/// What this program states about an image.
#[derive(Serialize)]
struct Origin {
    version: String,
    scene: Option<String>,
    fingerprint: Option<String>,
    backend: Option<String>,
    camera: Option<String>,
    iterations: Option<f64>,
    /// Names of its only light sources, or of those that were mixed.
    lights: Option<String>,
    settings: Map<String, serde_json::Value>,
    /// Steps with counts, iterations and weights.
    plan: Option<Vec<PlanStep>>,
    error: Option<RecordedError>,
    /// Error of the layer `denoised`.
    denoised_error: Option<RecordedDenoisedError>,
    /// RMS of the noise as luminance, W/(m^2 sr), pooled over all pixels.
    rms: Option<f64>,
    audit: Option<AuditSummary>,
    /// All other facts.
    other: Map<String, serde_json::Value>,
}

/// A step of the plan, as the attribute `bdpm.plan` has it.
#[derive(Serialize, Deserialize)]
struct PlanStep {
    light_paths: u32,
    /// A number, or the name of the layer with the number of each pixel.
    camera_paths: serde_json::Value,
    iterations: Option<u64>,
    weight: Option<f64>,
}

#[derive(Serialize)]
struct AuditSummary {
    verdict: String,
    /// 95 % bound of the relative difference.
    agreement: Option<f64>,
    /// Share of the light that was not audited.
    not_audited: Option<f64>,
}

pub fn run(path: &Path, as_json: bool) -> Result<String> {
    let file = read_exr_summary(path)?;
    let layers = file.layers().into_iter();
    let bdpm = file.is_ours().then(|| Origin::new(&file.metadata)).transpose();
    let report = ImageReport {
        image: path.to_string_lossy().into_owned(),
        file: &file,
        layers: layers.map(|(name, channels)| LayerReport { name, channels }).collect(),
        bdpm: bdpm.map_err(|error| error.at(path))?,
    };
    Ok(if as_json { json(&report) } else { text(&report) })
}

/// Takes a text from the facts.
fn take_text(facts: &mut Metadata, name: &str) -> Option<String> {
    match facts.remove(name)? {
        Value::Text(text) => Some(text),
        Value::Number(number) => Some(number.to_string()),
    }
}

/// Takes a number from the facts.
fn take_number(facts: &mut Metadata, name: &str) -> Option<f64> {
    match facts.remove(name)? {
        Value::Number(number) => Some(number),
        Value::Text(_) => None,
    }
}

/// A fact in JSON. Whole numbers have no point, and numbers that are 32-bit floats have their few
/// digits.
fn in_json(value: Value) -> serde_json::Value {
    let short = |x: f64| match f64::from(x as f32) == x {
        true => (x as f32).to_string().parse().unwrap_or(x),
        false => x,
    };
    match value {
        Value::Text(text) => text.into(),
        Value::Number(x) if x.fract() == 0.0 && x.abs() < 9e15 => (x as i64).into(),
        Value::Number(x) => Number::from_f64(short(x)).map_or(serde_json::Value::Null, Into::into),
    }
}

impl Origin {
    fn new(metadata: &Metadata) -> Result<Self> {
        let mut facts = metadata.clone();
        let error = RecordedError::read(metadata);
        let denoised_error = RecordedDenoisedError::read(metadata);
        facts.retain(|name, _| {
            !(name.starts_with("relative error") || RecordedDenoisedError::has(name))
        });
        let audit = take_text(&mut facts, "audit").map(|verdict| AuditSummary {
            verdict,
            agreement: take_number(&mut facts, "audit agreement"),
            not_audited: take_number(&mut facts, "audit share left out"),
        });
        let mut settings = Map::new();
        for name in Settings::NAMES {
            if let Some(value) = facts.remove(*name) {
                settings.insert((*name).into(), in_json(value));
            }
        }
        let plan = take_text(&mut facts, "plan").map(|plan| serde_json::from_str(&plan));
        let plan = plan.transpose().map_err(|error| {
            let problem = format!("the attribute bdpm.plan is not valid: {error}");
            Error::new(problem, "render the image again")
        })?;
        Ok(Self {
            version: take_text(&mut facts, "version").unwrap_or_default(),
            scene: take_text(&mut facts, "scene"),
            fingerprint: take_text(&mut facts, "fingerprint"),
            backend: take_text(&mut facts, "backend"),
            camera: take_text(&mut facts, "camera"),
            iterations: take_number(&mut facts, "iterations"),
            lights: take_text(&mut facts, LIGHTS),
            settings,
            plan,
            error,
            denoised_error,
            rms: take_number(&mut facts, POOLED_RMS),
            audit,
            other: facts.into_iter().map(|(name, value)| (name, in_json(value))).collect(),
        })
    }
}

/// Rows of a name and a value.
#[derive(Default)]
struct Rows(String);

impl Rows {
    fn add(&mut self, name: &str, value: impl AsRef<str>) {
        writeln!(self.0, "{name:<17} {}", value.as_ref()).expect("strings take everything");
    }

    fn add_file(&mut self, report: &ImageReport) {
        let ImageReport { file, layers, .. } = report;
        let ([width, height], [x, y], display) = (file.size, file.origin, file.display);
        let window = match [x, y] == [0, 0] && file.size == display {
            true => String::new(),
            false => format!(", at {x},{y} of {}x{}", display[0], display[1]),
        };
        self.add("image", format!("{width}x{height} pixels{window}"));
        self.add("written by", file.software.as_deref().unwrap_or("a program without a name"));
        for LayerReport { name, channels } in layers {
            let name = if name.is_empty() { "the image" } else { name };
            self.add("layer", format!("{name}: {}", channels.join(", ")));
        }
        self.add("compression", &file.compression);
        if file.parts > 1 {
            self.add("parts", format!("{}, of which this is the first", file.parts));
        }
        if file.deep {
            self.add("deep", "pixels have several samples, which bdpm does not read");
        }
    }

    fn add_origin(&mut self, origin: &Origin, layers: &[LayerReport]) {
        let Origin { scene, fingerprint, camera, backend, iterations, lights, .. } = origin;
        if let (Some(scene), Some(fingerprint)) = (scene, fingerprint) {
            self.add("scene", format!("{scene} (fingerprint {fingerprint})"));
        }
        for (name, value) in [("camera", camera), ("backend", backend), ("lights", lights)] {
            if let Some(value) = value {
                self.add(name, value);
            }
        }
        if let Some(iterations) = iterations {
            self.add("iterations", iterations.to_string());
        }
        for step in origin.plan.iter().flatten() {
            self.add("counts", step.text(&origin.settings));
        }
        self.add_error(origin, layers);
        for (name, value) in &origin.settings {
            let value = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
            self.add(&name.replace('_', " "), value);
        }
    }

    /// The stated errors: that of the image before denoising, and that of its denoised layer.
    fn add_error(&mut self, origin: &Origin, layers: &[LayerReport]) {
        let percent = |share: f64| format!("{:.2} %", 100.0 * share);
        let has = |name: &str| layers.iter().any(|layer| layer.name == name);
        let (has_denoised, replaced) = (has("denoised"), has(NOISY));
        let error = match origin.error {
            Some(RecordedError { total, noise, bias, interval }) => format!(
                "{}: noise {}, bias {}",
                error_text(total, interval.as_ref()),
                percent(noise),
                percent(bias)
            ),
            None => "not stated: only finished automatic renders state it".into(),
        };
        let of = if has_denoised || replaced { ", before denoising" } else { "" };
        // A mixture of denoised images has no other error.
        if origin.error.is_some() || has_denoised || origin.denoised_error.is_none() {
            self.add("relative error", format!("{error}{of}"));
        }
        let denoised = match origin.denoised_error {
            Some(RecordedDenoisedError { total, interval }) => {
                Some(error_text(total, interval.as_ref()))
            }
            None if replaced => Some("not known: bdpm render --denoise estimates it".into()),
            None if has_denoised => {
                Some("not stated: it was not estimated, or the render was not finished".into())
            }
            None => None,
        };
        if let Some(denoised) = denoised {
            self.add("denoised error", denoised);
        }
        if let Some(rms) = origin.rms {
            self.add("noise", format!("pooled RMS {rms:.4}, as luminance"));
        }
        if let Some(AuditSummary { verdict, agreement, .. }) = &origin.audit {
            let bound = agreement.filter(|_| verdict == "agrees");
            let bound = bound.map(|bound| format!(" with path tracing within {}", percent(bound)));
            self.add("audit", format!("{verdict}{}", bound.unwrap_or_default()));
        }
    }
}

impl PlanStep {
    fn text(&self, settings: &Map<String, serde_json::Value>) -> String {
        let light = match settings.get("strategy").and_then(serde_json::Value::as_str) {
            Some("path") => String::new(),
            _ => format!("{} light paths, ", self.light_paths),
        };
        let camera = match &self.camera_paths {
            serde_json::Value::String(layer) => format!("camera paths of the layer {layer}"),
            number => format!("{number} camera paths per pixel"),
        };
        let count = |iterations| counted(iterations as usize, "iteration");
        let rendered = self.iterations.map(|own| format!(", in {}", count(own)));
        format!("{light}{camera}{}", rendered.unwrap_or_default())
    }
}

fn text(report: &ImageReport) -> String {
    let mut rows = Rows::default();
    rows.add_file(report);
    match &report.bdpm {
        Some(origin) => rows.add_origin(origin, &report.layers),
        None => rows.add("origin", "another program: it states neither settings nor error"),
    }
    rows.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_no_digits_that_mean_nothing() {
        let shown = |x: f64| in_json(Value::Number(x)).to_string();
        assert_eq!(shown(3.0), "3");
        assert_eq!(shown(f64::from(4.633_333_f32)), "4.633333");
        assert_eq!(shown(0.06), "0.06");
        assert_eq!(shown(f64::NAN), "null");
    }
}
