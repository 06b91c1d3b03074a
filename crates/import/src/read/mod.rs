//! Readers of scene files, one folder per format. Each fills a [`Builder`](super::builder::Builder)
//! with meshes, looks and lights, and returns what its file describes.

mod gltf;
pub mod klems;
mod meters;
mod mitsuba;
mod mtl;
mod obj;
mod pbrt;
mod ply;
mod radiance;
pub mod toml;

pub use meters::{parse_meters, read_meters};
pub use toml::keys::render_settings;
pub use toml::{NamedMesh, read_meshes};

pub use super::builder::ImportOptions;

use super::builder::{Imported, ReadScene};
use super::environment::EnvironmentSource;
use super::excerpts::ShownFiles;
use super::text::{self, placed_at};
use bdpm_core::base::error::{Error, Result};
pub use bdpm_core::base::input::extension;
use bdpm_core::scene::Camera;
use glam::DVec3;
use std::path::Path;

/// Extensions of scene files, in lower case.
pub const SCENE_EXTENSIONS: &[&str] = &["toml", "gltf", "glb", "obj", "xml", "pbrt", "rad"];

const KNOWN_TYPES: &str =
    "give a .toml, .gltf, .glb, .obj, .xml, .pbrt or .rad file, or a folder that holds scene.toml";

const FROM_BLENDER: &str = "in Blender, choose File > Export > glTF 2.0 and give the .glb file, or \
                            render with the add-on (docs/how-to/blender.md)";

/// Reads a `.toml` scene file, a folder that holds `scene.toml`, a `.gltf`, `.glb` or `.obj` file,
/// an `.xml` file of Mitsuba, a `.pbrt` file of pbrt-v4, or a `.rad` file of Radiance.
///
/// # Errors
/// Names the file and, where there is one, the line or the JSON element that cannot be read.
pub fn read(path: &Path, options: &ImportOptions) -> Result<Imported> {
    if path.is_dir() {
        let inside = path.join("scene.toml");
        if !inside.exists() {
            return Err(Error::new("the folder holds no scene.toml", KNOWN_TYPES).at(path));
        }
        return read(&inside, options);
    }
    // A missing file is the more important problem than its extension.
    std::fs::metadata(path).map_err(|e| Error::io("read the scene", path, e))?;
    let extension = extension(path);
    if let (Some(name), false) = (options.camera, matches!(&extension[..], "gltf" | "glb" | "xml"))
    {
        let problem =
            format!("there is no camera `{name}`: only glTF and Mitsuba files have named cameras");
        return Err(Error::new(problem, "name no camera").at(path));
    }
    let read_file = match &extension[..] {
        "gltf" | "glb" => gltf::read,
        "toml" => toml::read,
        "obj" => obj::read,
        "xml" => mitsuba::read,
        "pbrt" => pbrt::read,
        "rad" => radiance::read,
        "blend" => {
            return Err(Error::new("files of Blender cannot be read", FROM_BLENDER).at(path));
        }
        other => {
            let problem = format!("scenes of type `.{other}` cannot be read");
            return Err(Error::new(problem, KNOWN_TYPES).at(path));
        }
    };
    let read = ReadScene::near(options, |options| read_file(path, options));
    shown(read.map_err(|error| placed_at(error, path)), path, options)
}

/// The scene of a file, or its error, without excerpts of files outside of its folder.
fn shown(read: Result<Imported>, path: &Path, options: &ImportOptions) -> Result<Imported> {
    let given = match options.environment {
        Some(EnvironmentSource::File(given)) => Some(&**given),
        _ => None,
    };
    let files = ShownFiles::of(path, given);
    let mut imported = read.map_err(|error| files.error(error))?;
    let warnings = std::mem::take(&mut imported.warnings).into_iter();
    imported.warnings = warnings.map(|warning| files.warning(warning)).collect();
    Ok(imported)
}

/// The camera of a scene for one whose origin is at this point, and the resolution that its file
/// gives. Of a scene file in TOML, only `[camera]` and `[render]` are read.
///
/// # Errors
/// In the cases of [`read`].
pub fn camera_of(path: &Path, origin: DVec3) -> Result<(Camera, Option<[u32; 2]>)> {
    if extension(path) == "toml" {
        return toml::keys::camera_alone(path, &text::read(path)?, origin);
    }
    let imported = read(path, &ImportOptions { origin: Some(origin), ..ImportOptions::default() })?;
    Ok((imported.scene.camera, imported.defaults.resolution))
}
