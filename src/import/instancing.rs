//! Which meshes a scene holds once for all of their places, and which it copies to each.

use crate::accel::TriangleMesh;
use crate::base::math::Bounds;
use crate::scene::transform::Transform;
use crate::scene::{Arrangement, Mesh, Placement, triangle_area};
use std::collections::HashMap;
use std::sync::Arc;

/// What has fewer triangles is copied: for entering an instance a ray could as well test some.
const LEAST: u64 = 100;

/// So is that of which all copies take fewer triangles: rays are slower where they enter an instance,
/// and hits there take longer to shade (`docs/performance.md`).
const WORTHWHILE: u64 = 10_000;

/// Instances must stay within the range of what finds intersections.
const LARGEST: f64 = TriangleMesh::MAX_COORDINATE as f64 * 0.999;

/// A mesh at one of its places.
pub(super) struct Part<'a> {
    pub name: &'a str,
    pub mesh: &'a Arc<Mesh>,
    /// Index of the material there.
    pub material: u32,
}

/// Meshes, as they come from files, with all their places.
#[derive(Default)]
pub(super) struct Uses {
    things: Vec<Thing>,
    /// Of each thing by the address of its first mesh, which stays there.
    thing_index: HashMap<*const Mesh, usize>,
    uses: Vec<Use>,
}

/// Meshes that are always moved together.
struct Thing {
    meshes: Vec<Arc<Mesh>>,
    bounds: Bounds,
    triangles: u64,
    /// Number of places that instances can have.
    instances: u64,
}

struct Use {
    thing: usize,
    /// Of each mesh, its name and material.
    looks: Vec<(String, u32)>,
    transform: Transform,
    is_instance: bool,
}

impl Uses {
    /// Adds meshes at a place: of those that belong together, always the same ones in the same order.
    /// `None` if a point moves out of range.
    pub fn add(&mut self, parts: &[Part<'_>], transform: &Transform) -> Option<()> {
        let Some(first) = parts.first() else { return Some(()) };
        let thing = *self.thing_index.entry(Arc::as_ptr(first.mesh)).or_insert_with(|| {
            self.things.push(Thing::new(parts));
            self.things.len() - 1
        });
        let known = &mut self.things[thing];
        let is_instance = transform.suits_instances() && transform.reach(&known.bounds) < LARGEST;
        if is_instance {
            known.instances += 1;
        } else {
            let mut points = known.meshes.iter().flat_map(|mesh| &mesh.positions);
            points.try_for_each(|point| transform.point(*point).map(|_| ()))?;
        }
        let looks = parts.iter().map(|part| (part.name.to_owned(), part.material)).collect();
        self.uses.push(Use { thing, looks, transform: *transform, is_instance });
        Some(())
    }

    /// Whether nothing was added.
    pub fn is_empty(&self) -> bool {
        self.uses.is_empty()
    }

    /// Number of triangles that the scene will hold, those without area included.
    pub fn stored(&self) -> u64 {
        let shared = self.things.iter().filter(|thing| thing.is_shared());
        let copied = self.uses.iter().filter(|one| !self.is_shared(one));
        let copied = copied.map(|one| &self.things[one.thing]);
        shared.chain(copied).fold(0, |sum, thing| sum.saturating_add(thing.triangles))
    }

    /// Puts all at their places, without triangles of no area, of which it tells the number.
    pub fn arrange(self) -> (Arrangement, u64) {
        let Arrangement { mut meshes, mut placements } = Arrangement::default();
        let mut dropped = 0;
        // Of the first mesh of each shared thing.
        let mut held: HashMap<usize, u32> = HashMap::new();
        for one in &self.uses {
            let sources = self.things[one.thing].meshes.iter();
            let next = meshes.len() as u32;
            let transform = self.is_shared(one).then_some(one.transform);
            let first = match transform {
                Some(_) => *held.entry(one.thing).or_insert(next),
                None => next,
            };
            for ((source, (name, material)), mesh) in sources.zip(&one.looks).zip(first..) {
                if first == next {
                    let moved = if transform.is_some() { None } else { Some(&one.transform) };
                    meshes.push(placed(source, name, moved, *material));
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

    fn is_shared(&self, one: &Use) -> bool {
        one.is_instance && self.things[one.thing].is_shared()
    }
}

impl Thing {
    fn new(parts: &[Part<'_>]) -> Self {
        let meshes: Vec<_> = parts.iter().map(|part| part.mesh.clone()).collect();
        let points = meshes.iter().flat_map(|mesh| &mesh.positions).copied();
        let bounds = points.fold(Bounds::EMPTY, Bounds::with);
        let triangles = meshes.iter().map(|mesh| mesh.triangles.len() as u64).sum();
        Self { meshes, bounds, triangles, instances: 0 }
    }

    fn is_shared(&self) -> bool {
        let copies = self.instances.saturating_sub(1).saturating_mul(self.triangles);
        self.instances > 1 && self.triangles >= LEAST && copies >= WORTHWHILE
    }
}

/// A mesh, moved if it is, without its triangles of no area.
fn placed(mesh: &Mesh, name: &str, transform: Option<&Transform>, material: u32) -> Mesh {
    let moved = transform.map_or_else(|| mesh.clone(), |transform| mesh.moved(transform));
    let mut own = Mesh { name: name.to_owned(), material, ..moved };
    let Mesh { positions, triangles, .. } = &mut own;
    let count = triangles.len();
    triangles.retain(|corners| triangle_area(corners.map(|i| positions[i as usize])) > 0.0);
    if triangles.len() < count {
        own.renumber();
    }
    own
}
