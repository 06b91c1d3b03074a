//! Meshes: an OBJ file each, in scene coordinates.

use super::folder::Folder;
use super::materials::Materials;
use super::names::{Names, for_file, for_line};
use super::numbers::unnormalized;
use crate::error::Result;
use crate::scene::Mesh;
use crate::scene::notes::Note;
use crate::scene::text::list;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::{self, Write};

pub(super) struct Meshes<'a> {
    meshes: &'a [Mesh],
    files: Vec<String>,
}

impl<'a> Meshes<'a> {
    pub fn new(meshes: &'a [Mesh]) -> Self {
        let mut names = Names::default();
        let file =
            |mesh: &Mesh| format!("meshes/{}.obj", names.unique(for_file(&mesh.name, "mesh")));
        Self { meshes, files: meshes.iter().map(file).collect() }
    }

    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.files.iter().map(String::as_str)
    }

    /// All `[[mesh]]`.
    pub fn tables(&self, materials: &Materials, notes: &mut Vec<Note>) -> String {
        let mut text = String::new();
        for (mesh, file) in self.meshes.iter().zip(&self.files) {
            let material = materials.quoted(mesh.material);
            // Strings take everything, here and elsewhere.
            let _ = write!(text, "\n[[mesh]]\nfile = \"{file}\"\nmaterial = {material}\n");
        }
        let with_tangents = self.meshes.iter().filter(|mesh| !mesh.tangents.is_empty());
        let names: BTreeSet<&str> = with_tangents.map(|mesh| &mesh.name[..]).collect();
        if !names.is_empty() {
            let names = list(names);
            let note = "OBJ files have no tangents; texture coordinates give those of";
            notes.push(Note::skipped(format!("{note} {names}")));
        }
        text
    }

    pub fn write(&self, out: &Folder) -> Result<()> {
        let all = self.meshes.par_iter().zip(&self.files);
        all.try_for_each(|(mesh, file)| out.write_part(file, |to| write(mesh, to)))
    }
}

fn write(mesh: &Mesh, to: &mut dyn Write) -> io::Result<()> {
    let Mesh { positions, normals, uvs, triangles, .. } = mesh;
    writeln!(to, "o {}", for_line(&mesh.name, "mesh"))?;
    for p in positions {
        writeln!(to, "v {} {} {}", p.x, p.y, p.z)?;
    }
    for uv in uvs {
        writeln!(to, "vt {} {}", uv.x, uv.y)?;
    }
    for normal in normals {
        let n = unnormalized(*normal);
        writeln!(to, "vn {} {} {}", n.x, n.y, n.z)?;
    }
    for corners in triangles {
        let [a, b, c] = corners.map(|index| u64::from(index) + 1);
        match (uvs.is_empty(), normals.is_empty()) {
            (true, true) => writeln!(to, "f {a} {b} {c}"),
            (false, true) => writeln!(to, "f {a}/{a} {b}/{b} {c}/{c}"),
            (true, false) => writeln!(to, "f {a}//{a} {b}//{b} {c}//{c}"),
            (false, false) => writeln!(to, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}"),
        }?;
    }
    Ok(())
}
