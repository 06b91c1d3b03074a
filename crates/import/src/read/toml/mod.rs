//! Scene files (TOML), and scenes from meshes in memory. `docs/reference/scene-format.md` describes
//! the format. No content of a file makes these functions panic.

mod camera;
mod environment;
pub mod keys;
mod light;
mod luminaire;
mod material;
mod medium;
mod mesh;
mod meter;
mod numbers;
mod parse;
mod places;
mod refractive_index;
pub mod sky;
mod texture;

pub use mesh::NamedMesh;

use super::ImportOptions;
use super::obj::{ObjFile, ObjPlacer};
use crate::builder::{Builder, Contents, EnvironmentReader, Imported, ReadScene};
use crate::look::Look;
use crate::text::{self, list, placed_at};
use crate::warnings::Warning;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::transform::MAX_COORDINATE;
use bdpm_core::scene::{Emitter, Medium, Region};
use glam::DVec3;
use keys::SceneFile;
use light::TableLight;
use luminaire::LuminaireFiles;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use texture::TomlTextures;

/// Reads a scene file.
pub(super) fn read(path: &Path, options: &ImportOptions) -> Result<ReadScene> {
    read_once(path, &text::read(path)?, &[], options)
}

/// Builds a scene from `meshes` and the `text` of a scene file, as
/// `load_meshes` of the crate above does.
///
/// # Errors
/// Names the file and, where there is one, the line that cannot be read.
pub fn read_meshes(
    path: &Path,
    text: &str,
    meshes: &[NamedMesh],
    options: &ImportOptions,
) -> Result<Imported> {
    let read = ReadScene::near(options, |options| read_once(path, text, meshes, options));
    super::shown(read, path, options)
}

/// Reads a scene as [`read_meshes`] does, unless it is far from the origin.
fn read_once(
    path: &Path,
    text: &str,
    meshes: &[NamedMesh],
    options: &ImportOptions,
) -> Result<ReadScene> {
    let file = keys::parse(path, text)?;
    let reader = SceneReader {
        path,
        origin: options.origin(),
        folder: path.parent().unwrap_or(Path::new("")),
        text,
        builder: Builder::default(),
        placer: ObjPlacer::default(),
        looks: BTreeMap::new(),
        media: BTreeMap::new(),
        files: HashMap::new(),
    };
    reader.read(&file, meshes, options).map_err(|error| placed_at(error, path))
}

/// A scene that is being read.
struct SceneReader<'a> {
    path: &'a Path,
    /// Point of the file that is the origin of the scene.
    origin: DVec3,
    folder: &'a Path,
    text: &'a str,
    builder: Builder,
    placer: ObjPlacer,
    /// The materials of the scene file.
    looks: BTreeMap<String, Look>,
    media: BTreeMap<String, Arc<Medium>>,
    files: HashMap<PathBuf, Rc<ObjFile>>,
}

/// An error and its byte offset in the file.
type Misplaced = (Error, usize);

impl<'a> SceneReader<'a> {
    fn read(
        mut self,
        file: &'a SceneFile,
        meshes: &[NamedMesh],
        options: &ImportOptions,
    ) -> Result<ReadScene> {
        let camera = file.camera.get_ref().camera(self.origin);
        let camera = camera.map_err(|error| self.at(error, file.camera.span().start))?;
        self.media = medium::media(&file.media).map_err(|error| self.place(error))?;
        let mut textures = TomlTextures::new(self.folder);
        for (name, table) in &file.materials {
            let look = table.look(&mut textures, &self.media);
            self.looks.insert(name.clone(), look.map_err(|error| self.place(error))?);
        }
        file.mesh.iter().try_for_each(|table| self.mesh(table))?;
        meshes.iter().try_for_each(|mesh| self.named_mesh(mesh))?;
        let (lights, light_names) = self.lights(file)?;
        self.warn_of_unused();
        let filling = file.medium.as_ref().map(|name| medium::named(name, &self.media));
        let region = |(name, rectangles): (&String, &keys::Rectangles)| Region {
            name: name.clone(),
            rectangles: rectangles.0.clone(),
        };
        let contents = Contents {
            lights,
            light_names,
            camera: Some(camera),
            environment: self.environment(file)?,
            defaults: file.render.clone(),
            regions: file.regions.iter().map(region).collect(),
            meters: keys::meter_sets(self.path, self.text, &file.meter, self.origin)?,
            ray_offset: self.ray_offset(file)?,
            filling_medium: filling.transpose().map_err(|error| self.place(error))?,
            ..Contents::default()
        };
        self.builder.finish(self.path, contents, options)
    }

    /// The error at a byte offset in the file, unless it is in another file.
    fn at(&self, error: Error, offset: usize) -> Error {
        if error.has_location() {
            return error;
        }
        error.at(self.path).at_offset(self.text, offset)
    }

    fn place(&self, (error, offset): Misplaced) -> Error {
        self.at(error, offset)
    }

    /// Adds all luminaires with an opening to the meshes, and returns the other lights with their
    /// names.
    fn lights(&mut self, file: &SceneFile) -> Result<(Vec<Emitter>, Vec<Option<String>>)> {
        let (mut lights, mut names) = (Vec::new(), Vec::new());
        let mut luminaires = LuminaireFiles::default();
        for table in &file.light {
            let start = table.span().start;
            let light = table.get_ref().light(self.folder, &mut luminaires, self.origin);
            match light.map_err(|error| within(error, self.path, self.text, start))? {
                TableLight::Emitter(emitter) => {
                    lights.push(emitter);
                    names.push(table.get_ref().name().map(str::to_owned));
                }
                TableLight::Luminaire(luminaire, notes) => {
                    self.builder.warnings.extend(notes.into_iter().map(Warning::chosen));
                    let name = luminaire.name.clone();
                    let added = self.builder.add_luminaire(luminaire);
                    let added = added.map_err(|error| self.at(error, start))?;
                    names.extend(added.as_ref().map(|_| Some(name)));
                    lights.extend(added);
                }
            }
        }
        Ok((lights, names))
    }

    fn warn_of_unused(&mut self) {
        let used: BTreeSet<&str> =
            self.builder.materials.iter().map(|material| &material.name[..]).collect();
        let unused = self.looks.keys().map(String::as_str).filter(|name| !used.contains(name));
        let unused: Vec<&str> = unused.collect();
        if !unused.is_empty() {
            let (path, names) = (self.path.display(), list(unused));
            let text = format!("{path}: no mesh uses the material {names}");
            self.builder.warnings.push(Warning::chosen(text));
        }
    }

    /// The environment or the sky.
    fn environment(&self, file: &'a SceneFile) -> Result<Option<EnvironmentReader<'a>>> {
        let (path, folder, text) = (self.path, self.folder, self.text);
        match (&file.environment, &file.sky) {
            (None, None) => Ok(None),
            (Some(_), Some(sky)) => {
                let advice = "remove one of them: each is the light from all around";
                let error = Error::new("the scene has both [environment] and [sky]", advice);
                Err(self.at(error, sky.span().start))
            }
            (Some(table), None) => Ok(Some(Box::new(move |warnings| {
                let own = table.get_ref().environment(folder, warnings);
                own.map_err(|error| within(error, path, text, table.span().start))
            }))),
            (None, Some(sky)) => {
                let own = sky.get_ref().environment();
                let own = own.map_err(|error| self.at(error, sky.span().start))?;
                Ok(Some(Box::new(|_| Ok(own))))
            }
        }
    }

    fn ray_offset(&self, file: &SceneFile) -> Result<Option<f32>> {
        let Some(key) = &file.ray_offset else { return Ok(None) };
        let distance = *key.get_ref();
        if (0.0..=f64::from(MAX_COORDINATE)).contains(&distance) {
            return Ok(Some(distance as f32));
        }
        let advice = format!("give a distance from 0 to {MAX_COORDINATE:e} scene units");
        Err(self.at(Error::new(format!("`ray_offset` is {distance}"), advice), key.span().start))
    }
}

/// The error of a table at a byte offset, unless it is about the content of another file.
fn within(error: Error, path: &Path, text: &str, offset: usize) -> Error {
    if error.has_location() { error } else { error.at(path).at_offset(text, offset) }
}
