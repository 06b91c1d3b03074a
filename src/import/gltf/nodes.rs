//! The tree of nodes: which of them the scene shows, and where.

use super::fault;
use super::json::{Document, Node, get};
use crate::base::error::Result;
use glam::{DAffine3, DMat4, DQuat, DVec3};

/// A node of the scene.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed<'a> {
    pub index: usize,
    pub node: &'a Node,
    /// From the node's coordinates to those of the scene.
    pub map: DAffine3,
}

/// The nodes of the default scene, each before its children, and whether the scene lists any below another or
/// twice: some exporters list them all. Without scenes all nodes are shown.
///
/// # Errors
/// If the nodes are no tree, or a transform is not finite.
pub(super) fn placed(document: &Document) -> Result<(Vec<Placed<'_>>, bool)> {
    let nodes = &document.nodes;
    let parents = parents(nodes)?;
    let roots: Vec<usize> = match (document.scene, document.scenes.first()) {
        (None, None) => (0..nodes.len()).filter(|node| parents[*node].is_none()).collect(),
        (None, Some(scene)) => scene.nodes.clone(),
        (Some(index), _) => get(&document.scenes, "scenes", index, "scene")?.nodes.clone(),
    };
    let scene = format!("scenes[{}].nodes", document.scene.unwrap_or(0));
    let mut listed = vec![false; nodes.len()];
    let mut tops = Vec::new();
    for root in &roots {
        get(nodes, "nodes", *root, &scene)?;
        if !std::mem::replace(&mut listed[*root], true) {
            tops.push(*root);
        }
    }
    // What is below a listed node is shown with it, and no second time.
    let mut known = vec![None; nodes.len()];
    tops.retain(|top| {
        parents[*top].is_none_or(|parent| !is_below(parent, &parents, &listed, &mut known))
    });
    let is_odd = tops.len() < roots.len();

    let mut placed = Vec::new();
    // A stack of its own: chains of nodes may be longer than the program's is deep.
    let mut open: Vec<_> = tops.iter().rev().map(|root| (*root, DAffine3::IDENTITY)).collect();
    while let Some((index, above)) = open.pop() {
        let node = &nodes[index];
        let map = above * local(node, index)?;
        if !map.is_finite() {
            let problem = "its transform is not finite, with those of the nodes above it";
            return Err(fault(format!("nodes[{index}]"), problem));
        }
        placed.push(Placed { index, node, map });
        open.extend(node.children.iter().rev().map(|child| (*child, map)));
    }
    Ok((placed, is_odd))
}

/// Whether a node or one above it is `listed`; `known` keeps what was found, for chains may be long and many.
fn is_below(
    node: usize,
    parents: &[Option<usize>],
    listed: &[bool],
    known: &mut [Option<bool>],
) -> bool {
    let mut way = Vec::new();
    let mut at = Some(node);
    let found = loop {
        match at {
            None => break false,
            Some(node) if listed[node] => break true,
            Some(node) => match known[node] {
                Some(found) => break found,
                None => {
                    way.push(node);
                    at = parents[node];
                }
            },
        }
    };
    way.into_iter().for_each(|node| known[node] = Some(found));
    found
}

/// The parent of each node.
fn parents(nodes: &[Node]) -> Result<Vec<Option<usize>>> {
    let mut parents = vec![None; nodes.len()];
    for (parent, node) in nodes.iter().enumerate() {
        for child in &node.children {
            let place = format!("nodes[{parent}].children");
            get(nodes, "nodes", *child, &place)?;
            if let Some(other) = parents[*child].replace(parent) {
                let problem = format!("nodes[{child}] is already a child of nodes[{other}]");
                return Err(fault(place, problem));
            }
        }
    }
    // Upward from each node, to where a walk came by before: if that was the same walk, in a circle.
    let mut walk_of = vec![usize::MAX; nodes.len()];
    for start in 0..nodes.len() {
        let mut at = Some(start);
        while let Some(node) = at.filter(|node| walk_of[*node] == usize::MAX) {
            walk_of[node] = start;
            at = parents[node];
        }
        if let Some(node) = at.filter(|node| walk_of[*node] == start) {
            let place = format!("nodes[{node}].children");
            return Err(fault(place, "the node is below itself"));
        }
    }
    Ok(parents)
}

/// A node's own transform.
fn local(node: &Node, index: usize) -> Result<DAffine3> {
    let place = |key: &str| format!("nodes[{index}].{key}");
    if let Some(matrix) = &node.matrix {
        let [_, _, _, x, _, _, _, y, _, _, _, z, _, _, _, w] = **matrix;
        // Exporters may have rounded.
        if [x, y, z, w - 1.0].iter().any(|off| off.abs() > 1e-5) {
            return Err(fault(place("matrix"), "its last row is not 0, 0, 0, 1"));
        }
        return Ok(DAffine3::from_mat4(DMat4::from_cols_array(matrix)));
    }
    let rotation = node.rotation.map_or(DQuat::IDENTITY, DQuat::from_array);
    if !(rotation.length_squared().is_finite() && rotation.length_squared() > 0.0) {
        return Err(fault(place("rotation"), "the quaternion has no length"));
    }
    // Exporters round to f32, and the identity must stay as it is.
    let rotation = if rotation == DQuat::IDENTITY { rotation } else { rotation.normalize() };
    let scale = node.scale.map_or(DVec3::ONE, DVec3::from_array);
    let translation = node.translation.map_or(DVec3::ZERO, DVec3::from_array);
    Ok(DAffine3::from_scale_rotation_translation(scale, rotation, translation))
}
