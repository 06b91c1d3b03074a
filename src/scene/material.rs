//! The look of a surface: how it scatters, and what it emits.

use super::alpha_mask::CutOut;
use super::{NormalMap, Texture};
use crate::base::math::Rgb;
use crate::scene::bsdf::Bsdf;
use glam::{Vec2, Vec3};
use std::sync::Arc;

/// The look of a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// Name as in the scene or MTL file.
    pub name: String,
    /// How it scatters.
    pub bsdf: Bsdf,
    /// What the albedo of a diffuse, coated or glossy surface is multiplied with, place by place.
    pub albedo_texture: Option<Arc<Texture>>,
    /// What a glossy surface's roughness (green) and metallic share (blue) are multiplied with.
    pub metallic_roughness_texture: Option<Arc<Texture>>,
    /// Where there is a surface at all: where its opacity is at least a half.
    pub opacity_texture: Option<Arc<Texture>>,
    /// If given, there is instead a surface for this share of the rays, in [0, 1], times the texture's opacity.
    pub opacity: Option<f32>,
    /// How its normals are bent.
    pub normal_map: Option<NormalMap>,
    /// Radiance emitted from the front side, W/(m^2 sr); the front sees the vertices
    /// counterclockwise.
    pub emission: Rgb,
    /// What the emission is multiplied with.
    pub emission_texture: Option<Arc<Texture>>,
    /// Whether rays of the camera pass it until they meet something else: a lamp that is not to be in the image, but
    /// is seen in mirrors and through glass.
    pub hidden: bool,
}

impl Material {
    /// A material that is the same everywhere and emits nothing.
    pub fn new(name: &str, bsdf: Bsdf) -> Self {
        Self {
            name: name.to_owned(),
            bsdf,
            albedo_texture: None,
            metallic_roughness_texture: None,
            opacity_texture: None,
            opacity: None,
            normal_map: None,
            emission: Rgb::ZERO,
            emission_texture: None,
            hidden: false,
        }
    }

    /// Whether it is not the same everywhere where there is a surface.
    pub fn varies(&self) -> bool {
        let Self { albedo_texture, metallic_roughness_texture, emission_texture, .. } = self;
        let textures = [albedo_texture, metallic_roughness_texture, emission_texture];
        textures.into_iter().any(Option::is_some) || self.normal_map.is_some()
    }

    /// Whether it has any texture.
    pub fn is_textured(&self) -> bool {
        self.varies() || self.opacity_texture.is_some()
    }

    /// All textures that it has.
    pub(crate) fn textures(&self) -> impl Iterator<Item = &Arc<Texture>> {
        let normals = self.normal_map.as_ref().map(|map| &map.texture);
        let Self { albedo_texture, metallic_roughness_texture, .. } = self;
        let Self { opacity_texture, emission_texture, .. } = self;
        let own = [albedo_texture, metallic_roughness_texture, opacity_texture, emission_texture];
        own.into_iter().flatten().chain(normals)
    }

    /// Whether it may ask photons where they came from: with a BSDF that varies, or a normal that is
    /// not the triangle's.
    pub(super) fn merges_by_direction(&self) -> bool {
        let lambertian = matches!(self.bsdf, Bsdf::Lambertian { .. });
        let merges = self.bsdf.merges() || self.metallic_roughness_texture.is_some();
        merges && !lambertian || self.normal_map.is_some()
    }

    /// Radiance emitted from the front side at `uv`, W/(m^2 sr).
    pub fn emission_at(&self, uv: Vec2) -> Rgb {
        let color = |texture: &Arc<Texture>| texture.color(uv);
        self.emission * self.emission_texture.as_ref().map_or(Rgb::ONE, color)
    }

    /// Where rays pass; lights let none, because they emit from all of a triangle.
    pub fn cut_out(&self) -> Option<CutOut> {
        let Self { opacity_texture, opacity, emission, .. } = self;
        let passes = opacity_texture.is_some() || opacity.is_some_and(|opacity| opacity < 1.0);
        let cut_out = || CutOut { texture: opacity_texture.clone(), factor: *opacity };
        (passes && *emission == Rgb::ZERO).then(cut_out)
    }

    /// How it scatters at `uv` of a mesh of this color there, if that varies.
    pub(super) fn bsdf_at(&self, uv: Vec2, color: Option<Rgb>) -> Option<Bsdf> {
        let (albedo, data) = (&self.albedo_texture, &self.metallic_roughness_texture);
        if albedo.is_none() && data.is_none() && color.is_none() {
            return None;
        }
        let picture = albedo.as_ref().map_or(Rgb::ONE, |texture| texture.color(uv));
        let color = picture * color.unwrap_or(Rgb::ONE);
        match self.bsdf {
            Bsdf::Lambertian { albedo, two_sided } => {
                Some(Bsdf::Lambertian { albedo: albedo * color, two_sided })
            }
            Bsdf::Glossy(glossy) => {
                let data = data.as_ref().map_or(Vec3::ONE, |texture| texture.data(uv));
                Some(Bsdf::Glossy(glossy.scaled(color, data.z, data.y)))
            }
            Bsdf::Coated(coated) => Some(Bsdf::Coated(coated.with_albedo(coated.albedo() * color))),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opacity_below_one_lets_rays_pass_unless_the_material_emits() {
        let plain =
            Material::new("plain", Bsdf::Lambertian { albedo: Rgb::splat(0.5), two_sided: true });
        assert!(plain.cut_out().is_none());
        let share = |opacity| Material { opacity: Some(opacity), ..plain.clone() };
        assert!(share(0.5).cut_out().is_some() && share(1.0).cut_out().is_none());
        let lamp = Material { emission: Rgb::ONE, ..share(0.5) };
        assert!(lamp.cut_out().is_none(), "lights let no ray pass");
    }
}
