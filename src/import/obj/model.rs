//! A whole OBJ file, from its pieces in order.

use super::ObjMesh;
use super::libraries::Library;
use super::records::{Before, Chunk, Item, Layout, MAX_UNKNOWN};
use super::vertices::Vertices;
use crate::base::error::{Error, Result};
use crate::base::math::Rgb;
use crate::scene::Mesh;
use glam::{Vec2, Vec3};
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// What faces of one mesh have in common.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
struct Key {
    name: String,
    material: Option<String>,
    layout: Layout,
}

/// The faces of one mesh.
#[derive(Debug, Default)]
pub(super) struct Faces {
    /// Number of corners of each.
    pub corners: Vec<u32>,
    /// Of all corners, as many as the layout's stride each.
    pub indices: Vec<u32>,
}

/// What was read so far.
#[derive(Debug)]
pub(super) struct Model {
    pub positions: Vec<Vec3>,
    /// Of the first positions; the others are white.
    pub colors: Vec<Rgb>,
    pub uvs: Vec<Vec2>,
    pub normals: Vec<Vec3>,
    parts: Vec<(Key, Faces)>,
    part_index: HashMap<Key, usize>,
    /// Of the faces to come.
    name: String,
    material: Option<String>,
    pub before: Before,
    pub ignored_elements: u64,
    /// As in its pieces.
    pub lost: u64,
    pub mended: u64,
    /// Unknown keywords and where they first appeared.
    pub unknown: BTreeMap<String, usize>,
}

impl Model {
    /// Of a file in which faces before any object or group have this name.
    pub fn new(name: String) -> Self {
        Self {
            positions: Vec::new(),
            colors: Vec::new(),
            uvs: Vec::new(),
            normals: Vec::new(),
            parts: Vec::new(),
            part_index: HashMap::new(),
            name,
            material: None,
            before: Before::default(),
            ignored_elements: 0,
            lost: 0,
            mended: 0,
            unknown: BTreeMap::new(),
        }
    }

    /// Adds the next piece.
    pub fn add(&mut self, mut chunk: Chunk) -> Result<()> {
        for (places, first) in chunk.relative.iter().zip(self.before.defined) {
            for place in places {
                let index = &mut chunk.indices[*place as usize];
                *index = index.wrapping_add(first);
            }
        }
        if !chunk.colors.is_empty() {
            self.colors.resize(self.positions.len(), Rgb::ONE);
            self.colors.append(&mut chunk.colors);
        }
        self.positions.append(&mut chunk.positions);
        self.uvs.append(&mut chunk.uvs);
        self.normals.append(&mut chunk.normals);
        let (mut corners, mut indices) = (&chunk.corners[..], &chunk.indices[..]);
        for item in chunk.items {
            match item {
                Item::Name(name) => self.name = name,
                Item::Material(material) => self.material = material,
                Item::Faces { layout, faces: face_count, indices: index_count } => {
                    let faces = self.faces(layout);
                    faces.corners.extend(corners.split_off(..face_count).unwrap_or_default());
                    faces.indices.extend(indices.split_off(..index_count).unwrap_or_default());
                }
            }
        }
        self.ignored_elements += chunk.ignored_elements;
        self.lost += chunk.lost;
        self.mended += chunk.mended;
        for (word, line) in chunk.unknown {
            if self.unknown.len() < MAX_UNKNOWN {
                self.unknown.entry(word).or_insert(self.before.lines + line);
            }
        }
        for Library { names, line } in chunk.libraries {
            if self.before.libraries.iter().all(|known| known.names != names) {
                let line = self.before.lines + line;
                self.before.libraries.push(Library { names, line });
            }
        }
        self.before.lines += chunk.lines;
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        for (defined, count) in self.before.defined.iter_mut().zip(counts) {
            *defined = u32::try_from(count).map_err(|_| {
                let problem = format!("the file has more than {} vertices", u32::MAX);
                Error::new(problem, "split the model into several files")
            })?;
        }
        Ok(())
    }

    /// Those of the current part.
    fn faces(&mut self, layout: Layout) -> &mut Faces {
        let Self { name, material, parts, part_index, .. } = self;
        let is_last = parts.last().is_some_and(|(key, _)| {
            (&key.name, &key.material, key.layout) == (&*name, &*material, layout)
        });
        let index = if is_last {
            parts.len() - 1
        } else {
            let key = Key { name: name.clone(), material: material.clone(), layout };
            *part_index.entry(key).or_insert_with_key(|key| {
                parts.push((key.clone(), Faces::default()));
                parts.len() - 1
            })
        };
        &mut parts[index].1
    }

    /// All meshes, and how many polygons were too large to be cut well.
    pub fn meshes(self) -> (Vec<ObjMesh>, u64) {
        let mut vertices =
            Vertices::new(&self.positions, &self.uvs, &self.normals).colored(&self.colors);
        let mut meshes = Vec::with_capacity(self.parts.len());
        for (Key { name, material, layout }, faces) in self.parts {
            let mesh = Arc::new(Mesh { name, ..vertices.mesh(layout, &faces) });
            meshes.push(ObjMesh { mesh, material });
        }
        (meshes, vertices.rough())
    }
}
