//! What a material of an MTL file means: its records, and the BSDF made of them.
//!
//! MTL grew from Phong's highlights, which are no physical material; the table in
//! `docs/scene-format.md` tells what becomes of it.

use super::DEFAULT_ALBEDO;
use crate::base::math::Rgb;
use crate::import::scene_file::material::{DEFAULT_IOR, dielectric};
use crate::scene::bsdf::{Bsdf, Coated, Conductor, Glossy, Reflectance};
use crate::scene::{Material, NormalMap, Texture};
use std::sync::Arc;

/// Below this roughness (`Pr`) a surface that is no metal has a smooth coat.
pub(in crate::import) const COAT_ROUGHNESS: f32 = 0.3;

/// The records of one material, as far as they are understood.
#[derive(Clone, Debug, Default)]
pub(in crate::import) struct MtlMaterial {
    /// `newmtl`
    pub name: String,
    /// `Kd`, at most 1.
    pub diffuse: Option<Rgb>,
    /// `Ks`, at most 1.
    pub specular: Option<Rgb>,
    /// `Ke`, W/(m^2 sr).
    pub emission: Option<Rgb>,
    /// `Ns`: Phong's exponent, at least 0.
    pub exponent: Option<f32>,
    /// `Ni`: refractive index.
    pub ior: Option<f32>,
    /// `d`, or 1 less `Tr`.
    pub opacity: Option<f32>,
    /// `illum`
    pub model: Option<u8>,
    /// `Pr`
    pub roughness: Option<f32>,
    /// `Pm`
    pub metalness: Option<f32>,
    /// `map_Kd`
    pub albedo_texture: Option<Arc<Texture>>,
    /// `map_d`
    pub opacity_texture: Option<Arc<Texture>>,
    /// `map_Ke`
    pub emission_texture: Option<Arc<Texture>>,
    /// `norm`
    pub normal_texture: Option<Arc<Texture>>,
}

/// What was left out of a material.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::import) struct Ignored {
    /// A highlight over a diffuse base.
    pub highlight: bool,
    /// An opacity of 0, which files have for what is to be seen.
    pub transparency: bool,
}

impl MtlMaterial {
    /// The material, and what of its records has no counterpart.
    pub(in crate::import) fn material(&self) -> (Material, Ignored) {
        let (bsdf, ignored) = self.bsdf();
        // Glass shows by itself what is behind it.
        let glass = bsdf.transmits();
        let unsaid = if self.emission_texture.is_some() { Rgb::ONE } else { Rgb::ZERO };
        let normal_map = self.normal_texture.clone();
        let material = Material {
            emission: self.emission.unwrap_or(unsaid),
            albedo_texture: self.albedo_texture.clone(),
            opacity_texture: self.opacity_texture.clone(),
            opacity: self
                .opacity
                .filter(|opacity| !glass && (f32::MIN_POSITIVE..1.0).contains(opacity)),
            normal_map: normal_map.map(|texture| NormalMap { texture, scale: 1.0 }),
            emission_texture: self.emission_texture.clone(),
            ..Material::new(&self.name, bsdf)
        };
        (material, ignored)
    }

    fn bsdf(&self) -> (Bsdf, Ignored) {
        let unsaid = if self.albedo_texture.is_some() { 1.0 } else { DEFAULT_ALBEDO };
        let diffuse = self.diffuse.unwrap_or(Rgb::splat(unsaid));
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
            // Refraction, and glass.
            Some(4 | 6 | 7 | 9) if has_ior => {
                (dielectric(ior, alpha, Rgb::ONE), Ignored::default())
            }
            // Reflection by ray tracing.
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

    /// GGX width: the square of `Pr`, else of the same curvature at its peak as Phong's lobe
    /// (`alpha^2 = 2/(Ns + 2)`, Walter et al. 2007); models of ray tracing are smooth.
    fn alpha(&self) -> f32 {
        match (self.roughness, self.exponent, self.model) {
            (Some(roughness), ..) => roughness * roughness,
            (None, _, Some(3..=9)) | (None, None, _) => 0.0,
            (None, Some(exponent), _) => (2.0 / (exponent + 2.0)).sqrt(),
        }
    }
}
