//! Finds and loads the material libraries that an OBJ file names.

use super::Looks;
use crate::file_names::is_guess;
use crate::read::mtl;
use crate::text::{find, list};
use crate::warnings::Warning;
use bdpm_core::base::error::Result;
use std::path::Path;

/// An `mtllib` record.
#[derive(Clone, Debug)]
pub(super) struct Library {
    /// File names, separated by spaces. A name may hold spaces itself.
    pub names: String,
    /// One-based line of the record.
    pub line: usize,
}

impl Library {
    /// Adds the looks of all libraries of the record. It first tries the whole text as one name,
    /// because names may hold spaces, then each word. A missing library causes a warning.
    pub(super) fn load(
        &self,
        obj: &Path,
        looks: &mut Looks,
        notes: &mut Vec<Warning>,
    ) -> Result<()> {
        let folder = obj.parent().unwrap_or(Path::new(""));
        let mut found = |name: &str, path: &Path| {
            if is_guess(folder, name, path) {
                let (obj, line, path) = (obj.display(), self.line, path.display());
                let note = format!("{obj}:{line}: read `{path}` as the material library `{name}`");
                notes.push(Warning::chosen(note));
            }
            mtl::load(path, looks, notes)
        };
        if let Some(path) = find(folder, &self.names) {
            return found(&self.names, &path);
        }
        let mut missing = Vec::new();
        let mut is_any_found = false;
        for name in self.names.split_whitespace() {
            match find(folder, name) {
                Some(path) => {
                    found(name, &path)?;
                    is_any_found = true;
                }
                None => missing.push(name),
            }
        }
        if !is_any_found {
            missing = vec![self.names.as_str()];
        }
        for name in missing {
            let (path, line, name) = (obj.display(), self.line, list([name]));
            let note = format!("{path}:{line}: the material library {name} does not exist");
            notes.push(Warning::skipped(note));
        }
        Ok(())
    }
}
