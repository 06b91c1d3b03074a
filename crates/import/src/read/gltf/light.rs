//! Punctual lights (`KHR_lights_punctual`): they shine along -z of their node, whose scale has no
//! effect. Their range is a hint for other renderers.

use super::json::{GltfDocument, get};
use super::nodes::SceneNode;
use super::{first_name, malformed};
use crate::light::{self, position, spot};
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::scene::{Directional, Emitter};
use glam::DVec3;
use std::f32::consts::FRAC_PI_2;

/// A light of the scene.
pub(super) struct NamedLight {
    /// The node's name, else the light's, else the node's element in the file.
    pub name: String,
    pub emitter: Emitter,
}

/// The light of a node, if it has one that is not dark.
pub(super) fn light(document: &GltfDocument, node: &SceneNode) -> Result<Option<NamedLight>> {
    let Some(light) = &node.json.extensions.light else { return Ok(None) };
    let own = format!("nodes[{}].extensions.KHR_lights_punctual.light", node.index);
    let element = format!("extensions.KHR_lights_punctual.lights[{}]", light.light);
    let light = get(&document.extensions.punctual.lights, "lights", light.light, &own)?;

    let intensity = Rgb::from_array(light.color) * light.intensity * (1.0 / LUMENS_PER_WATT);
    if !(intensity.is_finite() && intensity.min_element() >= 0.0) {
        return Err(malformed(element, "its intensity times its color is negative or not finite"));
    }
    if intensity == Rgb::ZERO {
        return Ok(None);
    }
    let position = position(node.map.translation).map_err(|e| malformed(&own, e.problem()))?;
    let direction = || {
        let along = light::direction(node.map.transform_vector3(DVec3::NEG_Z));
        along.map_err(|_| malformed(&own, "the node's transform leaves the light no direction"))
    };
    let emitter = match &light.kind[..] {
        "point" => Emitter::Point { position, intensity },
        "directional" => Emitter::Directional(Directional::new(direction()?, intensity)),
        "spot" => {
            let (inner, outer) = (light.spot.inner_cone_angle, light.spot.outer_cone_angle);
            // Written so that NaN fails. Right angles may be rounded up, and exporters write equal
            // angles for sharp edges.
            if !(0.0 <= inner && inner <= outer && 0.0 < outer && outer <= FRAC_PI_2 + 1e-4) {
                let problem = format!("innerConeAngle is {inner}, outerConeAngle {outer} radians");
                return Err(malformed(format!("{element}.spot"), problem));
            }
            Emitter::Spot(spot(
                position,
                direction()?,
                intensity,
                [inner, outer].map(|angle| f64::from(angle).cos()),
            ))
        }
        _ => return Err(malformed(element, "its type is none of point, spot and directional")),
    };
    let names = [&node.json.name[..], &light.name];
    let name = first_name(names, || format!("nodes[{}]", node.index));
    Ok(Some(NamedLight { name, emitter }))
}
