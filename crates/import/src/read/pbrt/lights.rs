//! Light sources: point, spot and distant lights, and the emission of shapes.

use super::params::Params;
use super::spectra::{self, ColorSpace};
use super::textures::Textures;
use crate::light::{self, spot};
use crate::look::Paint;
use crate::spectrum::ColorUse;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::scene::{Directional, Emitter, Falloff, Mesh, Spot};
use glam::{DAffine3, DVec3};
use std::f64::consts::{PI, TAU};

/// The emission of the shapes that follow an `AreaLightSource`.
pub(super) struct AreaLight {
    pub params: Params,
    pub color_space: ColorSpace,
}

/// The color of a light, whose default is white.
pub(super) fn color(
    params: &Params,
    name: &str,
    space: ColorSpace,
    textures: &Textures,
) -> Result<Rgb> {
    let own = params.get(name);
    let color = own.map(|own| spectra::color(own, ColorUse::Light, space, &textures.folder));
    Ok(color.transpose()?.unwrap_or(Rgb::ONE))
}

/// A light at a point or far away; `None` if its type is not supported.
pub(super) fn emitter(
    params: &Params,
    space: ColorSpace,
    map: DAffine3,
    textures: &mut Textures,
) -> Result<Option<Emitter>> {
    let scale = params.float_in("scale", 1.0, [0.0, 1e30])?;
    // A positive power replaces the intensity; `solid_angle` is that of light of intensity 1, sr.
    let powered = |solid_angle: f64| {
        let power = params.float_or("power", -1.0)?;
        Ok::<_, Error>(if power > 0.0 { power / solid_angle } else { 1.0 })
    };
    let placed = |error: Error| params.placed(&error);
    let from = params.point("from")?.unwrap_or_default();
    let position = || light::position(map.transform_point3(from)).map_err(placed);
    let direction = || {
        let to = params.point("to")?.unwrap_or(DVec3::Z);
        light::direction(map.transform_vector3(to - from)).map_err(placed)
    };
    Ok(Some(match &params.kind[..] {
        "point" => {
            let scale = (scale * powered(4.0 * PI)?) as f32;
            let intensity = scale * color(params, "I", space, textures)?;
            Emitter::Point { position: position()?, intensity }
        }
        "spot" => {
            let cone = params.float_in("coneangle", 30.0, [1e-3, 180.0])?;
            let delta = params.float_in("conedeltaangle", 5.0, [0.0, cone])?;
            let (outer, start) = (cone.to_radians().cos(), (cone - delta).to_radians().cos());
            let scale = (scale * powered(TAU * (1.0 - start + 0.5 * (start - outer)))?) as f32;
            let intensity = scale * color(params, "I", space, textures)?;
            let cone = spot(position()?, direction()?, intensity, [start, outer]);
            Emitter::Spot(Spot { falloff: Falloff::Smoothstep, ..cone })
        }
        "distant" => {
            let illuminance = params.float_or("illuminance", -1.0)?;
            let scale = scale * if illuminance > 0.0 { illuminance } else { 1.0 };
            let irradiance = scale as f32 * color(params, "L", space, textures)?;
            Emitter::Directional(Directional::new(direction()?, irradiance))
        }
        "goniometric" | "projection" => {
            textures.warnings.skipped("left out lights of type", &params.kind);
            return Ok(None);
        }
        other => {
            let problem = format!("lights of type `{other}` are unknown");
            return Err(params.location.error(problem, "use point, spot, distant or infinite"));
        }
    }))
}

impl AreaLight {
    /// The emitted radiance of a mesh, which `map` moves to the scene.
    pub fn paint(&self, mesh: &Mesh, map: DAffine3, textures: &mut Textures) -> Result<Paint> {
        let params = &self.params;
        if params.kind != "diffuse" {
            let problem = format!("area lights of type `{}` are unknown", params.kind);
            return Err(params.location.error(problem, "use diffuse"));
        }
        let mut paint = match params.text("filename")? {
            Some(file) => textures.light_picture(params, file)?,
            None => Paint::plain(color(params, "L", self.color_space, textures)?),
        };
        let mut scale = params.float_in("scale", 1.0, [0.0, 1e30])?;
        let power = params.float_or("power", -1.0)?;
        if power > 0.0 {
            let sides = if self.is_two_sided()? { 2.0 } else { 1.0 };
            let mean = match &paint.texture {
                Some(_) => f64::from(luminance(paint.mean())),
                None => 1.0,
            };
            scale *= power / (mean * sides * area(mesh, map) * PI);
        }
        paint.color *= scale as f32;
        if !paint.color.is_finite() {
            return Err(
                params.error("the emitted radiance is too large", "lower `scale` or `power`")
            );
        }
        Ok(paint)
    }

    /// Whether the back emits as well.
    pub fn is_two_sided(&self) -> Result<bool> {
        self.params.boolean("twosided", false)
    }
}

/// Area of a moved mesh.
fn area(mesh: &Mesh, map: DAffine3) -> f64 {
    let at = |i: u32| map.transform_point3(mesh.positions[i as usize].as_dvec3());
    let double = |corners: &[u32; 3]| {
        let [a, b, c] = corners.map(at);
        (b - a).cross(c - a).length()
    };
    0.5 * mesh.triangles.iter().map(double).sum::<f64>()
}
