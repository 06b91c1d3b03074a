//! Many placements of a node's mesh (`EXT_mesh_gpu_instancing`).

use super::accessor::AccessorReader;
use super::buffers::Buffers;
use super::json::{GltfDocument, GpuInstancing, get};
use super::malformed;
use super::nodes::SceneNode;
use bdpm_core::base::error::Result;
use glam::{DAffine3, DQuat, DVec3};

/// Number of placements of the node's mesh.
pub(super) fn count(document: &GltfDocument, node: &SceneNode) -> Result<u64> {
    let Some(GpuInstancing { attributes }) = &node.json.extensions.instancing else { return Ok(1) };
    let mut count = None;
    for (name, accessor) in attributes {
        let element = element(node, name);
        let own = get(&document.accessors, "accessors", *accessor, &element)?.count;
        if count.is_some_and(|count| count != own) {
            return Err(malformed(element, "its count differs from that of the other attributes"));
        }
        count = Some(own);
    }
    Ok(count.unwrap_or(1))
}

/// All placements of the node's mesh: maps from the mesh's coordinates to those of the scene.
pub(super) fn maps(buffers: &Buffers, node: &SceneNode) -> Result<Vec<DAffine3>> {
    let Some(GpuInstancing { attributes }) = &node.json.extensions.instancing else {
        return Ok(vec![node.map]);
    };
    let open = |name: &str, kind| {
        let open =
            |accessor: &usize| AccessorReader::open(buffers, *accessor, kind, element(node, name));
        attributes.get(name).map(open).transpose()
    };
    let translations = open("TRANSLATION", "VEC3")?;
    let rotations = open("ROTATION", "VEC4")?;
    let scales = open("SCALE", "VEC3")?;
    let vector = |reader: &Option<AccessorReader>, index: u64, default: DVec3| {
        let numbers = |reader: &AccessorReader| reader.numbers(index).map(f64::from).into();
        reader.as_ref().map_or(default, numbers)
    };
    let map = |index: u64| {
        let rotation = rotations.as_ref().map_or(DQuat::IDENTITY, |rotations| {
            DQuat::from_array(rotations.numbers(index).map(f64::from))
        });
        let length = rotation.length();
        let scale = vector(&scales, index, DVec3::ONE);
        let translation = vector(&translations, index, DVec3::ZERO);
        let own = DAffine3::from_scale_rotation_translation(scale, rotation / length, translation);
        let map = node.map * own;
        let error = || malformed(element(node, ""), format!("instance {index} is not finite"));
        if map.is_finite() { Ok(map) } else { Err(error()) }
    };
    (0..count(buffers.document, node)?).map(map).collect()
}

fn element(node: &SceneNode, attribute: &str) -> String {
    format!("nodes[{}].extensions.EXT_mesh_gpu_instancing.attributes.{attribute}", node.index)
}
