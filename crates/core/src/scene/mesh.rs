//! Triangle meshes, as files define them.

use super::triangle::{Corners, to_front};
use crate::accel::TriangleMesh;
use crate::base::math::Rgb;
use glam::{Vec2, Vec3};

/// A triangle mesh of one material: in the scene's space, or in its own space if it is instanced.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Name in its file.
    pub name: String,
    /// Vertex positions, scene units.
    pub positions: Vec<Vec3>,
    /// Unit normals to interpolate, one per position, or none. They are turned to the front of
    /// their triangle; those of length zero, and those in its plane, are replaced by its own.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one per position, or none; `v` points up in the picture.
    pub uvs: Vec<Vec2>,
    /// Directions of growing `u` for normal maps, one per position, or none. Without them, and
    /// always for the direction of `v`, normal maps use each triangle's texture coordinates.
    pub tangents: Vec<Vec3>,
    /// Factors of the albedo, linear and in [0, 1], one per position, or none.
    pub colors: Vec<Rgb>,
    /// Three vertex indices per triangle, counterclockwise seen from the front.
    pub triangles: Vec<[u32; 3]>,
    /// Index into [`Scene::materials`](super::Scene::materials).
    pub material: u32,
}

impl Mesh {
    /// Returns true if normals or colors vary over its triangles.
    pub(super) fn varies(&self) -> bool {
        !(self.normals.is_empty() && self.colors.is_empty())
    }

    /// Renumbers vertices by their first use, as readers do, and removes those that no triangle
    /// uses.
    pub fn renumber(&mut self) {
        let mut numbers = vec![u32::MAX; self.positions.len()];
        let mut order = Vec::with_capacity(self.positions.len());
        for corner in self.triangles.as_flattened_mut() {
            let number = &mut numbers[*corner as usize];
            if *number == u32::MAX {
                *number = order.len() as u32;
                order.push(*corner as usize);
            }
            *corner = *number;
        }
        fn pick<T: Copy>(list: &mut Vec<T>, order: &[usize]) {
            if !list.is_empty() {
                *list = order.iter().map(|vertex| list[*vertex]).collect();
            }
        }
        let Self { positions, normals, uvs, tangents, colors, .. } = self;
        [positions, normals, tangents, colors].into_iter().for_each(|list| pick(list, &order));
        pick(uvs, &order);
    }

    /// The geometry, without shading data.
    pub fn as_triangles(&self) -> TriangleMesh<'_> {
        TriangleMesh { positions: &self.positions, triangles: &self.triangles }
    }

    /// The shading data of the triangle with these vertices and this normal.
    pub(super) fn corners(&self, indices: [usize; 3], normal: Vec3) -> Corners {
        let own =
            |index: usize| to_front(self.normals.get(index).copied().unwrap_or_default(), normal);
        let uv = |index: usize| self.uvs.get(index).copied().unwrap_or_default();
        Corners::new(indices.map(own), indices.map(uv))
    }
}
