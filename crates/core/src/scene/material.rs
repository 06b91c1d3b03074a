//! Materials: scattering and emission of a surface.

use super::alpha_mask::AlphaMask;
use super::lights::luminaire::LuminousOpening;
use super::media::MediumBoundary;
use super::{Dispersion, NormalMap, Texture};
use crate::base::math::Rgb;
use crate::scene::bsdf::{Bsdf, TextureValues};
use glam::{Vec2, Vec3};
use serde::Serialize;
use std::sync::Arc;

/// The material of a surface.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Material {
    /// Name in the scene or MTL file.
    #[serde(skip)]
    pub name: String,
    /// The scattering function.
    pub bsdf: Bsdf,
    /// Dispersion of a dielectric, whose BSDF has the index at the line d; `None` if all
    /// wavelengths have this index.
    pub dispersion: Option<Arc<Dispersion>>,
    /// Factor of the albedo of a surface with a diffuse base, and of the reflectance of a sheet
    /// that also transmits diffusely.
    pub albedo_texture: Option<Arc<Texture>>,
    /// Factors of a glossy or principled surface's roughness (green) and metallic share (blue).
    pub metallic_roughness_texture: Option<Arc<Texture>>,
    /// Alpha mask: rays meet the surface only where the opacity is at least a half.
    pub opacity_texture: Option<Arc<Texture>>,
    /// If set, this share of the rays, in [0, 1], times the texture's opacity meets the surface
    /// instead.
    pub opacity: Option<f32>,
    /// Map that bends the normals.
    pub normal_map: Option<NormalMap>,
    /// Radiance emitted from the front side, W/(m^2 sr); seen from the front, vertices are
    /// counterclockwise. Where a share of the rays meets the surface, this is the radiance that
    /// they see, and the surface emits the share of it.
    pub emission: Rgb,
    /// Factor of the emission.
    pub emission_texture: Option<Arc<Texture>>,
    /// Emission of the luminous opening of a luminaire, which depends on the direction; `emission`
    /// is then 0.
    pub luminous_opening: Option<Arc<LuminousOpening>>,
    /// If true, camera rays pass the surface: a lamp that is not in the image, but visible in
    /// mirrors and through glass.
    pub hidden_from_camera: bool,
    /// The media on both sides, if the surface bounds any.
    pub boundary: Option<MediumBoundary>,
    /// Factor of the transmittance of a sheet that transmits diffusely. Only where there is one is
    /// it part of the fingerprint, so that other scenes keep theirs.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transmittance_texture: Option<Arc<Texture>>,
    /// If true, the back emits as the front does. Only then is it part of the fingerprint.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub two_sided_emission: bool,
}

impl Material {
    /// A uniform material that emits nothing.
    pub fn new(name: &str, bsdf: Bsdf) -> Self {
        Self {
            name: name.to_owned(),
            bsdf,
            dispersion: None,
            albedo_texture: None,
            metallic_roughness_texture: None,
            opacity_texture: None,
            opacity: None,
            normal_map: None,
            emission: Rgb::ZERO,
            emission_texture: None,
            luminous_opening: None,
            hidden_from_camera: false,
            boundary: None,
            transmittance_texture: None,
            two_sided_emission: false,
        }
    }

    /// Returns true if scattering, normals or emission vary over the surface, or depend on the
    /// direction of its texture coordinates.
    pub fn varies(&self) -> bool {
        let Self { albedo_texture, transmittance_texture, .. } = self;
        let Self { metallic_roughness_texture, emission_texture, .. } = self;
        let scattering = [albedo_texture, transmittance_texture, metallic_roughness_texture];
        let textures = scattering.into_iter().chain([emission_texture]);
        let is_textured = textures.into_iter().any(Option::is_some) || self.normal_map.is_some();
        is_textured || self.bsdf.is_anisotropic()
    }

    /// Returns true if the surface only bounds media, so that all light goes straight on.
    pub fn is_index_matched_boundary(&self) -> bool {
        self.boundary.is_some() && self.bsdf.is_index_matched()
    }

    /// Returns true if the material has any texture.
    pub fn is_textured(&self) -> bool {
        self.varies() || self.opacity_texture.is_some()
    }

    /// All textures of the material.
    pub fn textures(&self) -> impl Iterator<Item = &Arc<Texture>> {
        let normals = self.normal_map.as_ref().map(|map| &map.texture);
        let Self { albedo_texture, transmittance_texture, .. } = self;
        let Self { metallic_roughness_texture, opacity_texture, emission_texture, .. } = self;
        let scattering = [albedo_texture, transmittance_texture, metallic_roughness_texture];
        let own = scattering.into_iter().chain([opacity_texture, emission_texture]);
        own.flatten().chain(normals)
    }

    /// Returns true if the surface may have a lobe that is
    /// [`Lobe::Rough`](super::bsdf::Lobe::Rough) somewhere: a texture of its roughness makes any.
    pub(super) fn may_be_rough(&self) -> bool {
        self.bsdf.has_rough() || self.metallic_roughness_texture.is_some()
    }

    /// Returns true if merges may need the direction of photons: for BSDFs that vary with it, or
    /// normals that differ from the triangle's.
    pub(super) fn merges_by_direction(&self) -> bool {
        let merges = self.bsdf.merges() || self.metallic_roughness_texture.is_some();
        merges && !self.bsdf.is_constant() || self.normal_map.is_some()
    }

    /// Radiance that rays see on a side that emits at `uv`, W/(m^2 sr).
    pub fn emission_at(&self, uv: Vec2) -> Rgb {
        let color = |texture: &Arc<Texture>| texture.color(uv);
        self.emission * self.emission_texture.as_ref().map_or(Rgb::ONE, color)
    }

    /// The alpha mask; `None` if no ray passes.
    pub fn alpha_mask(&self) -> Option<AlphaMask> {
        let Self { opacity_texture, opacity, .. } = self;
        let passes = opacity_texture.is_some() || opacity.is_some_and(|opacity| opacity < 1.0);
        passes.then(|| AlphaMask { texture: opacity_texture.clone(), factor: *opacity })
    }

    /// Returns true if the surface, at least in part, is met by a share of the rays only.
    pub fn is_translucent(&self) -> bool {
        self.opacity.is_some() && self.alpha_mask().is_some()
    }

    /// The BSDF at `uv`, where the mesh has this color; `None` if it does not vary.
    pub(super) fn bsdf_at(&self, uv: Vec2, color: Option<Rgb>) -> Option<Bsdf> {
        let (albedo, data) = (&self.albedo_texture, &self.metallic_roughness_texture);
        let transmitted = &self.transmittance_texture;
        if [albedo, transmitted, data].iter().all(|own| own.is_none()) && color.is_none() {
            return None;
        }
        let picture = |texture: &Option<Arc<Texture>>| {
            texture.as_ref().map_or(Rgb::ONE, |texture| texture.color(uv))
        };
        let color = picture(albedo) * color.unwrap_or(Rgb::ONE);
        let data = data.as_ref().map_or(Vec3::ONE, |texture| texture.data(uv));
        let transmitted = picture(transmitted);
        let values = TextureValues { color, transmitted, metallic: data.z, roughness: data.y };
        self.bsdf.textured(&values)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn materials_that_a_share_of_rays_pass_are_translucent() {
        let plain =
            Material::new("plain", Bsdf::Lambertian { albedo: Rgb::splat(0.5), two_sided: true });
        assert!(plain.alpha_mask().is_none());
        let share = |opacity| Material { opacity: Some(opacity), ..plain.clone() };
        assert!(share(0.5).alpha_mask().is_some() && share(1.0).alpha_mask().is_none());
        let lamp = Material { emission: Rgb::ONE, ..share(0.5) };
        assert!(lamp.alpha_mask().is_some(), "lights let rays pass as well");
    }
}
