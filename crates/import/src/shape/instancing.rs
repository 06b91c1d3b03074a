//! Decides for each mesh whether the scene stores it once and instantiates it, or copies it to each
//! placement.

use crate::far::DBounds;
use bdpm_core::accel::TriangleMesh;
use bdpm_core::scene::transform::Transform;
use bdpm_core::scene::{Arrangement, Mesh, Placement, triangle_area};
use glam::DVec3;
use std::collections::HashMap;
use std::sync::Arc;

/// Groups with fewer triangles are copied: testing them costs a ray no more than entering an
/// instance.
const MIN_TRIANGLES: u64 = 100;

/// Groups are copied if their copies have fewer triangles in total. Rays are slower where they
/// enter an instance, and hits there take longer to shade (`docs/measurements/performance.md`).
const MIN_COPIES: u64 = 10_000;

/// Instances must stay within the range of the acceleration structures.
const MAX_REACH: f64 = TriangleMesh::MAX_COORDINATE as f64 * 0.999;

/// A mesh with the index of its material.
#[derive(Clone)]
pub struct MaterialMesh {
    pub mesh: Arc<Mesh>,
    pub material: u32,
    /// Point to which the positions of the mesh are relative, in the coordinates of its file.
    pub origin: DVec3,
}

impl MaterialMesh {
    /// A mesh whose positions are those of its file.
    pub fn new(mesh: Arc<Mesh>, material: u32) -> Self {
        Self { mesh, material, origin: DVec3::ZERO }
    }
}

/// Groups of meshes, as files define them, with all their placements.
#[derive(Default)]
pub struct MeshGroups {
    groups: Vec<MeshGroup>,
    /// Index of each group by the address of its first mesh, which the group keeps alive.
    group_index: HashMap<*const Mesh, usize>,
    uses: Vec<GroupUse>,
}

/// Meshes that are always placed together.
struct MeshGroup {
    /// Each with its origin in the coordinates of the group.
    meshes: Vec<(Arc<Mesh>, DVec3)>,
    bounds: DBounds,
    triangles: u64,
    /// Number of placements that an instance can have.
    instances: u64,
}

struct GroupUse {
    group: usize,
    /// Name of all meshes, in place of their own.
    name: Option<String>,
    /// Material of each mesh.
    materials: Vec<u32>,
    transform: Transform,
    is_instance: bool,
}

impl MeshGroups {
    /// Places a group of meshes, which are always the same in the same order. Their names are
    /// `name`, if it is given. `None` if a point moves out of range.
    pub fn add(
        &mut self,
        name: Option<&str>,
        parts: &[MaterialMesh],
        transform: &Transform,
    ) -> Option<()> {
        let Some(first) = parts.first() else { return Some(()) };
        let index = *self.group_index.entry(Arc::as_ptr(&first.mesh)).or_insert_with(|| {
            self.groups.push(MeshGroup::new(parts));
            self.groups.len() - 1
        });
        let group = &mut self.groups[index];
        let is_instance = transform.suits_instances() && reach(transform, group.bounds) < MAX_REACH;
        if is_instance {
            group.instances += 1;
        } else {
            for (mesh, origin) in &group.meshes {
                let transform = transform.relative_from(*origin);
                let mut points = mesh.positions.iter();
                points.try_for_each(|point| transform.point(*point).map(|_| ()))?;
            }
        }
        self.uses.push(GroupUse {
            group: index,
            name: name.map(str::to_owned),
            materials: parts.iter().map(|part| part.material).collect(),
            transform: *transform,
            is_instance,
        });
        Some(())
    }

    pub fn is_empty(&self) -> bool {
        self.uses.is_empty()
    }

    /// A box around all placements. It is larger than they are where they are turned.
    pub fn bounds(&self) -> DBounds {
        let of_one = |one: &GroupUse| {
            let corners = self.groups[one.group].bounds.corners();
            corners.map(|corner| one.transform.point_exact(corner)).collect::<Vec<_>>()
        };
        self.uses
            .iter()
            .flat_map(of_one)
            .filter(|p| p.is_finite())
            .fold(DBounds::EMPTY, DBounds::with)
    }

    /// Number of triangles that the scene will store, including those without area.
    pub fn stored(&self) -> u64 {
        let shared = self.groups.iter().filter(|group| group.is_shared());
        let copied = self.uses.iter().filter(|one| !self.is_shared(one));
        let copied = copied.map(|one| &self.groups[one.group]);
        shared.chain(copied).fold(0, |sum, group| sum.saturating_add(group.triangles))
    }

    /// Places all meshes without their triangles of no area, and returns the number of these
    /// triangles as well.
    pub fn arrange(self) -> (Arrangement, u64) {
        let Arrangement { mut meshes, mut placements } = Arrangement::default();
        let mut dropped = 0;
        // Index of the first mesh of each shared group.
        let mut stored: HashMap<usize, u32> = HashMap::new();
        for one in &self.uses {
            let sources = self.groups[one.group].meshes.iter();
            let next = meshes.len() as u32;
            let transform = self.is_shared(one).then_some(one.transform);
            let first = match transform {
                Some(_) => *stored.entry(one.group).or_insert(next),
                None => next,
            };
            for (((source, origin), material), mesh) in sources.zip(&one.materials).zip(first..) {
                let transform = transform.map(|map| map.relative_from(*origin));
                let own = one.transform.relative_from(*origin);
                if first == next {
                    let moved = if transform.is_some() { None } else { Some(&own) };
                    let name = one.name.as_ref().unwrap_or(&source.name).clone();
                    meshes.push(with_area(Mesh {
                        name,
                        material: *material,
                        ..moved.map_or_else(|| (**source).clone(), |map| source.moved(map))
                    }));
                }
                let mesh = if transform.is_some() { mesh } else { meshes.len() as u32 - 1 };
                let count = meshes[mesh as usize].triangles.len();
                dropped += (source.triangles.len() - count) as u64;
                if count > 0 {
                    placements.push(Placement { mesh, material: *material, transform });
                } else if transform.is_none() {
                    meshes.pop();
                }
            }
        }
        (Arrangement { meshes, placements }, dropped)
    }

    fn is_shared(&self, one: &GroupUse) -> bool {
        one.is_instance && self.groups[one.group].is_shared()
    }
}

impl MeshGroup {
    fn new(parts: &[MaterialMesh]) -> Self {
        let meshes: Vec<_> = parts.iter().map(|part| (part.mesh.clone(), part.origin)).collect();
        let points = meshes.iter().flat_map(|(mesh, origin)| {
            mesh.positions.iter().map(move |point| point.as_dvec3() + *origin)
        });
        let bounds = points.fold(DBounds::EMPTY, DBounds::with);
        let triangles = meshes.iter().map(|(mesh, _)| mesh.triangles.len() as u64).sum();
        Self { meshes, bounds, triangles, instances: 0 }
    }

    fn is_shared(&self) -> bool {
        let copies = self.instances.saturating_sub(1).saturating_mul(self.triangles);
        self.instances > 1 && self.triangles >= MIN_TRIANGLES && copies >= MIN_COPIES
    }
}

/// Largest coordinate of the transformed corners of a box; arbitrary if the box is empty.
fn reach(transform: &Transform, bounds: DBounds) -> f64 {
    let moved = bounds.corners().map(|corner| transform.point_exact(corner));
    moved.fold(0.0, |reach: f64, corner| reach.max(corner.abs().max_element()))
}

/// The mesh without its triangles of no area.
fn with_area(mut mesh: Mesh) -> Mesh {
    let Mesh { positions, triangles, .. } = &mut mesh;
    let count = triangles.len();
    triangles.retain(|corners| triangle_area(corners.map(|i| positions[i as usize])) > 0.0);
    if triangles.len() < count {
        mesh.renumber();
    }
    mesh
}
