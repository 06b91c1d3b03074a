//! `[materials.NAME]` of a scene file.

use super::numbers::{Index, Ior, Metallic, NormalScale, Opacity, Roughness};
use super::texture::{FilterKind, Pictures, TextureTable, Wraps};
use super::{Albedo, Power};
use crate::base::error::Error;
use crate::base::math::Rgb;
use crate::import::mtl;
use crate::import::text::list;
use crate::scene::bsdf::{
    Bsdf, Coated, Conductor, Dielectric, FacetModel, Facets, Glossy, Reflectance, RoughDielectric,
    SMOOTH_ALPHA, ThinDielectric,
};
use crate::scene::{Material, NormalMap, Sampling, Texture, Wrap};
use serde::Deserialize;
use std::sync::Arc;
use toml::Spanned;

/// Refractive index of glass, where nothing else is said.
pub(in crate::import) const DEFAULT_IOR: f32 = 1.5;

/// The keys of a material.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::import) struct MaterialTable {
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
    metal: Option<Spanned<String>>,
    eta: Option<Spanned<Index>>,
    k: Option<Spanned<Power>>,
    ior: Option<Spanned<Ior>>,
    outside_ior: Option<Spanned<Ior>>,
    roughness: Option<Spanned<Roughness>>,
    alpha: Option<Spanned<Roughness>>,
    metallic: Option<Spanned<Metallic>>,
    emission: Option<Power>,
    #[serde(default)]
    hidden: bool,
}

/// Models of facets that scatter once, as Mitsuba has them.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum FacetName {
    Ggx,
    Beckmann,
}

/// The materials there are.
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
}

impl MaterialKind {
    /// Its name in the file, and the keys that it has besides `type` and `emission`.
    fn keys(self) -> (&'static str, &'static [&'static str]) {
        match self {
            Self::Lambertian => ("lambertian", &["albedo", "albedo_texture", "two_sided"]),
            Self::Mirror => ("mirror", &["reflectance"]),
            Self::Dielectric => {
                let keys = &["ior", "outside_ior", "roughness", "alpha", "facets", "transmittance"];
                ("dielectric", keys)
            }
            Self::ThinDielectric => ("thin-dielectric", &["ior", "transmittance"]),
            Self::Metal => {
                let keys =
                    &["metal", "eta", "k", "reflectance", "roughness", "alpha", "facets", "tint"];
                ("metal", keys)
            }
            Self::Coated => ("coated", &["albedo", "albedo_texture", "ior"]),
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

/// The error and where in the file it is, bytes.
type Misplaced = (Error, usize);

impl MaterialTable {
    /// The material of these keys.
    ///
    /// # Errors
    /// If a key does not belong to the type, or two contradict each other.
    pub(in crate::import) fn material(
        &self,
        name: &str,
        pictures: &mut Pictures,
    ) -> Result<Material, Misplaced> {
        self.check_keys()?;
        let unsaid = if self.albedo_texture.is_some() { 1.0 } else { mtl::DEFAULT_ALBEDO };
        let albedo = rgb(&self.albedo).unwrap_or(Rgb::splat(unsaid));
        // What textures are multiplied with, if they are there.
        let share = if self.metallic_roughness_texture.is_some() { 1.0 } else { 0.0 };
        let metallic = self.metallic.as_ref().map_or(share, |m| m.get_ref().0);
        let alpha = self.alpha()?.unwrap_or(share);
        let ior =
            |key: &Option<Spanned<Ior>>, default| key.as_ref().map_or(default, |i| i.get_ref().0);
        let eta = ior(&self.ior, DEFAULT_IOR) / ior(&self.outside_ior, 1.0);
        let transmittance = rgb(&self.transmittance).unwrap_or(Rgb::ONE);
        let bsdf = match self.kind {
            MaterialKind::Lambertian => {
                let two_sided = self.two_sided.as_ref().is_none_or(|both| *both.get_ref());
                Bsdf::Lambertian { albedo, two_sided }
            }
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
            MaterialKind::Coated => Bsdf::Coated(Coated::new(albedo, eta)),
            MaterialKind::Glossy => Bsdf::Glossy(Glossy::new(albedo, metallic, eta, alpha)),
        };
        let unsaid = if self.emission_texture.is_some() { Rgb::ONE } else { Rgb::ZERO };
        let mut texture = |key| self.texture(key, pictures);
        Ok(Material {
            emission: self.emission.map_or(unsaid, |emission| emission.0),
            albedo_texture: texture(&self.albedo_texture)?,
            metallic_roughness_texture: texture(&self.metallic_roughness_texture)?,
            opacity_texture: texture(&self.opacity_texture)?,
            opacity: self.opacity.map(|opacity| opacity.0),
            normal_map: self.normal_map(texture(&self.normal_texture)?)?,
            emission_texture: texture(&self.emission_texture)?,
            hidden_from_camera: self.hidden,
            ..Material::new(name, bsdf)
        })
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
                let problem = "`normal_scale` comes without `normal_texture`";
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
                let problem = "`alpha` comes besides `roughness`, of which it is the square";
                Err((Error::new(problem, "give one of them"), alpha.span().start))
            }
            (Some(roughness), None) => Ok(Some(roughness.get_ref().0 * roughness.get_ref().0)),
            (None, alpha) => Ok(alpha.as_ref().map(|alpha| alpha.get_ref().0)),
        }
    }

    /// A texture, if one is named.
    fn texture(
        &self,
        key: &Option<Spanned<TextureTable>>,
        pictures: &mut Pictures,
    ) -> Result<Option<Arc<Texture>>, Misplaced> {
        let Some(key) = key else { return Ok(None) };
        let TextureTable { file, wrap, filter } = key.get_ref();
        let wrap = wrap.or(self.texture_wrap).map_or([Wrap::Repeat; 2], |wraps| wraps.0);
        let nearest = filter.or(self.texture_filter) == Some(FilterKind::Nearest);
        let texture = pictures.get(file, Sampling { wrap, nearest });
        texture.map(Some).map_err(|error| (error, key.span().start))
    }

    /// Refuses keys of other types.
    fn check_keys(&self) -> Result<(), Misplaced> {
        fn place<T>(key: &Option<Spanned<T>>) -> Option<usize> {
            key.as_ref().map(|value| value.span().start)
        }
        let given = [
            ("albedo", place(&self.albedo)),
            ("albedo_texture", place(&self.albedo_texture)),
            ("two_sided", place(&self.two_sided)),
            ("reflectance", place(&self.reflectance)),
            ("metal", place(&self.metal)),
            ("eta", place(&self.eta)),
            ("k", place(&self.k)),
            ("ior", place(&self.ior)),
            ("outside_ior", place(&self.outside_ior)),
            ("roughness", place(&self.roughness)),
            ("alpha", place(&self.alpha)),
            ("facets", place(&self.facets)),
            ("tint", place(&self.tint)),
            ("transmittance", place(&self.transmittance)),
            ("metallic", place(&self.metallic)),
            ("metallic_roughness_texture", place(&self.metallic_roughness_texture)),
        ];
        let (kind, keys) = self.kind.keys();
        for (key, place) in given {
            if let Some(place) = place
                && !keys.contains(&key)
            {
                let problem = format!("a material of type `{kind}` has no `{key}`");
                let advice = format!("remove it, or use {}", list(keys.iter().copied()));
                return Err((Error::new(problem, advice), place));
            }
        }
        Ok(())
    }

    /// How much a metal reflects: by name, by index, or by color; white if nothing is said.
    fn metal(&self) -> Result<Reflectance, Misplaced> {
        let one = "give one of `metal`, `eta` with `k`, and `reflectance`";
        let twice = |place: usize| (Error::new("the metal is described twice", one), place);
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
                Err((Error::new("`eta` comes without `k`", one), eta.span().start))
            }
            (None, None, Some(k), _) => {
                Err((Error::new("`k` comes without `eta`", one), k.span().start))
            }
            (None, Some(_), Some(_), Some(reflectance)) => Err(twice(reflectance.span().start)),
        }
    }
}

/// An interface, rough or smooth.
pub(in crate::import) fn dielectric(eta: f32, alpha: f32, transmittance: Rgb) -> Bsdf {
    interface(eta, Facets { model: FacetModel::Correlated, alpha }, transmittance)
}

/// The same of facets of any model.
pub(in crate::import) fn interface(eta: f32, facets: Facets, transmittance: Rgb) -> Bsdf {
    if facets.alpha < SMOOTH_ALPHA {
        Bsdf::Dielectric(Dielectric { eta, transmittance })
    } else {
        Bsdf::RoughDielectric(RoughDielectric::of(eta, facets).tinted(transmittance))
    }
}

fn rgb(key: &Option<Spanned<Albedo>>) -> Option<Rgb> {
    key.as_ref().map(|value| value.get_ref().0)
}
