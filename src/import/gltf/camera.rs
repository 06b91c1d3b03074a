//! Cameras: perspective ones, looking along -z of their node with +y up.

use super::json::{GltfDocument, Perspective, get};
use super::nodes::SceneNode;
use super::{first_name, malformed};
use crate::base::error::{Error, Result};
use crate::import::text::list;
use crate::import::warnings::Warning;
use crate::scene::{Camera, FieldOfView};
use glam::DVec3;
use std::f32::consts::PI;

/// Default number of pixels of the longer side of an image of a camera with an aspect ratio.
const LONGER_SIDE: f32 = 512.0;

/// A camera of the scene.
#[derive(Clone, Debug)]
pub(super) struct SceneCamera<'a> {
    /// The node's name, else the camera's, else the node's element in the file.
    pub name: String,
    /// Name of the camera itself, which nodes may share.
    shared_name: &'a str,
    /// `None` if the camera is orthographic.
    perspective: Option<&'a Perspective>,
    node: &'a SceneNode<'a>,
}

/// All cameras of the scene, in its order.
pub(super) fn cameras<'a>(
    document: &'a GltfDocument,
    nodes: &'a [SceneNode<'a>],
) -> Result<Vec<SceneCamera<'a>>> {
    let mut all = Vec::new();
    for node in nodes {
        let Some(index) = node.json.camera else { continue };
        let element = format!("nodes[{}].camera", node.index);
        let camera = get(&document.cameras, "cameras", index, element)?;
        let own = format!("cameras[{index}]");
        let perspective = match (&camera.kind[..], &camera.perspective) {
            ("perspective", Some(perspective)) => Some(perspective),
            ("perspective", None) => return Err(malformed(own, "perspective is missing")),
            ("orthographic", _) => None,
            _ => return Err(malformed(own, "its type is neither perspective nor orthographic")),
        };
        let shared_name = &camera.name[..];
        let names = [&node.json.name[..], shared_name];
        let name = first_name(names, || format!("nodes[{}]", node.index));
        all.push(SceneCamera { name, shared_name, perspective, node });
    }
    Ok(all)
}

/// The camera of this name (of its node or its own); without a name the first perspective camera,
/// if there is any.
///
/// # Errors
/// If no camera has this name, or the camera is not supported.
pub(super) fn choose<'c, 'a>(
    all: &'c [SceneCamera<'a>],
    wanted: Option<&str>,
    warnings: &mut Vec<Warning>,
) -> Result<Option<&'c SceneCamera<'a>>> {
    let Some(wanted) = wanted else {
        let first = all.iter().position(|camera| camera.perspective.is_some());
        let before = &all[..first.unwrap_or(all.len())];
        if !before.is_empty() {
            let names = list(before.iter().map(|camera| &camera.name[..]));
            let text = format!("orthographic cameras are not supported: {names}");
            warnings.push(Warning::skipped(text));
        }
        return Ok(first.map(|first| &all[first]));
    };
    let named = all.iter().find(|camera| camera.name == wanted);
    let found = named.or_else(|| all.iter().find(|camera| camera.shared_name == wanted));
    match found {
        Some(camera) if camera.perspective.is_none() => Err(Error::new(
            format!("the camera `{wanted}` is orthographic, which is not supported"),
            "use a perspective camera",
        )),
        Some(camera) => Ok(Some(camera)),
        None => {
            let advice = match all.is_empty() {
                true => "name no camera: the default camera sees everything".to_owned(),
                false => format!("use one of {}", list(all.iter().map(|camera| &camera.name[..]))),
            };
            Err(Error::new(format!("there is no camera `{wanted}`"), advice))
        }
    }
}

impl SceneCamera<'_> {
    /// The camera, and the size of its image if it has an aspect ratio.
    pub fn camera(&self) -> Result<(Camera, Option<[u32; 2]>)> {
        let element = format!("nodes[{}].camera", self.node.index);
        let Some(&Perspective { aspect_ratio, yfov }) = self.perspective else {
            return Err(malformed(element, "it is not perspective"));
        };
        if !(yfov > 0.0 && yfov < PI) {
            return Err(malformed(
                element,
                format!("yfov is {yfov}, not between 0 and pi radians"),
            ));
        }
        if aspect_ratio.is_some_and(|ratio| !(ratio > 0.0 && ratio.is_finite())) {
            return Err(malformed(element, "aspectRatio is not a positive number"));
        }
        let map = &self.node.map;
        let direction = map.transform_vector3(DVec3::NEG_Z).normalize_or_zero().as_vec3();
        let up = map.transform_vector3(DVec3::Y).normalize_or_zero().as_vec3();
        let field_of_view = FieldOfView::Y(yfov.to_degrees());
        let camera = Camera::look(map.translation.as_vec3(), direction, up, field_of_view)
            .map_err(|e| Error::new(format!("{element}: {}", e.problem()), e.advice()))?;
        let resolution = aspect_ratio.map(|ratio| {
            let [width, height] = [ratio.min(1.0), ratio.recip().min(1.0)];
            [width, height].map(|share| (LONGER_SIDE * share).round().max(1.0) as u32)
        });
        Ok((camera, resolution))
    }
}
