//! Decides for each mesh whether the scene stores it once and instantiates it, or copies it to each
//! placement.

use bdpm_core::accel::TriangleMesh;
use bdpm_core::base::math::Bounds;
use bdpm_core::scene::transform::Transform;
use bdpm_core::scene::{Arrangement, Mesh, Placement, triangle_area};
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
    meshes: Vec<Arc<Mesh>>,
    bounds: Bounds,
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
        let is_instance = transform.suits_instances() && transform.reach(&group.bounds) < MAX_REACH;
        if is_instance {
            group.instances += 1;
        } else {
            let mut points = group.meshes.iter().flat_map(|mesh| &mesh.positions);
            points.try_for_each(|point| transform.point(*point).map(|_| ()))?;
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
            for ((source, material), mesh) in sources.zip(&one.materials).zip(first..) {
                if first == next {
                    let moved = if transform.is_some() { None } else { Some(&one.transform) };
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
        let meshes: Vec<_> = parts.iter().map(|part| part.mesh.clone()).collect();
        let points = meshes.iter().flat_map(|mesh| &mesh.positions).copied();
        let bounds = points.fold(Bounds::EMPTY, Bounds::with);
        let triangles = meshes.iter().map(|mesh| mesh.triangles.len() as u64).sum();
        Self { meshes, bounds, triangles, instances: 0 }
    }

    fn is_shared(&self) -> bool {
        let copies = self.instances.saturating_sub(1).saturating_mul(self.triangles);
        self.instances > 1 && self.triangles >= MIN_TRIANGLES && copies >= MIN_COPIES
    }
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
