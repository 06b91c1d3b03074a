//! The meshes of a file, each read once however often it is placed, and the materials in use.

use super::buffers::Buffers;
use super::geometry::{self, MeshRequest, PrimitiveReader};
use super::json::{GltfDocument, Primitive, get};
use super::material::GltfLook;
use super::nodes::SceneNode;
use super::pose::Pose;
use super::texture::{GltfTextures, UvSource};
use super::{first_name, instances, malformed, material};
use crate::shape::instancing::MaterialMesh;
use bdpm_core::base::error::Result;
use bdpm_core::scene::Material;
use std::collections::hash_map::{Entry, HashMap};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Reads meshes and their materials.
pub(super) struct MeshReader<'a> {
    buffers: &'a Buffers<'a>,
    pub textures: GltfTextures<'a>,
    /// Meshes by their index, and by the node if that has a pose of its own.
    read: HashMap<(usize, Option<usize>), Vec<MaterialMesh>>,
    /// By index, or `None` for the standard's default material. Invisible materials have no use.
    material_uses: HashMap<Option<usize>, Option<MaterialUse>>,
    /// Names of materials without any opacity.
    pub invisible: BTreeSet<String>,
}

/// The properties of a material that its meshes need.
#[derive(Clone, Copy)]
struct MaterialUse {
    /// Index of the material in the scene.
    material: u32,
    /// Source of the coordinates of its textures.
    uv_source: Option<UvSource>,
    has_normal_map: bool,
    /// Whether colors of vertices tint it.
    is_tinted: bool,
}

/// Number of triangles of all meshes.
pub(super) struct TriangleCounts {
    /// Counted at each placement.
    pub placed: u64,
    /// Each mesh counted once.
    pub stored: u64,
}

/// Counts the triangles of all meshes without reading them.
pub(super) fn triangle_counts(
    document: &GltfDocument,
    nodes: &[SceneNode],
) -> Result<TriangleCounts> {
    let mut counts: HashMap<usize, u64> = HashMap::new();
    // Each use of a sparse accessor reads all its items.
    let (mut placed, mut replaced): (u64, u64) = (0, 0);
    for node in nodes.iter().filter(|node| !node.is_hidden) {
        let Some(index) = node.json.mesh else { continue };
        if let Entry::Vacant(entry) = counts.entry(index) {
            let element = format!("nodes[{}].mesh", node.index);
            let mesh = get(&document.meshes, "meshes", index, element)?;
            let mut count: u64 = 0;
            for (part, primitive) in mesh.primitives.iter().enumerate() {
                let element = format!("meshes[{index}].primitives[{part}]");
                let own = geometry::triangle_count(document, primitive, &element)?;
                count = count.saturating_add(own.unwrap_or(0));
                replaced = replaced.saturating_add(sparse_items(document, primitive));
            }
            if replaced > u64::from(u32::MAX) {
                let problem = "sparse accessors replace more elements than can be read";
                return Err(malformed(format!("meshes[{index}]"), problem));
            }
            entry.insert(count);
        }
        let placements = instances::count(document, node)?;
        placed = placed.saturating_add(counts[&index].saturating_mul(placements));
    }
    Ok(TriangleCounts { placed, stored: counts.into_values().fold(0, u64::saturating_add) })
}

/// Number of items that the sparse accessors of a primitive replace.
fn sparse_items(document: &GltfDocument, primitive: &Primitive) -> u64 {
    let targets = primitive.targets.iter().flat_map(BTreeMap::values);
    let used = primitive.attributes.values().chain(&primitive.indices).chain(targets);
    let accessors = used.filter_map(|index| document.accessors.get(*index));
    let sparse = accessors.filter_map(|accessor| accessor.sparse.as_ref());
    sparse.fold(0, |sum, sparse| sum.saturating_add(sparse.count))
}

impl<'a> MeshReader<'a> {
    pub fn new(buffers: &'a Buffers<'a>, textures: GltfTextures<'a>) -> Self {
        Self {
            buffers,
            textures,
            read: HashMap::new(),
            material_uses: HashMap::new(),
            invisible: BTreeSet::new(),
        }
    }

    /// The mesh of this index, which exists, in the pose of a node: one mesh per primitive.
    /// Materials are added to the scene with their first use.
    pub fn get(
        &mut self,
        index: usize,
        node: &SceneNode,
        pose: &Pose,
        materials: &mut Vec<Material>,
    ) -> Result<&[MaterialMesh]> {
        let has_own_pose = node.json.weights.is_some() || node.json.skin.is_some();
        let key = (index, has_own_pose.then_some(node.index));
        if !self.read.contains_key(&key) {
            let meshes = self.read(index, pose, materials)?;
            self.read.insert(key, meshes);
        }
        Ok(&self.read[&key])
    }

    fn read(
        &mut self,
        index: usize,
        pose: &Pose,
        materials: &mut Vec<Material>,
    ) -> Result<Vec<MaterialMesh>> {
        let document = self.buffers.document;
        let mesh = get(&document.meshes, "meshes", index, "nodes")?;
        let name = first_name([&mesh.name], || format!("meshes[{index}]"));
        let mut meshes = Vec::new();
        for (part, primitive) in mesh.primitives.iter().enumerate() {
            let element = format!("meshes[{index}].primitives[{part}]");
            if geometry::triangle_count(document, primitive, &element)?.is_none() {
                self.textures.warnings.skipped("ignored the points or lines of", &name);
                continue;
            }
            let material_use = self.material_use(primitive.material, &element, materials)?;
            let Some(MaterialUse { material, uv_source, has_normal_map, is_tinted }) = material_use
            else {
                continue;
            };
            if !is_tinted && primitive.attributes.contains_key("COLOR_0") {
                self.textures.warnings.skipped("ignored the vertex colors of glass in", &name);
            }
            let own = primitive.material.and_then(|index| document.materials.get(index));
            let is_blended = own
                .and_then(|material| material.alpha_mode.as_deref())
                .is_some_and(|mode| mode != "OPAQUE");
            let reader = PrimitiveReader { buffers: self.buffers, primitive, element: &element };
            if is_blended && reader.has_translucent_colors()? {
                self.textures
                    .warnings
                    .skipped("ignored the opacity of the vertex colors of", &name);
            }
            let uv_source = uv_source.as_ref();
            let mesh = reader.mesh(&MeshRequest {
                uv_source,
                tangents: has_normal_map,
                colors: is_tinted,
                pose,
            })?;
            if !mesh.triangles.is_empty() {
                meshes.push(MaterialMesh::new(Arc::new(mesh), material));
            }
        }
        Ok(meshes)
    }

    fn material_use(
        &mut self,
        index: Option<usize>,
        element: &str,
        materials: &mut Vec<Material>,
    ) -> Result<Option<MaterialUse>> {
        if let Some(known) = self.material_uses.get(&index) {
            return Ok(*known);
        }
        let element = format!("{element}.material");
        let GltfLook { name, look, uv_source } =
            material::look(self.buffers.document, &mut self.textures, index, &element)?;
        let material_use = look.map(|look| {
            let material = look.named(&name);
            let uv_source = uv_source.filter(|_| material.is_textured());
            let has_normal_map = material.normal_map.is_some();
            let is_tinted = !material.bsdf.transmits() || material.bsdf.transmits_diffusely();
            materials.push(material);
            let material = materials.len() as u32 - 1;
            MaterialUse { material, uv_source, has_normal_map, is_tinted }
        });
        if material_use.is_none() {
            self.invisible.insert(name);
        }
        self.material_uses.insert(index, material_use);
        Ok(material_use)
    }
}
