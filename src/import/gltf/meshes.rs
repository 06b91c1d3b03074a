//! The meshes of a file, each read once however often it is placed, and the materials in use.

use super::buffers::Buffers;
use super::geometry::Wanted;
use super::json::{Document, Primitive, get};
use super::nodes::Placed;
use super::pose::Pose;
use super::texture::{Pictures, UvSource};
use super::warnings::Remarks;
use super::{factors, fault, first_name, geometry, instances, material};
use crate::base::error::Result;
use crate::scene::{Material, Mesh};
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

/// The parts of a mesh, with the indices of their materials in the scene.
type Parts = Vec<(Arc<Mesh>, u32)>;

/// What is read of meshes and materials.
pub(super) struct Meshes<'a> {
    document: &'a Document,
    /// By index, and by the node for a pose of its own: the parts of a mesh, with the indices of their materials
    /// in the scene.
    read: HashMap<(usize, Option<usize>), Parts>,
    /// By index, or none for the standard's default; none for those that are nowhere to be seen.
    looks: HashMap<Option<usize>, Option<Look>>,
    /// Names of materials that are nowhere to be seen.
    pub hidden: BTreeSet<String>,
    pub remarks: Remarks,
}

/// What a mesh needs to know of its material.
#[derive(Clone, Copy)]
struct Look {
    /// Index of the material in the scene.
    material: u32,
    /// Of its textures.
    uv_source: Option<UvSource>,
    /// Whether it bends normals.
    bends: bool,
    /// Whether colors of vertices tint it.
    tints: bool,
}

impl<'a> Meshes<'a> {
    pub fn new(document: &'a Document) -> Self {
        let remarks = Remarks::default();
        let (read, looks) = (HashMap::new(), HashMap::new());
        Self { document, read, looks, hidden: BTreeSet::new(), remarks }
    }

    /// Number of triangles of all meshes: at all their places, and each counted once. Nothing is read
    /// for it.
    pub fn triangle_counts(&self, nodes: &[Placed]) -> Result<[u64; 2]> {
        let mut counts: HashMap<usize, u64> = HashMap::new();
        // Elements of sparse accessors are looked at with each use.
        let (mut all, mut replaced): (u64, u64) = (0, 0);
        for placed in nodes {
            let Some(index) = placed.node.mesh else { continue };
            let count = match counts.get(&index) {
                Some(count) => *count,
                None => {
                    let place = format!("nodes[{}].mesh", placed.index);
                    let mesh = get(&self.document.meshes, "meshes", index, place)?;
                    let mut count: u64 = 0;
                    for (part, primitive) in mesh.primitives.iter().enumerate() {
                        let place = format!("meshes[{index}].primitives[{part}]");
                        let own = geometry::triangle_count(self.document, primitive, &place)?;
                        count = count.saturating_add(own.unwrap_or(0));
                        replaced = replaced.saturating_add(self.replaced(primitive));
                    }
                    if replaced > u64::from(u32::MAX) {
                        let problem =
                            "sparse accessors replace more elements than can be looked at";
                        return Err(fault(format!("meshes[{index}]"), problem));
                    }
                    counts.insert(index, count);
                    count
                }
            };
            let places = instances::count(self.document, placed)?;
            all = all.saturating_add(count.saturating_mul(places));
        }
        Ok([all, counts.into_values().fold(0, u64::saturating_add)])
    }

    /// Number of elements that the sparse accessors of a primitive replace.
    fn replaced(&self, primitive: &Primitive) -> u64 {
        let targets = primitive.targets.iter().flat_map(BTreeMap::values);
        let used = primitive.attributes.values().chain(&primitive.indices).chain(targets);
        let accessors = used.filter_map(|index| self.document.accessors.get(*index));
        let sparse = accessors.filter_map(|accessor| accessor.sparse.as_ref());
        sparse.fold(0, |sum, sparse| sum.saturating_add(sparse.count))
    }

    /// The parts of the mesh of this index, which exists, in a pose. Materials become part of the scene with
    /// their first use.
    pub fn get(
        &mut self,
        (index, placed): (usize, &Placed),
        pose: &Pose,
        buffers: &Buffers,
        pictures: &mut Pictures,
        materials: &mut Vec<Material>,
    ) -> Result<&[(Arc<Mesh>, u32)]> {
        let is_own = placed.node.weights.is_some() || placed.node.skin.is_some();
        let key = (index, is_own.then_some(placed.index));
        if !self.read.contains_key(&key) {
            let parts = self.parts((index, pose), buffers, pictures, materials)?;
            self.read.insert(key, parts);
        }
        Ok(&self.read[&key])
    }

    fn parts(
        &mut self,
        (index, pose): (usize, &Pose),
        buffers: &Buffers,
        pictures: &mut Pictures,
        materials: &mut Vec<Material>,
    ) -> Result<Parts> {
        let document = self.document;
        let mesh = get(&document.meshes, "meshes", index, "nodes")?;
        let name = first_name([&mesh.name], || format!("meshes[{index}]"));
        let mut parts = Vec::new();
        for (part, primitive) in mesh.primitives.iter().enumerate() {
            let place = format!("meshes[{index}].primitives[{part}]");
            if geometry::triangle_count(document, primitive, &place)?.is_none() {
                self.remarks.skipped("ignored the points or lines of", &name);
                continue;
            }
            let look = self.look(primitive.material, &place, pictures, materials)?;
            let Some(Look { material, uv_source, bends, tints }) = look else { continue };
            if !tints && primitive.attributes.contains_key("COLOR_0") {
                self.remarks.skipped("ignored the vertex colors of glass in", &name);
            }
            let own = primitive.material.and_then(|index| document.materials.get(index));
            let blends = own
                .and_then(|material| material.alpha_mode.as_deref())
                .is_some_and(|mode| mode != "OPAQUE");
            if blends && geometry::has_translucent_colors(document, buffers, primitive, &place)? {
                self.remarks.skipped("ignored the opacity of the vertex colors of", &name);
            }
            let wanted =
                Wanted { uv_source: uv_source.as_ref(), tangents: bends, colors: tints, pose };
            let mesh = geometry::read(document, buffers, primitive, &wanted, &place)?;
            if !mesh.triangles.is_empty() {
                parts.push((Arc::new(mesh), material));
            }
        }
        Ok(parts)
    }

    fn look(
        &mut self,
        index: Option<usize>,
        place: &str,
        pictures: &mut Pictures,
        materials: &mut Vec<Material>,
    ) -> Result<Option<Look>> {
        if let Some(look) = self.looks.get(&index) {
            return Ok(*look);
        }
        let place = format!("{place}.material");
        let factors = factors::factors(self.document, pictures, index, &place)?;
        let look = material::material(&factors, &mut self.remarks).map(|material| {
            let uv_source = factors.uv_source.filter(|_| material.is_textured());
            let bends = material.normal_map.is_some();
            let tints = !material.bsdf.transmits();
            materials.push(material);
            Look { material: materials.len() as u32 - 1, uv_source, bends, tints }
        });
        if look.is_none() {
            self.hidden.insert(factors.name);
        }
        self.looks.insert(index, look);
        Ok(look)
    }
}
