//! The OBJ files of a scene, read on all threads: scenes may have hundreds of them.

use super::object::Object;
use crate::read::obj::{self, ObjFile};
use bdpm_core::base::error::Result;
use rayon::prelude::*;
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};

/// Files that were read before the shapes that use them.
#[derive(Default)]
pub(super) struct ObjFiles(HashMap<PathBuf, Result<ObjFile>>);

impl ObjFiles {
    /// Reads the files of these shapes. A file that cannot be read is an error of the shape that
    /// takes it.
    pub fn read(shapes: &[Object]) -> Self {
        let own = shapes.iter().filter(|shape| shape.kind() == "obj");
        let paths: HashSet<PathBuf> = own.filter_map(|shape| shape.file().ok()).collect();
        Self(paths.into_par_iter().map(|path| (path.clone(), obj::load(&path))).collect())
    }

    /// Returns the content of a file. It is kept once: another shape with other options reads the
    /// file again.
    ///
    /// # Errors
    /// As [`obj::load`].
    pub fn take(&mut self, path: &Path) -> Result<ObjFile> {
        self.0.remove(path).unwrap_or_else(|| obj::load(path))
    }
}
