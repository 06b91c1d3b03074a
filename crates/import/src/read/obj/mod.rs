//! Reads Wavefront OBJ files with the crate `tobj`.
//!
//! The file is first rewritten in one dialect (`normalize`), which also finds all errors. Then
//! `tobj` parses the numbers, merges vertices whose indices all agree, and returns one mesh per
//! object or group, material and format of faces. Polygons are cut here (`polygon`), because `tobj`
//! makes fans of those that are not convex. Material libraries are read by our own reader (`mtl`),
//! which knows textures, metals and glass.

mod libraries;
mod normalize;
mod place;

pub use place::{Looks, ObjPlacer};

use super::ImportOptions;
use super::ply::PlyFile;
use crate::builder::{Builder, Contents, ReadScene};
use crate::shape::polygon::{self, Cutter};
use crate::text::{list, read_lines};
use crate::warnings::Warning;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::Mesh;
use bdpm_core::scene::transform::Transform;
use glam::{DVec3, Vec2, Vec3};
use normalize::{Dialect, Normalized, Part, normalize};
use std::io::BufReader;
use std::panic::resume_unwind;
use std::path::Path;
use std::sync::Arc;
use tobj::{LoadOptions, Model};

/// Bytes that `tobj` takes from the rewritten text at once.
const BUFFER: usize = 1 << 16;

/// The triangles of one object or group that share a material.
#[derive(Clone, Debug)]
pub struct ObjMesh {
    /// Has the name of the object or group. The index of its material is not yet known.
    pub mesh: Arc<Mesh>,
    /// Name that `usemtl` gives.
    pub material: Option<String>,
}

/// The content of an OBJ file and its material libraries.
#[derive(Clone, Debug)]
pub struct ObjFile {
    /// Nonempty meshes, in the order in which they begin in the file.
    pub meshes: Vec<ObjMesh>,
    /// Materials of the libraries.
    pub looks: Looks,
    /// Warnings about ignored content.
    pub notes: Vec<Warning>,
    /// Point to which all positions are relative: zero unless they are far from the origin.
    pub origin: DVec3,
}

impl ObjFile {
    /// Wraps the only mesh of a file that names no materials.
    pub fn of(file: PlyFile, path: &Path) -> Self {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let mesh = Arc::new(Mesh { name, ..file.mesh });
        let meshes = vec![ObjMesh { mesh, material: None }];
        Self { meshes, looks: Looks::new(), notes: file.warnings, origin: file.origin }
    }

    /// Wraps a mesh in memory, which names no materials.
    pub fn in_memory(mesh: &Arc<Mesh>) -> Self {
        let meshes = vec![ObjMesh { mesh: Arc::clone(mesh), material: None }];
        Self { meshes, looks: Looks::new(), notes: Vec::new(), origin: DVec3::ZERO }
    }

    /// Number of triangles of all meshes.
    pub fn triangle_count(&self) -> u64 {
        self.meshes.iter().map(|part| part.mesh.triangles.len() as u64).sum()
    }
}

/// Reads an OBJ file as a scene.
pub(super) fn read(path: &Path, options: &ImportOptions) -> Result<ReadScene> {
    let obj = load(path)?;
    let mut builder = Builder::new(obj.notes.clone());
    builder.count(obj.triangle_count(), obj.triangle_count())?;
    // All points stay in range.
    let looks = (None, &Looks::new());
    let moved = Transform::IDENTITY.relative_to(options.origin());
    let _ = ObjPlacer::default().place(&mut builder, (path, &obj), &moved, looks);
    let contents = Contents { may_lack_light: true, ..Contents::default() };
    builder.finish(path, contents, options)
}

/// Reads an OBJ file with its material libraries. Positions far from the origin are read relative
/// to their center, in double precision.
///
/// # Errors
/// If a file cannot be read, or a line is malformed.
pub fn load(path: &Path) -> Result<ObjFile> {
    let text = read_lines(path)?;
    let mut dialect = Dialect::default();
    let (mut normalized, mut models) = rewritten(path, &text, dialect)?;
    let center = normalized.bounds.far_center_of_part();
    if normalized.has_colors || center.is_some() {
        let origin = center.unwrap_or(DVec3::ZERO);
        dialect = Dialect { is_colored: normalized.has_colors, origin };
        (normalized, models) = rewritten(path, &text, dialect)?;
    }
    drop(text);

    let mut notes = Vec::new();
    let mut skip =
        |text: String| notes.push(Warning::skipped(format!("{}: {text}", path.display())));
    let Normalized { ignored_elements, invalid_references, invalid_numbers, unsmoothed, .. } =
        normalized;
    for (count, what) in [
        (ignored_elements, "points, lines or curves"),
        (invalid_references, "references to texture coordinates or normals that do not exist"),
        (invalid_numbers, "coordinates of textures or normals that are no numbers, and took 0"),
    ] {
        if count > 0 {
            skip(format!("ignored {count} {what}"));
        }
    }
    if unsmoothed > 0 {
        skip(format!("{unsmoothed} faces of smoothing groups (`s`) are flat without normals"));
    }
    if !normalized.unknown.is_empty() {
        let words = normalized.unknown.iter().map(|(word, line)| format!("{word} (line {line})"));
        let words: Vec<_> = words.collect();
        skip(format!("ignored unknown records {}", list(words.iter().map(String::as_str))));
    }
    let mut looks = Looks::new();
    for library in &normalized.libraries {
        library.load(path, &mut looks, &mut notes)?;
    }
    let mut cutter = Cutter::default();
    // Without any face `tobj` returns one empty model.
    let pairs = normalized.parts.into_iter().zip(models);
    let mesh = |(Part { name, material, .. }, model): (_, Model)| {
        let mesh = Arc::new(Mesh { name, ..triangulated(model.mesh, &mut cutter) });
        ObjMesh { mesh, material }
    };
    let meshes = pairs.map(mesh).collect();
    if cutter.rough > 0 {
        let note = format!(
            "{}: cut {} faces of more than {} vertices that are not convex as if they were",
            path.display(),
            cutter.rough,
            polygon::LARGEST
        );
        notes.push(Warning::skipped(note));
    }
    Ok(ObjFile { meshes, looks, notes, origin: dialect.origin })
}

/// Rewrites the text on a thread of its own while `tobj` reads the result here. So the rewriting,
/// about a third of the work, costs little time. Not a task of rayon, whose pool may have one
/// thread only.
fn rewritten(path: &Path, text: &[u8], dialect: Dialect) -> Result<(Normalized, Vec<Model>)> {
    let (reader, writer) =
        std::io::pipe().map_err(|error| Error::io("open a pipe", path, error))?;
    std::thread::scope(|scope| {
        let normalizing = scope.spawn(move || normalize(path, text, dialect, writer));
        let options = LoadOptions { single_index: true, ..LoadOptions::default() };
        let read = {
            let mut reader = BufReader::with_capacity(BUFFER, reader);
            tobj::load_obj_buf(&mut reader, &options, |_| Ok(Default::default()))
        };
        let normalized = normalizing.join().unwrap_or_else(|panic| resume_unwind(panic));
        // Normalizing fails as well if `tobj` stops early, but does not know why.
        let (models, _) = read.map_err(|error| {
            let problem = format!("cannot read the model: {error}");
            Error::new(problem, "report this file as a bug of bdpm").at(path)
        })?;
        Ok((normalized?, models))
    })
}

/// The mesh with its polygons cut into triangles.
fn triangulated(read: tobj::Mesh, cutter: &mut Cutter) -> Mesh {
    let vectors = |numbers: &[f32]| -> Vec<Vec3> {
        numbers.as_chunks().0.iter().copied().map(Vec3::from_array).collect()
    };
    let positions = vectors(&read.positions);
    let mut triangles = Vec::with_capacity(read.indices.len() / 3);
    if read.face_arities.is_empty() {
        triangles.extend_from_slice(read.indices.as_chunks().0);
    }
    let mut rest = &read.indices[..];
    for count in read.face_arities {
        match rest.split_off(..count as usize).unwrap_or_default() {
            &[a, b, c] => triangles.push([a, b, c]),
            polygon => {
                let points = polygon.iter().map(|index| positions[*index as usize]);
                cutter.cut(points, |corners| triangles.push(corners.map(|i| polygon[i])));
            }
        }
    }
    // White is the color of a mesh without colors.
    let is_colored = read.vertex_color.iter().any(|component| *component != 1.0);
    Mesh {
        triangles,
        uvs: read.texcoords.as_chunks().0.iter().copied().map(Vec2::from_array).collect(),
        normals: vectors(&read.normals),
        colors: if is_colored { vectors(&read.vertex_color) } else { Vec::new() },
        positions,
        ..Mesh::default()
    }
}
