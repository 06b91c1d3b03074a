//! Scenes as folders that can be edited: `scene.toml`, a mesh per OBJ file, and textures as PNG.
//!
//! What is read again is the same bit by bit, so far as the formats can say it: numbers are written as
//! briefly as leads back to them.

mod folder;
mod materials;
mod meshes;
mod names;
mod numbers;
mod textures;
mod tables;

use super::Loaded;
use super::warnings::Warning;
use crate::base::error::Result;
use folder::Folder;
use materials::Materials;
use meshes::Meshes;
use std::path::Path;
use textures::Pictures;

/// What [`save`] did.
#[derive(Clone, Debug)]
pub struct Saved {
    /// Number of files.
    pub files: usize,
    /// What the folder cannot say.
    pub notes: Vec<Warning>,
}

/// Writes `loaded`, which came from a file called `origin`, as `folder`.
///
/// # Errors
/// If a file is there already and not to be replaced or this process has read it, or one cannot be written; then files that were
/// not there before may be.
pub fn save(loaded: &Loaded, origin: &str, folder: &Path, replace: bool) -> Result<Saved> {
    let Loaded { scene, defaults, .. } = loaded;
    let mut notes = Vec::new();
    let materials = Materials::new(scene.materials());
    let mut pictures = Pictures::default();
    let meshes = Meshes::new(scene);

    let mut text = tables::head(origin);
    text += &tables::camera(&scene.camera);
    text += &tables::render(defaults)?;
    text += &tables::regions(&scene.regions);
    let environment = scene.lights().environment();
    text += &environment.map(tables::environment).unwrap_or_default();
    text += &tables::lights(scene.lights().emitters(), &mut notes);
    text += &materials.tables(&mut pictures)?;
    text += &meshes.tables(&materials, &mut notes);

    let mut out = Folder::new(folder, replace);
    out.plan("scene.toml");
    meshes.files().chain(pictures.files()).for_each(|file| out.plan(file));
    let environment = environment.filter(|own| !tables::is_plain(own));
    if environment.is_some() {
        out.plan(tables::ENVIRONMENT);
    }
    let files = out.begin()?;
    meshes.write(&out)?;
    pictures.write(&out)?;
    if let Some(environment) = environment {
        textures::write_environment(environment, &out.path(tables::ENVIRONMENT))?;
    }
    // Last, so that there is no scene without its parts.
    out.write("scene.toml", |to| to.write_all(text.as_bytes()))?;
    Ok(Saved { files, notes })
}
