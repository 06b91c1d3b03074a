//! Loading of scene files (TOML), folders with `scene.toml`, and OBJ files as a [`Scene`]; scenes
//! from meshes in memory.
//!
//! The format is described in `docs/reference/scene-format.md`. No content of a file makes these
//! functions panic. [`Loaded::warnings`] reports all defaults and omissions.

use super::builder::{Builder, SceneExtras};
use super::camera_change::CameraChange;
use super::environment::EnvironmentSource;
use super::gltf;
use super::instances;
use super::mitsuba;
use super::obj::{self, ObjFile};
use super::pbrt;
use super::ply::{self, PlyUse, VDirection};
use super::scene_file::light::TableLight;
use super::scene_file::luminaire::LuminaireFiles;
use super::scene_file::medium;
use super::scene_file::texture::TomlTextures;
use super::scene_file::{self, MeshFileKind, SceneFile};
use super::summary::SceneSummary;
use super::text::{self, RELATIVE_NAME, list};
use super::warnings::{self, Warning};
use bdpm_core::base::error::{Error, Result};
pub(super) use bdpm_core::base::input::extension;
use bdpm_core::scene::transform::{MAX_COORDINATE, Transform};
use bdpm_core::scene::{Material, Mesh, MeterSet, Region, Scene, check_mesh};
use bdpm_core::settings::PartialSettings;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// A scene with the render settings of its file.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The scene.
    pub scene: Arc<Scene>,
    /// The file's `[render]` table.
    pub defaults: PartialSettings,
    /// Meters of the file's `[[meter]]` tables.
    pub meters: Vec<MeterSet>,
    /// Omissions and defaults.
    pub warnings: Vec<Warning>,
    /// Contents of the file.
    pub summary: SceneSummary,
    /// Time of building triangles and lights, a part of the loading time.
    pub assembly: Duration,
}

impl Loaded {
    /// All warnings, each on lines of its own.
    pub fn warnings_text(&self) -> String {
        self.warnings.iter().map(Warning::to_string).collect::<Vec<_>>().join("\n")
    }
}

/// Options for loading a scene.
#[derive(Clone, Copy, Debug, Default)]
pub struct LoadOptions<'a> {
    /// Name of a camera in a glTF or Mitsuba file.
    pub camera: Option<&'a str>,
    /// Whether skipped contents are an error.
    pub strict: bool,
    /// Environment that replaces that of the file.
    pub environment: Option<&'a EnvironmentSource>,
    /// Whether a glTF or OBJ file without a usable light source gets no default light.
    pub no_fallback_light: bool,
    /// Changes of the camera of the scene.
    pub camera_change: CameraChange<'a>,
}

impl<'a> LoadOptions<'a> {
    /// The requested environment and default light. Warnings report corrected pixels.
    pub(super) fn extras(&self, warnings: &mut Vec<Warning>) -> Result<SceneExtras<'a>> {
        let environment =
            self.environment.map(|source| source.environment(warnings)).transpose()?;
        let default_light = environment.is_none() && !self.no_fallback_light;
        let camera = self.camera_change;
        Ok(SceneExtras { environment, default_light, camera, ..SceneExtras::default() })
    }
}

/// Loads a `.toml` scene file, a folder that holds `scene.toml`, a `.gltf`, `.glb` or `.obj` file,
/// an `.xml` file of Mitsuba, or a `.pbrt` file of pbrt-v4. Files in the glTF and OBJ formats get a
/// camera and a light if they have none.
///
/// # Errors
/// Names the file and, where there is one, the line or the JSON element that cannot be read or
/// rendered.
pub fn load(path: impl AsRef<Path>) -> Result<Loaded> {
    load_with(path.as_ref(), &LoadOptions::default())
}

/// Loads a scene as [`load`] does, with options.
///
/// # Errors
/// In the cases of [`load`], if the file has no camera of the requested name, or if anything was
/// skipped and [`LoadOptions::strict`] is set.
pub fn load_with(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    let mut loaded = load_any(path, options)?;
    loaded.warnings.extend(warnings::far_from_origin(&loaded.scene));
    if options.strict {
        warnings::require_complete(&loaded.warnings).map_err(|error| error.at(path))?;
    }
    Ok(loaded)
}

fn load_any(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    if path.is_dir() {
        let inside = path.join("scene.toml");
        if !inside.exists() {
            return Err(Error::new("the folder holds no scene.toml", KNOWN_TYPES).at(path));
        }
        return load_any(&inside, options);
    }
    // A missing file is the more important problem than its extension.
    std::fs::metadata(path).map_err(|e| Error::io("read the scene", path, e))?;
    let extension = extension(path);
    let is_gltf = matches!(&extension[..], "gltf" | "glb");
    let has_cameras = is_gltf || extension == "xml";
    if let (Some(name), false) = (options.camera, has_cameras) {
        let problem =
            format!("there is no camera `{name}`: only glTF and Mitsuba files have named cameras");
        return Err(Error::new(problem, "name no camera").at(path));
    }
    match &extension[..] {
        _ if is_gltf => gltf::load(path, options),
        "toml" => load_toml(path, options),
        "obj" => load_obj(path, options),
        "xml" => mitsuba::load(path, options),
        "pbrt" => pbrt::load(path, options),
        "blend" => Err(Error::new("files of Blender cannot be read", FROM_BLENDER).at(path)),
        other => {
            let problem = format!("scenes of type `.{other}` cannot be read");
            Err(Error::new(problem, KNOWN_TYPES).at(path))
        }
    }
}

/// Extensions of scene files, in lower case.
pub const SCENE_EXTENSIONS: &[&str] = &["toml", "gltf", "glb", "obj", "xml", "pbrt"];

const KNOWN_TYPES: &str =
    "give a .toml, .gltf, .glb, .obj, .xml or .pbrt file, or a folder that holds scene.toml";

const FROM_BLENDER: &str = "in Blender, choose File > Export > glTF 2.0 and give the .glb file, or render with the \
                            add-on (docs/how-to/blender.md)";

/// The name of the file, or that of its folder for the usual file name `scene.toml`.
pub(super) fn scene_name(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    let folder = path.canonicalize().ok().and_then(|full| Some(full.parent()?.to_owned()));
    match folder.as_deref().and_then(Path::file_name) {
        Some(folder) if stem == "scene" => folder.to_string_lossy().into_owned(),
        _ => stem.to_string_lossy().into_owned(),
    }
}

/// A mesh in memory, and the name of its material.
#[derive(Clone, Debug)]
pub struct NamedMesh {
    /// The mesh; its index of a material is ignored.
    pub mesh: Arc<Mesh>,
    /// Name of a table `[materials.NAME]`.
    pub material: String,
}

/// Builds a scene from `meshes` and the `text` of a scene file, which has the camera, the materials
/// and the lights.
///
/// `path` names the scene and locates errors in `text`; files that `text` names are in its folder.
/// No file is needed at `path` itself.
///
/// # Errors
/// In the cases of [`load`], if a mesh is not valid (names it), or if `text` does not define its
/// material.
pub fn load_meshes(
    path: &Path,
    text: &str,
    meshes: &[NamedMesh],
    options: &LoadOptions,
) -> Result<Loaded> {
    let loaded = build_toml(path, text, meshes, options)?;
    if options.strict {
        warnings::require_complete(&loaded.warnings).map_err(|error| error.at(path))?;
    }
    Ok(loaded)
}

fn load_toml(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    build_toml(path, &text::read(path)?, &[], options)
}

fn build_toml(
    path: &Path,
    text: &str,
    meshes: &[NamedMesh],
    options: &LoadOptions,
) -> Result<Loaded> {
    let file = scene_file::parse(path, text)?;
    let at = |error: Error, offset: usize| error.at(path).at_offset(text, offset);
    let camera = file.camera.get_ref().camera().map_err(|e| at(e, file.camera.span().start))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut textures = TomlTextures::new(folder);
    let place = |(error, offset): (Error, usize)| at(error, offset);
    let media = medium::media(&file.media).map_err(place)?;
    let own = file.materials.iter().map(|(name, table)| {
        let material = table.material(name, &mut textures, &media).map_err(place)?;
        Ok((name.clone(), material))
    });
    let own: BTreeMap<String, Material> = own.collect::<Result<_>>()?;

    let mut builder = Builder::new(Vec::new());
    let mut files: HashMap<PathBuf, ObjFile> = HashMap::new();
    for table in &file.mesh {
        let mesh = table.get_ref();
        let transform = mesh.transform().map_err(|e| at(e, table.span().start))?;
        let mesh_path = folder.join(mesh.file.get_ref());
        let kind = mesh.kind(folder).map_err(|e| at(e, mesh.file.span().start))?;
        let is_new = !files.contains_key(&mesh_path);
        if is_new {
            let read = match kind {
                MeshFileKind::Ply => {
                    let wanted = PlyUse { v_direction: VDirection::Up, has_colors: true };
                    ObjFile::of(ply::read(&mesh_path, wanted)?, &mesh_path)
                }
                MeshFileKind::Obj => obj::load(&mesh_path)?,
            };
            builder.warnings.extend(read.notes.iter().cloned());
            files.insert(mesh_path.clone(), read);
        }
        let obj = &files[&mesh_path];
        let transforms = match &mesh.places {
            None => vec![transform],
            Some(name) => {
                let array = folder.join(name.get_ref());
                if !array.is_file() {
                    let problem = format!("there is no file `{}`", name.get_ref());
                    return Err(at(Error::new(problem, RELATIVE_NAME), name.span().start));
                }
                let transforms = instances::read(&array)?.into_iter();
                transforms.map(|transform| transform.flipped(mesh.flip)).collect()
            }
        };
        let count = obj.triangle_count();
        let placed = count.saturating_mul(transforms.len() as u64);
        let counted = builder.count(placed, if is_new { count } else { 0 }, path);
        let parts = obj.meshes.len().saturating_mul(transforms.len()) as u64;
        let counted = counted.and_then(|()| builder.count_placements(parts, path));
        counted.map_err(|error| at(error, table.span().start))?;
        if let Some(name) = &mesh.material {
            check_material(name.get_ref(), &file, obj).map_err(|e| at(e, name.span().start))?;
        }
        let material = mesh.material.as_ref().map(|name| name.get_ref().as_str());
        for transform in &transforms {
            builder.add(&mesh_path, obj, transform, material, &own).ok_or_else(|| {
                let problem = "the transform moves the mesh out of the range of coordinates";
                let error = Error::new(problem, "reduce its scale or translation");
                at(error, table.span().start)
            })?;
        }
    }
    for NamedMesh { mesh, material } in meshes {
        check_mesh(mesh).map_err(|error| error.at(path))?;
        let obj = ObjFile::in_memory(mesh);
        builder.count(obj.triangle_count(), 0, path)?;
        check_material(material, &file, &obj).map_err(|error| error.at(path))?;
        let place = builder.add(path, &obj, &Transform::IDENTITY, Some(material), &own);
        place.ok_or_else(|| {
            let problem = format!("the mesh `{}` is out of the range of coordinates", mesh.name);
            Error::new(problem, "scale the scene down").at(path)
        })?;
    }
    let mut lights = Vec::new();
    let mut luminaires = LuminaireFiles::default();
    for table in &file.light {
        let start = table.span().start;
        // Problems of a photometric file are about that file.
        let place = |error: Error| if error.has_location() { error } else { at(error, start) };
        match table.get_ref().light(folder, &mut luminaires).map_err(place)? {
            TableLight::Emitter(emitter) => lights.push(emitter),
            TableLight::Luminaire(luminaire, notes) => {
                builder.warnings.extend(notes.into_iter().map(Warning::chosen));
                lights.extend(builder.add_luminaire(luminaire).map_err(place)?);
            }
        }
    }
    builder.arrange(path)?;

    let used: BTreeSet<&str> = builder.materials.iter().map(|m| m.name.as_str()).collect();
    let unused = file.materials.keys().map(String::as_str).filter(|name| !used.contains(name));
    let unused: Vec<&str> = unused.collect();
    if !unused.is_empty() {
        let text = format!("{}: no mesh uses the material {}", path.display(), list(unused));
        builder.warnings.push(Warning::chosen(text));
    }
    let regions = file
        .regions
        .iter()
        .map(|(name, rectangles)| Region { name: name.clone(), rectangles: rectangles.0.clone() });
    let extras = options.extras(&mut builder.warnings)?;
    let mut environment = extras.environment;
    if let Some(table) = &file.environment {
        if environment.is_some() {
            builder.warnings.push(warnings::replaced_environment(path));
        } else {
            let own = table.get_ref().environment(folder, &mut builder.warnings);
            // Problems of the map are about its own file.
            let place = |error: Error| match error.has_location() {
                true => error,
                false => at(error, table.span().start),
            };
            environment = Some(own.map_err(place)?);
        }
    }
    if let Some(table) = &file.sky {
        let start = table.span().start;
        if file.environment.is_some() {
            let advice = "remove one of them: each is the light from all around";
            let error = Error::new("the scene has both [environment] and [sky]", advice);
            return Err(at(error, start));
        }
        let own = table.get_ref().environment().map_err(|error| at(error, start))?;
        if environment.is_some() {
            builder.warnings.push(warnings::replaced_environment(path));
        } else {
            environment = Some(own);
        }
    }
    let regions = regions.collect();
    let defaults = file.render.clone();
    let ray_offset = file.ray_offset.as_ref().map(|distance| {
        let (distance, start) = (*distance.get_ref(), distance.span().start);
        if (0.0..=f64::from(MAX_COORDINATE)).contains(&distance) {
            return Ok(distance as f32);
        }
        let advice = format!("give a distance from 0 to {MAX_COORDINATE:e} scene units");
        Err(at(Error::new(format!("`ray_offset` is {distance}"), advice), start))
    });
    let ray_offset = ray_offset.transpose()?;
    let filling = file.medium.as_ref().map(|name| medium::named(name, &media));
    let filling_medium = filling.transpose().map_err(place)?;
    let extras = SceneExtras {
        regions,
        environment,
        defaults,
        default_light: false,
        ray_offset,
        filling_medium,
        camera: extras.camera,
        meters: scene_file::meter_sets(path, text, &file.meter)?,
    };
    builder.finish(path, lights, camera, extras)
}

/// Refuses names of materials that neither the scene file nor the OBJ file defines.
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

    let camera = builder.default_camera(path, options.camera_change)?;
    let extras = options.extras(&mut builder.warnings)?;
    builder.finish(path, Vec::new(), camera, extras)
}
