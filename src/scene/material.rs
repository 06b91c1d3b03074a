//! What a surface does with light: the closed set of BSDFs, and emission.

use crate::math::{Rgb, cosine_hemisphere};
use glam::Vec3;
use std::f32::consts::FRAC_1_PI;

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

/// A bidirectional scattering distribution function. Directions point away from the surface;
/// normals are unit vectors on the side of `wo`.
#[derive(Clone, Debug, PartialEq)]
pub enum Bsdf {
    /// Ideal diffuse reflection from both sides.
    Lambertian {
        /// Reflected share of the incident flux, in [0, 1].
        albedo: Rgb,
    },
}

/// A sampled direction.
#[derive(Clone, Copy, Debug)]
pub struct BsdfSample {
    /// Sampled direction.
    pub wi: Vec3,
    /// `f cos(theta) / pdf_w`.
    pub weight: Rgb,
}

impl Bsdf {
    /// The BSDF's value, 1/sr, for light from `wi` to `wo`, both on the side of the normal.
    #[inline]
    pub fn eval(&self) -> Rgb {
        match self {
            Self::Lambertian { albedo } => *albedo * FRAC_1_PI,
        }
    }

    /// Samples the direction of the next segment from two uniform numbers.
    #[inline]
    pub fn sample(&self, normal: Vec3, u: [f32; 2]) -> BsdfSample {
        match self {
            Self::Lambertian { albedo } => {
                BsdfSample { wi: cosine_hemisphere(normal, u), weight: *albedo }
            }
        }
    }

    /// Share of the incident flux that is scattered, per channel.
    #[inline]
    pub fn albedo(&self) -> Rgb {
        match self {
            Self::Lambertian { albedo } => *albedo,
        }
    }
}
