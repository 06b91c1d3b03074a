//! Shapes that morph targets mix and skins bend, as the nodes pose them. Animations are not played.

use super::accessor::AccessorReader;
use super::buffers::Buffers;
use super::geometry::PrimitiveReader;
use super::json::get;
use super::malformed;
use super::nodes::SceneNode;
use bdpm_core::base::error::Result;
use bdpm_core::scene::Mesh;
use bdpm_core::scene::transform::MAX_COORDINATE;
use glam::{DAffine3, DMat3, DMat4, DVec3, Vec3};
use std::collections::HashMap;

/// How a node changes the shape of its mesh.
#[derive(Debug, Default)]
pub(super) struct Pose {
    /// Weights of the morph targets.
    weights: Vec<f32>,
    /// Map of each joint, from the space in which the mesh is bound to it to the scene; `None`
    /// without a skin.
    joints: Option<Vec<DAffine3>>,
}

impl Pose {
    /// The pose of the mesh of this index at a node. `maps` has the map of each node of the scene
    /// by its index.
    pub fn new(
        buffers: &Buffers,
        node: &SceneNode,
        mesh: usize,
        maps: &HashMap<usize, DAffine3>,
    ) -> Result<Self> {
        let own = get(&buffers.document.meshes, "meshes", mesh, "nodes")?;
        let weights = node.json.weights.as_ref().unwrap_or(&own.weights).clone();
        let element = format!("nodes[{}].skin", node.index);
        let joints = node.json.skin.map(|skin| joints(buffers, skin, maps, &element));
        Ok(Self { weights, joints: joints.transpose()? })
    }

    /// Whether a skin places the mesh in the scene.
    pub fn is_placed(&self) -> bool {
        self.joints.is_some()
    }

    /// Moves a mesh that has the vertices `used` of a primitive.
    pub fn apply(&self, part: &PrimitiveReader, mesh: &mut Mesh, used: &[u32]) -> Result<()> {
        for (index, (target, weight)) in
            part.primitive.targets.iter().zip(&self.weights).enumerate()
        {
            // Most targets of a pose have the weight 0.
            if *weight == 0.0 {
                continue;
            }
            for (name, own) in [("POSITION", &mut mesh.positions), ("NORMAL", &mut mesh.normals)] {
                let Some(accessor) = target.get(name) else { continue };
                let element = format!("{}.targets[{index}].{name}", part.element);
                let reader = AccessorReader::open(part.buffers, *accessor, "VEC3", element)?;
                check_count(&reader, used)?;
                for (value, vertex) in own.iter_mut().zip(used) {
                    *value += *weight * Vec3::from_array(reader.numbers(*vertex));
                }
            }
        }
        if let Some(joints) = &self.joints {
            bend(part, joints, mesh, used)?;
        }
        let is_far = |p: &Vec3| !(p.is_finite() && p.abs().max_element() <= MAX_COORDINATE);
        if mesh.positions.iter().any(is_far) {
            let problem =
                format!("its pose moves a vertex beyond {MAX_COORDINATE:e}, or to no finite point");
            return Err(malformed(part.element, problem));
        }
        Ok(())
    }
}

/// The maps of the joints of a skin.
fn joints(
    buffers: &Buffers,
    skin: usize,
    maps: &HashMap<usize, DAffine3>,
    element: &str,
) -> Result<Vec<DAffine3>> {
    let own = get(&buffers.document.skins, "skins", skin, element)?;
    let open = |accessor| {
        let element = format!("skins[{skin}].inverseBindMatrices");
        AccessorReader::open(buffers, accessor, "MAT4", element)
    };
    let inverse_bind = own.inverse_bind_matrices.map(open).transpose()?;
    if let Some(matrices) = &inverse_bind
        && matrices.count < own.joints.len() as u64
    {
        return Err(matrices.error(format!("there are fewer than the {} joints", own.joints.len())));
    }
    let joint = |(index, node): (usize, &usize)| {
        let joint = maps.get(node).copied().ok_or_else(|| {
            let element = format!("skins[{skin}].joints[{index}]");
            malformed(element, format!("nodes[{node}] is not in the scene"))
        })?;
        let Some(matrices) = &inverse_bind else { return Ok(joint) };
        let numbers = matrices.numbers::<16>(index as u64).map(f64::from);
        Ok(joint * DAffine3::from_mat4(DMat4::from_cols_array(&numbers)))
    };
    own.joints.iter().enumerate().map(joint).collect()
}

/// Moves each vertex by the weighted mean of its joints.
fn bend(part: &PrimitiveReader, joints: &[DAffine3], mesh: &mut Mesh, used: &[u32]) -> Result<()> {
    let mut sets = Vec::new();
    for set in 0.. {
        let open = |name: &str| {
            let reader = part.attribute(&format!("{name}_{set}"), "VEC4")?;
            reader.as_ref().map_or(Ok(()), |reader| check_count(reader, used))?;
            Ok(reader)
        };
        let [Some(indices), Some(weights)] = [open("JOINTS")?, open("WEIGHTS")?] else { break };
        sets.push((indices, weights));
    }
    for (i, vertex) in used.iter().enumerate() {
        let (mut matrix, mut shift, mut sum) = (DMat3::ZERO, DVec3::ZERO, 0.0);
        for (indices, weights) in &sets {
            let indices: [f32; 4] = indices.numbers(*vertex);
            let weights: [f32; 4] = weights.numbers(*vertex);
            for (joint, weight) in indices.into_iter().zip(weights) {
                if weight == 0.0 {
                    continue;
                }
                // Integers of up to 16 bits are exact. Any other number becomes 0 or too large.
                let own = joints.get(joint as usize).ok_or_else(|| {
                    let problem = format!("vertex {vertex} has joint {joint} of {}", joints.len());
                    malformed(format!("{}.attributes", part.element), problem)
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
            // The cofactors are the inverse transpose times a factor, which may have any sign.
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

/// Refuses an accessor that has fewer items than the vertices that are used.
fn check_count(reader: &AccessorReader, used: &[u32]) -> Result<()> {
    match used.iter().max() {
        Some(last) if reader.count <= u64::from(*last) => {
            Err(reader.error(format!("{} elements, but vertex {last} is used", reader.count)))
        }
        _ => Ok(()),
    }
}
