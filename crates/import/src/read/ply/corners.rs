//! Texture coordinates of the corners of faces, and colors of faces. A [`Mesh`] has one of each per
//! vertex, so vertices are split where faces disagree.

use bdpm_core::base::math::Rgb;
use bdpm_core::scene::Mesh;
use glam::Vec2;
use std::collections::HashMap;

/// Attributes of the triangles of a mesh, if its file has them.
#[derive(Default)]
pub(super) struct Corners {
    /// Texture coordinates, three per triangle.
    pub uvs: Vec<Vec2>,
    /// Linear colors, one per triangle.
    pub colors: Vec<Rgb>,
}

impl Corners {
    /// The mesh with these attributes in place of those of its vertices.
    pub fn split(self, mesh: Mesh) -> Mesh {
        let Self { uvs, colors } = self;
        if uvs.is_empty() && colors.is_empty() {
            return mesh;
        }
        let mut split = Mesh { name: mesh.name, ..Mesh::default() };
        let mut known: HashMap<(u32, [u32; 5]), u32> = HashMap::new();
        for (index, corners) in mesh.triangles.iter().enumerate() {
            let mut own = [0; 3];
            for (corner, &vertex) in corners.iter().enumerate() {
                let at = vertex as usize;
                // Strips of triangles have no attributes of their own.
                let uv = uvs.get(3 * index + corner).or(mesh.uvs.get(at)).copied();
                let color = colors.get(index).or(mesh.colors.get(at)).copied();
                let (u, c) = (uv.unwrap_or_default(), color.unwrap_or(Rgb::ONE));
                let key = (vertex, [u.x, u.y, c.x, c.y, c.z].map(f32::to_bits));
                own[corner] = *known.entry(key).or_insert_with(|| {
                    split.positions.push(mesh.positions[at]);
                    split.normals.extend(mesh.normals.get(at));
                    if !(uvs.is_empty() && mesh.uvs.is_empty()) {
                        split.uvs.push(u);
                    }
                    if !(colors.is_empty() && mesh.colors.is_empty()) {
                        split.colors.push(c);
                    }
                    split.positions.len() as u32 - 1
                });
            }
            split.triangles.push(own);
        }
        split
    }
}
