//! Which meshes a scene holds once for all of their places, and which it copies to each.

use super::transform::Transform;
use super::{Arrangement, Mesh, Placement, triangle_area};
use crate::accel::TriangleMesh;
use crate::math::Bounds;
use glam::Vec3;
use std::collections::HashMap;
use std::sync::Arc;

/// A mesh is held once if copies would take so many triangles more: rays are slower where they enter
/// an instance, and hits there take longer to shade (`docs/performance.md`).
const WORTHWHILE: u64 = 10_000;
fn worthwhile() -> u64 {
    std::env::var("BDPM_SHARE").ok().and_then(|v| v.parse().ok()).unwrap_or(WORTHWHILE)
}

/// Meshes, as they come from files, with all their places.
#[derive(Default)]
pub(super) struct Uses {
    sources: Vec<Source>,
    /// Of each mesh by its address; the sources keep it there.
    source_index: HashMap<*const Mesh, usize>,
    uses: Vec<Use>,
}

struct Source {
    mesh: Arc<Mesh>,
    bounds: Bounds,
    /// Number of places that instances can have.
    instances: u64,
}

struct Use {
    source: usize,
    name: String,
    transform: Transform,
    material: u32,
    is_instance: bool,
}

impl Uses {
    /// Adds a mesh at a place; `None` if a point moves out of range.
    pub fn add(
        &mut self,
        name: &str,
        mesh: &Arc<Mesh>,
        transform: &Transform,
        material: u32,
    ) -> Option<()> {
        let source = *self.source_index.entry(Arc::as_ptr(mesh)).or_insert_with(|| {
            let bounds = mesh.positions.iter().copied().fold(Bounds::EMPTY, Bounds::with);
            self.sources.push(Source { mesh: mesh.clone(), bounds, instances: 0 });
            self.sources.len() - 1
        });
        let known = &mut self.sources[source];
        let is_instance = transform.suits_instances() && transform.reach(&known.bounds) < LARGEST;
        if is_instance {
            known.instances += 1;
        } else if mesh.positions.iter().any(|point| transform.point(*point).is_none()) {
            return None;
        }
        let (name, transform) = (name.to_owned(), *transform);
        self.uses.push(Use { source, name, transform, material, is_instance });
        Some(())
    }

    /// Number of triangles that the scene will hold, those without area included.
    pub fn stored(&self) -> u64 {
        let count = |source: &Source| source.mesh.triangles.len() as u64;
        let shared = self.sources.iter().filter(|source| source.is_shared()).map(count);
        let copied = self.uses.iter().filter(|one| !self.is_shared(one));
        shared.sum::<u64>() + copied.map(|one| count(&self.sources[one.source])).sum::<u64>()
    }

    /// Puts all at their places, without triangles of no area, of which it tells the number.
    pub fn arrange(self) -> (Arrangement, u64) {
        let Arrangement { mut meshes, mut placements } = Arrangement::default();
        let mut dropped = 0;
        // Of the shared ones, by source.
        let mut held: HashMap<usize, u32> = HashMap::new();
        for one in &self.uses {
            let source = &self.sources[one.source].mesh;
            let next = meshes.len() as u32;
            let (mesh, transform) = if self.is_shared(one) {
                let mesh = *held.entry(one.source).or_insert_with(|| {
                    meshes.push(held_once(source, &one.name, one.material));
                    next
                });
                (mesh, Some(one.transform))
            } else {
                meshes.push(placed(source, &one.name, &one.transform, one.material));
                (next, None)
            };
            let count = meshes[mesh as usize].triangles.len();
            dropped += (source.triangles.len() - count) as u64;
            if count > 0 {
                placements.push(Placement { mesh, material: one.material, transform });
            } else if transform.is_none() {
                meshes.pop();
            }
        }
        (Arrangement { meshes, placements }, dropped)
    }

    fn is_shared(&self, one: &Use) -> bool {
        one.is_instance && self.sources[one.source].is_shared()
    }
}

/// Instances must stay within the range of what finds intersections.
const LARGEST: f64 = TriangleMesh::MAX_COORDINATE as f64 * 0.999;

impl Source {
    fn is_shared(&self) -> bool {
        let copies = self.instances.saturating_sub(1);
        copies > 0 && copies.saturating_mul(self.mesh.triangles.len() as u64) >= worthwhile()
    }
}

/// A mesh in its own space, without its triangles of no area.
fn held_once(mesh: &Mesh, name: &str, material: u32) -> Mesh {
    let has_area =
        |corners: &[u32; 3]| triangle_area(corners.map(|i| mesh.positions[i as usize])) > 0.0;
    let triangles = mesh.triangles.iter().copied().filter(has_area).collect();
    Mesh { name: name.to_owned(), triangles, material, ..mesh.clone() }
}

/// A mesh moved, without its triangles of no area.
fn placed(mesh: &Mesh, name: &str, transform: &Transform, material: u32) -> Mesh {
    // All points are in range.
    let moved = |point: &Vec3| transform.point(*point).unwrap_or_default();
    let positions: Vec<Vec3> = mesh.positions.iter().map(moved).collect();
    let corners = mesh.triangles.iter().map(|corners| transform.corners(*corners));
    let triangles = corners
        .filter(|corners| triangle_area(corners.map(|i| positions[i as usize])) > 0.0)
        .collect();
    Mesh {
        name: name.to_owned(),
        positions,
        normals: mesh.normals.iter().map(|n| transform.normal(*n)).collect(),
        uvs: mesh.uvs.clone(),
        tangents: mesh.tangents.iter().map(|t| transform.tangent(*t)).collect(),
        triangles,
        material,
    }
}
