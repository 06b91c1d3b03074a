//! `[materials.NAME]` of a scene file.

use super::medium;
use super::numbers::{
    Albedo, MetalIndex, Metallic, NonNegative, NormalScale, Opacity, Roughness, Share,
};
use super::refractive_index::Ior;
use super::texture::{FilterKind, TextureTable, TomlTextures, Wraps};
use crate::mtl;
use crate::text::list;
use bdpm_core::base::error::Error;
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::bsdf::{
    Bsdf, Coated, Conductor, Dielectric, FacetModel, Facets, Glossy, Plastic, Principled,
    PrincipledParameters, Reflectance, RoughDielectric, SMOOTH_ALPHA, ThinDielectric,
};
use bdpm_core::scene::{
    Dispersion, Material, Medium, NormalMap, RefractiveIndex, Sampling, Texture, Wrap,
};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::sync::Arc;
use toml::Spanned;

/// Default refractive index.
pub(crate) const DEFAULT_IOR: f32 = 1.5;

/// The keys of a material.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct MaterialTable {
    #[serde(default, rename = "type")]
    kind: MaterialKind,
    albedo: Option<Spanned<Albedo>>,
    albedo_texture: Option<Spanned<TextureTable>>,
    metallic_roughness_texture: Option<Spanned<TextureTable>>,
    opacity_texture: Option<Spanned<TextureTable>>,
    opacity: Option<Opacity>,
    transmittance: Option<Spanned<Albedo>>,
    normal_texture: Option<Spanned<TextureTable>>,
    normal_scale: Option<Spanned<NormalScale>>,
    emission_texture: Option<Spanned<TextureTable>>,
    texture_wrap: Option<Wraps>,
    texture_filter: Option<FilterKind>,
    two_sided: Option<Spanned<bool>>,
    reflectance: Option<Spanned<Albedo>>,
    facets: Option<Spanned<FacetName>>,
    tint: Option<Spanned<Albedo>>,
    nonlinear: Option<Spanned<bool>>,
    metal: Option<Spanned<String>>,
    eta: Option<Spanned<MetalIndex>>,
    k: Option<Spanned<NonNegative>>,
    ior: Option<Spanned<Ior>>,
    outside_ior: Option<Spanned<Ior>>,
    roughness: Option<Spanned<Roughness>>,
    alpha: Option<Spanned<Roughness>>,
    metallic: Option<Spanned<Metallic>>,
    anisotropic: Option<Spanned<Share>>,
    transmission: Option<Spanned<Share>>,
    specular_tint: Option<Spanned<Share>>,
    sheen: Option<Spanned<Share>>,
    sheen_tint: Option<Spanned<Share>>,
    flatness: Option<Spanned<Share>>,
    clearcoat: Option<Spanned<Share>>,
    clearcoat_gloss: Option<Spanned<Share>>,
    emission: Option<NonNegative>,
    interior: Option<Spanned<String>>,
    exterior: Option<Spanned<String>>,
    #[serde(default)]
    hidden: bool,
}

/// Models of facets that scatter once, as in Mitsuba.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum FacetName {
    Ggx,
    Beckmann,
}

/// Kinds of materials.
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum MaterialKind {
    #[default]
    Lambertian,
    Mirror,
    Dielectric,
    ThinDielectric,
    Metal,
    Coated,
    Glossy,
    Plastic,
    Principled,
    Boundary,
}

impl MaterialKind {
    /// The name in the file, and the keys besides those of all materials.
    fn keys(self) -> (&'static str, &'static [&'static str]) {
        match self {
            Self::Lambertian => ("lambertian", &["albedo", "albedo_texture", "two_sided"]),
            Self::Mirror => ("mirror", &["reflectance"]),
            Self::Dielectric => {
                let keys = &[
                    "ior",
                    "outside_ior",
                    "roughness",
                    "alpha",
                    "facets",
                    "transmittance",
                    "interior",
                    "exterior",
                ];
                ("dielectric", keys)
            }
            Self::ThinDielectric => {
                ("thin-dielectric", &["ior", "transmittance", "interior", "exterior"])
            }
            Self::Metal => {
                let keys =
                    &["metal", "eta", "k", "reflectance", "roughness", "alpha", "facets", "tint"];
                ("metal", keys)
            }
            Self::Coated => ("coated", &["albedo", "albedo_texture", "ior"]),
            Self::Plastic => {
                let keys = &[
                    "albedo",
                    "albedo_texture",
                    "ior",
                    "outside_ior",
                    "roughness",
                    "alpha",
                    "facets",
                    "tint",
                    "nonlinear",
                ];
                ("plastic", keys)
            }
            Self::Principled => {
                let keys = &[
                    "albedo",
                    "albedo_texture",
                    "ior",
                    "outside_ior",
                    "metallic",
                    "metallic_roughness_texture",
                    "roughness",
                    "anisotropic",
                    "transmission",
                    "specular_tint",
                    "sheen",
                    "sheen_tint",
                    "flatness",
                    "clearcoat",
                    "clearcoat_gloss",
                    "two_sided",
                    "interior",
                    "exterior",
                ];
                ("principled", keys)
            }
            Self::Boundary => ("boundary", &["interior", "exterior"]),
            Self::Glossy => {
                let keys = &[
                    "albedo",
                    "albedo_texture",
                    "ior",
                    "metallic",
                    "metallic_roughness_texture",
                    "roughness",
                    "alpha",
                ];
                ("glossy", keys)
            }
        }
    }
}

/// An error and its byte offset in the file.
type Misplaced = (Error, usize);

impl MaterialTable {
    /// The material of these keys.
    ///
    /// # Errors
    /// If a key does not belong to the type, or two contradict each other.
    pub(crate) fn material(
        &self,
        name: &str,
        textures: &mut TomlTextures,
        media: &BTreeMap<String, Arc<Medium>>,
    ) -> Result<Material, Misplaced> {
        self.check_keys()?;
        let default = if self.albedo_texture.is_some() { 1.0 } else { mtl::DEFAULT_ALBEDO };
        let albedo = rgb(&self.albedo).unwrap_or(Rgb::splat(default));
        // Factors of the texture, if there is one.
        let share = if self.metallic_roughness_texture.is_some() { 1.0 } else { 0.0 };
        let metallic = self.metallic.as_ref().map_or(share, |m| m.get_ref().0);
        let alpha = self.alpha()?.unwrap_or(share);
        let ior = |key: &Option<Spanned<Ior>>, default: f32| {
            key.as_ref()
                .map_or(RefractiveIndex::Constant(default.into()), |i| i.get_ref().0.clone())
        };
        let indices = [ior(&self.ior, DEFAULT_IOR), ior(&self.outside_ior, 1.0)];
        let [inside, outside] = indices.each_ref().map(|medium| medium.at_d() as f32);
        let eta = inside / outside;
        let transmittance = rgb(&self.transmittance).unwrap_or(Rgb::ONE);
        let bsdf = match self.kind {
            MaterialKind::Lambertian => Bsdf::Lambertian { albedo, two_sided: self.is_two_sided() },
            MaterialKind::Mirror => {
                Bsdf::Mirror { reflectance: rgb(&self.reflectance).unwrap_or(Rgb::ONE) }
            }
            MaterialKind::Dielectric => {
                let model = self.facets().unwrap_or_default();
                interface(eta, Facets { model, alpha }, transmittance)
            }
            MaterialKind::ThinDielectric => {
                Bsdf::ThinDielectric(ThinDielectric { eta, transmittance })
            }
            MaterialKind::Metal => {
                let tint = rgb(&self.tint);
                let model = self.facets().or(tint.map(|_| FacetModel::Ggx));
                Bsdf::Conductor(match model {
                    None => Conductor::new(self.metal()?, alpha),
                    Some(model) => {
                        let facets = Facets { model, alpha };
                        Conductor::once(self.metal()?, facets, tint.unwrap_or(Rgb::ONE))
                    }
                })
            }
            MaterialKind::Plastic => {
                let model = self.facets().unwrap_or(FacetModel::Ggx);
                let is_nonlinear = self.nonlinear.as_ref().is_some_and(|is| *is.get_ref());
                let plastic = Plastic::new(albedo, eta, Facets { model, alpha }, is_nonlinear);
                Bsdf::Plastic(plastic.tinted(rgb(&self.tint).unwrap_or(Rgb::ONE)))
            }
            MaterialKind::Principled => {
                Bsdf::Principled(Principled::new(self.principled(albedo, eta)))
            }
            MaterialKind::Boundary => Bsdf::ThinDielectric(ThinDielectric::new(1.0)),
            MaterialKind::Coated => Bsdf::Coated(Coated::new(albedo, eta)),
            MaterialKind::Glossy => Bsdf::Glossy(Glossy::new(albedo, metallic, eta, alpha)),
        };
        let default = if self.emission_texture.is_some() { Rgb::ONE } else { Rgb::ZERO };
        let mut texture = |key, is_color| self.texture(key, textures, is_color);
        let dispersion = match self.kind {
            MaterialKind::Dielectric => {
                let [inside, outside] = indices;
                Dispersion::new(inside, outside).map(Arc::new)
            }
            _ => None,
        };
        Ok(Material {
            dispersion,
            emission: self.emission.map_or(default, |emission| emission.0),
            albedo_texture: texture(&self.albedo_texture, true)?,
            metallic_roughness_texture: texture(&self.metallic_roughness_texture, false)?,
            opacity_texture: texture(&self.opacity_texture, false)?,
            opacity: self.opacity.map(|opacity| opacity.0),
            normal_map: self.normal_map(texture(&self.normal_texture, false)?)?,
            emission_texture: texture(&self.emission_texture, true)?,
            hidden_from_camera: self.hidden,
            boundary: medium::boundary([&self.interior, &self.exterior], media)?,
            ..Material::new(name, bsdf)
        })
    }

    /// Whether the back scatters as the front does.
    fn is_two_sided(&self) -> bool {
        self.two_sided.as_ref().is_none_or(|both| *both.get_ref())
    }

    /// The parameters of a principled surface.
    fn principled(&self, base_color: Rgb, eta: f32) -> PrincipledParameters {
        let share = |key: &Option<Spanned<Share>>| key.as_ref().map_or(0.0, |s| s.get_ref().0);
        let factor = self.metallic_roughness_texture.is_some();
        PrincipledParameters {
            base_color,
            eta,
            roughness: (self.roughness.as_ref().map(|roughness| roughness.get_ref().0))
                .unwrap_or(if factor { 1.0 } else { 0.5 }),
            metallic: (self.metallic.as_ref().map(|metallic| metallic.get_ref().0))
                .unwrap_or(if factor { 1.0 } else { 0.0 }),
            anisotropic: share(&self.anisotropic),
            spec_trans: share(&self.transmission),
            spec_tint: share(&self.specular_tint),
            sheen: share(&self.sheen),
            sheen_tint: share(&self.sheen_tint),
            flatness: share(&self.flatness),
            clearcoat: share(&self.clearcoat),
            clearcoat_gloss: share(&self.clearcoat_gloss),
            two_sided: self.is_two_sided(),
        }
    }

    /// The model of facets that scatter once, if it is given.
    fn facets(&self) -> Option<FacetModel> {
        self.facets.as_ref().map(|name| match name.get_ref() {
            FacetName::Ggx => FacetModel::Ggx,
            FacetName::Beckmann => FacetModel::Beckmann,
        })
    }

    /// The map of normals, if there is one.
    fn normal_map(&self, texture: Option<Arc<Texture>>) -> Result<Option<NormalMap>, Misplaced> {
        match (texture, &self.normal_scale) {
            (None, Some(scale)) => {
                let problem = "`normal_scale` has no `normal_texture`";
                Err((Error::new(problem, "add the texture, or remove it"), scale.span().start))
            }
            (texture, scale) => Ok(texture.map(|texture| NormalMap {
                texture,
                scale: scale.as_ref().map_or(1.0, |s| s.get_ref().0),
            })),
        }
    }

    /// Width of the distribution of facets, if it is given.
    fn alpha(&self) -> Result<Option<f32>, Misplaced> {
        match (&self.roughness, &self.alpha) {
            (Some(_), Some(alpha)) => {
                let problem = "`alpha` and `roughness`, whose square it is, are both given";
                Err((Error::new(problem, "give only one of them"), alpha.span().start))
            }
            (Some(roughness), None) => Ok(Some(roughness.get_ref().0 * roughness.get_ref().0)),
            (None, alpha) => Ok(alpha.as_ref().map(|alpha| alpha.get_ref().0)),
        }
    }

    /// A texture, if one is named.
    fn texture(
        &self,
        key: &Option<Spanned<TextureTable>>,
        textures: &mut TomlTextures,
        is_color: bool,
    ) -> Result<Option<Arc<Texture>>, Misplaced> {
        let Some(key) = key else { return Ok(None) };
        let TextureTable { file, wrap, filter } = key.get_ref();
        let wrap = wrap.or(self.texture_wrap).map_or([Wrap::Repeat; 2], |wraps| wraps.0);
        let nearest = filter.or(self.texture_filter) == Some(FilterKind::Nearest);
        let texture = textures.get(file, Sampling { wrap, nearest }, is_color);
        texture.map(Some).map_err(|error| (error, key.span().start))
    }

    /// Refuses keys of other types.
    fn check_keys(&self) -> Result<(), Misplaced> {
        fn start<T>(key: &Option<Spanned<T>>) -> Option<usize> {
            key.as_ref().map(|value| value.span().start)
        }
        let given = [
            ("albedo", start(&self.albedo)),
            ("albedo_texture", start(&self.albedo_texture)),
            ("two_sided", start(&self.two_sided)),
            ("reflectance", start(&self.reflectance)),
            ("metal", start(&self.metal)),
            ("eta", start(&self.eta)),
            ("k", start(&self.k)),
            ("ior", start(&self.ior)),
            ("outside_ior", start(&self.outside_ior)),
            ("roughness", start(&self.roughness)),
            ("alpha", start(&self.alpha)),
            ("facets", start(&self.facets)),
            ("tint", start(&self.tint)),
            ("nonlinear", start(&self.nonlinear)),
            ("transmittance", start(&self.transmittance)),
            ("metallic", start(&self.metallic)),
            ("anisotropic", start(&self.anisotropic)),
            ("transmission", start(&self.transmission)),
            ("specular_tint", start(&self.specular_tint)),
            ("sheen", start(&self.sheen)),
            ("sheen_tint", start(&self.sheen_tint)),
            ("flatness", start(&self.flatness)),
            ("clearcoat", start(&self.clearcoat)),
            ("clearcoat_gloss", start(&self.clearcoat_gloss)),
            ("metallic_roughness_texture", start(&self.metallic_roughness_texture)),
            ("interior", start(&self.interior)),
            ("exterior", start(&self.exterior)),
        ];
        let (kind, keys) = self.kind.keys();
        for (key, start) in given {
            if let Some(start) = start
                && !keys.contains(&key)
            {
                let problem = format!("a material of type `{kind}` has no `{key}`");
                let advice = format!("remove it, or use {}", list(keys.iter().copied()));
                return Err((Error::new(problem, advice), start));
            }
        }
        Ok(())
    }

    /// Reflectance of a metal: by name, by index, or by color; white by default.
    fn metal(&self) -> Result<Reflectance, Misplaced> {
        let one = "give one of `metal`, `eta` with `k`, and `reflectance`";
        let twice = |start: usize| (Error::new("the metal is described twice", one), start);
        match (&self.metal, &self.eta, &self.k, &self.reflectance) {
            (Some(name), None, None, None) => Reflectance::named(name.get_ref()).ok_or_else(|| {
                let problem = format!("unknown metal `{}`", name.get_ref());
                let advice = format!("use one of {}", list(Reflectance::NAMES));
                (Error::new(problem, advice), name.span().start)
            }),
            (None, Some(eta), Some(k), None) => {
                Ok(Reflectance::Measured { eta: eta.get_ref().0, k: k.get_ref().0 })
            }
            (None, None, None, reflectance) => {
                Ok(Reflectance::Artist { normal: rgb(reflectance).unwrap_or(Rgb::ONE) })
            }
            (Some(name), ..) => Err(twice(name.span().start)),
            (None, Some(eta), None, _) => {
                Err((Error::new("`eta` has no `k`", one), eta.span().start))
            }
            (None, None, Some(k), _) => Err((Error::new("`k` has no `eta`", one), k.span().start)),
            (None, Some(_), Some(_), Some(reflectance)) => Err(twice(reflectance.span().start)),
        }
    }
}

/// An interface between dielectrics, rough or smooth.
pub(crate) fn dielectric(eta: f32, alpha: f32, transmittance: Rgb) -> Bsdf {
    interface(eta, Facets { model: FacetModel::Correlated, alpha }, transmittance)
}

/// An interface between dielectrics with facets of any model.
pub(crate) fn interface(eta: f32, facets: Facets, transmittance: Rgb) -> Bsdf {
    if facets.alpha < SMOOTH_ALPHA {
        Bsdf::Dielectric(Dielectric { eta, transmittance })
    } else {
        Bsdf::RoughDielectric(RoughDielectric::of(eta, facets).tinted(transmittance))
    }
}

fn rgb(key: &Option<Spanned<Albedo>>) -> Option<Rgb> {
    key.as_ref().map(|value| value.get_ref().0)
}
