//! Meshes in PLY files, text or binary: vertices with normals, texture coordinates and linear colors.

use crate::base::error::{Error, Result};
use crate::import::text;
use crate::scene::Mesh;
use glam::{Vec2, Vec3};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};
use std::io::BufReader;
use std::path::Path;

/// What to do about a malformed file.
const AGAIN: &str = "export the mesh again";

/// Which way texture coordinates `v` grow in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rows {
    /// As most programs have it.
    Up,
    /// As Mitsuba has it.
    Down,
}

/// A vertex, a face, or whatever else there is.
#[derive(Default)]
struct Item {
    position: [f32; 3],
    normal: [f32; 3],
    uv: [f32; 2],
    color: [f32; 3],
    corners: Vec<u32>,
    /// Whether the list is none of indices.
    is_bad: bool,
}

impl Item {
    fn slot(&mut self, name: &str) -> Option<&mut f32> {
        Some(match name {
            "x" => &mut self.position[0],
            "y" => &mut self.position[1],
            "z" => &mut self.position[2],
            "nx" => &mut self.normal[0],
            "ny" => &mut self.normal[1],
            "nz" => &mut self.normal[2],
            "u" | "s" | "texture_u" => &mut self.uv[0],
            "v" | "t" | "texture_v" => &mut self.uv[1],
            "r" => &mut self.color[0],
            "g" => &mut self.color[1],
            "b" => &mut self.color[2],
            _ => return None,
        })
    }
}

impl PropertyAccess for Item {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if matches!(name, "vertex_indices" | "vertex_index") {
            let corners = property.to_u32_list();
            self.is_bad = corners.is_none();
            self.corners = corners.unwrap_or_default();
            return PropertyAccessResult::Set;
        }
        match (self.slot(name), property.to_f32_lossy()) {
            (Some(slot), Some(value)) => {
                *slot = value;
                PropertyAccessResult::Set
            }
            _ => PropertyAccessResult::Ignored,
        }
    }
}

/// Reads a mesh, with its normals, texture coordinates, and linear colors `r`, `g`, `b` within [0, 1].
///
/// # Errors
/// Names the file, and what is malformed.
pub(super) fn read(path: &Path, rows: Rows) -> Result<Mesh> {
    let broken = |problem: String| {
        let problem = problem.split_whitespace().collect::<Vec<_>>().join(" ");
        let problem: String = problem.chars().take(300).collect();
        Error::new(format!("cannot read it as a PLY file: {problem}"), AGAIN).at(path)
    };
    let mut reader = Reader::new(BufReader::new(text::open(path)?));
    let parser = Parser::<Item>::new();
    let header = parser.read_header(&mut reader).map_err(|e| broken(e.to_string()))?;
    let mut mesh = Mesh::default();
    for (name, element) in &header.elements {
        // What has no properties takes no bytes, however often it is there.
        if element.properties.is_empty() && element.count > 0 {
            return Err(broken(format!("the element `{name}` has no properties")));
        }
        let items = parser.read_payload_for_element(&mut reader, element, &header);
        let items = items.map_err(|e| broken(e.to_string()))?;
        let has = |names: &[&str]| names.iter().any(|name| element.properties.contains_key(*name));
        match &name[..] {
            "vertex" => {
                let (has_normals, has_uvs) = (has(&["nx"]), has(&["u", "s", "texture_u"]));
                let has_colors = has(&["r"]);
                for item in items {
                    mesh.positions.push(item.position.into());
                    if has_normals {
                        mesh.normals.push(Vec3::from(item.normal).normalize_or_zero());
                    }
                    if has_uvs {
                        let [u, v] = item.uv;
                        mesh.uvs.push(Vec2::new(u, if rows == Rows::Down { 1.0 - v } else { v }));
                    }
                    if has_colors {
                        mesh.colors.push(Vec3::from(item.color).clamp(Vec3::ZERO, Vec3::ONE));
                    }
                }
            }
            "face" => {
                for (index, Item { corners, is_bad, .. }) in items.into_iter().enumerate() {
                    if is_bad {
                        return Err(broken(format!(
                            "face {index} has corners that are no indices"
                        )));
                    }
                    let count = mesh.positions.len();
                    if let Some(bad) = corners.iter().find(|corner| **corner as usize >= count) {
                        let problem = format!("face {index} uses vertex {bad} of {count}");
                        return Err(broken(problem));
                    }
                    // Triangles and convex polygons.
                    for pair in corners.get(1..).unwrap_or_default().windows(2) {
                        mesh.triangles.push([corners[0], pair[0], pair[1]]);
                    }
                }
            }
            _ => {}
        }
    }
    Ok(mesh)
}
