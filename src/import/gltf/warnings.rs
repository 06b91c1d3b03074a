//! Notes that many materials or meshes share, gathered under one phrase.

use crate::import::text::list;
use crate::import::warnings::{Warning, WarningKind};
use std::collections::{BTreeMap, BTreeSet};

/// Names by phrase.
#[derive(Default)]
pub(super) struct Remarks {
    skipped: BTreeMap<&'static str, BTreeSet<String>>,
    chosen: BTreeMap<&'static str, BTreeSet<String>>,
}

impl Remarks {
    /// The image lacks something of `name`.
    pub fn skipped(&mut self, phrase: &'static str, name: &str) {
        self.skipped.entry(phrase).or_default().insert(name.to_owned());
    }

    /// Something was chosen for `name`.
    pub fn chosen(&mut self, phrase: &'static str, name: &str) {
        self.chosen.entry(phrase).or_default().insert(name.to_owned());
    }

    /// All notes, about the file of this name.
    pub fn notes(self, file: &str) -> Vec<Warning> {
        let kinds = [(WarningKind::Skipped, self.skipped), (WarningKind::Chosen, self.chosen)];
        let mut notes = Vec::new();
        for (kind, phrases) in kinds {
            for (phrase, names) in phrases {
                let names = list(names.iter().map(String::as_str));
                notes.push(Warning { kind, text: format!("{file}: {phrase} {names}") });
            }
        }
        notes
    }
}
