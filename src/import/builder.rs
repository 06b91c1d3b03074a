//! A scene as it comes together while files are read.

use super::default_camera;
use super::fallback;
use super::instancing::{Part, Uses};
use super::load::{Loaded, scene_name};
use super::mtl;
use super::obj::{ObjFile, ObjMesh};
use super::summary::SceneSummary;
use super::text::list;
use super::warnings::Warning;
use crate::base::error::{Error, Result};
use crate::base::math::Bounds;
use crate::base::memory::{GIB, available_memory};
use crate::scene::transform::Transform;
use crate::scene::{Arrangement, Camera, Emitter, Environment, Material, Placement, Region, Scene};
use crate::settings::PartialSettings;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Memory that a triangle takes at the least while a scene is read, bytes: corners, a cache line for
/// shading, and its place in the hierarchy.
const TRIANGLE_BYTES: f64 = 200.0;

/// Meshes and materials as they come together.
#[derive(Default)]
pub(super) struct Builder {
    uses: Uses,
    arrangement: Arrangement,
    pub materials: Vec<Material>,
    /// Index in `materials` by the OBJ file that names it (none for the scene file) and name.
    material_index: HashMap<(Option<PathBuf>, String), u32>,
    /// Names that the OBJ file uses without defining them.
    undefined: BTreeSet<String>,
    /// Whether meshes of the OBJ file name no material, and it defines none for them.
    unnamed: bool,
    /// Names of textured materials on meshes without texture coordinates.
    untextured: BTreeSet<String>,
    triangles: u64,
    /// Triangles without area.
    dropped: u64,
    pub notes: Vec<Warning>,
}

/// What a file says besides its meshes and materials.
#[derive(Default)]
pub(super) struct Rest {
    pub regions: Vec<Region>,
    pub environment: Option<Environment>,
    pub defaults: PartialSettings,
    /// Whether to give light to a scene that brings none worth the name.
    pub fallback: bool,
}

impl Builder {
    /// Begins with what is to be told anyway.
    pub fn new(notes: Vec<Warning>) -> Self {
        Self { notes, ..Self::default() }
    }

    /// Index of a material, which becomes part of the scene with its first use: from the scene
    /// file, else from the OBJ file's libraries, else grey.
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
                (Some(material), _) | (None, Some(material)) => material.clone(),
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

    /// Adds an OBJ file's meshes; `None` if a point moves out of range.
    pub fn add(
        &mut self,
        path: &Path,
        obj: &ObjFile,
        transform: &Transform,
        material: Option<&str>,
        own: &BTreeMap<String, Material>,
    ) -> Option<()> {
        let mut parts = Vec::new();
        for ObjMesh { mesh, material: named } in &obj.meshes {
            let material = self.material(material.or(named.as_deref()), own, path, obj);
            parts.push(Part { name: &mesh.name, mesh, material });
        }
        self.place(&parts, transform)?;
        let grey = format!("took grey of albedo {}", mtl::DEFAULT_ALBEDO);
        let path = path.display();
        if !self.undefined.is_empty() {
            let names = list(self.undefined.iter().map(String::as_str));
            self.notes.push(Warning::skipped(format!("{path}: {names} undefined; {grey}")));
            self.undefined.clear();
        }
        if std::mem::take(&mut self.unnamed) {
            self.notes.push(Warning::chosen(format!("{path}: faces without material; {grey}")));
        }
        Some(())
    }

    /// Whether nothing was placed.
    pub fn is_empty(&self) -> bool {
        self.uses.is_empty()
    }

    /// Adds meshes that belong together at one of their places; `None` if a point moves out of range.
    pub fn place(&mut self, parts: &[Part<'_>], transform: &Transform) -> Option<()> {
        for part in parts {
            let look = &self.materials[part.material as usize];
            if part.mesh.uvs.is_empty() && look.is_textured() {
                self.untextured.insert(look.name.clone());
            }
        }
        self.uses.add(parts, transform)
    }

    /// Refuses more triangles than can be numbered at all places, or `new` ones that cannot be held,
    /// before memory is taken for them.
    pub fn count(&mut self, placed: u64, new: u64, path: &Path) -> Result<()> {
        self.triangles = self.triangles.saturating_add(placed);
        if self.triangles > u64::from(u32::MAX) {
            let problem = format!("the scene has more than {} triangles", u32::MAX);
            return Err(Error::new(problem, ADVICE).at(path));
        }
        require_memory(new, path)
    }

    /// The box around all triangles.
    pub fn bounds(&self) -> Bounds {
        let Arrangement { meshes, placements } = &self.arrangement;
        let enclose = |bounds, one: &Placement| one.enclose(bounds, &meshes[one.mesh as usize]);
        placements.iter().fold(Bounds::EMPTY, enclose)
    }

    /// Puts all meshes at their places, if there is anything to render.
    pub fn arrange(&mut self, path: &Path) -> Result<()> {
        let uses = std::mem::take(&mut self.uses);
        require_memory(uses.stored(), path)?;
        (self.arrangement, self.dropped) = uses.arrange();
        if self.arrangement.placements.is_empty() {
            let problem = match self.dropped {
                0 => "the scene has no triangle".to_owned(),
                count => format!("all {count} triangles of the scene have no area"),
            };
            let advice = "add a mesh that has faces of at least three vertices";
            return Err(Error::new(problem, advice).at(path));
        }
        if !self.untextured.is_empty() {
            let names = list(self.untextured.iter().map(String::as_str));
            let note =
                "has a mesh without texture coordinates, and there its texture's corner alone";
            self.notes.push(Warning::skipped(format!("{}: {names} {note}", path.display())));
        }
        if self.dropped > 0 {
            // Nobody sees them.
            let note = format!("dropped {} triangles without area", self.dropped);
            self.notes.push(Warning::chosen(note));
        }
        Ok(())
    }

    /// A camera that sees everything, with a note.
    pub fn place_camera(&mut self, path: &Path) -> Result<Camera> {
        let camera = default_camera::camera(&self.bounds())?;
        let (path, position) = (path.display(), camera.position());
        let degrees = default_camera::DEGREES;
        let note = format!("{path}: no camera; put one at {position}, {degrees} degrees high");
        self.notes.push(Warning::chosen(note));
        Ok(camera)
    }

    pub fn finish(
        self,
        path: &Path,
        lights: Vec<Emitter>,
        camera: Camera,
        rest: Rest,
    ) -> Result<Loaded> {
        let Self { arrangement, materials, mut notes, .. } = self;
        let Rest { regions, environment, defaults, fallback } = rest;
        let start = Instant::now();
        let mut scene =
            Scene::new(scene_name(path), arrangement, materials, lights, camera, regions)?;
        if let Some(environment) = environment {
            scene = scene.with_environment(environment);
        } else if fallback {
            let resolution = defaults.resolution.unwrap_or([1, 1]);
            scene = fallback::lit(scene, resolution, path, &mut notes);
        }
        let assembly = start.elapsed();
        if scene.lights().is_empty() {
            let advice = "add a `[[light]]` table to the scene file, give a material an `emission`, or \
                          give --environment 1";
            return Err(Error::new("the scene has no light", advice).at(path));
        }
        if !scene.lights().power().is_finite() {
            let problem = "the power of all lights is too large for a number";
            return Err(Error::new(problem, "lower their intensity or emission").at(path));
        }
        let summary = SceneSummary::new(&scene);
        Ok(Loaded { scene: Arc::new(scene), defaults, notes, summary, assembly })
    }
}

const ADVICE: &str = "leave out or simplify some meshes";

/// Refuses more triangles than can be held.
fn require_memory(triangles: u64, path: &Path) -> Result<()> {
    let needed = triangles as f64 * TRIANGLE_BYTES;
    match available_memory() {
        Some(available) if needed > available => {
            let problem = format!(
                "the scene has {triangles} triangles or more, for which {:.1} GiB of memory are \
                 needed, but {:.1} GiB are available",
                needed / GIB,
                available / GIB
            );
            Err(Error::new(problem, ADVICE).at(path))
        }
        _ => Ok(()),
    }
}
