//! Scenes of Radiance (`.rad`).
//!
//! `docs/reference/radiance.md` describes the conversion of each primitive and its differences from
//! Radiance. Each approximation is a warning. Errors name file and line. No command of a file is
//! run: `xform`, `genbox` and `genprism` are done here, and all others are refused.

mod binary;
mod bsdf;
mod commands;
mod data;
mod generators;
mod instances;
mod lamps;
mod materials;
mod mesh;
mod patterns;
mod shapes;
mod skies;
mod sky;
mod tokens;
mod transforms;

use super::ImportOptions;
use crate::builder::{Builder, Contents, EnvironmentReader, ReadScene};
use crate::shape::instancing::MaterialMesh;
use crate::shape::polygon::Cutter;
use crate::shape::round::steps;
use crate::text;
use crate::warnings::GroupedWarnings;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::bsdf::Bsdf;
use bdpm_core::scene::{Camera, FieldOfView, Material, Mesh};
use commands::Command;
use glam::{DAffine3, DVec3, Vec3};
use instances::Instances;
use lamps::Lamps;
use materials::{Kind, Materials};
use sky::Sky;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;
use tokens::{Item, Primitive, Tokens};

/// Files that include each other, at most.
const MAX_DEPTH: usize = 32;

/// Bytes of files that are read again, all together.
const MAX_BYTES: usize = 256 << 20;

/// Opening angle of a view that is not given, degrees, across the height: that of rpict.
const VIEW_DEGREES: f32 = 45.0;

/// Steps around a round lamp whose radiance depends on the direction: each look-up goes over all
/// its sides.
const LAMP_STEPS: u32 = 16;

/// Steps around it for its intensity.
const EXACT_STEPS: u32 = 64;

/// Reads a scene after the materials in the file of the same name that ends in `.mat`, if there is
/// one, with the view of that which ends in `.vf`.
///
/// # Errors
/// Names the file and line of a primitive that is malformed or unknown.
pub(super) fn read(path: &Path, options: &ImportOptions) -> Result<ReadScene> {
    let mut reader = Reader {
        builder: Builder::default(),
        materials: Materials::default(),
        lamps: Lamps::default(),
        instances: Instances::default(),
        warnings: GroupedWarnings::default(),
        sky: Sky::default(),
        cutter: Cutter::default(),
        folder: path.parent().unwrap_or(Path::new("")).to_owned(),
        world: DAffine3::from_translation(-options.origin()),
        has_light: false,
        depth: 0,
        files: HashSet::new(),
        bytes: 0,
    };
    let placing = Placing::new(reader.world);
    let materials = path.with_extension("mat");
    if materials.exists() {
        reader.file(&materials, &placing)?;
    }
    reader.file(path, &placing)?;
    let file = path.display().to_string();
    let Reader { mut builder, warnings, sky, has_light, .. } = reader;
    builder.warnings.extend(warnings.into_warnings(&file));
    let environment = sky.environment();
    let environment =
        environment.map(|own| Box::new(move |_: &mut Vec<_>| Ok(own)) as EnvironmentReader);
    let view = path.with_extension("vf");
    let camera = view.exists().then(|| view_of(&view, options.origin())).transpose()?;
    let contents = Contents {
        lights: sky.suns,
        camera,
        environment,
        may_lack_light: !has_light,
        is_z_up: true,
        ..Contents::default()
    };
    builder.finish(path, contents, options)
}

/// Where the primitives of a file go.
#[derive(Clone)]
struct Placing {
    map: DAffine3,
    /// Replaces the modifiers of surfaces.
    modifier: Option<String>,
}

impl Placing {
    fn new(map: DAffine3) -> Self {
        Self { map, modifier: None }
    }
}

/// A scene that is being read.
struct Reader {
    builder: Builder,
    materials: Materials,
    lamps: Lamps,
    instances: Instances,
    warnings: GroupedWarnings,
    sky: Sky,
    cutter: Cutter,
    /// Folder of the scene, in which included files are looked for, too.
    folder: PathBuf,
    world: DAffine3,
    /// Any source or surface emits.
    has_light: bool,
    depth: usize,
    /// Files that were read.
    files: HashSet<PathBuf>,
    /// Bytes of those that were read again.
    bytes: usize,
}

impl Reader {
    /// Reads a file.
    fn file(&mut self, path: &Path, placing: &Placing) -> Result<()> {
        self.descend()?;
        // Of any size, and names in any encoding.
        let text = String::from_utf8_lossy(&text::read_lines(path)?).into_owned();
        if !self.files.insert(path.to_owned()) {
            self.bytes += text.len().max(64);
        }
        if self.bytes > MAX_BYTES {
            let problem =
                format!("files that are read again and again have {} MiB", MAX_BYTES >> 20);
            return Err(Error::new(problem, "reduce the copies of `xform`"));
        }
        let file: Rc<Path> = Rc::from(path);
        let mut tokens = Tokens::new(path, &text);
        while let Some(item) = tokens.item()? {
            let (offset, done) = match item {
                Item::Command(offset, line) => (
                    offset,
                    Command::parse(&line).and_then(|own| self.command(&file, &own, placing)),
                ),
                Item::Primitive(own) => (own.offset, self.primitive(&own, &file, placing)),
            };
            done.map_err(|error| match error.has_location() {
                true => error,
                false => error.at(path).at_offset(&text, offset),
            })?;
        }
        self.depth -= 1;
        Ok(())
    }

    /// Enters a file.
    fn descend(&mut self) -> Result<()> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            let problem = format!("files include each other more than {MAX_DEPTH} deep");
            return Err(Error::new(problem, "leave out the file that includes itself"));
        }
        Ok(())
    }

    /// Places what a command stands for.
    fn command(&mut self, path: &Rc<Path>, command: &Command, placing: &Placing) -> Result<()> {
        let modifier = command.modifier.as_ref().or(placing.modifier.as_ref()).cloned();
        for map in command.placements()? {
            let own = Placing { map: placing.map * map, modifier: modifier.clone() };
            match &command.source {
                commands::Source::Files(files) => {
                    for file in files {
                        let file = self.find(path, file)?;
                        self.builder.count_placements(1)?;
                        self.file(&file, &own)?;
                    }
                }
                commands::Source::Primitives(all) => {
                    for primitive in all {
                        self.primitive(primitive, path, &own)?;
                    }
                }
            }
        }
        for (phrase, name) in &command.notes {
            self.warnings.skipped(*phrase, name);
        }
        Ok(())
    }

    /// An included file: beside the file that includes it, beside the scene, or in the working
    /// directory, where Radiance looks for it.
    fn find(&self, includer: &Path, name: &str) -> Result<PathBuf> {
        let beside = includer.parent().unwrap_or(Path::new("")).join(name);
        let places = [beside, self.folder.join(name), PathBuf::from(name)];
        places.into_iter().find(|place| place.exists()).ok_or_else(|| {
            let advice = "check the name; it is relative to the folder of the file, that of the scene, or \
                          the working directory";
            Error::new(format!("there is no file `{name}`"), advice)
        })
    }

    fn primitive(&mut self, own: &Primitive, file: &Rc<Path>, placing: &Placing) -> Result<()> {
        if Kind::of(&own.kind).is_some() {
            return self.materials.define(own, (file, placing.map), &mut self.warnings);
        }
        let modifier = placing.modifier.as_deref().unwrap_or(&own.modifier);
        match &own.kind[..] {
            "source" => {
                self.has_light = true;
                let Self { sky, materials, warnings, .. } = self;
                return sky.add(own, modifier, materials, placing.map, warnings);
            }
            "mesh" => return self.compiled_mesh(own, file, placing),
            "instance" => return self.instance(own, file, placing),
            _ => {}
        }
        let look = self.materials.look(modifier, &mut self.warnings)?;
        let is_lamp = look.material.emission != Vec3::ZERO;
        self.has_light |= is_lamp;
        if is_lamp && self.lamp(own, modifier, placing)? {
            return Ok(());
        }
        let mesh = shapes::mesh(own, steps(is_lamp), &mut self.cutter)?;
        if mesh.triangles.is_empty() {
            self.warnings.skipped("left out shapes without area:", &own.name);
            return Ok(());
        }
        self.builder.count(0, mesh.triangles.len() as u64)?;
        let index = self.materials.index(modifier, &mut self.builder, &mut self.warnings)?;
        let parts = [MaterialMesh::new(Arc::new(mesh), index)];
        self.builder.place_by(&own.name, &parts, placing.map, false)
    }

    /// Places a surface as a luminous opening. Returns false if its radiance does not depend on the
    /// direction.
    fn lamp(&mut self, own: &Primitive, modifier: &str, placing: &Placing) -> Result<bool> {
        let (material, patterns) = self.materials.resolve(modifier)?;
        // Their alternates shine instead.
        if material.primitive.kind == "illum" && !material.primitive.words.is_empty() {
            return Ok(false);
        }
        let mut lamps = std::mem::take(&mut self.lamps);
        let emission = lamps.emission(&material, &patterns, |file, name| self.find(file, name));
        self.lamps = lamps;
        let Some(emission) = emission? else { return Ok(false) };
        if emission.has_focus() {
            let phrase = "the intensity of a point at all distances, which Radiance lowers near the \
                          lamp by the length of the direction, of (a short direction has no effect)";
            self.warnings.skipped(phrase, &material.primitive.name);
        }
        let [exact, mesh] = [EXACT_STEPS, LAMP_STEPS].map(|around| {
            let mesh = shapes::mesh(own, around, &mut self.cutter)?;
            Ok(placed(mesh, placing.map))
        });
        let (exact, mesh) = (exact?, mesh?);
        let opening = self.lamps.opening(&emission, &exact, &mesh)?;
        let Some(opening) = opening else { return Ok(false) };
        let black = Material::new(&material.primitive.name, Bsdf::diffuse(Vec3::ZERO));
        let luminous_opening = Some(Arc::new(opening));
        let index = self.builder.add_material(Material { luminous_opening, ..black });
        self.builder.count(0, mesh.triangles.len() as u64)?;
        let parts = [MaterialMesh::new(Arc::new(mesh), index)];
        self.builder.place_by(&own.name, &parts, DAffine3::IDENTITY, false)?;
        Ok(true)
    }
}

/// A mesh in the scene, with the same front.
fn placed(mut mesh: Mesh, map: DAffine3) -> Mesh {
    let at = |own: Vec3| map.transform_point3(own.as_dvec3()).as_vec3();
    mesh.positions.iter_mut().for_each(|own| *own = at(*own));
    mesh.normals.clear();
    if map.matrix3.determinant() < 0.0 {
        mesh.triangles.iter_mut().for_each(|corners| corners.swap(1, 2));
    }
    mesh
}

/// A mesh of positions and triangles.
fn mesh_of(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Mesh {
    Mesh { positions, triangles, ..Mesh::default() }
}

/// The camera of a view file of rpict or rvu: the last line that has options of a view. `origin`
/// becomes the origin of the scene.
fn view_of(path: &Path, origin: DVec3) -> Result<Camera> {
    let text = text::read(path)?;
    let lines = text.lines().enumerate();
    let line = lines.filter(|(_, line)| line.contains("-vp") || line.contains("-vd")).last();
    let Some((index, line)) = line else {
        let advice = "give -vp, -vd, -vu and -vv of a perspective, or remove the file";
        return Err(Error::new("the file has no view", advice).at(path));
    };
    camera_of(line, origin).map_err(|error| error.at(path).line(index + 1, line))
}

/// The camera of the options in a line.
fn camera_of(line: &str, origin: DVec3) -> Result<Camera> {
    let words: Vec<&str> = line.split_whitespace().collect();
    let number = |at: usize| -> Result<f64> {
        let word = words.get(at).copied().unwrap_or("");
        word.parse().map_err(|_| {
            Error::new(format!("`{word}` is not a number"), "give numbers after options of a view")
        })
    };
    let vector = |at: usize| Ok(DVec3::new(number(at)?, number(at + 1)?, number(at + 2)?));
    let (mut position, mut direction, mut up) = (DVec3::ZERO, DVec3::Y, DVec3::Z);
    let (mut degrees, mut shift) = (VIEW_DEGREES, [0.0; 2]);
    for (at, word) in words.iter().enumerate() {
        match *word {
            "-vp" => position = vector(at + 1)?,
            "-vd" => direction = vector(at + 1)?,
            "-vu" => up = vector(at + 1)?,
            "-vv" => degrees = number(at + 1)? as f32,
            "-vs" => shift[0] = number(at + 1)? as f32,
            "-vl" => shift[1] = number(at + 1)? as f32,
            kind if kind.starts_with("-vt") && kind != "-vtv" => {
                let problem = format!("the view `{kind}` is not a perspective");
                return Err(Error::new(problem, "give a perspective view, -vtv"));
            }
            _ => {}
        }
    }
    let [direction, up] = [direction, up].map(|own: DVec3| own.normalize_or_zero().as_vec3());
    let position = (position - origin).as_vec3();
    Camera::look(position, direction, up, FieldOfView::Y(degrees))?.shifted(shift)
}
