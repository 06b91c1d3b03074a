//! The scene of the paper's experiment, which the program carries: `bdpm reproduce` works in any
//! folder.

use bdpm::base::error::{Error, Result};
use std::fs;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// What stands for the scene in place of a path.
pub const BUILT_IN: &str = "built-in:cornell-box";

/// Folder of the scene, which names it.
const FOLDER: &str = "cornell-box";

/// Names and contents of its files.
const FILES: [(&str, &str); 3] = [
    ("scene.toml", include_str!("../../../scenes/cornell-box/scene.toml")),
    ("cornell-box.obj", include_str!("../../../scenes/cornell-box/cornell-box.obj")),
    ("cornell-box.mtl", include_str!("../../../scenes/cornell-box/cornell-box.mtl")),
];

/// The scene in a temporary folder, which vanishes with this value.
pub struct BuiltInScene(TempDir);

impl BuiltInScene {
    /// Writes the files.
    ///
    /// # Errors
    /// If the folder for temporary files is not writable; names it.
    pub fn new() -> Result<Self> {
        let folder = TempDir::new();
        let folder = folder.map_err(|e| Error::io("write", &std::env::temp_dir(), e))?;
        let scene = Self(folder);
        let path = scene.path();
        let written = fs::create_dir(&path).and_then(|()| {
            FILES.iter().try_for_each(|(name, content)| fs::write(path.join(name), content))
        });
        written.map_err(|e| Error::io("write", &path, e))?;
        Ok(scene)
    }

    /// Its folder.
    pub fn path(&self) -> PathBuf {
        self.0.path().join(FOLDER)
    }
}

/// Whether a path stands for the built-in scene.
pub fn is_built_in(path: &Path) -> bool {
    path == Path::new(BUILT_IN)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm::load;

    #[test]
    fn built_in_scene_is_that_of_the_repository() {
        let scene = BuiltInScene::new().unwrap();
        let own = load(scene.path()).unwrap().scene;
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box");
        let other = load(&path).unwrap().scene;
        assert_eq!((own.fingerprint(), &own.name), (other.fingerprint(), &other.name));
        let path = scene.path();
        drop(scene);
        assert!(!path.exists() && is_built_in(Path::new(BUILT_IN)));
    }
}
