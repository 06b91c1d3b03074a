//! The tree of nodes: the nodes that the scene shows, and their transforms.

use super::json::{GltfDocument, Node, get};
use super::malformed;
use bdpm_core::base::error::Result;
use glam::{DAffine3, DMat4, DQuat, DVec3};

/// A node of the scene.
#[derive(Clone, Copy, Debug)]
pub(super) struct SceneNode<'a> {
    pub index: usize,
    pub json: &'a Node,
    /// From the node's coordinates to those of the scene.
    pub map: DAffine3,
    /// Whether its mesh and lights are not part of the image (`KHR_node_visibility`).
    pub is_hidden: bool,
}

/// The nodes of the default scene, each before its children, and whether the scene lists any node
/// twice or below another listed node, as some exporters do. Without scenes all nodes are shown.
///
/// # Errors
/// If the nodes are not a tree, or a transform is not finite.
pub(super) fn scene_nodes(document: &GltfDocument) -> Result<(Vec<SceneNode<'_>>, bool)> {
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
    // Nodes below a listed node are shown with it. They must not be shown a second time.
    let mut known = vec![None; nodes.len()];
    tops.retain(|top| {
        parents[*top].is_none_or(|parent| !is_below(parent, &parents, &listed, &mut known))
    });
    let has_repeats = tops.len() < roots.len();

    let mut shown = Vec::new();
    // An explicit stack, because chains of nodes may overflow the program's.
    let top = |root: &usize| (*root, DAffine3::IDENTITY, false);
    let mut open: Vec<_> = tops.iter().rev().map(top).collect();
    while let Some((index, above, is_below_hidden)) = open.pop() {
        let json = &nodes[index];
        let is_hidden = is_below_hidden || !json.extensions.visibility.visible;
        let map = above * local(json, index)?;
        if !map.is_finite() {
            let problem = "its transform is not finite, combined with those of the nodes above it";
            return Err(malformed(format!("nodes[{index}]"), problem));
        }
        shown.push(SceneNode { index, json, map, is_hidden });
        open.extend(json.children.iter().rev().map(|child| (*child, map, is_hidden)));
    }
    Ok((shown, has_repeats))
}

/// Whether a node or one above it is `listed`. `known` keeps the results, because chains may be
/// long and many.
fn is_below(
    node: usize,
    parents: &[Option<usize>],
    listed: &[bool],
    known: &mut [Option<bool>],
) -> bool {
    let mut path = Vec::new();
    let mut at = Some(node);
    let found = loop {
        match at {
            None => break false,
            Some(node) if listed[node] => break true,
            Some(node) => match known[node] {
                Some(found) => break found,
                None => {
                    path.push(node);
                    at = parents[node];
                }
            },
        }
    };
    path.into_iter().for_each(|node| known[node] = Some(found));
    found
}

/// The parent of each node.
fn parents(nodes: &[Node]) -> Result<Vec<Option<usize>>> {
    let mut parents = vec![None; nodes.len()];
    for (parent, node) in nodes.iter().enumerate() {
        for child in &node.children {
            let element = format!("nodes[{parent}].children");
            get(nodes, "nodes", *child, &element)?;
            if let Some(other) = parents[*child].replace(parent) {
                let problem = format!("nodes[{child}] is already a child of nodes[{other}]");
                return Err(malformed(element, problem));
            }
        }
    }
    // Walk upward from each node to the first node that was visited. The same walk visited it if
    // there is a cycle.
    let mut walk_of = vec![usize::MAX; nodes.len()];
    for start in 0..nodes.len() {
        let mut at = Some(start);
        while let Some(node) = at.filter(|node| walk_of[*node] == usize::MAX) {
            walk_of[node] = start;
            at = parents[node];
        }
        if let Some(node) = at.filter(|node| walk_of[*node] == start) {
            let element = format!("nodes[{node}].children");
            return Err(malformed(element, "the node is below itself"));
        }
    }
    Ok(parents)
}

/// A node's own transform.
fn local(node: &Node, index: usize) -> Result<DAffine3> {
    let element = |key: &str| format!("nodes[{index}].{key}");
    if let Some(matrix) = &node.matrix {
        let [_, _, _, x, _, _, _, y, _, _, _, z, _, _, _, w] = **matrix;
        // Exporters may round.
        if [x, y, z, w - 1.0].iter().any(|off| off.abs() > 1e-5) {
            return Err(malformed(element("matrix"), "its last row is not 0, 0, 0, 1"));
        }
        return Ok(DAffine3::from_mat4(DMat4::from_cols_array(matrix)));
    }
    let rotation = node.rotation.map_or(DQuat::IDENTITY, DQuat::from_array);
    if !(rotation.length_squared().is_finite() && rotation.length_squared() > 0.0) {
        return Err(malformed(element("rotation"), "the quaternion has no length"));
    }
    // Exporters round to f32, and the identity must stay exact.
    let rotation = if rotation == DQuat::IDENTITY { rotation } else { rotation.normalize() };
    let scale = node.scale.map_or(DVec3::ONE, DVec3::from_array);
    let translation = node.translation.map_or(DVec3::ZERO, DVec3::from_array);
    Ok(DAffine3::from_scale_rotation_translation(scale, rotation, translation))
}
