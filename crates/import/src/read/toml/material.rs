//! `[materials.NAME]` of a scene file.

use super::keys::Point;
use super::numbers::{
    Albedo, MetalIndex, Metallic, NonNegative, NormalScale, Opacity, Roughness, Share,
};
use super::refractive_index::Ior;
use super::texture::{FilterKind, TextureTable, TomlTextures, Wraps};
use super::{Misplaced, medium};
use crate::look::{DEFAULT_ALBEDO, DEFAULT_IOR, Look, in_vacuum};
use crate::read::klems::{self, EvenShares};
use crate::text::{RELATIVE_NAME, list};
use bdpm_core::base::error::Error;
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::bsdf::{
    Bsdf, Coated, Conductor, DiffuseTransmission, FacetModel, Facets, Glossy, Klems, Plastic,
    Principled, PrincipledParameters, Reflectance, ThinDielectric,
};
use bdpm_core::scene::{Material, Medium, NormalMap, RefractiveIndex, Sampling, Texture, Wrap};
use glam::Vec3;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use toml::Spanned;

/// Reflectance and transmittance of sheets whose file gives none, as in pbrt.
const DEFAULT_SHEET: f32 = 0.25;

/// Shares of one may add up to this much above it by rounding.
const ROUNDING: f32 = 1e-5;

/// The keys of a material.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaterialTable {
    #[serde(rename = "type")]
    kind: Option<Spanned<MaterialKind>>,
    albedo: Option<Spanned<Albedo>>,
    albedo_texture: Option<Spanned<TextureTable>>,
    metallic_roughness_texture: Option<Spanned<TextureTable>>,
    opacity_texture: Option<Spanned<TextureTable>>,
    opacity: Option<Opacity>,
    transmittance: Option<Spanned<Albedo>>,
    visible_transmittance: Option<Spanned<Albedo>>,
    internal_transmittance: Option<Spanned<Albedo>>,
    normal_texture: Option<Spanned<TextureTable>>,
    normal_scale: Option<Spanned<NormalScale>>,
    emission_texture: Option<Spanned<TextureTable>>,
    texture_wrap: Option<Wraps>,
    texture_filter: Option<FilterKind>,
    two_sided: Option<Spanned<bool>>,
    reflectance: Option<Spanned<Albedo>>,
    reflectance_texture: Option<Spanned<TextureTable>>,
    transmittance_texture: Option<Spanned<TextureTable>>,
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
    #[serde(default)]
    two_sided_emission: bool,
    file: Option<Spanned<String>>,
    up: Option<Spanned<Point>>,
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
    DiffuseTransmission,
    Klems,
    Boundary,
}

impl MaterialKind {
    /// The name in the file, and the keys besides those of all materials.
    fn keys(self) -> (&'static str, &'static str) {
        match self {
            Self::Lambertian => ("lambertian", "albedo albedo_texture two_sided"),
            Self::Mirror => ("mirror", "reflectance"),
            Self::Dielectric => (
                "dielectric",
                "ior outside_ior roughness alpha facets transmittance interior exterior",
            ),
            Self::ThinDielectric => (
                "thin-dielectric",
                "ior transmittance visible_transmittance internal_transmittance interior exterior",
            ),
            Self::Metal => ("metal", "metal eta k reflectance roughness alpha facets tint"),
            Self::Coated => ("coated", "albedo albedo_texture ior"),
            Self::Glossy => (
                "glossy",
                "albedo albedo_texture ior metallic metallic_roughness_texture roughness alpha",
            ),
            Self::Plastic => (
                "plastic",
                "albedo albedo_texture ior outside_ior roughness alpha facets tint nonlinear",
            ),
            Self::Principled => (
                "principled",
                "albedo albedo_texture ior outside_ior metallic metallic_roughness_texture \
                 roughness anisotropic transmission specular_tint sheen sheen_tint flatness \
                 clearcoat clearcoat_gloss two_sided interior exterior",
            ),
            Self::DiffuseTransmission => (
                "diffuse-transmission",
                "reflectance reflectance_texture transmittance transmittance_texture interior \
                 exterior",
            ),
            Self::Klems => ("klems", "file up interior exterior"),
            Self::Boundary => ("boundary", "interior exterior"),
        }
    }
}

impl MaterialTable {
    /// The look that these keys describe.
    ///
    /// # Errors
    /// If a key does not belong to the type, or two contradict each other.
    pub fn look(
        &self,
        textures: &mut TomlTextures,
        media: &BTreeMap<String, Arc<Medium>>,
    ) -> Result<Look, Misplaced> {
        self.check_keys()?;
        let mut look = self.surface(textures.folder())?;
        let default = if self.emission_texture.is_some() { Rgb::ONE } else { Rgb::ZERO };
        let mut texture = |key, is_color| self.texture(key, textures, is_color);
        look.material = Material {
            emission: self.emission.map_or(default, |emission| emission.0),
            albedo_texture: match &self.reflectance_texture {
                Some(_) => texture(&self.reflectance_texture, true)?,
                None => texture(&self.albedo_texture, true)?,
            },
            transmittance_texture: texture(&self.transmittance_texture, true)?,
            metallic_roughness_texture: texture(&self.metallic_roughness_texture, false)?,
            opacity_texture: texture(&self.opacity_texture, false)?,
            opacity: self.opacity.map(|opacity| opacity.0),
            normal_map: self.normal_map(texture(&self.normal_texture, false)?)?,
            emission_texture: texture(&self.emission_texture, true)?,
            hidden_from_camera: self.hidden,
            two_sided_emission: self.two_sided_emission,
            boundary: medium::boundary([&self.interior, &self.exterior], media)?,
            ..look.material
        };
        Ok(look)
    }

    fn kind(&self) -> MaterialKind {
        self.kind.as_ref().map_or_else(Default::default, |kind| *kind.get_ref())
    }

    /// A uniform surface that scatters as these keys say. Names of files are relative to `folder`.
    fn surface(&self, folder: &Path) -> Result<Look, Misplaced> {
        let default = if self.albedo_texture.is_some() { 1.0 } else { DEFAULT_ALBEDO };
        let albedo = rgb(&self.albedo).unwrap_or(Rgb::splat(default));
        // Factors of the texture, if there is one.
        let share = if self.metallic_roughness_texture.is_some() { 1.0 } else { 0.0 };
        let metallic = self.metallic.as_ref().map_or(share, |m| m.get_ref().0);
        let alpha = self.alpha()?.unwrap_or(share);
        let indices = self.indices();
        let [inside, outside] = indices.each_ref().map(|medium| medium.at_d() as f32);
        let eta = inside / outside;
        let transmittance = rgb(&self.transmittance).unwrap_or(Rgb::ONE);
        Ok(Look::new(match self.kind() {
            MaterialKind::Lambertian => Bsdf::Lambertian { albedo, two_sided: self.is_two_sided() },
            MaterialKind::Mirror => {
                Bsdf::Mirror { reflectance: rgb(&self.reflectance).unwrap_or(Rgb::ONE) }
            }
            MaterialKind::Dielectric => {
                let facets = Facets { model: self.facets().unwrap_or_default(), alpha };
                return Ok(Look::dielectric(indices, facets, transmittance));
            }
            MaterialKind::ThinDielectric => Bsdf::ThinDielectric(self.glazing(eta)?),
            MaterialKind::Boundary => return Ok(Look::sheet(1.0, Rgb::ONE)),
            MaterialKind::Metal => Bsdf::Conductor(self.conductor(alpha)?),
            MaterialKind::Plastic => Bsdf::Plastic(self.plastic(albedo, eta, alpha)),
            MaterialKind::Principled => {
                Bsdf::Principled(Principled::new(self.principled(albedo, eta)))
            }
            MaterialKind::DiffuseTransmission => Bsdf::DiffuseTransmission(self.sheet()?),
            MaterialKind::Klems => Bsdf::Klems(self.klems(folder)?),
            MaterialKind::Coated => Bsdf::Coated(Coated::new(albedo, eta)),
            MaterialKind::Glossy => Bsdf::Glossy(Glossy::new(albedo, metallic, eta, alpha)),
        }))
    }

    /// Refractive indices inside and outside.
    fn indices(&self) -> [RefractiveIndex; 2] {
        let [inside, outside] = in_vacuum(DEFAULT_IOR);
        let own = |key: &Option<Spanned<Ior>>| key.as_ref().map(|ior| ior.get_ref().0.clone());
        [own(&self.ior).unwrap_or(inside), own(&self.outside_ior).unwrap_or(outside)]
    }

    fn conductor(&self, alpha: f32) -> Result<Conductor, Misplaced> {
        let tint = rgb(&self.tint);
        let model = self.facets().or(tint.map(|_| FacetModel::Ggx));
        let reflectance = self.metal()?;
        Ok(match model {
            None => Conductor::new(reflectance, alpha),
            Some(model) => {
                Conductor::once(reflectance, Facets { model, alpha }, tint.unwrap_or(Rgb::ONE))
            }
        })
    }

    fn plastic(&self, albedo: Rgb, eta: f32, alpha: f32) -> Plastic {
        let model = self.facets().unwrap_or(FacetModel::Ggx);
        let is_nonlinear = self.nonlinear.as_ref().is_some_and(|is| *is.get_ref());
        let plastic = Plastic::new(albedo, eta, Facets { model, alpha }, is_nonlinear);
        plastic.tinted(rgb(&self.tint).unwrap_or(Rgb::ONE))
    }

    /// A sheet that reflects and transmits diffusely. Factors of textures may have any sum.
    fn sheet(&self) -> Result<DiffuseTransmission, Misplaced> {
        let share = |share: &Option<Spanned<Albedo>>, is_textured: bool| {
            let default = if is_textured { 1.0 } else { DEFAULT_SHEET };
            rgb(share).unwrap_or(Rgb::splat(default))
        };
        let textured = [&self.reflectance_texture, &self.transmittance_texture];
        let textured = textured.map(|texture| texture.is_some());
        let reflectance = share(&self.reflectance, textured[0]);
        let transmittance = share(&self.transmittance, textured[1]);
        let sum = (reflectance + transmittance).max_element();
        let given = self.transmittance.as_ref().or(self.reflectance.as_ref());
        match given {
            Some(key) if sum > 1.0 + ROUNDING && textured == [false; 2] => {
                let problem = format!("reflectance and transmittance add up to {sum}");
                let advice = "give two of at most 1 together in each channel; each is \
                              0.25 if it is missing";
                Err((Error::new(problem, advice), key.span().start))
            }
            _ => Ok(DiffuseTransmission::new(reflectance, transmittance)),
        }
    }

    /// A sheet that scatters as the matrices of a BSDF file.
    fn klems(&self, folder: &Path) -> Result<Klems, Misplaced> {
        let Some(file) = &self.file else {
            let problem = "a material of type `klems` has no `file`";
            let start = self.kind.as_ref().map_or(0, |kind| kind.span().start);
            return Err((Error::new(problem, "give the name of a BSDF file (XML)"), start));
        };
        let at = |error| (error, file.span().start);
        let path = folder.join(file.get_ref());
        if !path.is_file() {
            let problem = format!("there is no file `{}`", file.get_ref());
            return Err(at(Error::new(problem, RELATIVE_NAME)));
        }
        let matrices = klems::read(&path, EvenShares::default()).map_err(at)?;
        let up = self.up.as_ref().map_or(Vec3::Y, |up| up.get_ref().0);
        if up == Vec3::ZERO {
            return Err(at(Error::new("`up` is 0", "give a direction along the sheet")));
        }
        Ok(Klems::new(matrices, up))
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

    /// A sheet of this relative index, by the factor on light that goes straight through it, by the
    /// share that passes at normal incidence, or by that which is left after crossing it.
    fn glazing(&self, eta: f32) -> Result<ThinDielectric, Misplaced> {
        let clear_sheet = ThinDielectric::new(eta);
        let internal = rgb(&self.internal_transmittance).unwrap_or(Rgb::ONE);
        let Some(visible) = &self.visible_transmittance else {
            let transmittance = rgb(&self.transmittance).unwrap_or(Rgb::ONE);
            return Ok(ThinDielectric { transmittance, internal, ..clear_sheet });
        };
        let start = visible.span().start;
        if self.transmittance.is_some() || self.internal_transmittance.is_some() {
            let problem = "the transmittance of the sheet is described twice";
            let advice = "give `visible_transmittance` alone";
            return Err((Error::new(problem, advice), start));
        }
        let [clear, _] = clear_sheet.shares(1.0);
        let factor = visible.get_ref().0 / clear;
        if factor.max_element() > 1.0 + ROUNDING {
            let most = clear.max_element();
            let problem = format!("clear glass of this index transmits {most:.3}");
            return Err((Error::new(problem, "give less, or another `ior`"), start));
        }
        Ok(ThinDielectric { transmittance: factor.min(Rgb::ONE), ..clear_sheet })
    }

    /// Refuses keys of other types.
    fn check_keys(&self) -> Result<(), Misplaced> {
        /// The given ones of the keys of a table, each with its byte offset in the file.
        macro_rules! starts {
            ($table:ident: $($key:ident)*) => {
                [$((stringify!($key), $table.$key.as_ref().map(|key| key.span().start))),*]
            };
        }
        let given = starts!(self:
            albedo albedo_texture two_sided reflectance reflectance_texture
            transmittance_texture metal eta k ior outside_ior roughness alpha
            facets tint nonlinear transmittance visible_transmittance internal_transmittance metallic anisotropic transmission specular_tint sheen
            sheen_tint flatness clearcoat clearcoat_gloss metallic_roughness_texture file up
            interior exterior);
        let (kind, keys) = self.kind().keys();
        for (key, start) in given {
            if let Some(start) = start
                && keys.split(' ').all(|own| own != key)
            {
                let problem = format!("a material of type `{kind}` has no `{key}`");
                let advice = format!("remove it, or use {}", list(keys.split(' ')));
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

fn rgb(key: &Option<Spanned<Albedo>>) -> Option<Rgb> {
    key.as_ref().map(|value| value.get_ref().0)
}
