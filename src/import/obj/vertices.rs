//! From corners, which have an index each for position, texture coordinates and normal, to vertices,
//! which have one for all three.

use super::model::Faces;
use super::polygon::Cutter;
use super::records::Layout;
use crate::base::math::Rgb;
use crate::scene::Mesh;
use glam::{Vec2, Vec3};

/// No vertex.
const NONE: u32 = u32::MAX;

/// Vertices of one position that are compared with a new one. Few meshes have more there; those get
/// some vertices twice, which takes memory only, but searching all would take forever in bad cases.
const COMPARED: usize = 64;

/// Makes meshes of the faces of a file.
pub(super) struct Vertices<'a> {
    positions: &'a [Vec3],
    uvs: &'a [Vec2],
    normals: &'a [Vec3],
    /// Of the first positions; the others are white.
    colors: &'a [Rgb],
    /// Of each position, the newest vertex of the mesh in the making.
    newest: Vec<u32>,
    /// Of each vertex of that mesh, its indices and the one before it at its position.
    made: Vec<([u32; 3], u32)>,
    cutter: Cutter,
}

impl<'a> Vertices<'a> {
    /// Of what a file defines.
    pub fn new(positions: &'a [Vec3], uvs: &'a [Vec2], normals: &'a [Vec3]) -> Self {
        let newest = vec![NONE; positions.len()];
        let (made, cutter) = (Vec::new(), Cutter::default());
        Self { positions, uvs, normals, colors: &[], newest, made, cutter }
    }

    /// The same with colors of the first positions.
    pub fn colored(self, colors: &'a [Rgb]) -> Self {
        Self { colors, ..self }
    }

    /// A mesh of faces of one layout, in their order; vertices are in that of their first use.
    pub fn mesh(&mut self, layout: Layout, faces: &Faces) -> Mesh {
        let mut triangles = Vec::with_capacity(faces.corners.len());
        let mut corners = faces.indices.chunks_exact(layout.stride());
        let mut polygon = Vec::new();
        for &count in &faces.corners {
            polygon.clear();
            for corner in corners.by_ref().take(count as usize) {
                let key = match (layout.uvs, corner) {
                    (_, &[position, uv, normal]) => [position, uv, normal],
                    (true, &[position, uv]) => [position, uv, 0],
                    (_, &[position, normal]) => [position, 0, normal],
                    (_, rest) => [rest[0], 0, 0],
                };
                polygon.push(self.vertex(key));
            }
            if let [a, b, c] = polygon[..] {
                triangles.push([a, b, c]);
                continue;
            }
            let point = |vertex: &u32| self.positions[self.made[*vertex as usize].0[0] as usize];
            self.cutter.cut(polygon.iter().map(point), |corners| {
                triangles.push(corners.map(|corner| polygon[corner]));
            });
        }
        let mut mesh = Mesh { triangles, ..Mesh::default() };
        let keys = || self.made.iter().map(|(key, _)| key.map(|index| index as usize));
        mesh.positions = keys().map(|[index, _, _]| self.positions[index]).collect();
        if layout.uvs {
            mesh.uvs = keys().map(|[_, index, _]| self.uvs[index]).collect();
        }
        let color = |index: usize| self.colors.get(index).copied().unwrap_or(Rgb::ONE);
        if keys().any(|[index, _, _]| color(index) != Rgb::ONE) {
            mesh.colors = keys().map(|[index, _, _]| color(index)).collect();
        }
        if layout.normals {
            mesh.normals = keys().map(|[_, _, index]| self.normals[index]).collect();
        }
        for ([position, ..], _) in self.made.drain(..) {
            self.newest[position as usize] = NONE;
        }
        mesh
    }

    /// The vertex of these indices.
    fn vertex(&mut self, key: [u32; 3]) -> u32 {
        let newest = &mut self.newest[key[0] as usize];
        let mut vertex = *newest;
        for _ in 0..COMPARED {
            if vertex == NONE {
                break;
            }
            let (known, older) = self.made[vertex as usize];
            if known == key {
                return vertex;
            }
            vertex = older;
        }
        self.made.push((key, *newest));
        *newest = self.made.len() as u32 - 1;
        *newest
    }

    /// How many polygons were too large to be cut well.
    pub fn rough(&self) -> u64 {
        self.cutter.rough
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_vertices_of_a_position_are_compared_and_no_more() {
        for (count, is_found) in [(COMPARED, true), (COMPARED + 1, false), (300_000, false)] {
            let uvs = vec![Vec2::ZERO; count];
            let mut vertices = Vertices::new(&[Vec3::ZERO], &uvs, &[]);
            let made: Vec<u32> = (0..count as u32).map(|uv| vertices.vertex([0, uv, 0])).collect();
            assert!(made.iter().copied().eq(0..count as u32));
            // The oldest is compared last.
            let again = vertices.vertex([0, 0, 0]);
            assert_eq!(again, if is_found { 0 } else { count as u32 });
        }
    }
}
