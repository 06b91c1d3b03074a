//! Shapes that morph targets mix and skins bend, as the nodes have them: animations are not played.

use super::accessor::Reader;
use super::buffers::Buffers;
use super::fault;
use super::json::{Document, Primitive, get};
use super::nodes::Placed;
use crate::base::error::Result;
use crate::scene::Mesh;
use crate::scene::transform::MAX_COORDINATE;
use glam::{DAffine3, DMat3, DMat4, DVec3, Vec3};
use std::collections::HashMap;

/// What a node makes of the shape of its mesh.
#[derive(Debug, Default)]
pub(super) struct Pose {
    /// Of morph targets.
    weights: Vec<f32>,
    /// Of each joint, from where the mesh is bound to it to the scene; none without a skin.
    joints: Option<Vec<DAffine3>>,
}

impl Pose {
    /// The pose of a placed mesh of that index; `nodes` are all that the scene shows.
    pub fn new(
        document: &Document,
        buffers: &Buffers,
        placed: &Placed,
        mesh: usize,
        nodes: &HashMap<usize, DAffine3>,
    ) -> Result<Self> {
        let own = get(&document.meshes, "meshes", mesh, "nodes")?;
        let weights = placed.node.weights.as_ref().unwrap_or(&own.weights).clone();
        let place = format!("nodes[{}].skin", placed.index);
        let joints = placed.node.skin.map(|skin| joints(document, buffers, skin, nodes, &place));
        Ok(Self { weights, joints: joints.transpose()? })
    }

    /// Whether a skin says where the mesh is.
    pub fn has_location(&self) -> bool {
        self.joints.is_some()
    }

    /// Moves a mesh of the vertices `used` of a primitive.
    pub fn apply(
        &self,
        document: &Document,
        buffers: &Buffers,
        primitive: &Primitive,
        (mesh, used): (&mut Mesh, &[u32]),
        place: &str,
    ) -> Result<()> {
        for (index, (target, weight)) in primitive.targets.iter().zip(&self.weights).enumerate() {
            // Most targets of a pose have none.
            if *weight == 0.0 {
                continue;
            }
            for (name, own) in [("POSITION", &mut mesh.positions), ("NORMAL", &mut mesh.normals)] {
                let at = format!("{place}.targets[{index}].{name}");
                let Some(accessor) = target.get(name) else { continue };
                let reader = Reader::open(document, buffers, *accessor, "VEC3", &at)?;
                check_count(&reader, used, &at)?;
                for (value, vertex) in own.iter_mut().zip(used) {
                    *value += *weight * Vec3::from_array(reader.numbers((*vertex).into()));
                }
            }
        }
        if let Some(joints) = &self.joints {
            bend(document, buffers, primitive, joints, (&mut *mesh, used), place)?;
        }
        let is_far = |p: &Vec3| !(p.is_finite() && p.abs().max_element() <= MAX_COORDINATE);
        if mesh.positions.iter().any(is_far) {
            let problem = format!("its pose moves a vertex beyond {MAX_COORDINATE:e}, or nowhere");
            return Err(fault(place, problem));
        }
        Ok(())
    }
}

fn joints(
    document: &Document,
    buffers: &Buffers,
    skin: usize,
    nodes: &HashMap<usize, DAffine3>,
    place: &str,
) -> Result<Vec<DAffine3>> {
    let own = get(&document.skins, "skins", skin, place)?;
    let at = format!("skins[{skin}].inverseBindMatrices");
    let open = |accessor| Reader::open(document, buffers, accessor, "MAT4", &at);
    let unbound = own.inverse_bind_matrices.map(open).transpose()?;
    if unbound.as_ref().is_some_and(|unbound| unbound.count < own.joints.len() as u64) {
        return Err(fault(at, format!("there are fewer than the {} joints", own.joints.len())));
    }
    let joint = |(index, node): (usize, &usize)| {
        let joint = nodes.get(node).copied().ok_or_else(|| {
            let at = format!("skins[{skin}].joints[{index}]");
            fault(at, format!("nodes[{node}] is not in the scene"))
        })?;
        let Some(unbound) = &unbound else { return Ok(joint) };
        let numbers = unbound.numbers::<16>(index as u64).map(f64::from);
        Ok(joint * DAffine3::from_mat4(DMat4::from_cols_array(&numbers)))
    };
    own.joints.iter().enumerate().map(joint).collect()
}

/// Moves each vertex by the mean of its joints.
fn bend(
    document: &Document,
    buffers: &Buffers,
    primitive: &Primitive,
    joints: &[DAffine3],
    (mesh, used): (&mut Mesh, &[u32]),
    place: &str,
) -> Result<()> {
    let mut sets = Vec::new();
    for set in 0.. {
        let names = ["JOINTS", "WEIGHTS"].map(|name| format!("{name}_{set}"));
        let open = |name: &String| {
            let at = format!("{place}.attributes.{name}");
            let Some(accessor) = primitive.attributes.get(name) else { return Ok(None) };
            let reader = Reader::open(document, buffers, *accessor, "VEC4", &at)?;
            check_count(&reader, used, &at)?;
            Ok(Some(reader))
        };
        let [Some(joints), Some(weights)] = [open(&names[0])?, open(&names[1])?] else { break };
        sets.push((joints, weights));
    }
    for (i, vertex) in used.iter().enumerate() {
        let (mut matrix, mut shift, mut sum) = (DMat3::ZERO, DVec3::ZERO, 0.0);
        for (indices, weights) in &sets {
            let indices: [f32; 4] = indices.numbers((*vertex).into());
            let weights: [f32; 4] = weights.numbers((*vertex).into());
            for (joint, weight) in indices.into_iter().zip(weights) {
                if weight == 0.0 {
                    continue;
                }
                // Integers of up to 16 bits; what is no such number is 0 or too large.
                let own = joints.get(joint as usize).ok_or_else(|| {
                    let problem = format!("vertex {vertex} has joint {joint} of {}", joints.len());
                    fault(format!("{place}.attributes"), problem)
                })?;
                let weight = f64::from(weight);
                matrix += own.matrix3 * weight;
                shift += own.translation * weight;
                sum += weight;
            }
        }
        if sum == 0.0 {
            continue;
        }
        let position = &mut mesh.positions[i];
        *position = ((matrix * position.as_dvec3() + shift) / sum).as_vec3();
        if let Some(normal) = mesh.normals.get_mut(i) {
            // By the cofactors: the inverse transpose but for a factor, which may be of any sign.
            let [x, y, z] = [matrix.x_axis, matrix.y_axis, matrix.z_axis];
            let cofactors = DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y));
            *normal = (cofactors * normal.as_dvec3()).normalize_or_zero().as_vec3();
        }
        if let Some(tangent) = mesh.tangents.get_mut(i) {
            *tangent = (matrix * tangent.as_dvec3()).normalize_or_zero().as_vec3();
        }
    }
    Ok(())
}

/// Refuses attributes of fewer elements than the vertices that are used.
fn check_count(reader: &Reader, used: &[u32], place: &str) -> Result<()> {
    match used.iter().max() {
        Some(last) if reader.count <= u64::from(*last) => {
            let problem = format!("{} elements, but vertex {last} is used", reader.count);
            Err(fault(place, problem))
        }
        _ => Ok(()),
    }
}
