//! Records of a material in an MTL file, and their conversion to a BSDF.
//!
//! MTL describes highlights by Phong's model, which is not physically based. The table in
//! `docs/reference/meshes.md` lists which records become which BSDF.

use super::DEFAULT_ALBEDO;
use crate::scene_file::material::{DEFAULT_IOR, dielectric};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::bsdf::{Bsdf, Coated, Conductor, Glossy, Reflectance};
use bdpm_core::scene::{Material, NormalMap, Texture};
use glam::Affine2;
use std::sync::Arc;

/// A nonmetal whose roughness (`Pr`) is below this value gets a smooth coat.
const COAT_ROUGHNESS: f32 = 0.3;

/// The supported records of one material.
#[derive(Clone, Debug, Default)]
pub(crate) struct MtlMaterial {
    /// `newmtl`: name of the material.
    pub name: String,
    /// `Kd`: diffuse albedo, each component in [0, 1].
    pub diffuse: Option<Rgb>,
    /// `Ks`: specular reflectance, each component in [0, 1].
    pub specular: Option<Rgb>,
    /// `Ke`: emitted radiance, W/(m^2 sr).
    pub emission: Option<Rgb>,
    /// `Ns`: exponent of Phong's model, at least 0.
    pub exponent: Option<f32>,
    /// `Ni`: refractive index.
    pub ior: Option<f32>,
    /// `d` or 1 - `Tr`: opacity in [0, 1].
    pub opacity: Option<f32>,
    /// `illum`: illumination model, 0 to 10.
    pub model: Option<u8>,
    /// `Pr`: perceptual roughness in [0, 1].
    pub roughness: Option<f32>,
    /// `Pm`: metalness in [0, 1].
    pub metalness: Option<f32>,
    /// `map_Kd`: texture that multiplies the albedo.
    pub albedo_texture: Option<Arc<Texture>>,
    /// `map_d`: texture of the opacity.
    pub opacity_texture: Option<Arc<Texture>>,
    /// `map_Ke`: texture that multiplies the emission.
    pub emission_texture: Option<Arc<Texture>>,
    /// `norm`: tangent-space normal map.
    pub normal_texture: Option<Arc<Texture>>,
    /// `-bm` of `norm`: factor of the slope of the normal map.
    pub normal_scale: Option<f32>,
    /// `Tf`: factor of light that crosses the surface.
    pub filter: Option<Rgb>,
    /// `-s` and `-o` of the first texture.
    pub to_uv: Option<Affine2>,
}

/// Properties of a material that its BSDF does not represent.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Ignored {
    /// Whether a highlight over a diffuse base was ignored.
    pub highlight: bool,
    /// Whether an opacity of 0 was ignored, which some exporters write for visible surfaces.
    pub transparency: bool,
    /// Whether a transmission filter was ignored.
    pub filter: bool,
}

impl MtlMaterial {
    /// Returns the material and the properties that it does not represent.
    pub(crate) fn material(&self) -> (Material, Ignored) {
        let (bsdf, ignored) = self.bsdf();
        // Glass is transparent by its BSDF, so its opacity does not count.
        let glass = bsdf.transmits();
        let default = if self.emission_texture.is_some() { Rgb::ONE } else { Rgb::ZERO };
        let normal_map = self.normal_texture.clone();
        let material = Material {
            emission: self.emission.unwrap_or(default),
            albedo_texture: self.albedo_texture.clone(),
            opacity_texture: self.opacity_texture.clone(),
            opacity: self
                .opacity
                .filter(|opacity| !glass && (f32::MIN_POSITIVE..1.0).contains(opacity)),
            normal_map: normal_map
                .map(|texture| NormalMap { texture, scale: self.normal_scale.unwrap_or(1.0) }),
            emission_texture: self.emission_texture.clone(),
            ..Material::new(&self.name, bsdf)
        };
        (material, ignored)
    }

    fn bsdf(&self) -> (Bsdf, Ignored) {
        let default = if self.albedo_texture.is_some() { 1.0 } else { DEFAULT_ALBEDO };
        let diffuse = self.diffuse.unwrap_or(Rgb::splat(default));
        let specular = self.specular.unwrap_or(Rgb::ZERO);
        let ior = self.ior.unwrap_or(DEFAULT_IOR);
        let alpha = self.alpha();
        let metal = |normal| Bsdf::Conductor(Conductor::new(Reflectance::Artist { normal }, alpha));
        let metallic = self.metalness.unwrap_or(0.0);
        let glossy = || Bsdf::Glossy(Glossy::new(diffuse, metallic, ior, alpha));
        let has_ior = ior > 1.0;
        let has_highlight = self.model == Some(2) && specular != Rgb::ZERO;
        let transparency = self.opacity == Some(0.0);
        let kept = Ignored { transparency, ..Ignored::default() };

        if metallic >= 1.0 {
            return (metal(diffuse), kept);
        } else if metallic > 0.0 {
            return (glossy(), kept);
        }
        match self.model {
            // Models with refraction, and glass.
            Some(4 | 6 | 7 | 9) if has_ior => {
                // Some programs write a filter of 0 for clear glass.
                let filter = self.filter.filter(|own| *own != Rgb::ZERO);
                let ignored =
                    Ignored { filter: self.filter == Some(Rgb::ZERO), ..Ignored::default() };
                (dielectric(ior, alpha, filter.unwrap_or(Rgb::ONE).min(Rgb::ONE)), ignored)
            }
            // Models with ray-traced reflection.
            Some(3 | 5 | 8) if diffuse == Rgb::ZERO && alpha == 0.0 => {
                (Bsdf::Mirror { reflectance: specular }, kept)
            }
            Some(3 | 5 | 8) if diffuse != Rgb::ZERO && has_ior => {
                (Bsdf::Coated(Coated::new(diffuse, ior)), kept)
            }
            _ if diffuse == Rgb::ZERO && specular != Rgb::ZERO => (metal(specular), kept),
            _ if self.roughness.is_some_and(|r| r < COAT_ROUGHNESS) && has_ior => {
                (Bsdf::Coated(Coated::new(diffuse, ior)), kept)
            }
            _ if has_ior
                && (self.roughness.is_some() || has_highlight && self.exponent.is_some()) =>
            {
                (glossy(), kept)
            }
            _ => (Bsdf::diffuse(diffuse), Ignored { highlight: has_highlight, ..kept }),
        }
    }

    /// Returns the width `alpha` of the GGX distribution. It is the square of `Pr` if that is
    /// given. Otherwise `alpha^2 = 2/(Ns + 2)` (Walter et al. 2007), which matches the curvature of
    /// Phong's lobe at its peak. Models with ray-traced reflection or refraction are smooth.
    fn alpha(&self) -> f32 {
        match (self.roughness, self.exponent, self.model) {
            (Some(roughness), ..) => roughness * roughness,
            (None, _, Some(3..=9)) | (None, None, _) => 0.0,
            (None, Some(exponent), _) => (2.0 / (exponent + 2.0)).sqrt(),
        }
    }
}
