//! Parts of a scene that are compiled: `mesh` of a `.rtm` file, and `instance` of an octree.

use super::binary::{Binary, Format};
use super::commands::Command;
use super::mesh::CompiledMesh;
use super::tokens::Primitive;
use super::transforms::Transforms;
use super::{Placing, Reader};
use crate::shape::instancing::MaterialMesh;
use bdpm_core::base::error::{Error, Result};
use glam::DAffine3;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

/// Compiled files so far.
#[derive(Default)]
pub struct Instances {
    meshes: HashMap<PathBuf, Rc<SceneMesh>>,
    octrees: HashMap<PathBuf, Rc<Octree>>,
}

/// A compiled mesh with the indices of its materials in the scene.
struct SceneMesh {
    compiled: CompiledMesh,
    /// For each part; `None` for one without a material.
    materials: Vec<Option<u32>>,
    emits: bool,
}

/// What an octree contains.
enum Octree {
    /// The files of its scene, or commands with `!`.
    Files(Vec<String>),
    /// The scene of one that is frozen.
    Frozen(Vec<Primitive>),
}

impl Octree {
    fn read(path: &Path) -> Result<Self> {
        let mut file = Binary::open(path, Format::Octree)?;
        let mut read = || {
            let mut files = Vec::new();
            loop {
                let name = file.string()?;
                if name.is_empty() {
                    break;
                }
                files.push(name);
            }
            // The number of primitives.
            file.index()?;
            if files.is_empty() {
                file.skip_tree()?;
                return Ok(Self::Frozen(file.primitives()?));
            }
            Ok(Self::Files(files))
        };
        read().map_err(|error: Error| error.at(path))
    }
}

/// The file of a mesh or an instance, and its map.
fn arguments(own: &Primitive) -> Result<(&str, DAffine3)> {
    let Some((file, words)) = own.words.split_first() else {
        return Err(own.error("names no file", "give the name of a file, then options of xform"));
    };
    let (transforms, other) = Transforms::of(words)?;
    match (other, &transforms.placements()?[..]) {
        (None, [map]) => Ok((file, *map)),
        (Some(word), _) => {
            let problem = format!("has the word `{word}`");
            Err(own.error(&problem, "give options of xform after the file"))
        }
        _ => Err(own.error("has an array", "use `-a` with !xform instead")),
    }
}

impl Reader {
    /// Places a compiled mesh.
    pub(super) fn compiled_mesh(
        &mut self,
        own: &Primitive,
        file: &Rc<Path>,
        placing: &Placing,
    ) -> Result<()> {
        let (name, map) = arguments(own)?;
        let path = self.find(file, name)?;
        let scene_mesh = match self.instances.meshes.get(&path) {
            Some(own) => Rc::clone(own),
            None => {
                let read = Rc::new(self.read_mesh(&path, placing)?);
                self.instances.meshes.insert(path, Rc::clone(&read));
                read
            }
        };
        let modifier = placing.modifier.as_deref().unwrap_or(&own.modifier);
        // A modifier replaces all materials of the mesh.
        let of_all = match modifier {
            "void" => None,
            name => {
                let look = self.materials.look(name, &mut self.warnings)?;
                self.has_light |= look.material.emission != glam::Vec3::ZERO;
                Some(self.materials.index(name, &mut self.builder, &mut self.warnings)?)
            }
        };
        self.has_light |= of_all.is_none() && scene_mesh.emits;
        let SceneMesh { compiled, materials, .. } = &*scene_mesh;
        let mut parts = Vec::new();
        for ((_, mesh), material) in compiled.parts.iter().zip(materials) {
            let Some(material) = of_all.or(*material) else {
                let phrase = "left out triangles without a material (give the mesh a modifier, or \
                              compile it with `obj2mesh -a`) of";
                self.warnings.skipped(phrase, &own.name);
                continue;
            };
            parts.push(MaterialMesh { mesh: Arc::clone(mesh), material, origin: compiled.origin });
        }
        if parts.is_empty() {
            return Ok(());
        }
        self.builder.place_by(&own.name, &parts, placing.map * map, false)
    }

    /// Reads a mesh with its materials, whose names do not leave it.
    fn read_mesh(&mut self, path: &Path, placing: &Placing) -> Result<SceneMesh> {
        let compiled = CompiledMesh::read(path)?;
        let count = compiled.parts.iter().map(|(_, mesh)| mesh.triangles.len() as u64).sum();
        self.builder.count(0, count)?;
        self.materials.enter();
        let made = self.mesh_materials(&compiled, path, placing);
        self.materials.leave();
        let (materials, emits) = made.map_err(|error| error.at(path))?;
        Ok(SceneMesh { compiled, materials, emits })
    }

    /// The material of each part, and whether any emits.
    fn mesh_materials(
        &mut self,
        compiled: &CompiledMesh,
        path: &Path,
        placing: &Placing,
    ) -> Result<(Vec<Option<u32>>, bool)> {
        let file = Rc::from(path);
        let mut by_index = HashMap::new();
        let mut emits = false;
        for (index, primitive) in compiled.primitives.iter().enumerate() {
            self.materials.define(primitive, (&file, placing.map), &mut self.warnings)?;
            // Those of the same name follow later.
            if compiled.parts.iter().any(|(material, _)| *material == Some(index)) {
                let name = &primitive.name;
                let own = self.materials.index(name, &mut self.builder, &mut self.warnings)?;
                emits |= self.builder.materials[own as usize].emission != glam::Vec3::ZERO;
                by_index.insert(index, own);
            }
        }
        let of = |material: &Option<usize>| material.and_then(|own| by_index.get(&own).copied());
        Ok((compiled.parts.iter().map(|(material, _)| of(material)).collect(), emits))
    }

    /// Places the scene of an octree, whose names do not leave it.
    pub(super) fn instance(
        &mut self,
        own: &Primitive,
        file: &Rc<Path>,
        placing: &Placing,
    ) -> Result<()> {
        let (name, map) = arguments(own)?;
        let path = self.find(file, name)?;
        self.builder.count_placements(1)?;
        let octree = match self.instances.octrees.get(&path) {
            Some(own) => Rc::clone(own),
            None => {
                let read = Rc::new(Octree::read(&path)?);
                self.instances.octrees.insert(path.clone(), Rc::clone(&read));
                read
            }
        };
        let modifier = placing.modifier.as_ref().unwrap_or(&own.modifier);
        let modifier = (modifier != "void").then(|| modifier.clone());
        let own = Placing { map: placing.map * map, modifier };
        self.materials.enter();
        let done = self.octree(&octree, &Rc::from(path), &own);
        self.materials.leave();
        done
    }

    fn octree(&mut self, octree: &Octree, path: &Rc<Path>, placing: &Placing) -> Result<()> {
        self.descend()?;
        match octree {
            Octree::Files(files) => {
                for name in files {
                    if let Some(line) = name.strip_prefix('!') {
                        self.command(path, &Command::parse(line)?, placing)?;
                        continue;
                    }
                    let file = self.find(path, name)?;
                    self.file(&file, placing)?;
                }
            }
            Octree::Frozen(primitives) => {
                for primitive in primitives {
                    let placed = self.primitive(primitive, path, placing);
                    placed.map_err(
                        |error| if error.has_location() { error } else { error.at(&**path) },
                    )?;
                }
            }
        }
        self.depth -= 1;
        Ok(())
    }
}
