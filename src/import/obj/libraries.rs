//! The material libraries that an OBJ file names.

use crate::base::error::Result;
use crate::import::mtl;
use crate::import::notes::Note;
use crate::import::text::list;
use crate::scene::Material;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A mention of a material library.
#[derive(Clone, Debug)]
pub(super) struct Library {
    pub names: String,
    pub line: usize,
}

impl Library {
    /// Names may hold spaces, and one line may name several libraries: try the whole first.
    pub(super) fn load(
        &self,
        obj: &Path,
        materials: &mut BTreeMap<String, Material>,
        notes: &mut Vec<Note>,
    ) -> Result<()> {
        let folder = obj.parent().unwrap_or(Path::new(""));
        let find = |name: &str| -> Option<PathBuf> {
            let candidates = [folder.join(name), folder.join(name.replace('\\', "/"))];
            candidates.into_iter().find(|path| path.exists())
        };
        if let Some(path) = find(&self.names) {
            return mtl::load(&path, materials, notes);
        }
        let mut missing = Vec::new();
        let several: Vec<_> =
            self.names.split_whitespace().map(|name| (name, find(name))).collect();
        if several.iter().all(|(_, path)| path.is_none()) {
            missing.push(self.names.as_str());
        }
        for (name, path) in &several {
            match path {
                Some(path) => mtl::load(path, materials, notes)?,
                None if missing.is_empty() => missing.push(name),
                None => {}
            }
        }
        if !missing.is_empty() {
            let names = list(missing);
            let (path, line) = (obj.display(), self.line);
            let note = format!("{path}:{line}: the material library {names} does not exist");
            notes.push(Note::skipped(note));
        }
        Ok(())
    }
}
