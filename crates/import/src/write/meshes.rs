//! Meshes: an OBJ file for each, and a table for each placement.

use super::folder::ExportFolder;
use super::materials::MaterialTables;
use super::numbers::unnormalized;
use crate::srgb::encode;
use crate::text::list;
use crate::warnings::Warning;
use bdpm_core::base::error::Result;
use bdpm_core::base::names::{Names, for_file, for_line};
use bdpm_core::scene::transform::Transform;
use bdpm_core::scene::{Mesh, Placement, Scene};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::io::{self, Write};

pub(super) struct MeshFiles<'a> {
    scene: &'a Scene,
    /// File of each mesh.
    files: Vec<String>,
}

impl<'a> MeshFiles<'a> {
    pub fn new(scene: &'a Scene) -> Self {
        let mut names = Names::default();
        let file =
            |mesh: &Mesh| format!("meshes/{}.obj", names.unique(for_file(&mesh.name, "mesh")));
        Self { scene, files: scene.meshes().iter().map(file).collect() }
    }

    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.files.iter().map(String::as_str)
    }

    /// All `[[mesh]]`.
    pub fn tables(&self, materials: &MaterialTables, warnings: &mut Vec<Warning>) -> String {
        let mut text = String::new();
        for Placement { mesh, material, transform } in self.scene.placements() {
            let (file, material) = (&self.files[*mesh as usize], materials.quoted(*material));
            // Writing to strings cannot fail.
            let _ = write!(text, "\n[[mesh]]\nfile = \"{file}\"\nmaterial = {material}\n");
            let origin = self.scene.file_origin();
            let far = (origin != DVec3::ZERO).then_some(Transform::IDENTITY);
            if let Some(transform) = transform.or(far) {
                let transform = transform.relative_to(-origin);
                let _ = writeln!(text, "matrix = {:?}", transform.rows());
                if transform.is_flipped() {
                    text += "flip = true\n";
                }
            }
        }
        let with_tangents = self.scene.meshes().iter().filter(|mesh| !mesh.tangents.is_empty());
        let names: BTreeSet<&str> = with_tangents.map(|mesh| &mesh.name[..]).collect();
        if !names.is_empty() {
            let names = list(names);
            let text = "OBJ files have no tangents; texture coordinates replace those of";
            warnings.push(Warning::skipped(format!("{text} {names}")));
        }
        text
    }

    pub fn write(&self, out: &ExportFolder) -> Result<()> {
        let all = self.scene.meshes().par_iter().zip(&self.files);
        // Reading transforms the normals of instances as they are. It normalizes all other normals.
        let mut moved = vec![false; self.files.len()];
        for Placement { mesh, transform, .. } in self.scene.placements() {
            moved[*mesh as usize] |= transform.is_some();
        }
        all.zip(moved)
            .try_for_each(|((mesh, file), moved)| out.write_part(file, |to| write(mesh, moved, to)))
    }
}

fn write(mesh: &Mesh, moved: bool, to: &mut dyn Write) -> io::Result<()> {
    let Mesh { positions, normals, uvs, colors, triangles, .. } = mesh;
    writeln!(to, "o {}", for_line(&mesh.name, "mesh"))?;
    for (i, p) in positions.iter().enumerate() {
        write!(to, "v {} {} {}", p.x, p.y, p.z)?;
        match colors.get(i).map(|color| encode(*color)) {
            None => writeln!(to),
            Some([r, g, b]) => writeln!(to, " {r} {g} {b}"),
        }?;
    }
    for uv in uvs {
        writeln!(to, "vt {} {}", uv.x, uv.y)?;
    }
    for normal in normals {
        let n = if moved { *normal } else { unnormalized(*normal) };
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
