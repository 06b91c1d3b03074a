//! The material libraries that an OBJ file names.

use crate::base::error::Result;
use crate::import::mtl;
use crate::import::text::{find, list};
use crate::import::warnings::Warning;
use crate::scene::Material;
use std::collections::BTreeMap;
use std::path::Path;

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
        notes: &mut Vec<Warning>,
    ) -> Result<()> {
        let folder = obj.parent().unwrap_or(Path::new(""));
        if let Some(path) = find(folder, &self.names) {
            return mtl::load(&path, materials, notes);
        }
        let mut missing = Vec::new();
        let mut is_any = false;
        for name in self.names.split_whitespace() {
            match find(folder, name) {
                Some(path) => {
                    mtl::load(&path, materials, notes)?;
                    is_any = true;
                }
                None => missing.push(name),
            }
        }
        if !is_any {
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
