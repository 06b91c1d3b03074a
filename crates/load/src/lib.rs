//! Scenes ready to render: what [`import`](bdpm_import) reads, with the requested camera, a
//! default light where a file has none, and checks of both.
//!
//! Importers only describe what a file contains. Whatever must trace rays to decide, such as
//! whether the camera sees any light, happens here.

mod camera_change;
mod checks;
mod chosen_lights;
mod convert;
mod default_camera;
mod default_light;
mod lit_check;
mod sight;
mod summary;

pub use bdpm_import::NamedMesh;
pub use camera_change::{CameraChange, LookAt};
pub use chosen_lights::{chosen, matches};
pub use convert::{Converted, convert};
pub use summary::{SceneSummary, counted};

use bdpm_core::base::error::Result;
use bdpm_core::scene::{MeterSet, Scene};
use bdpm_core::settings::PartialSettings;
use bdpm_import::{
    EnvironmentSource, Exported, ImportOptions, Imported, Warning, export_scene, read, read_meshes,
};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

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
    /// Names of the only light sources that shine, in which `*` stands for any characters.
    pub lights: Option<&'a [String]>,
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
/// In the cases of [`load`], if the file has no camera or light source of a requested name, or if
/// anything was skipped and [`LoadOptions::strict`] is set.
pub fn load_with(path: &Path, options: &LoadOptions) -> Result<Loaded> {
    complete(read(path, &options.import())?, path, options)
}

/// Builds a scene from `meshes` and the `text` of a scene file, which has the camera, the materials
/// and the lights.
///
/// `path` names the scene and locates errors in `text`. Files that `text` names are in its folder.
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
    complete(read_meshes(path, text, meshes, &options.import())?, path, options)
}

/// Writes `loaded`, which was read from the file `origin`, as a folder that loads as the same
/// scene. Files that exist are replaced if `replace` is set.
///
/// # Errors
/// If a file exists and must not be replaced, if this process has read it, or if a file cannot be
/// written. In the last case some files may have been written.
pub fn export(loaded: &Loaded, origin: &str, folder: &Path, replace: bool) -> Result<Exported> {
    let Loaded { scene, defaults, meters, .. } = loaded;
    export_scene(scene, (defaults, meters), origin, folder, replace)
}

impl<'a> LoadOptions<'a> {
    fn import(&self) -> ImportOptions<'a> {
        ImportOptions { camera: self.camera, environment: self.environment, origin: None }
    }
}

/// Completes and checks a scene that was read from the file or folder `path`.
fn complete(imported: Imported, path: &Path, options: &LoadOptions) -> Result<Loaded> {
    let Imported {
        file,
        mut scene,
        has_camera,
        may_lack_light,
        mut defaults,
        meters,
        mut warnings,
        mut names,
        mut assembly,
    } = imported;
    let change = options.camera_change;
    let mut accel = None;
    if !has_camera && !change.replaces_position() {
        let start = Instant::now();
        let (warning, built) = default_camera::place(&mut scene, &change, &file);
        warnings.push(warning);
        accel = built;
        assembly += start.elapsed();
    }
    let (camera, resolution) = change.apply(scene.camera, scene.file_origin())?;
    scene.camera = camera;
    defaults.resolution = resolution.or(defaults.resolution);
    if may_lack_light && options.environment.is_none() && !options.no_fallback_light {
        let start = Instant::now();
        let resolution = defaults.resolution.unwrap_or([1, 1]);
        scene = default_light::with_light(scene, accel, resolution, &file, &mut warnings);
        assembly += start.elapsed();
    }
    checks::require_light(&scene).map_err(|error| error.at(&file))?;
    if let Some(patterns) = options.lights {
        let only = chosen(&scene, patterns).and_then(|sources| scene.with_only(&sources));
        scene = only.map_err(|error| error.at(&file))?;
        names.lights.retain(|name| patterns.iter().any(|pattern| matches(pattern, name)));
    }
    if options.strict {
        checks::require_complete(&warnings).map_err(|error| error.at(path))?;
    }
    let summary = SceneSummary::new(&scene, names);
    Ok(Loaded { scene: Arc::new(scene), defaults, meters, warnings, summary, assembly })
}
