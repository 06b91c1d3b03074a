//! Meshes in PLY files, text or binary, compressed by gzip or not: vertices with normals, texture coordinates and linear
//! colors.

use super::text;
use crate::base::error::{Error, Result};
use crate::scene::Mesh;
use flate2::bufread::MultiGzDecoder;
use glam::{Vec2, Vec3};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Advice for a malformed file.
const EXPORT_AGAIN: &str = "export the mesh again";

/// Direction in which texture coordinates `v` grow in the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum VDirection {
    /// In most programs.
    Up,
    /// In Mitsuba.
    Down,
}

/// A vertex, a face, or any other element.
#[derive(Default)]
struct PlyItem {
    position: [f32; 3],
    normal: [f32; 3],
    uv: [f32; 2],
    color: [f32; 3],
    corners: Vec<u32>,
    /// Whether the list holds anything but indices.
    is_bad: bool,
}

impl PlyItem {
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

impl PropertyAccess for PlyItem {
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

/// The content of a file, decompressed if it is compressed by gzip.
fn plain(path: &Path) -> Result<Box<dyn Read>> {
    let mut file = BufReader::new(text::open(path)?);
    let start = file.fill_buf().map_err(|e| Error::io("read the file", path, e))?;
    let is_compressed = start.starts_with(&[0x1f, 0x8b]);
    Ok(if is_compressed { Box::new(MultiGzDecoder::new(file)) } else { Box::new(file) })
}

/// Reads a mesh, with its normals, texture coordinates, and linear colors `r`, `g`, `b` within [0,
/// 1].
///
/// # Errors
/// Names the file and its problem.
pub(super) fn read(path: &Path, v_direction: VDirection) -> Result<Mesh> {
    let broken = |problem: String| {
        let problem = problem.split_whitespace().collect::<Vec<_>>().join(" ");
        let problem: String = problem.chars().take(300).collect();
        Error::new(format!("cannot read it as a PLY file: {problem}"), EXPORT_AGAIN).at(path)
    };
    let mut reader = Reader::new(BufReader::new(plain(path)?));
    let parser = Parser::<PlyItem>::new();
    let header = parser.read_header(&mut reader).map_err(|e| broken(e.to_string()))?;
    let mut mesh = Mesh::default();
    for (name, element) in &header.elements {
        // Elements without properties take no bytes, so that the file does not limit their number.
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
                        mesh.uvs.push(Vec2::new(
                            u,
                            if v_direction == VDirection::Down { 1.0 - v } else { v },
                        ));
                    }
                    if has_colors {
                        mesh.colors.push(Vec3::from(item.color).clamp(Vec3::ZERO, Vec3::ONE));
                    }
                }
            }
            "face" => {
                for (index, PlyItem { corners, is_bad, .. }) in items.into_iter().enumerate() {
                    if is_bad {
                        return Err(broken(format!("face {index} has invalid vertex indices")));
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
