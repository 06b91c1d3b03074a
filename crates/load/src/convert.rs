//! Conversion of a scene to a folder in the program's own format.

use super::{Loaded, SceneSummary, export, load};
use bdpm_core::base::error::Result;
use bdpm_core::base::input;
use bdpm_import::Warning;
use serde::Serialize;
use std::path::Path;

/// A scene that was written as a folder, and read again.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Converted {
    /// The folder.
    pub folder: String,
    /// Number of files that were written.
    pub files: usize,
    /// Fingerprints of the scene, and of the written folder when it is read again: 16 hexadecimal
    /// digits.
    pub fingerprints: [String; 2],
    /// Contents of the scene.
    pub read: SceneSummary,
    /// Omissions and defaults, of reading and of writing.
    #[serde(rename = "notes")]
    pub warnings: Vec<Warning>,
}

/// Writes a scene, which was read from the file `origin`, as a folder with `scene.toml`, OBJ meshes
/// and textures, and reads that again. Files that exist are replaced if `replace` is set.
///
/// A copy that is not bit-identical gets a warning.
///
/// # Errors
/// In the cases of [`export`], and if the written folder cannot be read.
pub fn convert(loaded: Loaded, origin: &str, folder: &Path, replace: bool) -> Result<Converted> {
    let exported = export(&loaded, origin, folder, replace)?;
    let Loaded { scene, summary, mut warnings, .. } = loaded;
    warnings.extend(exported.warnings);
    if let [name, others @ ..] = &summary.cameras[..]
        && !others.is_empty()
    {
        let name = summary.camera.as_ref().unwrap_or(name);
        warnings.push(Warning::chosen(format!("the folder contains only the camera `{name}`")));
    }
    let fingerprint = scene.fingerprint();
    // Only one of both scenes needs memory, unless the caller keeps this one.
    drop(scene);
    let again = load(folder).map(|again| again.scene.fingerprint());
    // They are copies, which another conversion of this process may replace.
    input::forget(&exported.files);
    let again = again?;
    if again != fingerprint {
        let warning = "the copy is not bit-identical, so its image may differ by rounding";
        warnings.push(Warning::chosen(warning));
    }
    Ok(Converted {
        folder: folder.display().to_string(),
        files: exported.files.len(),
        fingerprints: [fingerprint, again].map(|bits| format!("{bits:016x}")),
        read: summary,
        warnings,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{LoadOptions, NamedMesh, load_meshes};
    use bdpm_core::scene::Mesh;
    use glam::Vec3;
    use std::sync::Arc;

    const REST: &str = "
[camera]
position = [0, 0, 2]
target = [0, 0, 0]
fov_y_deg = 30
[render]
resolution = [8, 6]
[materials.\"mesh 0\"]
albedo = 0.3
emission = [3, 2, 1]
";

    #[test]
    fn scene_of_arrays_is_converted_twice_by_one_process() {
        let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
        let mesh = Mesh {
            name: "mesh".into(),
            positions: corners.map(|(x, y)| Vec3::new(x, y, 0.1)).into(),
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            ..Mesh::default()
        };
        let meshes = [NamedMesh { mesh: Arc::new(mesh), material: "mesh 0".into() }];
        let loaded =
            load_meshes(Path::new("sign"), REST, &meshes, &LoadOptions::default()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("new");
        let convert = |replace| convert(loaded.clone(), "sign", &out, replace);
        let converted = convert(false).unwrap();
        assert_eq!(converted.fingerprints[0], converted.fingerprints[1]);
        assert!(converted.files == 2 && converted.warnings.is_empty(), "{converted:?}");
        assert!(convert(false).unwrap_err().to_string().contains("already holds"));
        assert_eq!(convert(true).unwrap(), converted);
        // A file that was read for another purpose is an input.
        load(&out).unwrap();
        assert!(convert(true).unwrap_err().to_string().contains("a file that was read"));
    }
}
