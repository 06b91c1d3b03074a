//! The look of a surface: how it scatters, and what it emits.

use crate::bsdf::Bsdf;
use crate::math::Rgb;

/// The look of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name as in the scene or MTL file.
    pub name: String,
    /// How it scatters.
    pub bsdf: Bsdf,
    /// Radiance emitted from the front side, W/(m^2 sr); the front sees the vertices
    /// counterclockwise.
    pub emission: Rgb,
}
