//! The look of a surface: how it scatters, and what it emits.

use super::Texture;
use crate::bsdf::Bsdf;
use crate::math::Rgb;
use glam::Vec2;
use std::sync::Arc;

/// The look of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name as in the scene or MTL file.
    pub name: String,
    /// How it scatters.
    pub bsdf: Bsdf,
    /// What the albedo of a diffuse surface or base is multiplied with, place by place.
    pub albedo_texture: Option<Arc<Texture>>,
    /// Where there is a surface at all: where its opacity is at least a half.
    pub opacity_texture: Option<Arc<Texture>>,
    /// Radiance emitted from the front side, W/(m^2 sr); the front sees the vertices
    /// counterclockwise.
    pub emission: Rgb,
}

impl Material {
    /// A material that is the same everywhere and emits nothing.
    pub fn new(name: &str, bsdf: Bsdf) -> Self {
        let (albedo_texture, opacity_texture) = (None, None);
        Self { name: name.to_owned(), bsdf, albedo_texture, opacity_texture, emission: Rgb::ZERO }
    }

    /// The texture that cuts holes; lights have none, because they emit from all of a triangle.
    pub fn cut_out(&self) -> Option<&Arc<Texture>> {
        self.opacity_texture.as_ref().filter(|_| self.emission == Rgb::ZERO)
    }

    /// How it scatters at `uv`, if that varies.
    pub(super) fn bsdf_at(&self, uv: Vec2) -> Option<Bsdf> {
        let color = self.albedo_texture.as_ref()?.color(uv);
        match self.bsdf {
            Bsdf::Lambertian { albedo, two_sided } => {
                Some(Bsdf::Lambertian { albedo: albedo * color, two_sided })
            }
            Bsdf::Glossy(glossy) => Some(Bsdf::Glossy(glossy.scaled(color, 1.0, 1.0))),
            Bsdf::Coated(coated) => Some(Bsdf::Coated(coated.with_albedo(coated.albedo() * color))),
            _ => None,
        }
    }
}
