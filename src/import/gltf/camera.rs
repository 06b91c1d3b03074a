//! Cameras: perspective ones, looking along -z of their node with +y up.

use super::json::{Document, Perspective, get};
use super::nodes::Placed;
use super::{fault, first_name};
use crate::base::error::{Error, Result};
use crate::import::text::list;
use crate::import::warnings::Warning;
use crate::scene::{Camera, FieldOfView};
use glam::DVec3;
use std::f32::consts::PI;

/// Pixels of the longer side of an image of a camera with an aspect ratio, unless something else is
/// said.
const LONGER_SIDE: f32 = 512.0;

/// A camera of the scene.
#[derive(Clone, Debug)]
pub(super) struct Candidate<'a> {
    /// The node's name, else the camera's, else its place in the file.
    pub name: String,
    /// Name of the camera itself, which nodes may share.
    shared_name: &'a str,
    /// `None` if it is of another kind.
    perspective: Option<&'a Perspective>,
    placed: &'a Placed<'a>,
}

/// All cameras of the scene, in its order.
pub(super) fn candidates<'a>(
    document: &'a Document,
    nodes: &'a [Placed<'a>],
) -> Result<Vec<Candidate<'a>>> {
    let mut all = Vec::new();
    for placed in nodes {
        let Some(index) = placed.node.camera else { continue };
        let place = format!("nodes[{}].camera", placed.index);
        let camera = get(&document.cameras, "cameras", index, place)?;
        let own = format!("cameras[{index}]");
        let perspective = match (&camera.kind[..], &camera.perspective) {
            ("perspective", Some(perspective)) => Some(perspective),
            ("perspective", None) => return Err(fault(own, "perspective is missing")),
            ("orthographic", _) => None,
            _ => return Err(fault(own, "its type is neither perspective nor orthographic")),
        };
        let shared_name = &camera.name[..];
        let names = [&placed.node.name[..], shared_name];
        let name = first_name(names, || format!("nodes[{}]", placed.index));
        all.push(Candidate { name, shared_name, perspective, placed });
    }
    Ok(all)
}

/// The one of this name, by node or camera; without a name the first perspective one, if there is
/// any.
///
/// # Errors
/// If there is none of this name, or it is not supported.
pub(super) fn choose<'c, 'a>(
    all: &'c [Candidate<'a>],
    wanted: Option<&str>,
    notes: &mut Vec<Warning>,
) -> Result<Option<&'c Candidate<'a>>> {
    let Some(wanted) = wanted else {
        let first = all.iter().position(|camera| camera.perspective.is_some());
        let before = &all[..first.unwrap_or(all.len())];
        if !before.is_empty() {
            let names = list(before.iter().map(|camera| &camera.name[..]));
            notes
                .push(Warning::skipped(format!("orthographic cameras are not supported: {names}")));
        }
        return Ok(first.map(|first| &all[first]));
    };
    let named = all.iter().find(|camera| camera.name == wanted);
    let found = named.or_else(|| all.iter().find(|camera| camera.shared_name == wanted));
    match found {
        Some(camera) if camera.perspective.is_none() => Err(Error::new(
            format!("the camera `{wanted}` is orthographic, which is not supported"),
            "choose a perspective camera",
        )),
        Some(camera) => Ok(Some(camera)),
        None if all.is_empty() => {
            let advice = "leave --camera out for one that sees everything";
            Err(Error::new(format!("there is no camera `{wanted}`, nor any other"), advice))
        }
        None => {
            let names = list(all.iter().map(|camera| &camera.name[..]));
            let advice = format!("choose one of {names}");
            Err(Error::new(format!("there is no camera `{wanted}`"), advice))
        }
    }
}

impl Candidate<'_> {
    /// The camera, and the size of its image if it has an aspect ratio.
    pub fn camera(&self) -> Result<(Camera, Option<[u32; 2]>)> {
        let place = format!("nodes[{}].camera", self.placed.index);
        let Some(&Perspective { aspect_ratio, yfov }) = self.perspective else {
            return Err(fault(place, "it is not perspective"));
        };
        if !(yfov > 0.0 && yfov < PI) {
            return Err(fault(place, format!("yfov is {yfov}, not between 0 and pi radians")));
        }
        if aspect_ratio.is_some_and(|ratio| !(ratio > 0.0 && ratio.is_finite())) {
            return Err(fault(place, "aspectRatio is no positive number"));
        }
        let map = &self.placed.map;
        let direction = map.transform_vector3(DVec3::NEG_Z).normalize_or_zero().as_vec3();
        let up = map.transform_vector3(DVec3::Y).normalize_or_zero().as_vec3();
        let field_of_view = FieldOfView::Y(yfov.to_degrees());
        let camera = Camera::look(map.translation.as_vec3(), direction, up, field_of_view)
            .map_err(|e| Error::new(format!("{place}: {}", e.problem()), e.advice()))?;
        let resolution = aspect_ratio.map(|ratio| {
            let [width, height] = [ratio.min(1.0), ratio.recip().min(1.0)];
            [width, height].map(|share| (LONGER_SIDE * share).round().max(1.0) as u32)
        });
        Ok((camera, resolution))
    }
}
