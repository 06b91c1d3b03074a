//! Warnings about how a scene was read.

use super::text::{list, problems};
use bdpm_core::base::error::{Error, Result, visible};
use bdpm_core::scene::Scene;
use serde::Serialize;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{self, Write};
use std::path::Path;

/// Something that was left out of the scene, or chosen for the user.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// Whether anything is missing.
    pub kind: WarningKind,
    /// A sentence without a full stop.
    pub text: String,
    /// What to do, if there is a choice.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub advice: Option<&'static str>,
}

/// Kinds of [`Warning`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum WarningKind {
    /// The image lacks something that the file contains.
    Skipped,
    /// The file leaves something open, or the change has no visible effect.
    Chosen,
}

impl Warning {
    /// A warning about something that the image lacks.
    pub fn skipped(text: impl Into<String>) -> Self {
        Self { kind: WarningKind::Skipped, text: text.into(), advice: None }
    }

    /// A warning about something that the file leaves open.
    pub fn chosen(text: impl Into<String>) -> Self {
        Self { kind: WarningKind::Chosen, text: text.into(), advice: None }
    }
}

/// A warning that the requested environment replaces that of the file.
pub(super) fn replaced_environment(path: &Path) -> Warning {
    let text = "the given environment replaces that of the file";
    Warning::chosen(format!("{}: {text}", path.display()))
}

/// Distance of a scene from the origin, over its size, from which on its image is noticeably wrong:
/// 0.7 % at 10,000.
const FAR: f32 = 1000.0;

/// A warning that single precision rounds the positions of a scene too coarsely.
pub(super) fn far_from_origin(scene: &Scene) -> Option<Warning> {
    let away = scene.bounds().center().abs().max_element() / scene.size();
    (away > FAR && away.is_finite()).then(|| Warning {
        advice: Some("move the scene to the origin"),
        ..Warning::chosen(format!(
            "the scene is {away:.0} times its size away from the origin, where single precision rounds positions to \
             {:.1e} of its size: light leaks and is lost",
            away * f32::EPSILON
        ))
    })
}

/// The text, and a line with the advice if there is some.
impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.text.chars().try_for_each(|c| f.write_char(visible(c)))?;
        self.advice.map_or(Ok(()), |advice| write!(f, "\nhelp: {advice}"))
    }
}

/// Refuses a scene if anything was skipped.
pub(super) fn require_complete(warnings: &[Warning]) -> Result<()> {
    let skipped = warnings.iter().filter(|warning| warning.kind == WarningKind::Skipped);
    let text = problems(skipped.map(|warning| &warning.text[..]));
    if text.is_empty() {
        return Ok(());
    }
    let advice = "change the files, or load the scene without strict checking";
    Err(Error::new(format!("not all of the scene can be rendered: {text}"), advice))
}

/// Warnings that many elements of a file share: the names of the elements by kind and phrase.
#[derive(Default)]
pub(super) struct GroupedWarnings(BTreeMap<(WarningKind, String), BTreeSet<String>>);

impl GroupedWarnings {
    /// The image lacks something of the element `name`, or shows it differently.
    pub fn skipped(&mut self, phrase: impl Into<String>, name: &str) {
        self.add(WarningKind::Skipped, phrase.into(), name);
    }

    /// Each phrase whose condition is met describes something that the image lacks of `name`.
    pub fn skipped_if<const N: usize>(&mut self, phrases: [(bool, &str); N], name: &str) {
        let met = phrases.into_iter().filter(|(condition, _)| *condition);
        met.for_each(|(_, phrase)| self.skipped(phrase, name));
    }

    /// Something was chosen for the element `name`.
    pub fn chosen(&mut self, phrase: impl Into<String>, name: &str) {
        self.add(WarningKind::Chosen, phrase.into(), name);
    }

    fn add(&mut self, kind: WarningKind, phrase: String, name: &str) {
        self.0.entry((kind, phrase)).or_default().insert(name.to_owned());
    }

    /// One warning for each phrase, about the file of this name.
    pub fn into_warnings(self, file: &str) -> impl Iterator<Item = Warning> {
        self.0.into_iter().map(move |((kind, phrase), names)| {
            let names = list(names.iter().map(String::as_str));
            Warning { kind, text: format!("{file}: {phrase} {names}"), advice: None }
        })
    }
}
