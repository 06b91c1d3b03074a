//! Wavefront OBJ: positions, faces, groups and the names of materials.
//!
//! The file is cut into pieces that are read side by side (`records`), and put together in their
//! order (`model`): what comes out does not depend on the number of threads.
//!
//! Generated files hold this reader against the crate `tobj` (`beside_tobj`), which is not the reader
//! itself for what it makes of other files, even behind a layer that joins, cleans and counts lines: it
//! makes up normals and texture coordinates of faces that have none, finds wrong references when their
//! lines are past or not at all, forgets the names of materials that are defined later or elsewhere, and
//! refuses comments after numbers. To put that right, the layer would have to read the faces itself.
//! Alone, without that layer, `tobj` takes half as long again as this reader on one thread, and more
//! than twice as long as on two (`cargo run --release --example load_table`).

#[cfg(test)]
mod beside_tobj;
mod libraries;
mod model;
mod numbers;
mod polygon;
mod records;
mod vertices;

use super::lines::pieces;
use super::text::{list, read_lines};
use super::warnings::Warning;
use crate::base::error::Result;
use crate::scene::{Material, Mesh};
use model::Model;
use rayon::prelude::*;
use records::{Before, parse};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// About what a piece takes, bytes: small enough to keep all threads busy, and never the reason for
/// a different result.
const PIECE: usize = 1 << 18;

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
    pub notes: Vec<Warning>,
}

impl ObjFile {
    /// Of a mesh alone, in a file that names no materials.
    pub(super) fn of(mesh: Mesh, path: &Path) -> Self {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let mesh = Arc::new(Mesh { name, ..mesh });
        let meshes = vec![ObjMesh { mesh, material: None }];
        Self { meshes, materials: BTreeMap::new(), notes: Vec::new() }
    }

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
    let text = read_lines(path)?;
    let model = read(path, &text, PIECE)?;
    drop(text);

    let mut notes = Vec::new();
    let mut skipped = |what: String| {
        notes.push(Warning::skipped(format!("{}: {what}", path.display())));
    };
    if model.ignored_elements > 0 {
        skipped(format!("ignored {} points, lines or curves", model.ignored_elements));
    }
    for (count, what) in [
        (model.lost, "references to texture coordinates or normals that do not exist"),
        (model.mended, "coordinates of textures or normals that are no numbers, and took 0"),
    ] {
        if count > 0 {
            skipped(format!("ignored {count} {what}"));
        }
    }
    if !model.unknown.is_empty() {
        let words = model.unknown.iter().map(|(word, line)| format!("{word} (line {line})"));
        let words: Vec<_> = words.collect();
        let words = list(words.iter().map(String::as_str));
        skipped(format!("ignored unknown records {words}"));
    }
    let mut materials = BTreeMap::new();
    for library in &model.before.libraries {
        library.load(path, &mut materials, &mut notes)?;
    }
    let (meshes, rough) = model.meshes();
    if rough > 0 {
        let note = format!(
            "{}: cut {rough} faces of more than {} vertices that are not convex as if they were",
            path.display(),
            polygon::LARGEST
        );
        notes.push(Warning::skipped(note));
    }
    Ok(ObjFile { meshes, materials, notes })
}

/// Reads the text in pieces of about `size` bytes.
fn read(path: &Path, text: &[u8], size: usize) -> Result<Model> {
    let pieces = pieces(text, size);
    let side_by_side = pieces.par_iter().map(|piece| parse(path, piece, &Before::enough()));
    let chunks: Vec<_> = side_by_side.collect();
    let mut model = Model::new(path.file_stem().unwrap_or_default().to_string_lossy().into_owned());
    for (chunk, piece) in chunks.into_iter().zip(pieces) {
        let chunk = match chunk {
            Ok(chunk) if chunk.fits(&model.before) => chunk,
            _ => parse(path, piece, &model.before)?,
        };
        model.add(chunk).map_err(|error| error.at(path))?;
    }
    Ok(model)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const RECORDS: [&str; 28] = [
        "v 0 0 0",
        "v 1 0 0",
        "v 0 1 0",
        "v 1 1 0 0.5",
        "vt 0 1",
        "vt 0.5",
        "vn 0 0 1",
        "f 1 2 3",
        "f -1 -2 -3",
        "f 1/1 2/2 3/1",
        "f 1//1 -1//-1 2//1",
        "f 1/1/1 2/-1/1 3/1/-1 -1/-1/-1",
        "f 1 \\\n 2 3",
        "o a",
        "g b",
        "usemtl m",
        "usemtl n",
        "mtllib a.mtl",
        "mtllib b.mtl",
        "l 1 2",
        "what 1",
        "# f \\",
        "",
        "f 9 9 9",
        "f 1/5/7 2/-4/1 3/1/0",
        "vt nan 1e30",
        "usemtl",
        "mtllib",
    ];

    /// Everything there is to say about a file read in such pieces.
    fn outcome(text: &str, size: usize) -> String {
        read(Path::new("a.obj"), text.as_bytes(), size).map_or_else(
            |error| error.to_string(),
            |model| {
                let libraries = format!("{:?}", model.before.libraries);
                let counts = (model.ignored_elements, model.lost, model.mended);
                let rest = format!("{counts:?} {:?}", model.unknown);
                format!("{libraries} {rest} {:?}", model.meshes())
            },
        )
    }

    proptest! {
        #[test]
        fn pieces_make_no_difference(
            records in proptest::collection::vec(0..RECORDS.len(), 0..60), size in 1..60_usize,
        ) {
            // Most files should have something to refer to.
            let first = RECORDS[..7].join("\n");
            let records: Vec<&str> = records.iter().map(|i| RECORDS[*i]).collect();
            let text = format!("{first}\n{}", records.join("\n"));
            prop_assert_eq!(outcome(&text, size), outcome(&text, usize::MAX), "{}", text);
        }
    }

    #[test]
    fn the_first_error_is_told_with_its_line() {
        let good = "v 0 0 0\nf 1 1 1\n".repeat(20);
        for (bad, problem) in [
            ("f -22 1 1\nv x", "vertex -22, but 20 are defined"),
            ("v y 1 1\nf 0 0 0\nv x", "`y` is not a number"),
            ("f 22 1 1\nv 1 1 1", "vertex 22, but 20 are defined"),
        ] {
            let text = format!("{good}{bad}\n{good}");
            for size in [1, 30, usize::MAX] {
                let told = outcome(&text, size);
                assert!(told.contains("a.obj:41: ") && told.contains(problem), "{told}");
            }
        }
    }
}
