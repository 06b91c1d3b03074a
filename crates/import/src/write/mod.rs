//! Scenes as folders that can be edited: `scene.toml`, a mesh per OBJ file, textures as PNG,
//! and matrices of scattering as BSDF files.
//!
//! The folder loads as an identical scene, as far as the formats allow: numbers are written with
//! the shortest text that parses to the same bits.

mod folder;
mod klems;
mod materials;
mod media;
mod meshes;
mod numbers;
mod tables;
mod textures;

use crate::warnings::Warning;
use bdpm_core::base::error::Result;
use bdpm_core::scene::{MeterSet, Scene};
use bdpm_core::settings::PartialSettings;
use folder::ExportFolder;
use klems::BsdfFiles;
use materials::MaterialTables;
use media::MediumTables;
use meshes::MeshFiles;
use std::path::{Path, PathBuf};
use textures::TextureFiles;

/// The result of [`export_scene`].
#[derive(Clone, Debug)]
pub struct Exported {
    /// The files.
    pub files: Vec<PathBuf>,
    /// Properties of the scene that the formats cannot represent.
    pub warnings: Vec<Warning>,
}

/// Writes a scene with its settings and meters, which was read from the file `origin`, as `folder`.
/// Files that exist are replaced if `replace` is set.
///
/// # Errors
/// If a file exists and must not be replaced, if this process has read it, or if a file cannot be
/// written. In the last case some files may have been written.
pub fn export_scene(
    scene: &Scene,
    (defaults, meters): (&PartialSettings, &[MeterSet]),
    origin: &str,
    folder: &Path,
    replace: bool,
) -> Result<Exported> {
    let mut warnings = Vec::new();
    let media = MediumTables::new(scene);
    let materials = MaterialTables::new(scene.materials(), &media);
    let (mut textures, mut bsdfs) = (TextureFiles::default(), BsdfFiles::default());
    let meshes = MeshFiles::new(scene);

    let mut text = tables::head(origin);
    text += &tables::ray_offset(scene.own_ray_offset());
    text += &media.key("medium", scene.filling_medium());
    text += &tables::camera(scene);
    text += &tables::render(defaults)?;
    text += &tables::regions(&scene.regions);
    let environment = scene.lights().environment();
    text += &environment.map(tables::environment).unwrap_or_default();
    text += &tables::lights(scene, &mut warnings);
    text += &media.tables();
    text += &materials.tables(&mut textures, &mut bsdfs)?;
    text += &meshes.tables(&materials, &mut warnings);
    text += &tables::meters(meters, scene);

    let mut out = ExportFolder::new(folder, replace);
    out.plan("scene.toml");
    meshes.files().chain(textures.files()).chain(bsdfs.files()).for_each(|file| out.plan(file));
    let environment = environment.filter(|own| !tables::is_plain(own));
    if environment.is_some() {
        out.plan(tables::ENVIRONMENT);
    }
    let inset = environment.filter(|own| own.inset().is_some());
    if inset.is_some() {
        out.plan(tables::INSET);
    }
    let files = out.begin()?;
    meshes.write(&out)?;
    textures.write(&out)?;
    bsdfs.write(&out)?;
    if let Some(environment) = environment {
        self::textures::write_environment(environment, &out.path(tables::ENVIRONMENT))?;
    }
    if let Some(environment) = inset {
        self::textures::write_inset(environment, &out.path(tables::INSET))?;
    }
    // The scene file is last, so that no scene lacks its parts.
    out.write("scene.toml", |to| to.write_all(text.as_bytes()))?;
    Ok(Exported { files, warnings })
}
