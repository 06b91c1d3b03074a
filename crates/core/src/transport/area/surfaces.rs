//! The interface through which areas see a scene.

use super::box_tree::Box3;
use crate::accel::{Instance, TriangleMesh};
use glam::{DVec3, Vec3};

/// The surfaces of a scene. Triangles are named as in hits: by the index of their place, and theirs
/// in the mesh.
pub trait Surfaces: Send + Sync {
    /// All meshes, each in its own space.
    fn meshes(&self) -> Vec<TriangleMesh<'_>>;

    /// A mesh by its index in [`Self::meshes`].
    fn mesh(&self, mesh: u32) -> TriangleMesh<'_>;

    /// The meshes' places in the scene.
    fn places(&self) -> &[Instance];

    /// Unit normal of a triangle's front in the scene, as vertices on it have it; zero of triangles
    /// without area.
    fn normal(&self, place: u32, triangle: u32) -> Vec3;

    /// Whether photons merge on the surfaces of a place.
    fn merges(&self, place: u32) -> bool;

    /// Whether the surfaces of a place have holes.
    fn has_holes(&self, place: u32) -> bool {
        let _ = place;
        false
    }

    /// Mean opacity around a point of a surface with holes.
    fn opacity(&self, at: &Hole) -> f32 {
        let _ = at;
        1.0
    }
}

/// A disc of a surface with holes, over which its mean opacity is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hole {
    /// Index of the place.
    pub place: u32,
    /// Index of the triangle in its mesh.
    pub triangle: u32,
    /// Barycentric weights of the second and third corner, of the triangle's point that is nearest
    /// to the middle of the disc.
    pub at: [f32; 2],
    /// Radius of the disc over which the mean is taken, scene units.
    pub radius: f32,
}

/// The corners of a triangle in the scene, in the order of the mesh.
pub(super) fn corners(surfaces: &dyn Surfaces, place: &Instance, triangle: u32) -> [DVec3; 3] {
    let mesh = surfaces.mesh(place.mesh);
    mesh.triangles[triangle as usize].map(|index| {
        let own = mesh.positions[index as usize].as_dvec3();
        place.to_scene.map_or(own, |to_scene| to_scene.transform_point3(own))
    })
}

/// The box around some points, rounded outward.
pub(super) fn box_around(points: impl Iterator<Item = DVec3>) -> Box3 {
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for point in points {
        (min, max) = (min.min(point), max.max(point));
    }
    let down = |c: f64| (c as f32).next_down();
    let up = |c: f64| (c as f32).next_up();
    Box3 {
        min: Vec3::from_array(min.to_array().map(down)).into(),
        max: Vec3::from_array(max.to_array().map(up)).into(),
    }
}
