//! Lights at points and far away, which several formats have.

use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::transform::MAX_COORDINATE;
use bdpm_core::scene::{Falloff, Spot};
use glam::{DVec3, Vec3};

/// Narrowest falloff of a spot in cosines. Rounding must not reduce it to 0.
const LEAST_FALLOFF: f64 = 1e-9;

/// A spot with these cosines of its inner and outer angle, and the falloff of glTF between them.
pub fn spot(
    position: Vec3,
    direction: Vec3,
    intensity: Rgb,
    [cos_inner, cos_outer]: [f64; 2],
) -> Spot {
    let cos_inner = cos_inner.min(1.0);
    let cos_outer = cos_outer.min(cos_inner - LEAST_FALLOFF);
    let falloff = Falloff::default();
    Spot { position, direction, intensity, cos_inner, cos_outer, falloff }
}

/// The position of a light.
///
/// # Errors
/// If it is out of the range of coordinates. The error names no place.
pub fn position(point: DVec3) -> Result<Vec3> {
    let point = point.as_vec3();
    // Written so that NaN fails.
    if point.abs().cmple(Vec3::splat(MAX_COORDINATE)).all() {
        return Ok(point);
    }
    let problem = format!("the light's position is beyond {MAX_COORDINATE:e}");
    Err(Error::new(problem, "move it closer"))
}

/// The unit vector along `vector`.
///
/// # Errors
/// If the vector has no length. The error names no place.
pub fn direction(vector: DVec3) -> Result<Vec3> {
    let unit = vector.try_normalize().map(|unit| unit.as_vec3());
    unit.ok_or_else(|| Error::new("the light has no direction", "give a vector that is not zero"))
}
