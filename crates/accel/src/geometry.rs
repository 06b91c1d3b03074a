//! The input of a backend: meshes and their instances.

use super::{MeshError, TriangleMesh};
use glam::{Affine3A, DAffine3, Vec3};
use std::borrow::Cow;

/// Meshes and their instances. [`Hit::mesh`](super::Hit::mesh) is an index into the instances.
#[derive(Clone, Debug, Default)]
pub struct Geometry<'a> {
    /// Each mesh once.
    pub meshes: Vec<TriangleMesh<'a>>,
    /// In the order of their indices.
    pub instances: Vec<Instance>,
}

/// A mesh placed in the scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instance {
    /// Index of the mesh.
    pub mesh: u32,
    /// Transform from the mesh's space to the scene's; `None` for a mesh in scene space, which
    /// should have no other instance.
    pub to_scene: Option<DAffine3>,
}

impl<'a> Geometry<'a> {
    /// One instance per mesh, in scene space, in the order of the slice.
    pub fn of_meshes(meshes: &[TriangleMesh<'a>]) -> Self {
        let instances = (0..).zip(meshes).map(|(mesh, _)| Instance { mesh, to_scene: None });
        Self { meshes: meshes.to_vec(), instances: instances.collect() }
    }

    /// Number of triangles, counted at each instance.
    pub fn instanced_triangles(&self) -> usize {
        self.instances.iter().map(|instance| self.mesh(instance).triangles.len()).sum()
    }

    /// The mesh of an instance, in its own space.
    ///
    /// # Panics
    /// If there is no such mesh.
    pub fn mesh(&self, instance: &Instance) -> TriangleMesh<'a> {
        self.meshes[instance.mesh as usize]
    }

    /// The vertices of an instance in scene space.
    ///
    /// # Panics
    /// If there is no such mesh.
    pub fn positions(&self, instance: &Instance) -> Cow<'a, [Vec3]> {
        let positions = self.mesh(instance).positions;
        let Some(to_scene) = instance.to_scene else { return Cow::Borrowed(positions) };
        let placed = positions.iter().map(|p| to_scene.transform_point3(p.as_dvec3()).as_vec3());
        Cow::Owned(placed.collect())
    }
}

/// The transform of an instance in f32, if rays can be transformed by it and its inverse.
///
/// # Errors
/// If it is too far from a rotation of about the same size.
pub fn instance_transform(to_scene: DAffine3) -> Result<Affine3A, MeshError> {
    let scale = to_scene.matrix3;
    let inverse = scale.inverse();
    // Products of three numbers must be normal in f32, for determinants; written so that NaN fails.
    let is_bounded = |x: glam::DMat3| x.to_cols_array().iter().all(|x| x.abs() < MAX_SCALE);
    let far = to_scene.translation.abs().max_element();
    let fits =
        is_bounded(scale) && is_bounded(inverse) && far < f64::from(TriangleMesh::MAX_COORDINATE);
    if fits { Ok(to_scene.as_affine3a()) } else { Err(MeshError::Transform) }
}

/// Bound of the entries of an instance's transform and of its inverse.
const MAX_SCALE: f64 = 1e9;
