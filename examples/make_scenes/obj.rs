//! Writing OBJ files.

use super::mesh::Mesh;
use glam::DVec3;
use std::fmt::Write;

/// Content of an OBJ file: meshes with names and materials.
#[derive(Clone, Debug)]
pub struct Model {
    /// The comment at its top, one line or more.
    pub comment: &'static str,
    /// Digits behind the point of positions and of normals.
    pub decimals: (usize, usize),
    parts: Vec<Part>,
}

#[derive(Clone, Debug)]
struct Part {
    name: String,
    material: Option<String>,
    mesh: Mesh,
}

impl Model {
    /// With 4 decimals of positions and normals: tenths of a millimeter, where units are meters.
    pub fn new(comment: &'static str) -> Self {
        Self { comment, decimals: (4, 4), parts: Vec::new() }
    }

    /// With other numbers of decimals of positions and of normals.
    #[must_use]
    pub fn decimals(mut self, positions: usize, normals: usize) -> Self {
        self.decimals = (positions, normals);
        self
    }

    /// Adds an object of one material.
    #[must_use]
    pub fn part(
        mut self,
        name: impl Into<String>,
        material: impl Into<String>,
        mesh: Mesh,
    ) -> Self {
        self.parts.push(Part { name: name.into(), material: Some(material.into()), mesh });
        self
    }

    /// Adds an object whose material the scene file gives.
    #[must_use]
    pub fn plain(mut self, name: impl Into<String>, mesh: Mesh) -> Self {
        self.parts.push(Part { name: name.into(), material: None, mesh });
        self
    }

    /// The file's text.
    pub fn text(&self) -> String {
        let mut text = String::new();
        for line in self.comment.lines() {
            let _ = writeln!(text, "# {line}");
        }
        let (mut positions, mut normals) = (1, 1);
        for part in &self.parts {
            let _ = write!(text, "\no {}\n", part.name);
            if let Some(material) = &part.material {
                let _ = writeln!(text, "usemtl {material}");
            }
            let mesh = &part.mesh;
            mesh.positions.iter().for_each(|p| vector(&mut text, "v", *p, self.decimals.0));
            mesh.normals.iter().for_each(|n| vector(&mut text, "vn", *n, self.decimals.1));
            for face in &mesh.faces {
                text.push('f');
                for corner in face {
                    let _ = write!(text, " {}", corner.position + positions);
                    if let Some(normal) = corner.normal {
                        let _ = write!(text, "//{}", normal + normals);
                    }
                }
                text.push('\n');
            }
            positions += mesh.positions.len();
            normals += mesh.normals.len();
        }
        text
    }
}

fn vector(text: &mut String, keyword: &str, v: DVec3, decimals: usize) {
    let [x, y, z] = v.to_array().map(|value| number(value, decimals));
    let _ = writeln!(text, "{keyword} {x} {y} {z}");
}

/// A number with at most so many digits behind the point, without zeros at its end.
pub fn number(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let short =
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    (if short == "-0" { "0" } else { short }).to_owned()
}
