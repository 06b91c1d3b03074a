//! Meshes at several places: a scene of its own for each, and an instance of it for each place.

use super::EmbreeError;
use super::geometry::GeometryHandle;
use super::scene::{CommittedScene, GeomId, SceneBuilder};
use crate::accel::{Geometry, Instance, MeshError, TriangleMesh, instance_transform};
use crate::base::math::Bounds;
use glam::{Affine3A, DAffine3, DVec3, Vec3};
use std::collections::HashMap;
use std::collections::hash_map::Entry;

/// Names meshes of a [`SceneBuilder`] that may have several places.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SharedId(usize);

/// Meshes that may have several places.
#[derive(Debug)]
pub(super) struct Shared {
    /// Of these meshes alone, never of instances.
    pub(super) scene: SceneBuilder,
    bounds: Bounds,
    is_empty: bool,
}

/// An instance to come.
#[derive(Debug)]
pub(super) struct Placed {
    /// Index of what is shared.
    shared: usize,
    to_scene: Affine3A,
    id: u32,
}

impl SceneBuilder {
    /// Adds meshes at their places; those with a transform are held once however many places they
    /// have. Neighbors in the list that are moved together become one instance: rays meet fewer.
    ///
    /// # Errors
    /// As [`add_mesh`](Self::add_mesh) and [`place`](Self::place).
    ///
    /// # Panics
    /// If a place names a mesh that there is not.
    pub fn add(&mut self, geometry: &Geometry<'_>) -> Result<(), EmbreeError> {
        let mut shared = HashMap::new();
        // Meshes that follow another in the list are parts of one thing; two places of one mesh are not.
        let together = |a: &Instance, b: &Instance| a.to_scene == b.to_scene && a.mesh < b.mesh;
        for places in geometry.instances.chunk_by(together) {
            let meshes: Vec<_> = places.iter().map(|place| geometry.mesh(place)).collect();
            let Some(to_scene) = places[0].to_scene else {
                meshes.into_iter().try_for_each(|mesh| self.add_mesh(mesh).map(|_| ()))?;
                continue;
            };
            let names: Vec<u32> = places.iter().map(|place| place.mesh).collect();
            let id = match shared.entry(names) {
                Entry::Occupied(known) => *known.get(),
                Entry::Vacant(new) => *new.insert(self.share(&meshes)?),
            };
            self.place(id, to_scene)?;
        }
        Ok(())
    }

    /// Copies meshes into the scene that get their places, all of them together, by
    /// [`place`](Self::place).
    ///
    /// # Errors
    /// As [`add_mesh`](Self::add_mesh).
    pub fn share(&mut self, meshes: &[TriangleMesh<'_>]) -> Result<SharedId, EmbreeError> {
        let mut scene = Self::new(&self.device)?;
        scene.set_watertight(self.watertight)?;
        for &mesh in meshes {
            scene.add_mesh(mesh).map_err(|error| self.about_next(error))?;
        }
        let points = meshes.iter().flat_map(|mesh| mesh.positions).copied();
        let bounds = points.fold(Bounds::EMPTY, Bounds::with);
        let is_empty = meshes.iter().all(|mesh| mesh.triangles.is_empty());
        self.shared.push(Shared { scene, bounds, is_empty });
        Ok(SharedId(self.shared.len() - 1))
    }

    /// Puts shared meshes to a place; the id is that of the first of them, and the others' follow. Rays
    /// are transformed in f32: where they hit is off by rounding errors of the coordinates on both
    /// sides of the transform.
    ///
    /// # Errors
    /// [`EmbreeError::Mesh`] if the transform is nothing for numbers, or moves the mesh out of their
    /// range; [`EmbreeError::TooManyMeshes`] if there are not enough ids left. The scene is then as it
    /// was before.
    ///
    /// # Panics
    /// If another builder made the id, and this one has no such meshes.
    pub fn place(&mut self, id: SharedId, to_scene: DAffine3) -> Result<GeomId, EmbreeError> {
        let mesh = self.meshes;
        let Shared { scene, bounds, is_empty } = &self.shared[id.0];
        let transform = instance_transform(to_scene)
            .and_then(|transform| match beyond(bounds, to_scene) {
                Some(position) if !is_empty => Err(MeshError::TooFar { position }),
                _ => Ok(transform),
            })
            .map_err(|problem| EmbreeError::Mesh { mesh, problem })?;
        let meshes = self.meshes_with(scene.meshes)?;
        if !is_empty {
            self.placed.push(Placed { shared: id.0, to_scene: transform, id: mesh });
        }
        self.meshes = meshes;
        Ok(GeomId(mesh))
    }

    /// Builds what is shared, and only then makes the instances of it, as Embree wants.
    pub(super) fn commit_instances(&mut self) -> Result<(), EmbreeError> {
        let shared = std::mem::take(&mut self.shared).into_iter();
        let shared = shared.map(|shared| shared.scene.commit()).collect::<Result<Vec<_>, _>>()?;
        for Placed { shared: index, to_scene, id } in std::mem::take(&mut self.placed) {
            // What is shared holds no instances, so there is one level of them.
            let instance = GeometryHandle::instance(&self.device, &shared[index], &to_scene)?;
            self.attach(&instance, id)?;
        }
        // Dropped here: its instances hold what Embree needs of it.
        self.triangles += shared.iter().map(CommittedScene::triangles).sum::<usize>();
        Ok(())
    }

    /// An error about a mesh of another scene, if its meshes were added to this one.
    fn about_next(&self, error: EmbreeError) -> EmbreeError {
        match error {
            EmbreeError::Mesh { mesh, problem } => {
                EmbreeError::Mesh { mesh: self.meshes.saturating_add(mesh), problem }
            }
            other => other,
        }
    }
}

/// A corner of the box that moves out of the range of coordinates.
fn beyond(bounds: &Bounds, to_scene: DAffine3) -> Option<Vec3> {
    let sides = [bounds.min.as_dvec3(), bounds.max.as_dvec3()];
    (0..8)
        .map(|corner| DVec3::from_array([0, 1, 2].map(|axis| sides[corner >> axis & 1][axis])))
        .map(|corner| to_scene.transform_point3(corner).as_vec3())
        .find(|position| position.abs().max_element() > TriangleMesh::MAX_COORDINATE)
}
