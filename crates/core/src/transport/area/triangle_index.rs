//! Finds the triangles near a box, in all meshes at all their places.

use super::box_tree::{Box3, BoxTree};
use super::surfaces::{Surfaces, box_around, corners};
use crate::accel::{Instance, TriangleMesh};
use glam::{DAffine3, DVec3, Vec3};
use rayon::prelude::*;

/// Maximum number of triangles in a leaf. Each place has a leaf of its own, because a search in its
/// mesh costs more than a test of its box.
const TRIANGLES: usize = 4;

/// Trees over each mesh's triangles, in its own space, and over the places.
#[derive(Debug)]
pub struct TriangleIndex {
    meshes: Vec<BoxTree>,
    places: BoxTree,
    /// From the scene to the mesh's space, for each place.
    to_mesh: Vec<Option<DAffine3>>,
}

impl TriangleIndex {
    /// Builds the trees over all triangles of a scene.
    pub fn new(surfaces: &dyn Surfaces) -> Self {
        let tree = |(mesh, own): (usize, &TriangleMesh)| {
            let place = Instance { mesh: mesh as u32, to_scene: None };
            let count = own.triangles.len() as u32;
            let around = |triangle| box_around(corners(surfaces, &place, triangle).into_iter());
            BoxTree::new(&(0..count).map(around).collect::<Vec<_>>(), TRIANGLES)
        };
        let meshes: Vec<_> = surfaces.meshes().par_iter().enumerate().map(tree).collect();
        let around = |place: &Instance| {
            let own = meshes[place.mesh as usize].bounds();
            place.to_scene.map_or(own, |to_scene| moved(&own, &to_scene))
        };
        let places = BoxTree::new(&surfaces.places().iter().map(around).collect::<Vec<_>>(), 1);
        let to_mesh = |place: &Instance| place.to_scene.map(|to_scene| to_scene.inverse());
        Self { places, to_mesh: surfaces.places().iter().map(to_mesh).collect(), meshes }
    }

    /// Visits triangles whose boxes meet `around`, by place and index, with their corners in the
    /// mesh's space, until a visit returns `false`. Returns whether none did. Triangles of a place
    /// follow each other. Where a place is rotated, `around` is widened to a box in the mesh's
    /// space.
    pub fn find(
        &self,
        surfaces: &dyn Surfaces,
        around: &Box3,
        mut visit: impl FnMut(u32, u32, [Vec3; 3]) -> bool,
    ) -> bool {
        self.places.find(around, |place| {
            let mesh = surfaces.places()[place as usize].mesh;
            let to_mesh = &self.to_mesh[place as usize];
            let around = to_mesh.map_or(*around, |to_mesh| moved(around, &to_mesh));
            let TriangleMesh { positions, triangles } = surfaces.mesh(mesh);
            self.meshes[mesh as usize].find(&around, |triangle| {
                let corners = triangles[triangle as usize].map(|index| positions[index as usize]);
                let own = corners.into_iter().fold(Box3::EMPTY, |own, p| own.with(p.into()));
                !own.meets(&around) || visit(place, triangle, corners)
            })
        })
    }

    /// Size in bytes.
    pub fn bytes(&self) -> usize {
        let meshes: usize = self.meshes.iter().map(BoxTree::bytes).sum();
        meshes + self.places.bytes() + self.to_mesh.capacity() * size_of::<Option<DAffine3>>()
    }
}

/// A box that holds another at its place.
fn moved(own: &Box3, map: &DAffine3) -> Box3 {
    if own.min.x > own.max.x {
        return *own;
    }
    let [min, max] = [own.min, own.max].map(|corner| corner.as_dvec3());
    let (middle, half) = (0.5 * (min + max), 0.5 * (max - min));
    let middle = map.transform_point3(middle);
    let [x, y, z] = map.matrix3.to_cols_array_2d().map(|axis| DVec3::from_array(axis).abs());
    let half = x * half.x + y * half.y + z * half.z;
    // Rounding of coordinates on the way.
    let half = half + 1e-6 * (half + middle.abs());
    box_around([middle - half, middle + half].into_iter())
}
