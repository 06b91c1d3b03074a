//! Warnings about the content of a material library.

use super::LibraryMaterial;
use super::material::MtlMaterial;
use crate::text::{list, problems};
use crate::warnings::Warning;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Names of the materials and textures that warnings mention.
#[derive(Default)]
pub(super) struct Notes {
    /// Materials with several definitions.
    pub twice: BTreeSet<String>,
    /// Textures that do not exist.
    pub missing: BTreeSet<String>,
    /// Textures that were found under another name, with that name.
    pub guessed: BTreeSet<String>,
    /// Textures that cannot be read, each with the reason.
    pub unreadable: BTreeSet<String>,
    /// Materials with textures of an unsupported kind, each with its record.
    pub textures: BTreeSet<String>,
    /// Ignored options of textures, each with its material.
    pub options: BTreeSet<String>,
    /// Materials whose textures have different maps of texture coordinates.
    pub mappings: BTreeSet<String>,
    /// Records that are not known.
    pub unknown: BTreeSet<String>,
    /// Materials whose highlight was ignored.
    highlights: BTreeSet<String>,
    /// Materials whose opacity of 0 was ignored.
    transparent: BTreeSet<String>,
    /// Materials whose transmission filter was ignored.
    filters: BTreeSet<String>,
}

impl Notes {
    /// Adds a material after its last record.
    pub fn finish(
        &mut self,
        records: MtlMaterial,
        materials: &mut BTreeMap<String, LibraryMaterial>,
    ) {
        let (material, ignored) = records.material();
        let name = &material.name;
        for (is_met, names) in [
            (ignored.highlight, &mut self.highlights),
            (ignored.transparency, &mut self.transparent),
            (ignored.filter, &mut self.filters),
        ] {
            if is_met {
                names.insert(name.clone());
            }
        }
        let to_uv = records.to_uv.unwrap_or_default();
        materials.insert(name.clone(), LibraryMaterial { material, to_uv });
    }

    /// Adds the warnings about the library `path`.
    pub fn into_warnings(self, path: &Path, warnings: &mut Vec<Warning>) {
        let mut add = |kind: fn(String) -> Warning, text: String| {
            warnings.push(kind(format!("{}: {text}", path.display())));
        };
        if !self.unreadable.is_empty() {
            let all = problems(self.unreadable.iter().map(String::as_str));
            add(Warning::skipped, format!("ignored some textures: {all}"));
        }
        for (names, phrase) in [
            (self.twice, "ignored all but the last definition of"),
            (self.missing, "ignored some textures, for there are no files"),
            (self.textures, "ignored some textures (of another use) of"),
            (self.options, "ignored some options of textures:"),
            (self.mappings, "used one map of texture coordinates for all textures of"),
            (self.unknown, "ignored the records"),
            (self.highlights, "ignored the highlights (`Ks` with `Kd`) of"),
            (self.transparent, "ignored the opacity of 0 of"),
            (self.filters, "ignored the transmission filter `Tf` of"),
        ] {
            if !names.is_empty() {
                add(
                    Warning::skipped,
                    format!("{phrase} {}", list(names.iter().map(String::as_str))),
                );
            }
        }
        if !self.guessed.is_empty() {
            let names = list(self.guessed.iter().map(String::as_str));
            add(Warning::chosen, format!("found textures under other names: {names}"));
        }
    }
}
