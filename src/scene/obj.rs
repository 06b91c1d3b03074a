//! Wavefront OBJ: positions, faces, groups and the names of materials.
//!
//! `tobj` triangulates and groups, but its errors have neither file nor line, and it lets through
//! numbers that are not finite. So each line is checked on its way to `tobj`, which sees records
//! that cannot fail only.

use super::obj_records::{Part, Records};
use crate::error::{Error, Result};
use crate::scene::mtl;
use crate::scene::notes::Note;
use crate::scene::text::{Lines, list};
use crate::scene::{Material, Mesh};
use glam::{Vec2, Vec3};
use std::collections::{BTreeMap, HashMap};
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The triangles of one object or group that share a material.
#[derive(Clone, Debug)]
pub(super) struct ObjMesh {
    /// Named as the object or group; its material's index is not yet known.
    pub mesh: Arc<Mesh>,
    /// As named by `usemtl`.
    pub material: Option<String>,
}

/// What an OBJ file and its material libraries hold.
#[derive(Clone, Debug)]
pub(super) struct ObjFile {
    /// In the order in which they begin in the file; none is empty.
    pub meshes: Vec<ObjMesh>,
    /// By name.
    pub materials: BTreeMap<String, Material>,
    /// What was ignored.
    pub notes: Vec<Note>,
}

impl ObjFile {
    /// Of all meshes.
    pub(super) fn triangle_count(&self) -> u64 {
        self.meshes.iter().map(|part| part.mesh.triangles.len() as u64).sum()
    }
}

/// Reads an OBJ file with its material libraries.
///
/// # Errors
/// If a file cannot be read, or names the line that is malformed.
pub(super) fn load(path: &Path) -> Result<ObjFile> {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut records = Records::new(Lines::open(path)?, stem);
    let options = tobj::LoadOptions { triangulate: true, single_index: true, ..Default::default() };
    let read = tobj::load_obj_buf(&mut BufReader::new(&mut records), &options, |_| {
        Err(tobj::LoadError::GenericFailure) // never asked: `mtllib` is not passed on
    });
    if let Some(error) = records.error {
        return Err(error);
    }
    let (models, _) = read.map_err(|e| {
        Error::new(format!("not a valid OBJ file: {e}"), "export the model again").at(path)
    })?;

    let mut notes = Vec::new();
    if records.ignored_elements > 0 {
        let count = records.ignored_elements;
        let note = format!("{}: ignored {count} points, lines or curves", path.display());
        notes.push(Note::skipped(note));
    }
    if !records.unknown.is_empty() {
        let known = records.unknown.iter().map(|(word, line)| format!("{word} (line {line})"));
        let words: Vec<_> = known.collect();
        let words = list(words.iter().map(String::as_str));
        let note = format!("{}: ignored unknown records {words}", path.display());
        notes.push(Note::skipped(note));
    }
    let mut materials = BTreeMap::new();
    for library in &records.libraries {
        library.load(path, &mut materials, &mut notes)?;
    }
    Ok(ObjFile { meshes: group(models, &records.parts), materials, notes })
}

/// Joins the models of equal name and material, which a file may switch between at will.
fn group(models: Vec<tobj::Model>, parts: &[Part]) -> Vec<ObjMesh> {
    let mut meshes: Vec<(Mesh, Option<String>)> = Vec::new();
    let mut index_of = HashMap::new();
    for model in models {
        // The name is the number under which `Records` announced the part.
        let Some(part) = model.name.parse().ok().and_then(|index: usize| parts.get(index)) else {
            continue;
        };
        if model.mesh.indices.is_empty() {
            continue;
        }
        let index = *index_of.entry(part).or_insert_with(|| {
            let Part { name, material, .. } = part.clone();
            meshes.push((Mesh { name, ..Mesh::default() }, material));
            meshes.len() - 1
        });
        let mesh = &mut meshes[index].0;
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(model.mesh.positions.chunks_exact(3).map(Vec3::from_slice));
        mesh.normals.extend(model.mesh.normals.chunks_exact(3).map(Vec3::from_slice));
        mesh.uvs.extend(model.mesh.texcoords.chunks_exact(2).map(Vec2::from_slice));
        let triangles = model.mesh.indices.chunks_exact(3);
        mesh.triangles.extend(triangles.map(|t| [t[0] + first, t[1] + first, t[2] + first]));
    }
    let shared = |(mesh, material)| ObjMesh { mesh: Arc::new(mesh), material };
    meshes.into_iter().map(shared).collect()
}

/// A mention of a material library.
pub(super) struct Library {
    pub names: String,
    pub line: usize,
}

impl Library {
    /// Names may hold spaces, and one line may name several libraries: try the whole first.
    fn load(
        &self,
        obj: &Path,
        materials: &mut BTreeMap<String, Material>,
        notes: &mut Vec<Note>,
    ) -> Result<()> {
        let folder = obj.parent().unwrap_or(Path::new(""));
        let find = |name: &str| -> Option<PathBuf> {
            let candidates = [folder.join(name), folder.join(name.replace('\\', "/"))];
            candidates.into_iter().find(|path| path.exists())
        };
        if let Some(path) = find(&self.names) {
            return mtl::load(&path, materials, notes);
        }
        let mut missing = Vec::new();
        let several: Vec<_> =
            self.names.split_whitespace().map(|name| (name, find(name))).collect();
        if several.iter().all(|(_, path)| path.is_none()) {
            missing.push(self.names.as_str());
        }
        for (name, path) in &several {
            match path {
                Some(path) => mtl::load(path, materials, notes)?,
                None if missing.is_empty() => missing.push(name),
                None => {}
            }
        }
        if !missing.is_empty() {
            let names = list(missing);
            let (path, line) = (obj.display(), self.line);
            let note = format!("{path}:{line}: the material library {names} does not exist");
            notes.push(Note::skipped(note));
        }
        Ok(())
    }
}
