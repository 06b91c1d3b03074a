//! Records of a material in an MTL file, and their conversion to a BSDF.
//!
//! MTL describes highlights by Phong's model, which is not physically based. The table in
//! `docs/reference/meshes.md` lists which records become which BSDF.

use crate::look::{DEFAULT_ALBEDO, DEFAULT_IOR, Look, correlated, in_vacuum};
use crate::warnings::GroupedWarnings;
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::bsdf::{Bsdf, Coated, Conductor, Glossy, Reflectance};
use bdpm_core::scene::{Material, NormalMap, Texture};
use glam::Affine2;
use std::sync::Arc;

/// A nonmetal whose roughness (`Pr`) is below this value gets a smooth coat.
const COAT_ROUGHNESS: f32 = 0.3;

/// The supported records of one material.
#[derive(Clone, Debug, Default)]
pub(super) struct MtlMaterial {
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

impl MtlMaterial {
    /// The look that the records describe, with warnings about those that it does not represent.
    pub fn look(&self, warnings: &mut GroupedWarnings) -> Look {
        let mut look = self.surface(warnings);
        if let Some(to_uv) = self.to_uv {
            // The first texture of a material, whose map counts.
            let _ = look.shares_map(to_uv);
        }
        // Glass is transparent by its BSDF, so its opacity does not count.
        let is_glass = look.material.bsdf.transmits();
        let is_share = |opacity: &f32| (f32::MIN_POSITIVE..1.0).contains(opacity);
        let default = if self.emission_texture.is_some() { Rgb::ONE } else { Rgb::ZERO };
        let scale = self.normal_scale.unwrap_or(1.0);
        look.material = Material {
            emission: self.emission.unwrap_or(default),
            albedo_texture: self.albedo_texture.clone(),
            opacity_texture: self.opacity_texture.clone(),
            opacity: self.opacity.filter(|opacity| !is_glass && is_share(opacity)),
            normal_map: self.normal_texture.clone().map(|texture| NormalMap { texture, scale }),
            emission_texture: self.emission_texture.clone(),
            ..look.material
        };
        look
    }

    /// A uniform surface that scatters as the records say.
    fn surface(&self, warnings: &mut GroupedWarnings) -> Look {
        let default = if self.albedo_texture.is_some() { 1.0 } else { DEFAULT_ALBEDO };
        let diffuse = self.diffuse.unwrap_or(Rgb::splat(default));
        let specular = self.specular.unwrap_or(Rgb::ZERO);
        let ior = self.ior.unwrap_or(DEFAULT_IOR);
        let alpha = self.alpha();
        let metallic = self.metalness.unwrap_or(0.0);
        let is_metal = metallic > 0.0;
        let has_ior = ior > 1.0;
        // Models with refraction, and glass.
        let is_glass = matches!(self.model, Some(4 | 6 | 7 | 9)) && has_ior && !is_metal;
        if is_glass {
            // Some programs write a filter of 0 for clear glass.
            let filter = self.filter.filter(|own| *own != Rgb::ZERO).unwrap_or(Rgb::ONE);
            let is_black = self.filter == Some(Rgb::ZERO);
            warnings
                .skipped_if([(is_black, "ignored the transmission filter `Tf` of")], &self.name);
            return Look::dielectric(in_vacuum(ior), correlated(alpha), filter.min(Rgb::ONE));
        }
        let metal = |normal| Bsdf::Conductor(Conductor::new(Reflectance::Artist { normal }, alpha));
        let has_highlight = self.model == Some(2) && specular != Rgb::ZERO;
        // Models with ray-traced reflection.
        let is_reflective = matches!(self.model, Some(3 | 5 | 8));
        let is_smooth = self.roughness.is_some_and(|roughness| roughness < COAT_ROUGHNESS);
        let is_rough = self.roughness.is_some() || has_highlight && self.exponent.is_some();
        let bsdf = match () {
            _ if metallic >= 1.0 => metal(diffuse),
            _ if is_metal => Bsdf::Glossy(Glossy::new(diffuse, metallic, ior, alpha)),
            _ if is_reflective && diffuse == Rgb::ZERO && alpha == 0.0 => {
                Bsdf::Mirror { reflectance: specular }
            }
            _ if diffuse == Rgb::ZERO && specular != Rgb::ZERO => metal(specular),
            _ if has_ior && (is_smooth || is_reflective && diffuse != Rgb::ZERO) => {
                Bsdf::Coated(Coated::new(diffuse, ior))
            }
            _ if has_ior && is_rough => Bsdf::Glossy(Glossy::new(diffuse, metallic, ior, alpha)),
            _ => Bsdf::diffuse(diffuse),
        };
        let is_diffuse = matches!(bsdf, Bsdf::Lambertian { .. });
        let phrases = [
            // Some exporters write it for visible surfaces.
            (self.opacity == Some(0.0), "ignored the opacity of 0 of"),
            (is_diffuse && has_highlight, "ignored the highlights (`Ks` with `Kd`) of"),
        ];
        warnings.skipped_if(phrases, &self.name);
        Look::new(bsdf)
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
