//! What the user should know about how a scene was read.

use crate::base::error::{Error, Result, visible};
use serde::Serialize;
use std::fmt::{self, Write};

/// What was left out or chosen for the user.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Warning {
    /// Whether anything is missing.
    pub kind: WarningKind,
    /// A sentence without a full stop.
    pub text: String,
}

/// Kinds of [`Warning`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum WarningKind {
    /// The file says it, and the image lacks it.
    Skipped,
    /// The file leaves it open, or it makes no difference.
    Chosen,
}

impl Warning {
    /// Of something that the image lacks.
    pub fn skipped(text: impl Into<String>) -> Self {
        Self { kind: WarningKind::Skipped, text: text.into() }
    }

    /// Of something that the file leaves open.
    pub fn chosen(text: impl Into<String>) -> Self {
        Self { kind: WarningKind::Chosen, text: text.into() }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.text.chars().try_for_each(|c| f.write_char(visible(c)))
    }
}

/// Refuses a scene of which anything was skipped.
pub(super) fn require_complete(notes: &[Warning]) -> Result<()> {
    const SHOWN: usize = 5;
    let mut skipped = notes.iter().filter(|note| note.kind == WarningKind::Skipped);
    let shown: Vec<&str> = skipped.by_ref().take(SHOWN).map(|note| &note.text[..]).collect();
    let mut text = shown.join("; ");
    match skipped.count() {
        _ if shown.is_empty() => return Ok(()),
        0 => {}
        more => text += &format!("; and {more} more"),
    }
    let advice = "change the files, or leave --strict out to render without it";
    Err(Error::new(format!("not all of the scene can be rendered: {text}"), advice))
}
