//! A scene under construction while files are read.

use super::camera_change::CameraChange;
use super::default_camera;
use super::fallback;
use super::growth::Growth;
use super::instancing::{MaterialMesh, MeshGroups};
use super::load::{Loaded, scene_name};
use super::mtl;
use super::obj::{ObjFile, ObjMesh};
use super::summary::SceneSummary;
use super::text::{check_memory, list};
use super::warnings::Warning;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::{Bounds, Rgb};
use bdpm_core::base::memory::available_memory;
use bdpm_core::scene::transform::Transform;
use bdpm_core::scene::{
    Arrangement, Camera, Emitter, Environment, Material, Medium, MediumBoundary, Mesh, MeterSet,
    Region, Scene,
};
use bdpm_core::settings::PartialSettings;
use glam::{Affine2, Vec2};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Minimum memory of a triangle while a scene is read, bytes: its corners, a cache line for
/// shading, and its entry in the acceleration structure.
const TRIANGLE_BYTES: f64 = 200.0;

/// Memory of a placement of a mesh while a scene is read, bytes: its transform in the file, here,
/// in the scene and in the acceleration structure.
const PLACEMENT_BYTES: u64 = 800;

/// Triangles of this many bytes are checked at once.
const CHECKED_BYTES: f64 = 1e6;

/// Address of a mesh, and bits of a map of texture coordinates.
type MappedKey = (*const Mesh, [u32; 6]);

/// Meshes, materials and warnings of a scene under construction.
#[derive(Default)]
pub(super) struct Builder {
    groups: MeshGroups,
    arrangement: Arrangement,
    pub materials: Vec<Material>,
    /// Index in `materials` by the OBJ file of the material (`None` for the scene file) and its
    /// name.
    material_index: HashMap<(Option<PathBuf>, String), u32>,
    /// Names of materials that the OBJ file uses without defining them.
    undefined: BTreeSet<String>,
    /// Whether meshes of the OBJ file have no material.
    unnamed: bool,
    /// Names of textured materials on meshes without texture coordinates.
    untextured: BTreeSet<String>,
    /// Meshes whose texture coordinates a material maps, by the address of the original, which
    /// stays alive beside its copy, and the bits of the map.
    mapped: HashMap<MappedKey, [Arc<Mesh>; 2]>,
    triangles: u64,
    growth: Growth,
    pub warnings: Vec<Warning>,
}

/// Contents of a file besides its meshes, materials, lights and camera.
#[derive(Default)]
pub(super) struct SceneExtras<'a> {
    pub regions: Vec<Region>,
    pub environment: Option<Environment>,
    pub defaults: PartialSettings,
    /// Whether a scene without a usable light source gets a default one.
    pub default_light: bool,
    /// Distance off surfaces at which rays start, scene units, if it is given.
    pub ray_offset: Option<f32>,
    /// Medium between all objects.
    pub filling_medium: Option<Arc<Medium>>,
    /// Meters of the scene.
    pub meters: Vec<MeterSet>,
    /// Changes of the camera.
    pub camera: CameraChange<'a>,
}

impl Builder {
    /// Starts with warnings about the file.
    pub fn new(warnings: Vec<Warning>) -> Self {
        Self { warnings, ..Self::default() }
    }

    /// Index of a material, which is added to the scene with its first use. It is from the scene
    /// file, else from the libraries of the OBJ file, else gray.
    fn material(
        &mut self,
        name: Option<&str>,
        own: &BTreeMap<String, Material>,
        path: &Path,
        obj: &ObjFile,
    ) -> u32 {
        let is_named = name.is_some();
        let name = name.unwrap_or("default");
        let own = own.get(name);
        let file = own.is_none().then(|| path.to_owned());
        *self.material_index.entry((file, name.to_owned())).or_insert_with(|| {
            let material = match (own, obj.materials.get(name)) {
                (Some(material), _) => material.clone(),
                (None, Some(library)) => library.material.clone(),
                (None, None) => {
                    if is_named {
                        self.undefined.insert(name.to_owned());
                    }
                    self.unnamed |= !is_named;
                    mtl::grey(name)
                }
            };
            self.materials.push(material);
            self.materials.len() as u32 - 1
        })
    }

    /// The mesh with the texture coordinates of the pictures of its material.
    fn mapped(
        &mut self,
        mesh: &Arc<Mesh>,
        name: Option<&str>,
        own: &BTreeMap<String, Material>,
        obj: &ObjFile,
    ) -> Arc<Mesh> {
        let library = name.filter(|name| !own.contains_key(*name));
        let to_uv = library.and_then(|name| obj.materials.get(name)).map(|own| own.to_uv);
        let Some(to_uv) = to_uv.filter(|map| *map != Affine2::IDENTITY) else {
            return Arc::clone(mesh);
        };
        // All placements of a mesh share one copy.
        let key = (Arc::as_ptr(mesh), to_uv.to_cols_array().map(f32::to_bits));
        let [_, copy] = self.mapped.entry(key).or_insert_with(|| {
            let mut copy = Mesh::clone(mesh);
            for uv in &mut copy.uvs {
                let mapped = to_uv.transform_point2(*uv);
                *uv = if mapped.is_finite() { mapped } else { Vec2::ZERO };
            }
            [Arc::clone(mesh), Arc::new(copy)]
        });
        Arc::clone(copy)
    }

    /// Adds an OBJ file's meshes; `None` if a point moves out of range.
    pub fn add(
        &mut self,
        path: &Path,
        obj: &ObjFile,
        transform: &Transform,
        material: Option<&str>,
        own: &BTreeMap<String, Material>,
    ) -> Option<()> {
        let part = |ObjMesh { mesh, material: named }: &ObjMesh| {
            let name = material.or(named.as_deref());
            let mesh = self.mapped(mesh, name, own, obj);
            MaterialMesh { mesh, material: self.material(name, own, path, obj) }
        };
        let parts: Vec<MaterialMesh> = obj.meshes.iter().map(part).collect();
        self.place(None, &parts, transform)?;
        let gray = format!("used gray of albedo {}", mtl::DEFAULT_ALBEDO);
        let path = path.display();
        if !self.undefined.is_empty() {
            let names = list(self.undefined.iter().map(String::as_str));
            self.warnings.push(Warning::skipped(format!("{path}: {names} undefined; {gray}")));
            self.undefined.clear();
        }
        if std::mem::take(&mut self.unnamed) {
            self.warnings.push(Warning::chosen(format!("{path}: faces without material; {gray}")));
        }
        Some(())
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
        self.groups.add(name, parts, transform)
    }

    /// Counts `placed` triangles. Refuses more than can be numbered, or `new` ones that do not fit
    /// in memory, before they are read.
    pub fn count(&mut self, placed: u64, new: u64, path: &Path) -> Result<()> {
        self.triangles = self.triangles.saturating_add(placed);
        if self.triangles > u64::from(u32::MAX) {
            let problem = format!("the scene has more than {} triangles", u32::MAX);
            return Err(Error::new(problem, SIMPLIFY).at(path));
        }
        let bytes = new as f64 * TRIANGLE_BYTES;
        // Small parts are checked by their sum.
        if bytes >= CHECKED_BYTES {
            require_memory(new, path)?;
        }
        self.grow(bytes as u64, path)
    }

    /// Counts `count` placements of meshes, before they exist. Refuses more than fit in memory.
    pub fn count_placements(&mut self, count: u64, path: &Path) -> Result<()> {
        self.grow(count.saturating_mul(PLACEMENT_BYTES), path)
    }

    fn grow(&mut self, bytes: u64, path: &Path) -> Result<()> {
        self.growth.add(bytes).map_err(|problem| {
            let problem = format!("the meshes of the scene and their placements take {problem}");
            Error::new(problem, SIMPLIFY).at(path)
        })
    }

    /// The box around all triangles.
    pub fn bounds(&self) -> Bounds {
        self.arrangement.bounds()
    }

    /// Arranges all meshes. Refuses a scene without triangles.
    pub fn arrange(&mut self, path: &Path) -> Result<()> {
        let groups = std::mem::take(&mut self.groups);
        require_memory(groups.stored(), path)?;
        let dropped;
        (self.arrangement, dropped) = groups.arrange();
        if self.arrangement.placements.is_empty() {
            let problem = match dropped {
                0 => "the scene has no triangle".to_owned(),
                count => format!("all {count} triangles of the scene have no area"),
            };
            let advice = "add a mesh that has faces of at least three vertices";
            return Err(Error::new(problem, advice).at(path));
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
        Ok(())
    }

    /// A camera that sees everything, with a warning unless `change` replaces its position.
    pub fn default_camera(&mut self, path: &Path, change: CameraChange<'_>) -> Result<Camera> {
        let camera = default_camera::camera(&self.bounds())?;
        if change.from.is_some() || change.look_at.is_some() {
            return Ok(camera);
        }
        let (path, position) = (path.display(), camera.position());
        let degrees = change.fov.unwrap_or(default_camera::DEGREES);
        let text = format!("{path}: no camera; added one at {position}, {degrees} degrees high");
        self.warnings.push(Warning::chosen(text));
        Ok(camera)
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

    pub fn finish(
        self,
        path: &Path,
        lights: Vec<Emitter>,
        camera: Camera,
        extras: SceneExtras<'_>,
    ) -> Result<Loaded> {
        let Self { arrangement, materials, mut warnings, .. } = self;
        let SceneExtras {
            regions,
            environment,
            mut defaults,
            default_light,
            ray_offset,
            filling_medium,
            meters,
            camera: change,
        } = extras;
        let (camera, resolution) = change.apply(camera)?;
        defaults.resolution = resolution.or(defaults.resolution);
        let start = Instant::now();
        let name = scene_name(path);
        let mut scene = Scene::with_ray_offset(
            name,
            arrangement,
            materials,
            lights,
            camera,
            regions,
            ray_offset,
        )?;
        if let Some(environment) = environment {
            scene = scene.with_environment(environment);
        } else if default_light {
            let resolution = defaults.resolution.unwrap_or([1, 1]);
            scene = fallback::with_light(scene, resolution, path, &mut warnings);
        }
        scene = scene.with_filling_medium(filling_medium).map_err(|error| error.at(path))?;
        let assembly = start.elapsed();
        if scene.lights().is_empty() {
            let advice = "add a `[[light]]` table to the scene file, give a material an `emission`, or \
                          give an environment of radiance 1";
            return Err(Error::new("the scene has no light", advice).at(path));
        }
        if !scene.lights().power().is_finite() {
            let problem = format!("the power of all lights overflows{}", strongest(&scene));
            return Err(Error::new(problem, "lower their intensity or emission").at(path));
        }
        let summary = SceneSummary::new(&scene);
        Ok(Loaded { scene: Arc::new(scene), defaults, meters, warnings, summary, assembly })
    }
}

/// Names the light that makes the power of all overflow, as the end of a sentence.
fn strongest(scene: &Scene) -> String {
    let emitters = scene.lights().emitters();
    let power = |emitter: &Emitter| {
        let largest = emitter.power().max_element();
        if largest.is_nan() { f32::INFINITY } else { largest }
    };
    let first = emitters.iter().max_by(|a, b| power(a).total_cmp(&power(b)));
    let of_all: Rgb = emitters.iter().map(Emitter::power).sum();
    match first {
        Some(Emitter::Triangle { .. } | Emitter::Textured(_)) if !of_all.is_finite() => {
            let emission = |own: &&Material| own.emission.max_element();
            let materials = scene.materials().iter();
            let brightest = materials.max_by(|a, b| emission(a).total_cmp(&emission(b)));
            brightest.map_or_else(String::new, |own| {
                format!("; the material `{}` has the largest emission", own.name)
            })
        }
        Some(first) if !of_all.is_finite() => match first.position() {
            Some(position) => format!("; the strongest light is at {position}"),
            None => "; the strongest light is parallel".to_owned(),
        },
        _ => "; the environment is the strongest".to_owned(),
    }
}

const SIMPLIFY: &str = "leave out or simplify some meshes";

/// Refuses more triangles than fit in memory.
fn require_memory(triangles: u64, path: &Path) -> Result<()> {
    check_memory(triangles as f64 * TRIANGLE_BYTES, available_memory()).map_err(|problem| {
        let problem = format!("the scene has at least {triangles} triangles, which take {problem}");
        Error::new(problem, SIMPLIFY).at(path)
    })
}
