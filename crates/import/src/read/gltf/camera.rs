//! Cameras: perspective and orthographic ones, looking along -z of their node with +y up.

use super::json::{GltfDocument, Orthographic, Perspective, get};
use super::nodes::SceneNode;
use super::{first_name, malformed};
use crate::text::list;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::scene::{Camera, Extent, FieldOfView, Optics};
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
    lens: Lens<'a>,
    node: &'a SceneNode<'a>,
}

/// The projection of a camera.
#[derive(Clone, Copy, Debug)]
enum Lens<'a> {
    Perspective(&'a Perspective),
    Orthographic(&'a Orthographic),
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
        let lens = match (&camera.kind[..], &camera.perspective, &camera.orthographic) {
            ("perspective", Some(own), _) => Lens::Perspective(own),
            ("perspective", None, _) => return Err(malformed(own, "perspective is missing")),
            ("orthographic", _, Some(own)) => Lens::Orthographic(own),
            ("orthographic", _, None) => return Err(malformed(own, "orthographic is missing")),
            _ => return Err(malformed(own, "its type is neither perspective nor orthographic")),
        };
        let shared_name = &camera.name[..];
        let names = [&node.json.name[..], shared_name];
        let name = first_name(names, || format!("nodes[{}]", node.index));
        all.push(SceneCamera { name, shared_name, lens, node });
    }
    Ok(all)
}

/// The camera of this name (of its node or its own); without a name the first camera, if there is
/// any.
///
/// # Errors
/// If no camera has this name.
pub(super) fn choose<'c, 'a>(
    all: &'c [SceneCamera<'a>],
    wanted: Option<&str>,
) -> Result<Option<&'c SceneCamera<'a>>> {
    let Some(wanted) = wanted else { return Ok(all.first()) };
    let named = all.iter().find(|camera| camera.name == wanted);
    let found = named.or_else(|| all.iter().find(|camera| camera.shared_name == wanted));
    found.map(Some).ok_or_else(|| {
        let advice = match all.is_empty() {
            true => "name no camera: the default camera sees everything".to_owned(),
            false => format!("use one of {}", list(all.iter().map(|camera| &camera.name[..]))),
        };
        Error::new(format!("there is no camera `{wanted}`"), advice)
    })
}

impl SceneCamera<'_> {
    /// The camera, and the size of its image if it has an aspect ratio.
    pub fn camera(&self) -> Result<(Camera, Option<[u32; 2]>)> {
        let element = format!("nodes[{}].camera", self.node.index);
        let (optics, aspect_ratio) = self.lens.optics(&element)?;
        let map = &self.node.map;
        let direction = map.transform_vector3(DVec3::NEG_Z).normalize_or_zero().as_vec3();
        let up = map.transform_vector3(DVec3::Y).normalize_or_zero().as_vec3();
        let camera = Camera::with_optics(map.translation.as_vec3(), direction, up, optics)
            .map_err(|e| Error::new(format!("{element}: {}", e.problem()), e.advice()))?;
        let resolution = aspect_ratio.map(|ratio| {
            let [width, height] = [ratio.min(1.0), ratio.recip().min(1.0)];
            [width, height].map(|share| (LONGER_SIDE * share).round().max(1.0) as u32)
        });
        Ok((camera, resolution))
    }
}

impl Lens<'_> {
    /// The optics, and the aspect ratio if there is one.
    fn optics(self, element: &str) -> Result<(Optics, Option<f32>)> {
        match self {
            Self::Perspective(&Perspective { aspect_ratio, yfov }) => {
                if !(yfov > 0.0 && yfov < PI) {
                    let problem = format!("yfov is {yfov}, not between 0 and pi radians");
                    return Err(malformed(element, problem));
                }
                if aspect_ratio.is_some_and(|ratio| !(ratio > 0.0 && ratio.is_finite())) {
                    return Err(malformed(element, "aspectRatio is not a positive number"));
                }
                Ok((Optics::Pinhole(FieldOfView::Y(yfov.to_degrees())), aspect_ratio))
            }
            Self::Orthographic(&Orthographic { xmag, ymag }) => {
                // Exporters of mirrored cameras write negative numbers.
                let (width, height) = (2.0 * xmag.abs(), 2.0 * ymag.abs());
                let ratio = width / height;
                if !(width > 0.0 && height > 0.0 && ratio > 0.0 && ratio.is_finite()) {
                    return Err(malformed(element, "xmag and ymag are not two positive numbers"));
                }
                Ok((Optics::Orthographic(Extent::Y(height)), Some(ratio)))
            }
        }
    }
}
