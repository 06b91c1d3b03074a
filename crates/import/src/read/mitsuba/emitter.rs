//! Emitters without shapes.

use super::object::Object;
use super::sky::{self, is_sky};
use super::texture::Paints;
use crate::environment;
use crate::light::{self, spot};
use crate::sensor::MIRROR;
use crate::spectrum::ColorUse;
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::{Directional, Emitter, Environment, Falloff, Spot};
use bdpm_light::sky::Sky;
use glam::{DAffine3, DMat3, DVec3, Vec3};
use std::f64::consts::{PI, TAU};

/// Width up to which small maps of radiance are refined, pixels.
const FINE: u32 = 1024;

/// An environment before the scene is turned to it.
pub(super) struct EnvironmentEmitter {
    content: Content,
    /// Rotation of a map from its space, in which +y is up, to the scene.
    to_world: DMat3,
}

/// Radiance of an environment.
enum Content {
    Map { width: u32, height: u32, pixels: Vec<Rgb> },
    Sky(Box<Sky>),
}

/// A light at a point or far away, in a scene that `world` transforms; `None` if its type is not
/// supported.
pub(super) fn emitter(
    object: &Object,
    world: DAffine3,
    paints: &mut Paints,
) -> Result<Option<Emitter>> {
    let map = world * object.map("to_world")?;
    Ok(Some(match object.kind() {
        "point" => {
            let own = match object.point("position")? {
                Some(position) => world.transform_point3(position),
                None => map.translation,
            };
            let intensity = light(object, "intensity", paints)?;
            Emitter::Point { position: position(object, own)?, intensity }
        }
        "spot" => Emitter::Spot(cone(object, map, paints)?),
        "directional" => {
            let along = match object.point("direction")? {
                Some(direction) => world.transform_vector3(direction),
                None => map.matrix3.z_axis,
            };
            let irradiance = light(object, "irradiance", paints)?;
            Emitter::Directional(Directional::new(direction(object, along)?, irradiance))
        }
        "projector" => Emitter::Spot(projector(object, map, paints)?),
        other => {
            paints.skipped(format!("left out lights of type `{other}`:"), object);
            return Ok(None);
        }
    }))
}

/// The color of this name, whose default is white.
fn light(object: &Object, name: &str, paints: &mut Paints) -> Result<Rgb> {
    paints.mean(object, name, ColorUse::Light, Rgb::ONE)
}

fn position(object: &Object, point: DVec3) -> Result<Vec3> {
    light::position(point).map_err(|error| object.placed(&error))
}

fn direction(object: &Object, vector: DVec3) -> Result<Vec3> {
    light::direction(vector).map_err(|error| object.placed(&error))
}

/// A spot that shines along +z of its map.
fn cone(object: &Object, map: DAffine3, paints: &mut Paints) -> Result<Spot> {
    let given = object.float("cutoff_angle")?.unwrap_or(20.0);
    if !(1e-3..=90.0).contains(&given) {
        let phrase = "used the nearest angle from 0.001 to 90 degrees for the cutoff of";
        paints.skipped(phrase, object);
    }
    let cutoff = given.clamp(1e-3, 90.0).to_radians();
    let beam = object.float("beam_width")?.map_or(0.75 * cutoff, f64::to_radians);
    if !(0.0..=cutoff).contains(&beam) {
        paints.skipped("used an angle up to the cutoff for the beam of", object);
    }
    let intensity = light(object, "intensity", paints)?;
    let position = position(object, map.translation)?;
    let direction = direction(object, map.matrix3.z_axis)?;
    if object.get("texture")?.is_some() {
        paints.skipped("left out the texture of", object);
    }
    let cosines = [beam.clamp(0.0, cutoff), cutoff].map(f64::cos);
    let spot = spot(position, direction, intensity, cosines);
    Ok(Spot { falloff: Falloff::LinearInAngle, ..spot })
}

/// A round spot of the power of a projector.
fn projector(object: &Object, map: DAffine3, paints: &mut Paints) -> Result<Spot> {
    let irradiance = light(object, "irradiance", paints)?;
    let scale = object.float_in("scale", 1.0, [0.0, 1e30])? as f32;
    let degrees = object.float_in("fov", 45.0, [1e-3, 179.0])?;
    let _ = object.string("fov_axis")?;
    paints.skipped("used a round spot of the same power for the projector", object);
    // The flux through a square of the field of view at distance 1, within a circle of the same
    // area.
    let area = (2.0 * (0.5 * degrees).to_radians().tan()).powi(2);
    let cos = 1.0 / (1.0 + area / PI).sqrt();
    let intensity = irradiance * (scale * (PI * area / (TAU * (1.0 - cos))) as f32);
    let position = position(object, map.translation)?;
    let direction = direction(object, map.matrix3.z_axis)?;
    Ok(spot(position, direction, intensity, [cos; 2]))
}

impl EnvironmentEmitter {
    /// Reads `constant`, `envmap` and skies; `None` for other types.
    pub fn read(object: &Object, paints: &mut Paints) -> Result<Option<Self>> {
        match object.kind() {
            "constant" => {
                let radiance = paints.mean(object, "radiance", ColorUse::Light, Rgb::ONE)?;
                let content = Content::Map { width: 1, height: 1, pixels: vec![radiance] };
                Ok(Some(Self { content, to_world: DMat3::IDENTITY }))
            }
            "envmap" => {
                let (width, height, mut pixels) = environment::read(&object.file()?)?;
                let scale = object.float_in("scale", 1.0, [0.0, 1e30])? as f32;
                let invalid = environment::scale_pixels(&mut pixels, Rgb::splat(scale)).len();
                if invalid > 0 {
                    let phrase =
                        format!("used 0 for {invalid} pixels that are negative or not finite of");
                    paints.skipped(phrase, object);
                }
                let to_world = rotation(object)?;
                let (width, height, pixels) = fine(width, height, &pixels);
                let phrase =
                    "used constant pixels (small maps are refined) for the interpolated map of";
                paints.chosen(phrase, object);
                Ok(Some(Self { content: Content::Map { width, height, pixels }, to_world }))
            }
            _ if is_sky(object) => {
                let (sky, to_world) = sky::read(object, rotation(object)?, paints)?;
                Ok(Some(Self { content: Content::Sky(Box::new(sky)), to_world }))
            }
            _ => Ok(None),
        }
    }

    /// The rotation of the scene after which the map's +y is up: the inverse of `to_world` without
    /// its mirroring.
    pub fn upright(&self) -> DMat3 {
        let mirror = self.to_world.determinant() < 0.0;
        let own = if mirror { self.to_world * MIRROR } else { self.to_world };
        own.transpose()
    }

    /// Adds the sun of another environment to a sky without a sun, or the sky to the sun. Returns
    /// false if they are not such a pair.
    pub fn complete(&mut self, other: &Self) -> bool {
        let (Content::Sky(own), Content::Sky(added)) = (&mut self.content, &other.content) else {
            return false;
        };
        let overlaps =
            own.dome.is_some() == added.dome.is_some() || own.sun.is_some() == added.sun.is_some();
        if overlaps || !self.to_world.abs_diff_eq(other.to_world, 1e-9) {
            return false;
        }
        own.dome = own.dome.take().or_else(|| added.dome.clone());
        own.sun = own.sun.or(added.sun);
        true
    }

    /// The environment of a scene that was turned upright and, if `is_mirrored` is set, mirrored
    /// afterward.
    ///
    /// # Errors
    /// If the radiance of a sky overflows.
    pub fn environment(self, is_mirrored: bool) -> Result<Environment> {
        let swaps = is_mirrored != (self.to_world.determinant() < 0.0);
        match self.content {
            Content::Map { width, height, mut pixels } => {
                if swaps {
                    pixels.chunks_exact_mut(width as usize).for_each(<[Rgb]>::reverse);
                }
                // The first column of Mitsuba begins at -z, where our middle column is.
                let turn_deg = if width > 1 { 180.0 } else { 0.0 };
                Ok(Environment::new(width, height, pixels, turn_deg))
            }
            Content::Sky(sky) => sky.environment(if swaps { MIRROR } else { DMat3::IDENTITY }, 0.0),
        }
    }
}

/// The rotation in the property `to_world`, which may mirror.
fn rotation(object: &Object) -> Result<DMat3> {
    let map = object.map("to_world")?.matrix3;
    let unit = |axis: DVec3| axis.normalize_or_zero();
    let to_world = DMat3::from_cols(unit(map.x_axis), unit(map.y_axis), unit(map.z_axis));
    let skew = (to_world.transpose() * to_world - DMat3::IDENTITY).to_cols_array();
    if skew.iter().any(|x| x.abs() > 1e-3) {
        let problem = "its to_world is not a rotation";
        return Err(object.error(problem, "use only rotations and uniform scales"));
    }
    Ok(to_world)
}

/// Resamples a map as Mitsuba interpolates it: its columns are centered, and its first and last
/// rows are at the poles. Our pixels are constant.
fn fine(width: u32, height: u32, pixels: &[Rgb]) -> (u32, u32, Vec<Rgb>) {
    let factor = (FINE / width).clamp(1, 16);
    let (columns, rows) = (width * factor, height * factor);
    let at =
        |x: i64, y: usize| pixels[y * width as usize + x.rem_euclid(i64::from(width)) as usize];
    let mut made = Vec::with_capacity(columns as usize * rows as usize);
    for row in 0..rows {
        let y = (row as f32 + 0.5) / rows as f32 * (height - 1) as f32;
        let top = (y as usize).min(height.saturating_sub(2) as usize);
        let bottom = (top + 1).min(height as usize - 1);
        let down = y - top as f32;
        for column in 0..columns {
            let x = (column as f32 + 0.5) / factor as f32 - 0.5;
            let left = x.floor();
            let (i, right) = (left as i64, x - left);
            let along = |y: usize| at(i, y).lerp(at(i + 1, y), right);
            made.push(along(top).lerp(along(bottom), down));
        }
    }
    (columns, rows, made)
}
