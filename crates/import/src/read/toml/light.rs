//! `[[light]]` of a scene file, in radiometric or photometric units.

use super::keys::Point;
use super::luminaire::{LuminaireFiles, LuminaireTable};
use super::numbers::NonNegative;
use crate::light::spot;
use crate::luminaires::PlacedLuminaire;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::scene::lights::emitter::{Directional, Emitter, Spot};
use bdpm_core::scene::transform::normalized;
use glam::Vec3;
use serde::Deserialize;
use std::f32::consts::PI;
use std::path::Path;

/// `[[light]]`
#[derive(Debug, Deserialize)]
#[serde(tag = "type", rename_all = "kebab-case", deny_unknown_fields)]
pub enum LightTable {
    Point {
        position: Point,
        intensity: Option<NonNegative>,
        power: Option<NonNegative>,
        candela: Option<NonNegative>,
        lumen: Option<NonNegative>,
    },
    Spot {
        position: Point,
        target: Option<Point>,
        direction: Option<Point>,
        /// Half the opening angles of the cones, from the axis.
        outer_deg: f32,
        #[serde(default)]
        inner_deg: f32,
        intensity: Option<NonNegative>,
        power: Option<NonNegative>,
        candela: Option<NonNegative>,
        lumen: Option<NonNegative>,
    },
    Sun {
        direction: Point,
        irradiance: Option<NonNegative>,
        lux: Option<NonNegative>,
    },
    Luminaire(LuminaireTable),
}

/// A light of a scene file.
pub enum TableLight {
    Emitter(Emitter),
    /// A luminaire, and notes about its file.
    Luminaire(PlacedLuminaire, Vec<String>),
}

impl LightTable {
    /// The light; files are in `folder`.
    pub fn light(&self, folder: &Path, files: &mut LuminaireFiles) -> Result<TableLight> {
        if let Self::Luminaire(table) = self {
            let (luminaire, notes) = table.luminaire(folder, files)?;
            return Ok(TableLight::Luminaire(luminaire, notes));
        }
        self.emitter().map(TableLight::Emitter)
    }

    fn emitter(&self) -> Result<Emitter> {
        match self {
            Self::Point { position, intensity, power, candela, lumen } => {
                let intensity = one_of(&[
                    ("intensity", intensity, 1.0),
                    ("power", power, 1.0 / (4.0 * PI)),
                    ("candela", candela, 1.0 / LUMENS_PER_WATT),
                    ("lumen", lumen, 1.0 / (4.0 * PI * LUMENS_PER_WATT)),
                ])?;
                Ok(Emitter::Point { position: position.0, intensity })
            }
            Self::Spot {
                position,
                target,
                direction,
                outer_deg,
                inner_deg,
                intensity,
                power,
                candela,
                lumen,
            } => {
                let direction = match (target, direction) {
                    (Some(target), None) => target.0 - position.0,
                    (None, Some(direction)) => direction.0,
                    _ => {
                        let advice =
                            "give the point it shines at as `target`, or a vector as `direction`";
                        let problem = "a spot needs exactly one of `target` and `direction`";
                        return Err(Error::new(problem, advice));
                    }
                };
                let cosines = cones(*inner_deg, *outer_deg)?;
                let spot = spot(position.0, unit(direction)?, Rgb::ONE, cosines);
                let solid_angle = spot.solid_angle();
                let intensity = one_of(&[
                    ("intensity", intensity, 1.0),
                    ("power", power, 1.0 / solid_angle),
                    ("candela", candela, 1.0 / LUMENS_PER_WATT),
                    ("lumen", lumen, 1.0 / (solid_angle * LUMENS_PER_WATT)),
                ])?;
                Ok(Emitter::Spot(Spot { intensity, ..spot }))
            }
            Self::Sun { direction, irradiance, lux } => {
                let irradiance = one_of(&[
                    ("irradiance", irradiance, 1.0),
                    ("lux", lux, 1.0 / LUMENS_PER_WATT),
                ])?;
                Ok(Emitter::Directional(Directional::new(unit(direction.0)?, irradiance)))
            }
            Self::Luminaire(_) => unreachable!("`light` returns it before"),
        }
    }
}

/// The only given amount, times its factor.
fn one_of(keys: &[(&str, &Option<NonNegative>, f32)]) -> Result<Rgb> {
    let given: Vec<Rgb> =
        keys.iter().filter_map(|(_, value, factor)| value.map(|v| v.0 * *factor)).collect();
    match given[..] {
        [value] => Ok(value),
        _ => {
            let names: Vec<_> = keys.iter().map(|(name, ..)| format!("`{name}`")).collect();
            let problem = format!("the light needs exactly one of {}", names.join(", "));
            Err(Error::new(problem, "give one number for all channels, or three"))
        }
    }
}

fn unit(direction: Vec3) -> Result<Vec3> {
    let unit = normalized(direction);
    if unit == Vec3::ZERO {
        let advice = "give a vector along which it shines, such as [0, -1, 0]";
        return Err(Error::new("the light's direction has no length", advice));
    }
    Ok(unit)
}

/// Cosines of a spot's angles.
fn cones(inner_deg: f32, outer_deg: f32) -> Result<[f32; 2]> {
    // Written so that NaN fails.
    if !(0.0 <= inner_deg && inner_deg < outer_deg && (0.5..=90.0).contains(&outer_deg)) {
        let problem =
            format!("the spot's angles are inner_deg = {inner_deg}, outer_deg = {outer_deg}");
        let advice = "give angles from the axis with 0 <= inner_deg < outer_deg, and outer_deg from 0.5 to 90";
        return Err(Error::new(problem, advice));
    }
    Ok([inner_deg, outer_deg].map(|degrees| degrees.to_radians().cos()))
}
