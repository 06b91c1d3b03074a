//! From a scene file (TOML), a folder with `scene.toml`, or an OBJ file to a [`Scene`].
//!
//! The format is described in `docs/scene-format.md`. Nothing in a file makes these functions
//! panic, and whatever was chosen or left out for the user is told in [`Loaded::notes`].

use crate::error::{Error, Result};
use crate::math::{Bounds, Rgb};
use crate::scene::obj::{self, ObjFile};
use crate::scene::scene_file::{self, SceneFile};
use crate::scene::text::{self, list};
use crate::scene::transform::Transform;
use crate::scene::{
    Camera, Emitter, Environment, FieldOfView, Material, Mesh, Region, Scene, mtl, triangle_area,
};
use crate::settings::RenderDefaults;
use glam::Vec3;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::f32::consts::PI;
use std::path::{Path, PathBuf};

/// A scene with what its file says about rendering it.
#[derive(Clone, Debug)]
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// The file's `[render]` table.
    pub defaults: RenderDefaults,
    /// What was skipped or chosen for the user, a sentence each.
    pub notes: Vec<String>,
}

/// Loads a `.toml` scene file, a folder that holds `scene.toml`, or an `.obj` file, which gets a
/// camera and, if nothing in it emits, a light.
///
/// # Errors
/// Names the file and, where there is one, the line that cannot be read or rendered.
pub fn load(path: &Path) -> Result<Loaded> {
    if path.is_dir() {
        let inside = path.join("scene.toml");
        if !inside.exists() {
            let advice = "name a .toml or .obj file, or a folder that holds scene.toml";
            return Err(Error::new("the folder holds no scene.toml", advice).at(path));
        }
        return load_toml(&inside);
    }
    // A missing file is worth more words than its extension.
    std::fs::metadata(path).map_err(|e| Error::io("read the scene", path, e))?;
    match extension(path).as_str() {
        "toml" => load_toml(path),
        "obj" => load_obj(path),
        other => Err(Error::new(
            format!("scenes of type `.{other}` cannot be read"),
            "give a .toml or .obj file, or a folder that holds scene.toml",
        )
        .at(path)),
    }
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_lowercase()
}

/// The file's name, or its folder's where the file has the name that all have.
fn scene_name(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default();
    let folder = path.canonicalize().ok().and_then(|full| Some(full.parent()?.to_owned()));
    match folder.as_deref().and_then(Path::file_name) {
        Some(folder) if stem == "scene" => folder.to_string_lossy().into_owned(),
        _ => stem.to_string_lossy().into_owned(),
    }
}

/// Meshes and materials as they come together.
#[derive(Default)]
struct Builder {
    meshes: Vec<Mesh>,
    materials: Vec<Material>,
    /// Index in `materials` by the OBJ file that names it (none for the scene file) and name.
    material_index: HashMap<(Option<PathBuf>, String), u32>,
    /// Names that the OBJ file uses without defining them.
    undefined: BTreeSet<String>,
    /// Names of textured materials on meshes without texture coordinates.
    untextured: BTreeSet<String>,
    triangles: u64,
    /// Triangles without area.
    dropped: u64,
    notes: Vec<String>,
}

impl Builder {
    /// Index of a material, which becomes part of the scene with its first use: from the scene
    /// file, else from the OBJ file's libraries, else grey.
    fn material(
        &mut self,
        name: Option<&str>,
        own: &BTreeMap<String, Material>,
        path: &Path,
        obj: &ObjFile,
    ) -> u32 {
        let name = name.unwrap_or("default");
        let own = own.get(name);
        let file = own.is_none().then(|| path.to_owned());
        *self.material_index.entry((file, name.to_owned())).or_insert_with(|| {
            let material = match (own, obj.materials.get(name)) {
                (Some(material), _) | (None, Some(material)) => material.clone(),
                (None, None) => {
                    self.undefined.insert(name.to_owned());
                    mtl::grey(name)
                }
            };
            self.materials.push(material);
            self.materials.len() as u32 - 1
        })
    }

    /// Adds an OBJ file's meshes; `None` if a point moves out of range.
    fn add(
        &mut self,
        path: &Path,
        obj: &ObjFile,
        transform: &Transform,
        material: Option<&str>,
        own: &BTreeMap<String, Material>,
    ) -> Option<()> {
        for part in &obj.meshes {
            let material = self.material(material.or(part.material.as_deref()), own, path, obj);
            let look = &self.materials[material as usize];
            if part.uvs.is_empty() && look.is_textured() {
                self.untextured.insert(look.name.clone());
            }
            let positions: Vec<Vec3> =
                part.positions.iter().map(|p| transform.point(*p)).collect::<Option<_>>()?;
            let corners = part.triangles.iter().map(|corners| transform.corners(*corners));
            let triangles: Vec<[u32; 3]> = corners
                .filter(|corners| triangle_area(corners.map(|i| positions[i as usize])) > 0.0)
                .collect();
            self.dropped += (part.triangles.len() - triangles.len()) as u64;
            if !triangles.is_empty() {
                let name = part.name.clone();
                let normals: Vec<Vec3> =
                    part.normals.iter().map(|n| transform.normal(*n)).collect();
                let uvs = part.uvs.clone();
                let tangents = Vec::new();
                self.meshes.push(Mesh {
                    name,
                    positions,
                    normals,
                    uvs,
                    tangents,
                    triangles,
                    material,
                });
            }
        }
        if !self.undefined.is_empty() {
            let names = list(self.undefined.iter().map(String::as_str));
            let albedo = mtl::DEFAULT_ALBEDO;
            let path = path.display();
            self.notes.push(format!("{path}: {names} undefined; took grey of albedo {albedo}"));
            self.undefined.clear();
        }
        Some(())
    }

    /// Refuses more triangles than can be numbered, before memory is taken for them.
    fn count(&mut self, obj: &ObjFile, path: &Path) -> Result<()> {
        self.triangles += obj.meshes.iter().map(|mesh| mesh.triangles.len() as u64).sum::<u64>();
        if self.triangles <= u64::from(u32::MAX) {
            return Ok(());
        }
        let problem = format!("the scene has more than {} triangles", u32::MAX);
        Err(Error::new(problem, "leave out or simplify some meshes").at(path))
    }

    fn bounds(&self) -> Bounds {
        let corners = |mesh: &Mesh| {
            let points = mesh.triangles.iter().flatten().map(|i| mesh.positions[*i as usize]);
            points.fold(Bounds::EMPTY, Bounds::with)
        };
        let boxes = self.meshes.iter().map(corners);
        boxes.fold(Bounds::EMPTY, |all, one| all.with(one.min).with(one.max))
    }

    /// Whether there is anything to render.
    fn require_triangles(&mut self, path: &Path) -> Result<()> {
        if self.meshes.is_empty() {
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
            self.notes.push(format!("{}: {names} {note}", path.display()));
        }
        if self.dropped > 0 {
            self.notes.push(format!("dropped {} triangles without area", self.dropped));
        }
        Ok(())
    }

    fn finish(
        self,
        path: &Path,
        lights: Vec<Emitter>,
        camera: Camera,
        regions: Vec<Region>,
        (environment, defaults): (Option<Environment>, RenderDefaults),
    ) -> Result<Loaded> {
        let Self { meshes, materials, notes, .. } = self;
        let mut scene = Scene::new(scene_name(path), meshes, materials, lights, camera, regions);
        if let Some(environment) = environment {
            scene = scene.with_environment(environment);
        }
        if scene.lights.is_empty() {
            return Err(Error::new(
                "the scene has no light",
                "add a `[[light]]` table to the scene file, or give a material an `emission`",
            )
            .at(path));
        }
        if !scene.lights.power().is_finite() {
            let problem = "the power of all lights is too large for a number";
            return Err(Error::new(problem, "lower their intensity or emission").at(path));
        }
        Ok(Loaded { scene, defaults, notes })
    }
}

fn load_toml(path: &Path) -> Result<Loaded> {
    let text = text::read(path)?;
    let file = scene_file::parse(path, &text)?;
    let place = |error: Error, offset: usize| error.at(path).at_offset(&text, offset);
    let camera = file.camera.get_ref().camera().map_err(|e| place(e, file.camera.span().start))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let own = file.materials.iter().map(|(name, table)| {
        let material =
            table.material(name, folder).map_err(|(error, offset)| place(error, offset))?;
        Ok((name.clone(), material))
    });
    let own: BTreeMap<String, Material> = own.collect::<Result<_>>()?;

    let mut builder = Builder::default();
    let mut files: HashMap<PathBuf, ObjFile> = HashMap::new();
    for table in &file.mesh {
        let mesh = table.get_ref();
        let transform = mesh.transform().map_err(|e| place(e, table.span().start))?;
        let name = mesh.file.get_ref();
        let obj_path = folder.join(name);
        let here = |problem, advice| place(Error::new(problem, advice), mesh.file.span().start);
        if extension(&obj_path) != "obj" {
            return Err(here(format!("`{name}` is not an OBJ file"), "give a file ending in .obj"));
        }
        if let Err(error) = std::fs::metadata(&obj_path) {
            let advice = "check the name; it is relative to the folder of the scene file";
            return Err(here(format!("cannot read the mesh file `{name}`: {error}"), advice));
        }
        if !files.contains_key(&obj_path) {
            let read = obj::load(&obj_path)?;
            builder.notes.extend(read.notes.iter().cloned());
            files.insert(obj_path.clone(), read);
        }
        let obj = &files[&obj_path];
        builder.count(obj, path)?;
        if let Some(wanted) = &mesh.material {
            check_material(wanted.get_ref(), &file, obj)
                .map_err(|e| place(e, wanted.span().start))?;
        }
        let material = mesh.material.as_ref().map(|name| name.get_ref().as_str());
        builder.add(&obj_path, obj, &transform, material, &own).ok_or_else(|| {
            let problem = "the transform moves the mesh out of the range of coordinates";
            place(Error::new(problem, "scale or move it less"), table.span().start)
        })?;
    }
    builder.require_triangles(path)?;

    let used: BTreeSet<&str> = builder.materials.iter().map(|m| m.name.as_str()).collect();
    let unused = file.materials.keys().map(String::as_str).filter(|name| !used.contains(name));
    let unused: Vec<&str> = unused.collect();
    if !unused.is_empty() {
        let note = format!("{}: no mesh uses the material {}", path.display(), list(unused));
        builder.notes.push(note);
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
    let environment = file.environment.as_ref().map(|table| {
        let (own, start) = (table.get_ref(), table.span().start);
        // What is wrong with the map is about its own file.
        own.environment(folder)
            .map_err(|error| if error.is_placed() { error } else { place(error, start) })
    });
    let rest = (environment.transpose()?, file.render.clone());
    builder.finish(path, lights, camera, regions.collect(), rest)
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

fn load_obj(path: &Path) -> Result<Loaded> {
    let obj = obj::load(path)?;
    let mut builder = Builder { notes: obj.notes.clone(), ..Builder::default() };
    builder.count(&obj, path)?;
    // The identity keeps all points in range.
    let _ = builder.add(path, &obj, &Transform::IDENTITY, None, &BTreeMap::new());
    builder.require_triangles(path)?;

    let bounds = builder.bounds();
    let sphere = (0.5 * (bounds.max - bounds.min).length()).max(f32::MIN_POSITIVE);
    let degrees = 40.0_f32;
    // From the front (+z) and above, just far enough for the bounding sphere. Far from the origin
    // the distance may vanish in rounding, and the camera's own check does not see it.
    let toward = Vec3::new(0.25, 0.4, 1.0).normalize();
    let distance = sphere / (0.5 * degrees).to_radians().sin();
    let position = bounds.center() + distance * toward;
    let camera = Camera::look(position, -toward, Vec3::Y, FieldOfView::Y(degrees))?;
    let path_shown = path.display();
    builder.notes.push(format!(
        "{path_shown}: no camera in an OBJ file; put one at {position}, {degrees} degrees high"
    ));

    let mut lights = Vec::new();
    if builder.materials.iter().all(|m| m.emission.max_element() <= 0.0) {
        let light = position + Vec3::Y * sphere;
        // Irradiance pi at the center: a white surface that faces the light has radiance 1 there.
        let intensity = PI * (light - bounds.center()).length_squared();
        lights.push(Emitter::Point { position: light, intensity: Rgb::splat(intensity) });
        builder.notes.push(format!(
            "{path_shown}: nothing emits light; put a point light of {intensity} W/sr at {light}"
        ));
    }
    builder.finish(path, lights, camera, Vec::new(), (None, RenderDefaults::default()))
}
