//! `[[light]]` of a scene file, in radiometric or photometric units.

use super::keys::{Point, Position};
use super::luminaire::{LuminaireFiles, OpeningChoice};
use super::numbers::NonNegative;
use crate::light::spot;
use crate::luminaires::PlacedLuminaire;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::scene::lights::emitter::{Directional, Emitter, Falloff, Spot};
use bdpm_core::scene::transform::normalized;
use glam::{DVec3, Vec3};
use serde::Deserialize;
use std::f32::consts::PI;
use std::path::Path;

/// `[[light]]`: the keys of all types, so that an unknown or wrong one is reported at its own line.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightTable {
    #[serde(rename = "type")]
    kind: LightKind,
    pub(super) name: Option<String>,
    pub(super) position: Option<Position>,
    target: Option<Position>,
    pub(super) direction: Option<Point>,
    /// Half the opening angles of the cones of a spot, from the axis.
    outer_deg: Option<f64>,
    inner_deg: Option<f64>,
    /// Intensity between both cones.
    falloff: Option<FalloffName>,
    intensity: Option<NonNegative>,
    power: Option<NonNegative>,
    candela: Option<NonNegative>,
    pub(super) lumen: Option<NonNegative>,
    irradiance: Option<NonNegative>,
    lux: Option<NonNegative>,
    pub(super) file: Option<String>,
    /// Number of the set of lamps of an EULUMDAT file, from 1.
    pub(super) lamp_set: Option<i64>,
    /// Toward the plane C0 of a luminaire.
    pub(super) c0: Option<Point>,
    /// Turn about the direction, counterclockwise as seen from behind the luminaire.
    pub(super) turn_deg: Option<f64>,
    /// Tilt for the tilt factors of the file.
    pub(super) tilt_deg: Option<f64>,
    pub(super) scale: Option<f64>,
    pub(super) color: Option<NonNegative>,
    pub(super) opening: Option<OpeningChoice>,
    /// Whether camera rays pass the opening.
    pub(super) hidden: Option<bool>,
}

/// Falloffs of spots.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum FalloffName {
    Quadratic,
    Smoothstep,
    Linear,
}

impl From<FalloffName> for Falloff {
    fn from(name: FalloffName) -> Self {
        match name {
            FalloffName::Quadratic => Self::Quadratic,
            FalloffName::Smoothstep => Self::Smoothstep,
            FalloffName::Linear => Self::LinearInAngle,
        }
    }
}

/// Types of lights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum LightKind {
    Point,
    Spot,
    Sun,
    Luminaire,
}

impl LightKind {
    /// Name of the type, and keys that it has besides `type` and `name`.
    fn keys(self) -> (&'static str, &'static [&'static str]) {
        match self {
            Self::Point => ("point", &["position", "intensity", "power", "candela", "lumen"]),
            Self::Spot => {
                let keys = &[
                    "position",
                    "target",
                    "direction",
                    "outer_deg",
                    "inner_deg",
                    "falloff",
                    "intensity",
                    "power",
                    "candela",
                    "lumen",
                ];
                ("spot", keys)
            }
            Self::Sun => ("sun", &["direction", "irradiance", "lux"]),
            Self::Luminaire => {
                let keys = &[
                    "file",
                    "lamp_set",
                    "position",
                    "direction",
                    "c0",
                    "turn_deg",
                    "tilt_deg",
                    "scale",
                    "lumen",
                    "color",
                    "opening",
                    "hidden",
                ];
                ("luminaire", keys)
            }
        }
    }
}

/// A light of a scene file.
pub enum TableLight {
    Emitter(Emitter),
    /// A luminaire, and notes about its file.
    Luminaire(PlacedLuminaire, Vec<String>),
}

impl LightTable {
    /// Name in results.
    pub fn name(&self) -> Option<&str> {
        self.name.as_deref()
    }

    /// The light in a scene whose origin is at this point; files are in `folder`.
    pub fn light(
        &self,
        folder: &Path,
        files: &mut LuminaireFiles,
        origin: DVec3,
    ) -> Result<TableLight> {
        self.check_keys()?;
        match self.kind {
            LightKind::Point => self.point(origin),
            LightKind::Spot => self.spot(origin),
            LightKind::Sun => self.sun(),
            LightKind::Luminaire => {
                let (luminaire, notes) = self.luminaire(folder, files, origin)?;
                return Ok(TableLight::Luminaire(luminaire, notes));
            }
        }
        .map(TableLight::Emitter)
    }

    /// Refuses keys of other types.
    fn check_keys(&self) -> Result<()> {
        let given = [
            ("position", self.position.is_some()),
            ("target", self.target.is_some()),
            ("direction", self.direction.is_some()),
            ("outer_deg", self.outer_deg.is_some()),
            ("inner_deg", self.inner_deg.is_some()),
            ("falloff", self.falloff.is_some()),
            ("intensity", self.intensity.is_some()),
            ("power", self.power.is_some()),
            ("candela", self.candela.is_some()),
            ("lumen", self.lumen.is_some()),
            ("irradiance", self.irradiance.is_some()),
            ("lux", self.lux.is_some()),
            ("file", self.file.is_some()),
            ("lamp_set", self.lamp_set.is_some()),
            ("c0", self.c0.is_some()),
            ("turn_deg", self.turn_deg.is_some()),
            ("tilt_deg", self.tilt_deg.is_some()),
            ("scale", self.scale.is_some()),
            ("color", self.color.is_some()),
            ("opening", self.opening.is_some()),
            ("hidden", self.hidden.is_some()),
        ];
        let (kind, keys) = self.kind.keys();
        let foreign = given.into_iter().find(|(key, is_given)| *is_given && !keys.contains(key));
        let Some((key, _)) = foreign else { return Ok(()) };
        let problem = format!("unknown key `{key}` of a light of the type \"{kind}\"");
        let names: Vec<_> = keys.iter().map(|key| format!("`{key}`")).collect();
        Err(Error::new(problem, format!("use {}", names.join(", "))))
    }

    /// The value of a key that the type of the light needs.
    pub(super) fn need<T>(&self, key: &str, value: Option<T>) -> Result<T> {
        let (kind, _) = self.kind.keys();
        value.ok_or_else(|| {
            let problem = format!("the key `{key}` is missing from a light of the type \"{kind}\"");
            Error::new(problem, "add it; docs/reference/scene-format.md lists the keys of lights")
        })
    }

    /// The only one of four amounts of light of a point or spot, W/sr; `solid_angle` is that of a
    /// spot with the intensity of its axis, sr.
    fn axial_intensity(&self, solid_angle: f32) -> Result<Rgb> {
        one_of(&[
            ("intensity", &self.intensity, 1.0),
            ("power", &self.power, 1.0 / solid_angle),
            ("candela", &self.candela, 1.0 / LUMENS_PER_WATT),
            ("lumen", &self.lumen, 1.0 / (solid_angle * LUMENS_PER_WATT)),
        ])
    }

    fn point(&self, origin: DVec3) -> Result<Emitter> {
        let position = self.need("position", self.position)?.relative_to(origin);
        Ok(Emitter::Point { position, intensity: self.axial_intensity(4.0 * PI)? })
    }

    fn spot(&self, origin: DVec3) -> Result<Emitter> {
        let in_file = self.need("position", self.position)?;
        let position = in_file.relative_to(origin);
        let direction = match (self.target, self.direction) {
            (Some(target), None) => in_file.vector_to(target, origin),
            (None, Some(direction)) => direction.0,
            _ => {
                let advice = "give the point it shines at as `target`, or a vector as `direction`";
                let problem = "a spot needs exactly one of `target` and `direction`";
                return Err(Error::new(problem, advice));
            }
        };
        let outer_deg = self.need("outer_deg", self.outer_deg)?;
        let cosines = cones(self.inner_deg.unwrap_or(0.0), outer_deg)?;
        let falloff = self.falloff.map_or_else(Falloff::default, Falloff::from);
        let spot = Spot { falloff, ..spot(position, unit(direction)?, Rgb::ONE, cosines) };
        let intensity = self.axial_intensity(spot.solid_angle())?;
        Ok(Emitter::Spot(Spot { intensity, ..spot }))
    }

    fn sun(&self) -> Result<Emitter> {
        let irradiance = one_of(&[
            ("irradiance", &self.irradiance, 1.0),
            ("lux", &self.lux, 1.0 / LUMENS_PER_WATT),
        ])?;
        let direction = self.need("direction", self.direction)?;
        Ok(Emitter::Directional(Directional::new(unit(direction.0)?, irradiance)))
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
fn cones(inner_deg: f64, outer_deg: f64) -> Result<[f64; 2]> {
    // Written so that NaN fails.
    if !(0.0 <= inner_deg && inner_deg < outer_deg && (0.5..=90.0).contains(&outer_deg)) {
        let problem =
            format!("the spot's angles are inner_deg = {inner_deg}, outer_deg = {outer_deg}");
        let advice = "give angles from the axis with 0 <= inner_deg < outer_deg, and outer_deg from 0.5 to 90";
        return Err(Error::new(problem, advice));
    }
    Ok([inner_deg, outer_deg].map(|degrees| degrees.to_radians().cos()))
}
