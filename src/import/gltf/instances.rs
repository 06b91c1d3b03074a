//! Many places of a node's mesh (`EXT_mesh_gpu_instancing`).

use super::accessor::Reader;
use super::buffers::Buffers;
use super::fault;
use super::json::{Document, Instancing, get};
use super::nodes::Placed;
use crate::base::error::Result;
use glam::{DAffine3, DQuat, DVec3};

/// How many places the node's mesh has.
pub(super) fn count(document: &Document, placed: &Placed) -> Result<u64> {
    let Some(Instancing { attributes }) = &placed.node.extensions.instancing else { return Ok(1) };
    let mut count = None;
    for (name, accessor) in attributes {
        let place = place(placed, name);
        let own = get(&document.accessors, "accessors", *accessor, &place)?.count;
        if count.is_some_and(|count| count != own) {
            return Err(fault(place, "its count is not that of the others"));
        }
        count = Some(own);
    }
    Ok(count.unwrap_or(1))
}

/// All places of the node's mesh: from its coordinates to those of the scene.
pub(super) fn maps(
    document: &Document,
    buffers: &Buffers,
    placed: &Placed,
) -> Result<Vec<DAffine3>> {
    let Some(Instancing { attributes }) = &placed.node.extensions.instancing else {
        return Ok(vec![placed.map]);
    };
    let open = |name: &str, kind| {
        let accessor = attributes.get(name);
        let open = |accessor: &usize| {
            Reader::open(document, buffers, *accessor, kind, place(placed, name))
        };
        accessor.map(open).transpose()
    };
    let translations = open("TRANSLATION", "VEC3")?;
    let rotations = open("ROTATION", "VEC4")?;
    let scales = open("SCALE", "VEC3")?;
    let vector = |reader: &Option<Reader>, index: u64, otherwise: DVec3| {
        let numbers = |reader: &Reader| DVec3::from_array(reader.numbers(index).map(f64::from));
        reader.as_ref().map_or(otherwise, numbers)
    };
    let map = |index: u64| {
        let rotation = rotations.as_ref().map_or(DQuat::IDENTITY, |rotations| {
            DQuat::from_array(rotations.numbers(index).map(f64::from))
        });
        let length = rotation.length();
        let scale = vector(&scales, index, DVec3::ONE);
        let translation = vector(&translations, index, DVec3::ZERO);
        let own = DAffine3::from_scale_rotation_translation(scale, rotation / length, translation);
        let map = placed.map * own;
        let problem = || fault(place(placed, ""), format!("instance {index} is not finite"));
        if map.is_finite() { Ok(map) } else { Err(problem()) }
    };
    (0..count(document, placed)?).map(map).collect()
}

fn place(placed: &Placed, name: &str) -> String {
    format!("nodes[{}].extensions.EXT_mesh_gpu_instancing.attributes.{name}", placed.index)
}
