//! Conversions of scenes to the program's own format.

use crate::error::raised;
use crate::scene::Scene;
use crate::tables;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use std::path::PathBuf;

/// Converts a scene to a folder with scene.toml, OBJ meshes and PNG textures, which `bdpm.load` and
/// the program read as the same scene. Returns a dictionary with the keys of `bdpm convert --json`,
/// such as `files`, `fingerprints` and `notes`.
///
/// - `scene`: a file, which is read as by `bdpm.load` without options, or a `Scene`, also one of
///   arrays.
/// - `folder`: the folder, which is made if it is missing.
/// - `force`: replace existing files.
///
/// Raises bdpm.Error if a file exists and `force` is not set, if it is a file of the scene itself,
/// or if it cannot be written.
#[pyfunction]
#[pyo3(signature = (scene, folder, *, force=false))]
pub fn convert<'py>(
    py: Python<'py>,
    scene: &Bound<'py, PyAny>,
    folder: PathBuf,
    force: bool,
) -> PyResult<Bound<'py, PyAny>> {
    let (loaded, origin) = match scene.cast::<Scene>() {
        Ok(scene) => {
            let loaded = scene.get().loaded.clone();
            let name = loaded.scene.name.clone();
            (loaded, name)
        }
        Err(_) => {
            let path: PathBuf = scene.extract().map_err(|_| {
                PyTypeError::new_err("scene is neither a Scene nor the path of a file")
            })?;
            let loaded = py.detach(|| bdpm::load(&path)).map_err(raised)?;
            let name = path.file_name().map(|name| name.to_string_lossy().into_owned());
            let name = name.unwrap_or_else(|| loaded.scene.name.clone());
            (loaded, name)
        }
    };
    let converted = py.detach(|| bdpm::load::convert(loaded, &origin, &folder, force));
    tables::object(py, &converted.map_err(raised)?)
}
