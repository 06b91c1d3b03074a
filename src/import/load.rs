//! From a scene file (TOML), a folder with `scene.toml`, or an OBJ file to a [`Scene`].
//!
//! The format is described in `docs/scene-format.md`. Nothing in a file makes these functions
//! panic, and whatever was chosen or left out for the user is told in [`Loaded::notes`].

use super::builder::{Builder, Rest};
use super::environment::EnvironmentSource;
use super::gltf;
use super::instances;
use super::mitsuba;
use super::obj;
use super::obj::ObjFile;
use super::ply;
use super::scene_file;
use super::scene_file::SceneFile;
use super::scene_file::texture::Pictures;
use super::summary::SceneSummary;
use super::text;
use super::text::list;
use super::warnings;
use super::warnings::Warning;
use crate::base::error::{Error, Result};
use crate::scene::transform::Transform;
use crate::scene::{Material, Region, Scene};
use crate::settings::PartialSettings;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// A scene with what its file says about rendering it.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The scene.
    pub scene: Arc<Scene>,
    /// The file's `[render]` table.
    pub defaults: PartialSettings,
    /// What was skipped or chosen for the user.
    pub notes: Vec<Warning>,
    /// What was read.
    pub summary: SceneSummary,
    /// How much of the time of loading went into [`Scene::new`]: triangles and lights.
    pub assembly: Duration,
}

impl Loaded {
    /// All notes, a line each.
    pub fn notes_text(&self) -> String {
        self.notes.iter().map(Warning::to_string).collect::<Vec<_>>().join("\n")
    }
}

/// What the user says about reading a scene.
#[derive(Clone, Copy, Debug, Default)]
pub struct LoadOptions<'a> {
    /// Name of the camera, of those in a glTF file or one of Mitsuba.
    pub camera: Option<&'a str>,
    /// Whether it is an error if anything is skipped.
    pub strict: bool,
    /// Light from all around, in place of the file's.
    pub environment: Option<&'a EnvironmentSource>,
    /// Whether a glTF or OBJ file that brings no light worth the name gets none.
    pub no_fallback_light: bool,
}

impl LoadOptions<'_> {
    /// What is asked for besides a file's own content; notes tell what was mended.
    pub(super) fn rest(&self, notes: &mut Vec<Warning>) -> Result<Rest> {
        let environment = self.environment.map(|source| source.environment(notes)).transpose()?;
        let fallback = environment.is_none() && !self.no_fallback_light;
        Ok(Rest { environment, fallback, ..Rest::default() })
    }
}

/// Loads a `.toml` scene file, a folder that holds `scene.toml`, a `.gltf`, `.glb` or `.obj` file,
/// which gets a camera and a light if it has none, or an `.xml` file of Mitsuba.
///
/// # Errors
/// Names the file and, where there is one, the line or the JSON element that cannot be read or
/// rendered.
pub fn load(path: impl AsRef<Path>) -> Result<Loaded> {
    load_with(path.as_ref(), &LoadOptions::default())
}

/// The same with options.
///
/// # Errors
/// As [`load`]; also if there is no such camera, or something was skipped that must not be.
pub fn load_with(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    let loaded = load_any(path, options)?;
    if options.strict {
        warnings::require_complete(&loaded.notes).map_err(|error| error.at(path))?;
    }
    Ok(loaded)
}

fn load_any(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    if path.is_dir() {
        let inside = path.join("scene.toml");
        if !inside.exists() {
            let advice =
                "name a .toml, .gltf, .glb, .obj or .xml file, or a folder that holds scene.toml";
            return Err(Error::new("the folder holds no scene.toml", advice).at(path));
        }
        return load_any(&inside, options);
    }
    // A missing file is worth more words than its extension.
    std::fs::metadata(path).map_err(|e| Error::io("read the scene", path, e))?;
    let extension = extension(path);
    let is_gltf = matches!(&extension[..], "gltf" | "glb");
    let has_cameras = is_gltf || extension == "xml";
    if let (Some(name), false) = (options.camera, has_cameras) {
        let problem = format!(
            "there is no camera `{name}`: only glTF and Mitsuba's files have cameras by name"
        );
        return Err(Error::new(problem, "leave --camera out").at(path));
    }
    match &extension[..] {
        _ if is_gltf => gltf::load(path, options),
        "toml" => load_toml(path, options),
        "obj" => load_obj(path, options),
        "xml" => mitsuba::load(path, options),
        other => Err(Error::new(
            format!("scenes of type `.{other}` cannot be read"),
            "give a .toml, .gltf, .glb, .obj or .xml file, or a folder that holds scene.toml",
        )
        .at(path)),
    }
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

/// The file's name, or its folder's where the file has the name that all have.
pub(super) fn scene_name(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    let folder = path.canonicalize().ok().and_then(|full| Some(full.parent()?.to_owned()));
    match folder.as_deref().and_then(Path::file_name) {
        Some(folder) if stem == "scene" => folder.to_string_lossy().into_owned(),
        _ => stem.to_string_lossy().into_owned(),
    }
}

fn load_toml(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    let text = text::read(path)?;
    let file = scene_file::parse(path, &text)?;
    let place = |error: Error, offset: usize| error.at(path).at_offset(&text, offset);
    let camera = file.camera.get_ref().camera().map_err(|e| place(e, file.camera.span().start))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut pictures = Pictures::new(folder);
    let own = file.materials.iter().map(|(name, table)| {
        let material =
            table.material(name, &mut pictures).map_err(|(error, offset)| place(error, offset))?;
        Ok((name.clone(), material))
    });
    let own: BTreeMap<String, Material> = own.collect::<Result<_>>()?;

    let mut builder = Builder::new(Vec::new());
    let mut files: HashMap<PathBuf, ObjFile> = HashMap::new();
    for table in &file.mesh {
        let mesh = table.get_ref();
        let transform = mesh.transform().map_err(|e| place(e, table.span().start))?;
        let name = mesh.file.get_ref();
        let obj_path = folder.join(name);
        let here = |problem, advice| place(Error::new(problem, advice), mesh.file.span().start);
        let kind = extension(&obj_path);
        if !matches!(&kind[..], "obj" | "ply") {
            let problem = format!("`{name}` is neither an OBJ nor a PLY file");
            return Err(here(problem, "give a file ending in .obj or .ply"));
        }
        if kind == "ply" && mesh.material.is_none() {
            let problem = format!("the mesh `{name}` has no material: PLY files name none");
            return Err(here(problem, "add a line such as `material = \"chalk\"`"));
        }
        if let Err(error) = std::fs::metadata(&obj_path) {
            let advice = "check the name; it is relative to the folder of the scene file";
            return Err(here(format!("cannot read the mesh file `{name}`: {error}"), advice));
        }
        let is_new = !files.contains_key(&obj_path);
        if is_new {
            let read = match &kind[..] {
                "ply" => ObjFile::of(ply::read(&obj_path, ply::Rows::Up)?, &obj_path),
                _ => obj::load(&obj_path)?,
            };
            builder.notes.extend(read.notes.iter().cloned());
            files.insert(obj_path.clone(), read);
        }
        let obj = &files[&obj_path];
        let count = obj.triangle_count();
        let places = match &mesh.places {
            None => vec![transform],
            Some(file) if folder.join(file.get_ref()).is_file() => {
                instances::read(&folder.join(file.get_ref()))?
                    .into_iter()
                    .map(|place| place.flipped(mesh.flip))
                    .collect()
            }
            Some(file) => {
                let problem = format!("there is no file `{}`", file.get_ref());
                let advice = "check the name; it is relative to the folder of the scene file";
                return Err(place(Error::new(problem, advice), file.span().start));
            }
        };
        let placed = count.saturating_mul(places.len() as u64);
        builder.count(placed, if is_new { count } else { 0 }, path)?;
        if let Some(wanted) = &mesh.material {
            check_material(wanted.get_ref(), &file, obj)
                .map_err(|e| place(e, wanted.span().start))?;
        }
        let material = mesh.material.as_ref().map(|name| name.get_ref().as_str());
        for transform in &places {
            builder.add(&obj_path, obj, transform, material, &own).ok_or_else(|| {
                let problem = "the transform moves the mesh out of the range of coordinates";
                place(Error::new(problem, "scale or move it less"), table.span().start)
            })?;
        }
    }
    builder.arrange(path)?;

    let used: BTreeSet<&str> = builder.materials.iter().map(|m| m.name.as_str()).collect();
    let unused = file.materials.keys().map(String::as_str).filter(|name| !used.contains(name));
    let unused: Vec<&str> = unused.collect();
    if !unused.is_empty() {
        let note = format!("{}: no mesh uses the material {}", path.display(), list(unused));
        builder.notes.push(Warning::chosen(note));
    }
    let lights = file
        .light
        .iter()
        .map(|table| table.get_ref().emitter().map_err(|error| place(error, table.span().start)));
    let lights = lights.collect::<Result<_>>()?;
    let regions = file
        .regions
        .iter()
        .map(|(name, rectangles)| Region { name: name.clone(), rectangles: rectangles.0.clone() });
    let regions = regions.collect();
    let asked = options.rest(&mut builder.notes)?.environment;
    let environment = match (&file.environment, asked) {
        (None, asked) => asked,
        (Some(_), Some(asked)) => {
            let note = "--environment takes the place of its own";
            builder.notes.push(Warning::chosen(format!("{}: {note}", path.display())));
            Some(asked)
        }
        (Some(table), None) => {
            let (own, start) = (table.get_ref(), table.span().start);
            // What is wrong with the map is about its own file.
            let read = own.environment(folder, &mut builder.notes);
            Some(read.map_err(|error| if error.is_placed() { error } else { place(error, start) })?)
        }
    };
    let rest = Rest { regions, environment, defaults: file.render.clone(), fallback: false };
    builder.finish(path, lights, camera, rest)
}

fn check_material(name: &str, file: &SceneFile, obj: &ObjFile) -> Result<()> {
    if file.materials.contains_key(name) || obj.materials.contains_key(name) {
        return Ok(());
    }
    let known: BTreeSet<&str> =
        file.materials.keys().chain(obj.materials.keys()).map(String::as_str).collect();
    let advice = match known.len() {
        0 => format!("define it in a table [materials.{name}]"),
        _ => format!("use one of {}, or define it in a table [materials.{name}]", list(known)),
    };
    Err(Error::new(format!("unknown material `{name}`"), advice))
}

fn load_obj(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    let obj = obj::load(path)?;
    let mut builder = Builder::new(obj.notes.clone());
    builder.count(obj.triangle_count(), obj.triangle_count(), path)?;
    // The identity keeps all points in range.
    let _ = builder.add(path, &obj, &Transform::IDENTITY, None, &BTreeMap::new());
    builder.arrange(path)?;

    let camera = builder.place_camera(path)?;
    let rest = options.rest(&mut builder.notes)?;
    builder.finish(path, Vec::new(), camera, rest)
}
