//! Notes that many elements share, gathered under one phrase.

use crate::import::text::list;
use crate::import::warnings::{Warning, WarningKind};
use std::collections::{BTreeMap, BTreeSet};

/// Names by phrase.
#[derive(Default)]
pub(super) struct Remarks(BTreeMap<(bool, String), BTreeSet<String>>);

impl Remarks {
    /// The image lacks something of `name`, or shows it in another way.
    pub fn skipped(&mut self, phrase: impl Into<String>, name: &str) {
        self.0.entry((false, phrase.into())).or_default().insert(name.to_owned());
    }

    /// Something was chosen for `name`.
    pub fn chosen(&mut self, phrase: impl Into<String>, name: &str) {
        self.0.entry((true, phrase.into())).or_default().insert(name.to_owned());
    }

    /// All notes, about the file of this name.
    pub fn notes(self, file: &str) -> impl Iterator<Item = Warning> {
        self.0.into_iter().map(move |((is_chosen, phrase), names)| {
            let kind = if is_chosen { WarningKind::Chosen } else { WarningKind::Skipped };
            let names = list(names.iter().map(String::as_str));
            Warning { kind, text: format!("{file}: {phrase} {names}") }
        })
    }
}
