//! Instanced meshes: an Embree scene for each set of meshes, and Embree instances of that scene.

use super::EmbreeError;
use super::geometry::GeometryHandle;
use super::scene::{CommittedScene, GeomId, SceneBuilder};
use crate::{Geometry, Instance, MeshError, TriangleMesh, instance_transform};
use glam::{Affine3A, DAffine3, DVec3, Vec3};
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// Names a set of meshes of a [`SceneBuilder`] that may have several instances.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SharedId(usize);

/// Meshes that are instanced together.
#[derive(Debug)]
pub(super) struct SharedMeshes {
    /// Scene of these meshes; it never contains instances.
    pub(super) scene: SceneBuilder,
    /// Smallest and largest coordinates; of no vertex, infinite.
    bounds: [Vec3; 2],
    is_empty: bool,
}

/// An instance that `commit` will make.
#[derive(Debug)]
pub(super) struct PendingInstance {
    /// Index of the shared meshes.
    shared: usize,
    to_scene: Affine3A,
    id: u32,
}

impl SceneBuilder {
    /// Adds the instances of a geometry. A mesh with a transform is stored once for all its
    /// instances. Neighbors in the list with one transform become one Embree instance, so that rays
    /// visit fewer.
    ///
    /// # Errors
    /// As [`add_mesh`](Self::add_mesh) and [`place`](Self::place).
    ///
    /// # Panics
    /// If an instance names a mesh that does not exist.
    pub fn add(&mut self, geometry: &Geometry<'_>) -> Result<(), EmbreeError> {
        let mut shared = HashMap::new();
        // Consecutive meshes are parts of one object; two instances of one mesh are not.
        let are_one_object =
            |a: &Instance, b: &Instance| a.to_scene == b.to_scene && a.mesh < b.mesh;
        for instances in geometry.instances.chunk_by(are_one_object) {
            let meshes: Vec<_> = instances.iter().map(|one| geometry.mesh(one)).collect();
            let Some(to_scene) = instances[0].to_scene else {
                meshes.into_iter().try_for_each(|mesh| self.add_mesh(mesh).map(|_| ()))?;
                continue;
            };
            let names: Vec<u32> = instances.iter().map(|one| one.mesh).collect();
            let id = match shared.entry(names) {
                Entry::Occupied(known) => *known.get(),
                Entry::Vacant(new) => *new.insert(self.share(&meshes)?),
            };
            self.place(id, to_scene)?;
        }
        Ok(())
    }

    /// Copies meshes into the scene; [`place`](Self::place) makes instances of all of them
    /// together.
    ///
    /// # Errors
    /// As [`add_mesh`](Self::add_mesh).
    pub fn share(&mut self, meshes: &[TriangleMesh<'_>]) -> Result<SharedId, EmbreeError> {
        let mut scene = Self::new(&self.device)?;
        scene.set_watertight(self.watertight)?;
        for &mesh in meshes {
            scene.add_mesh(mesh).map_err(|error| self.renumbered(error))?;
        }
        let points = meshes.iter().flat_map(|mesh| mesh.positions).copied();
        let empty = [Vec3::INFINITY, Vec3::NEG_INFINITY];
        let bounds = points.fold(empty, |[min, max], point| [min.min(point), max.max(point)]);
        let is_empty = meshes.iter().all(|mesh| mesh.triangles.is_empty());
        self.shared.push(SharedMeshes { scene, bounds, is_empty });
        Ok(SharedId(self.shared.len() - 1))
    }

    /// Makes an instance of shared meshes. The id is that of their first mesh; the others have the
    /// next ids. Rays are transformed in f32: hits have rounding errors of the coordinates on both
    /// sides of the transform.
    ///
    /// # Errors
    /// [`EmbreeError::Mesh`] if the transform is out of range, or moves the mesh out of the range
    /// of coordinates; [`EmbreeError::TooManyMeshes`] if there are not enough ids left. The scene
    /// is then unchanged.
    ///
    /// # Panics
    /// If another builder made the id, and this builder has no such meshes.
    pub fn place(&mut self, id: SharedId, to_scene: DAffine3) -> Result<GeomId, EmbreeError> {
        let mesh = self.meshes;
        let SharedMeshes { scene, bounds, is_empty } = &self.shared[id.0];
        let transform = instance_transform(to_scene)
            .and_then(|transform| match out_of_range(bounds, to_scene) {
                Some(position) if !is_empty => Err(MeshError::TooFar { position }),
                _ => Ok(transform),
            })
            .map_err(|problem| EmbreeError::Mesh { mesh, problem })?;
        let meshes = self.meshes_with(scene.meshes)?;
        if !is_empty {
            self.pending.push(PendingInstance { shared: id.0, to_scene: transform, id: mesh });
        }
        self.meshes = meshes;
        Ok(GeomId(mesh))
    }

    /// Builds the shared scenes, then makes their instances: Embree requires this order.
    pub(super) fn commit_instances(&mut self) -> Result<(), EmbreeError> {
        let shared = std::mem::take(&mut self.shared).into_iter();
        let shared = shared.map(|shared| shared.scene.commit()).collect::<Result<Vec<_>, _>>()?;
        for PendingInstance { shared: index, to_scene, id } in std::mem::take(&mut self.pending) {
            // Shared scenes contain no instances, so there is one level of them.
            let instance = GeometryHandle::instance(&self.device, &shared[index], &to_scene)?;
            self.attach(&instance, id)?;
        }
        // The shared scenes are dropped here: their instances keep references to them.
        self.triangles += shared.iter().map(CommittedScene::triangles).sum::<usize>();
        Ok(())
    }

    /// An error of a shared scene, with the index that the mesh would have in this scene.
    fn renumbered(&self, error: EmbreeError) -> EmbreeError {
        match error {
            EmbreeError::Mesh { mesh, problem } => {
                EmbreeError::Mesh { mesh: self.meshes.saturating_add(mesh), problem }
            }
            other => other,
        }
    }
}

/// A corner of the box that the transform moves out of the range of coordinates.
fn out_of_range(bounds: &[Vec3; 2], to_scene: DAffine3) -> Option<Vec3> {
    let sides = bounds.map(|side| side.as_dvec3());
    (0..8)
        .map(|corner| DVec3::from_array([0, 1, 2].map(|axis| sides[corner >> axis & 1][axis])))
        .map(|corner| to_scene.transform_point3(corner).as_vec3())
        .find(|position| position.abs().max_element() > TriangleMesh::MAX_COORDINATE)
}
