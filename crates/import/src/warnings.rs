//! Warnings about how a scene was read.

use super::text::{list, problems};
use bdpm_core::base::names::visible;
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
pub fn replaced_environment(path: &Path) -> Warning {
    let text = "the given environment replaces that of the file";
    Warning::chosen(format!("{}: {text}", path.display()))
}

/// The text, and a line with the advice if there is some.
impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.text.chars().try_for_each(|c| f.write_char(visible(c)))?;
        self.advice.map_or(Ok(()), |advice| write!(f, "\nhelp: {advice}"))
    }
}

/// Warnings that many elements of a file share.
#[derive(Default)]
pub struct GroupedWarnings {
    /// Names of the elements by kind and phrase.
    names: BTreeMap<(WarningKind, String), BTreeSet<String>>,
    /// Pictures that cannot be read, each with the reason.
    unreadable: BTreeSet<String>,
}

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

    /// A file was found under another name than `name`.
    pub fn guessed(&mut self, name: &str) {
        self.chosen("found under other names the files", name);
    }

    /// A picture cannot be read, for a reason.
    pub fn unreadable(&mut self, problem: String) {
        self.unreadable.insert(problem);
    }

    fn add(&mut self, kind: WarningKind, phrase: String, name: &str) {
        self.names.entry((kind, phrase)).or_default().insert(name.to_owned());
    }

    /// One warning for each phrase, about the file of this name.
    pub fn into_warnings(self, file: &str) -> impl Iterator<Item = Warning> {
        let all = problems(self.unreadable.iter().map(String::as_str));
        let text = format!("{file}: ignored textures that cannot be read: {all}");
        let unreadable = (!all.is_empty()).then(|| Warning::skipped(text));
        let file = file.to_owned();
        let grouped = self.names.into_iter().map(move |((kind, phrase), names)| {
            let names = list(names.iter().map(String::as_str));
            Warning { kind, text: format!("{file}: {phrase} {names}"), advice: None }
        });
        unreadable.into_iter().chain(grouped)
    }
}
