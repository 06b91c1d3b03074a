//! A scene under construction while a file is read.

use super::environment::EnvironmentSource;
use super::far;
use super::growth::Growth;
use super::shape::instancing::{MaterialMesh, MeshGroups};
use super::text::{check_memory, list};
use super::warnings::{Warning, replaced_environment};
use super::whole_view;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::luminance;
use bdpm_core::base::memory::available_memory;
use bdpm_core::base::names::for_display;
use bdpm_core::scene::transform::Transform;
use bdpm_core::scene::{
    Arrangement, Camera, Emitter, Environment, Material, Medium, MediumBoundary, MeterSet, Region,
    Scene,
};
use bdpm_core::settings::PartialSettings;
use glam::{DAffine3, DVec3};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Options for reading a scene.
#[derive(Clone, Copy, Debug, Default)]
pub struct ImportOptions<'a> {
    /// Name of a camera in a glTF or Mitsuba file.
    pub camera: Option<&'a str>,
    /// Environment that replaces that of the file.
    pub environment: Option<&'a EnvironmentSource>,
    /// Point of the file's coordinates that becomes the origin of the scene. If not given, it is
    /// near the center of a scene that is far from the origin, and else the origin of the file.
    pub origin: Option<DVec3>,
}

impl ImportOptions<'_> {
    /// Point of the file's coordinates that becomes the origin of the scene.
    pub fn origin(&self) -> DVec3 {
        self.origin.unwrap_or(DVec3::ZERO)
    }
}

/// Result of reading a file.
pub enum ReadScene {
    /// The scene.
    Complete(Box<Imported>),
    /// The scene is far from the origin. It has to be read again with this point as its origin,
    /// because single precision has rounded its positions.
    Far(DVec3),
}

impl ReadScene {
    /// Reads a scene, and again if it is far from the origin.
    pub fn near(
        options: &ImportOptions,
        read: impl Fn(&ImportOptions) -> Result<Self>,
    ) -> Result<Imported> {
        let origin = match read(options)? {
            Self::Complete(imported) => return Ok(*imported),
            Self::Far(origin) => origin,
        };
        match read(&ImportOptions { origin: Some(origin), ..*options })? {
            Self::Complete(mut imported) => {
                imported.warnings.push(far::note(origin));
                Ok(*imported)
            }
            Self::Far(_) => unreachable!("a scene with a given origin is not far"),
        }
    }
}

/// A scene as its file describes it: without a default light, and with a camera that sees
/// everything if the file has none.
pub struct Imported {
    /// The file. For a folder, the scene file in it.
    pub file: PathBuf,
    /// The scene.
    pub scene: Scene,
    /// Whether the file has the camera of the scene.
    pub has_camera: bool,
    /// Whether files of this format often have no usable light source.
    pub may_lack_light: bool,
    /// Settings of the file.
    pub defaults: PartialSettings,
    /// Meters of the file.
    pub meters: Vec<MeterSet>,
    /// Omissions and choices.
    pub warnings: Vec<Warning>,
    /// Names of lights and cameras in the file.
    pub names: FileNames,
    /// Time of building triangles and lights, a part of the time of reading.
    pub assembly: Duration,
}

/// Names in a file that the scene does not have.
#[derive(Clone, Debug, Default)]
pub struct FileNames {
    /// Names of the lights, if the format has names for them.
    pub lights: Vec<String>,
    /// Names of all cameras to choose from.
    pub cameras: Vec<String>,
    /// Name of the chosen camera.
    pub camera: Option<String>,
}

/// Reads an environment, unless the user requests another. Warnings report corrected pixels.
pub type EnvironmentReader<'a> = Box<dyn FnOnce(&mut Vec<Warning>) -> Result<Environment> + 'a>;

/// Contents of a file besides its meshes and materials.
#[derive(Default)]
pub struct Contents<'a> {
    pub lights: Vec<Emitter>,
    /// Name of each light, if the file names any.
    pub light_names: Vec<Option<String>>,
    pub camera: Option<Camera>,
    pub environment: Option<EnvironmentReader<'a>>,
    pub defaults: PartialSettings,
    pub regions: Vec<Region>,
    pub meters: Vec<MeterSet>,
    /// Distance off surfaces at which rays start, scene units, if it is given.
    pub ray_offset: Option<f32>,
    /// Medium between all objects.
    pub filling_medium: Option<Arc<Medium>>,
    pub names: FileNames,
    pub may_lack_light: bool,
    /// +z is up for a camera that the file does not have, instead of +y.
    pub is_z_up: bool,
}

/// Minimum memory of a triangle while a scene is read, bytes: its corners, a cache line for
/// shading, and its entry in the acceleration structure.
const TRIANGLE_BYTES: f64 = 200.0;

/// Memory of a placement of a mesh while a scene is read, bytes: its transform in the file, here,
/// in the scene and in the acceleration structure.
const PLACEMENT_BYTES: u64 = 800;

/// Triangles of this many bytes are checked at once.
const CHECKED_BYTES: f64 = 1e6;

/// Meshes, materials and warnings of a scene under construction. Errors name no file.
#[derive(Default)]
pub struct Builder {
    groups: MeshGroups,
    pub materials: Vec<Material>,
    /// Names of textured materials on meshes without texture coordinates.
    untextured: BTreeSet<String>,
    triangles: u64,
    growth: Growth,
    pub warnings: Vec<Warning>,
}

impl Builder {
    /// Starts with warnings about the file.
    pub fn new(warnings: Vec<Warning>) -> Self {
        Self { warnings, ..Self::default() }
    }

    /// Adds a material, and returns its index. Names come from files, so they are made fit to be
    /// shown, here and in all other places where they enter the scene.
    pub fn add_material(&mut self, mut material: Material) -> u32 {
        material.name = for_display(&material.name);
        self.materials.push(material);
        self.materials.len() as u32 - 1
    }

    /// Whether no mesh was placed.
    pub fn is_empty(&self) -> bool {
        self.groups.is_empty()
    }

    /// Places a group of meshes, which get the name `name` if it is given; `None` if a point moves
    /// out of range.
    pub fn place(
        &mut self,
        name: Option<&str>,
        parts: &[MaterialMesh],
        transform: &Transform,
    ) -> Option<()> {
        for part in parts {
            let material = &self.materials[part.material as usize];
            if part.mesh.uvs.is_empty() && material.is_textured() {
                self.untextured.insert(material.name.clone());
            }
        }
        self.groups.add(name.map(for_display).as_deref(), parts, transform)
    }

    /// Counts and places a group of meshes, which get the name `name`.
    ///
    /// # Errors
    /// If there are too many triangles, the map has no inverse, or a point moves out of range.
    pub fn place_by(
        &mut self,
        name: &str,
        parts: &[MaterialMesh],
        map: DAffine3,
        is_flipped: bool,
    ) -> Result<()> {
        self.count(parts.iter().map(|part| part.mesh.triangles.len() as u64).sum(), 0)?;
        self.count_placements(parts.len() as u64)?;
        let transform = Transform::new(map)?.flipped(is_flipped);
        self.place(Some(name), parts, &transform).ok_or_else(out_of_range)
    }

    /// Counts `placed` triangles. Refuses more than can be numbered, or `new` ones that do not fit
    /// in memory, before they are read.
    pub fn count(&mut self, placed: u64, new: u64) -> Result<()> {
        self.triangles = self.triangles.saturating_add(placed);
        if self.triangles > u64::from(u32::MAX) {
            let problem = format!("the scene has more than {} triangles", u32::MAX);
            return Err(Error::new(problem, SIMPLIFY));
        }
        let bytes = new as f64 * TRIANGLE_BYTES;
        // Small parts are checked by their sum.
        if bytes >= CHECKED_BYTES {
            require_memory(new)?;
        }
        self.grow(bytes as u64)
    }

    /// Counts `count` placements of meshes, before they exist. Refuses more than fit in memory.
    pub fn count_placements(&mut self, count: u64) -> Result<()> {
        self.grow(count.saturating_mul(PLACEMENT_BYTES))
    }

    fn grow(&mut self, bytes: u64) -> Result<()> {
        self.growth.add(bytes).map_err(|problem| {
            let problem = format!("the meshes of the scene and their placements take {problem}");
            Error::new(problem, SIMPLIFY)
        })
    }

    /// The medium that fills the scene if this one is around the camera; `None` if a shape bounds
    /// it.
    pub fn filling_medium(&self, around_camera: Option<Arc<Medium>>) -> Option<Arc<Medium>> {
        around_camera.filter(|medium| {
            let bounds = |own: &Material| {
                let Some(MediumBoundary { interior, exterior }) = &own.boundary else {
                    return false;
                };
                // Light that goes straight on leaves a medium for the space around it.
                let is_hull = own.is_index_matched_boundary();
                interior.as_ref() == Some(medium) || is_hull && exterior.as_ref() == Some(medium)
            };
            !self.materials.iter().any(bounds)
        })
    }

    /// Builds the scene of the file `path`, which does not have a default light, unless the scene
    /// is far from the origin. All its positions are relative to the origin of the `options`.
    ///
    /// # Errors
    /// If the scene has no triangle, does not fit in memory, or is not valid.
    pub fn finish(
        mut self,
        path: &Path,
        contents: Contents<'_>,
        options: &ImportOptions,
    ) -> Result<ReadScene> {
        if options.origin.is_none()
            && let Some(center) = self.groups.bounds().far_center()
        {
            return Ok(ReadScene::Far(center));
        }
        let Contents { defaults, meters, mut names, may_lack_light, .. } = contents;
        let name = |name: &Option<String>| name.as_deref().map(for_display);
        names.lights = contents.light_names.iter().filter_map(name).collect();
        names.cameras.iter_mut().chain(&mut names.camera).for_each(|own| *own = for_display(own));
        let lit = contents.lights.iter().zip(&contents.light_names);
        let lit = lit.filter(|(light, _)| shines(light));
        let light_names = lit.map(|(_, own)| name(own)).collect();
        let has_camera = contents.camera.is_some();
        let arrangement = self.arrange(path)?;
        let camera = match contents.camera {
            Some(camera) => camera,
            None => whole_view::camera(&arrangement.bounds(), contents.is_z_up)?,
        };
        let environment = match (options.environment, contents.environment) {
            (Some(source), own) => {
                let environment = source.environment(&mut self.warnings)?;
                self.warnings.extend(own.map(|_| replaced_environment(path)));
                Some(environment)
            }
            (None, own) => own.map(|read| read(&mut self.warnings)).transpose()?,
        };
        let Self { materials, warnings, .. } = self;
        let start = Instant::now();
        let scene = Scene::with_ray_offset(
            scene_name(path),
            arrangement,
            materials,
            contents.lights,
            camera,
            contents.regions,
            contents.ray_offset,
        )?;
        let scene = scene.with_environment(environment).with_file_origin(options.origin());
        let scene = scene.with_light_names(light_names);
        let scene = scene.with_filling_medium(contents.filling_medium)?;
        Ok(ReadScene::Complete(Box::new(Imported {
            file: path.to_owned(),
            scene,
            has_camera,
            may_lack_light,
            defaults,
            meters,
            warnings,
            names,
            assembly: start.elapsed(),
        })))
    }

    /// Arranges all meshes. Refuses a scene without triangles.
    fn arrange(&mut self, path: &Path) -> Result<Arrangement> {
        let groups = std::mem::take(&mut self.groups);
        require_memory(groups.stored())?;
        let (arrangement, dropped) = groups.arrange();
        if arrangement.placements.is_empty() {
            let problem = match dropped {
                0 => "the scene has no triangle".to_owned(),
                count => format!("all {count} triangles of the scene have no area"),
            };
            let advice = "add a mesh that has faces of at least three vertices";
            return Err(Error::new(problem, advice));
        }
        if !self.untextured.is_empty() {
            let names = list(self.untextured.iter().map(String::as_str));
            let text = "a mesh without texture coordinates shows one texel of the material";
            self.warnings.push(Warning::skipped(format!("{}: {text} {names}", path.display())));
        }
        if dropped > 0 {
            // They are invisible.
            let text = format!("dropped {dropped} triangles without area");
            self.warnings.push(Warning::chosen(text));
        }
        Ok(arrangement)
    }
}

/// Whether a light has power once it is in a scene: that of parallel light depends on the scene.
fn shines(light: &Emitter) -> bool {
    let strength = match light {
        Emitter::Directional(light) => light.irradiance,
        other => other.power(),
    };
    luminance(strength) > 0.0
}

/// The name of the file, or that of its folder for the usual file name `scene.toml`.
fn scene_name(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    let folder = path.canonicalize().ok().and_then(|full| Some(full.parent()?.to_owned()));
    match folder.as_deref().and_then(Path::file_name) {
        Some(folder) if stem == "scene" => for_display(&folder.to_string_lossy()),
        _ => for_display(&stem.to_string_lossy()),
    }
}

/// The error about a shape that its transform moves too far.
pub fn out_of_range() -> Error {
    let problem = "its transform moves it out of the range of coordinates";
    Error::new(problem, "reduce its scale or translation")
}

const SIMPLIFY: &str = "leave out or simplify some meshes";

/// Refuses more triangles than fit in memory.
fn require_memory(triangles: u64) -> Result<()> {
    check_memory(triangles as f64 * TRIANGLE_BYTES, available_memory()).map_err(|problem| {
        let problem = format!("the scene has at least {triangles} triangles, which take {problem}");
        Error::new(problem, SIMPLIFY)
    })
}
