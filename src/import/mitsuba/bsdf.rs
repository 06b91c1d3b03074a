//! BSDFs as materials.

use super::color::ColorUse;
use super::document::MAX_DEPTH;
use super::metals;
use super::object::Object;
use super::texture::{MitsubaTextures, Paint};
use crate::base::error::{Error, Result};
use crate::base::math::{Rgb, luminance};
use crate::import::scene_file::material::interface;
use crate::import::text::list;
use crate::import::texture_file::linear_color;
use crate::scene::Texture;
use crate::scene::bsdf::{
    Bsdf, Coated, Conductor, FacetModel, Facets, Glossy, Reflectance, SMOOTH_ALPHA, ThinDielectric,
    fresnel,
};
use glam::Affine2;
use std::collections::HashMap;
use std::sync::Arc;

/// The material properties of a BSDF.
#[derive(Clone)]
pub(super) struct SurfaceLook {
    pub bsdf: Bsdf,
    /// Texture that multiplies the albedo.
    pub albedo: Option<Arc<Texture>>,
    /// Map of texture coordinates, for all textures.
    pub to_uv: Affine2,
    /// Share of the rays that meet the surface, and a texture that multiplies it.
    pub opacity: Option<(f32, Option<Arc<Texture>>)>,
    pub normals: Option<NormalSource>,
    /// Whether Mitsuba shows it black from behind, and this renderer does not.
    pub is_black_behind: bool,
}

/// Sources of bent normals.
#[derive(Clone)]
pub(super) enum NormalSource {
    /// A normal map.
    Map(Arc<Texture>),
    /// Heights, and their scale.
    Bumps(Arc<Texture>, f32),
}

impl SurfaceLook {
    fn plain(bsdf: Bsdf) -> Self {
        let (albedo, opacity, normals, to_uv) = (None, None, None, Affine2::IDENTITY);
        Self { bsdf, albedo, to_uv, opacity, normals, is_black_behind: false }
    }

    /// The look of a surface without any BSDF: lamps are black.
    pub fn without_bsdf(is_lamp: bool) -> Self {
        Self::plain(lambertian(Rgb::splat(if is_lamp { 0.0 } else { 0.5 })))
    }

    fn painted(bsdf: Bsdf, paint: Paint) -> Self {
        Self { albedo: paint.texture, to_uv: paint.to_uv, ..Self::plain(bsdf) }
    }
}

/// The BSDFs of a scene.
#[derive(Default)]
pub(super) struct BsdfCache {
    /// By element, because many shapes may refer to one.
    known: HashMap<usize, SurfaceLook>,
}

impl BsdfCache {
    /// The look of a BSDF, which is nested in `depth` others.
    pub fn look(
        &mut self,
        object: &Object,
        textures: &mut MitsubaTextures,
        depth: usize,
    ) -> Result<SurfaceLook> {
        if let Some(known) = self.known.get(&object.index) {
            return Ok(known.clone());
        }
        if depth > MAX_DEPTH {
            let problem = "it refers to itself, or is nested too deep";
            return Err(object.error(problem, "nest BSDFs less"));
        }
        let look = self.read(object, textures, depth)?;
        self.known.insert(object.index, look.clone());
        Ok(look)
    }

    fn read(
        &mut self,
        object: &Object,
        textures: &mut MitsubaTextures,
        depth: usize,
    ) -> Result<SurfaceLook> {
        match object.kind() {
            "diffuse" => diffuse(object, textures),
            "roughdiffuse" => {
                textures.skipped("used Lambertian surfaces for rough diffuse ones:", object);
                diffuse(object, textures)
            }
            "conductor" | "roughconductor" => conductor(object, textures),
            "dielectric" | "roughdielectric" => dielectric(object, textures),
            "thindielectric" => {
                let eta = relative_index(object, 1.5046)?;
                let transmittance = transmittance(object, textures)?;
                Ok(SurfaceLook::plain(Bsdf::ThinDielectric(ThinDielectric { eta, transmittance })))
            }
            "plastic" | "roughplastic" => plastic(object, textures),
            "principled" => principled(object, textures, false),
            "principledthin" => principled(object, textures, true),
            "phong" | "ward" => {
                textures.skipped("used only the diffuse part of", object);
                let paint = textures.share(object, "diffuse_reflectance", Rgb::splat(0.5))?;
                Ok(SurfaceLook::painted(lambertian(paint.color), paint))
            }
            "null" => {
                Ok(SurfaceLook { opacity: Some((0.0, None)), ..SurfaceLook::without_bsdf(false) })
            }
            "twosided" => {
                let nested = self.nested(object, textures, depth)?;
                if nested.len() > 1 {
                    textures.skipped("used the front's BSDF for both sides of", object);
                }
                let mut look = first(object, nested)?;
                if let Bsdf::Lambertian { two_sided, .. } = &mut look.bsdf {
                    *two_sided = true;
                }
                Ok(SurfaceLook { is_black_behind: false, ..look })
            }
            "mask" => {
                let look = first(object, self.nested(object, textures, depth)?)?;
                let opacity = textures.share(object, "opacity", Rgb::splat(0.5))?;
                Ok(masked(look, &opacity, object, textures))
            }
            "normalmap" => {
                let look = first(object, self.nested(object, textures, depth)?)?;
                let Some(child) = one_texture(object, "normalmap")? else { return Ok(look) };
                let (texture, to_uv) = textures.data(&child)?;
                // The code 127.5 stands for 0, and v points down.
                let code = |x: f32| (128.0 + 127.0 * x).round().clamp(1.0, 255.0) as u8;
                let vector = |code: u8| f32::from(code) / 127.5 - 1.0;
                let map = texture.map_texels(|[r, g, b, _]| {
                    [code(vector(r)), code(-vector(g)), code(vector(b)), 255]
                });
                bent(textures, look, NormalSource::Map(Arc::new(map)), to_uv, object)
            }
            "bumpmap" | "bump" => {
                let look = first(object, self.nested(object, textures, depth)?)?;
                let scale = object.float("scale")?.unwrap_or(1.0) as f32;
                let Some(child) = one_texture(object, "")? else { return Ok(look) };
                let (texture, to_uv) = textures.data(&child)?;
                bent(textures, look, NormalSource::Bumps(texture, scale), to_uv, object)
            }
            "blendbsdf" => self.blend(object, textures, depth),
            "mixturebsdf" | "coating" | "roughcoating" => {
                textures.skipped("used only the first BSDF of", object);
                first(object, self.nested(object, textures, depth)?)
            }
            other => {
                let phrase = format!("used diffuse gray for BSDFs of type `{other}`:");
                textures.skipped(phrase, object);
                Ok(SurfaceLook::without_bsdf(false))
            }
        }
    }

    fn nested(
        &mut self,
        object: &Object,
        textures: &mut MitsubaTextures,
        depth: usize,
    ) -> Result<Vec<SurfaceLook>> {
        let nested = object.all("bsdf")?;
        nested.iter().map(|one| self.look(one, textures, depth + 1)).collect()
    }

    /// The mean of two diffuse BSDFs, else the BSDF with more weight.
    fn blend(
        &mut self,
        object: &Object,
        textures: &mut MitsubaTextures,
        depth: usize,
    ) -> Result<SurfaceLook> {
        let weight = textures.share(object, "weight", Rgb::splat(0.5))?;
        let share = weight.mean().x.clamp(0.0, 1.0);
        let Ok([a, b]) = <[SurfaceLook; 2]>::try_from(self.nested(object, textures, depth)?) else {
            return Err(object.error("it does not have two BSDFs", "give two"));
        };
        let is_plain = |look: &SurfaceLook| {
            look.albedo.is_none() && look.opacity.is_none() && look.normals.is_none()
        };
        if let (
            Bsdf::Lambertian { albedo, two_sided },
            Bsdf::Lambertian { albedo: other, two_sided: also },
        ) = (a.bsdf, b.bsdf)
            && is_plain(&a)
            && is_plain(&b)
            && two_sided == also
        {
            let mixed = |share: Rgb| albedo + (other - albedo) * share;
            if weight.texture.is_none() {
                return Ok(SurfaceLook::plain(Bsdf::Lambertian {
                    albedo: mixed(weight.color),
                    two_sided,
                }));
            }
            let paint = weight.mapped(mixed);
            return Ok(SurfaceLook::painted(
                Bsdf::Lambertian { albedo: paint.color, two_sided },
                paint,
            ));
        }
        if share > 0.0 && share < 1.0 {
            textures.skipped("used only the BSDF with more weight of", object);
        }
        Ok(if share > 0.5 { b } else { a })
    }
}

/// A look with bent normals. All textures share one map of texture coordinates.
fn bent(
    textures: &mut MitsubaTextures,
    look: SurfaceLook,
    normals: NormalSource,
    to_uv: Affine2,
    object: &Object,
) -> Result<SurfaceLook> {
    // Mitsuba has this property since 3.7.1.
    if object.boolean("use_shadowing_function")?.unwrap_or(true) {
        let phrase = "left out the shadowing by bumps (`use_shadowing_function`) of";
        textures.skipped(phrase, object);
    }
    warn_of_two_maps(textures, &look, to_uv, object);
    let to_uv = if look.albedo.is_some() { look.to_uv } else { to_uv };
    Ok(SurfaceLook { normals: Some(normals), to_uv, ..look })
}

/// Warns if a texture needs other coordinates than the albedo's.
fn warn_of_two_maps(
    textures: &mut MitsubaTextures,
    look: &SurfaceLook,
    to_uv: Affine2,
    object: &Object,
) {
    if look.albedo.is_some() && look.to_uv != to_uv {
        let phrase = "used the texture coordinates of the albedo's texture for all of";
        textures.skipped(phrase, object);
    }
}

fn first(object: &Object, nested: Vec<SurfaceLook>) -> Result<SurfaceLook> {
    nested.into_iter().next().ok_or_else(|| object.error("it has no BSDF within", "add one"))
}

/// The texture of this name, or the first texture.
fn one_texture<'a>(object: &Object<'a>, name: &str) -> Result<Option<Object<'a>>> {
    if let Some(found) = object.get(name)? {
        return Ok(Some(found));
    }
    let found = object.all("texture")?.into_iter().next();
    found.map(Some).ok_or_else(|| object.error("it has no texture", "add one"))
}

/// Facets of a smooth surface.
const SMOOTH: Facets = Facets { model: FacetModel::Ggx, alpha: 0.0 };

/// A Lambertian surface that scatters on one side only.
fn lambertian(albedo: Rgb) -> Bsdf {
    Bsdf::Lambertian { albedo, two_sided: false }
}

fn diffuse(object: &Object, textures: &mut MitsubaTextures) -> Result<SurfaceLook> {
    // The old name of the property is valid as well.
    let name = if object.get("diffuse_reflectance")?.is_some() {
        "diffuse_reflectance"
    } else {
        "reflectance"
    };
    let paint = textures.share(object, name, Rgb::splat(0.5))?;
    Ok(SurfaceLook::painted(lambertian(paint.color), paint))
}

/// Facets of a rough surface, with the given width or else `default`.
fn facets(object: &Object, textures: &mut MitsubaTextures, default: f32) -> Result<Facets> {
    let mut width = |name: &str| -> Result<Option<f32>> {
        if object.get(name)?.is_none() {
            return Ok(None);
        }
        Ok(Some(textures.mean_share(object, name, Rgb::splat(default))?.x))
    };
    let (both, u, v) = (width("alpha")?, width("alpha_u")?, width("alpha_v")?);
    let both = both.unwrap_or(default);
    let (u, v) = (u.unwrap_or(both), v.unwrap_or(both));
    if u != v {
        let phrase = "used one width of facets along u and v (the root of their product) for";
        textures.skipped(phrase, object);
    }
    let model = match object.string("distribution")? {
        None | Some("beckmann") => FacetModel::Beckmann,
        Some("ggx") => FacetModel::Ggx,
        Some(other) => {
            let phrase = format!("used Beckmann's facets for `{other}`:");
            textures.skipped(phrase, object);
            FacetModel::Beckmann
        }
    };
    let _ = object.boolean("sample_visible")?;
    let alpha = if u == v { u } else { (u * v).sqrt() };
    Ok(Facets { model, alpha })
}

fn conductor(object: &Object, textures: &mut MitsubaTextures) -> Result<SurfaceLook> {
    let tint = textures.mean_share(object, "specular_reflectance", Rgb::ONE)?;
    let material = object.string("material")?;
    let has_indices = object.get("eta")?.is_some() || object.get("k")?.is_some();
    let default = if object.document.is_old { "Cu" } else { "none" };
    let indices = match material {
        _ if has_indices => {
            let mut part = |name: &str, default: f32| match object.get(name)? {
                Some(child) => textures.spectrum(&child, ColorUse::Index, object),
                None => Ok(Rgb::splat(default)),
            };
            Some([part("eta", 0.0)?, part("k", 1.0)?])
        }
        name if name.unwrap_or(default) == "none" => None,
        name => {
            let name = name.unwrap_or(default);
            let known = metals::metal(name).ok_or_else(|| {
                let advice =
                    format!("use one of {}, or give eta and k", list(metals::metal_names()));
                object.error(format!("unknown material `{name}`"), &advice)
            })?;
            Some(known)
        }
    };
    let outside = match object.get("ext_eta")? {
        Some(_) => index(object, "ext_eta", 1.0)?,
        None => 1.0,
    };
    let facets = match object.kind() {
        "roughconductor" => facets(object, textures, 0.1)?,
        _ => SMOOTH,
    };
    let smooth = facets.alpha < SMOOTH_ALPHA;
    let bsdf = match indices {
        None if smooth => Bsdf::Mirror { reflectance: tint },
        None => metal(Reflectance::Artist { normal: Rgb::ONE }, tint, facets),
        Some([eta, k]) => {
            let reflectance = Reflectance::Measured { eta: eta / outside, k: k / outside };
            metal(reflectance, tint, facets)
        }
    };
    Ok(SurfaceLook { is_black_behind: true, ..SurfaceLook::plain(bsdf) })
}

/// A metal with facets that scatter once.
fn metal(reflectance: Reflectance, tint: Rgb, facets: Facets) -> Bsdf {
    Bsdf::Conductor(Conductor::once(reflectance, facets, tint))
}

/// A refractive index by number or name.
fn index(object: &Object, name: &str, default: f32) -> Result<f32> {
    let Some(text) = object.string(name)? else { return Ok(default) };
    let known = text.trim().parse().ok().or_else(|| metals::dielectric(text.trim()));
    known.filter(|index: &f32| (0.1..=10.0).contains(index)).ok_or_else(|| {
        let problem = format!("`{name}` is `{text}`");
        object.error(problem, "give a number from 0.1 to 10, or a name such as bk7, water or air")
    })
}

/// Refractive index of the inside, relative to the outside.
fn relative_index(object: &Object, default: f32) -> Result<f32> {
    Ok(index(object, "int_ior", default)? / index(object, "ext_ior", 1.000_277)?)
}

/// Factor of light that crosses a dielectric. Reflected light is not tinted.
fn transmittance(object: &Object, textures: &mut MitsubaTextures) -> Result<Rgb> {
    if textures.mean_share(object, "specular_reflectance", Rgb::ONE)? != Rgb::ONE {
        textures.skipped("left reflected light without the tint of", object);
    }
    textures.mean_share(object, "specular_transmittance", Rgb::ONE)
}

fn dielectric(object: &Object, textures: &mut MitsubaTextures) -> Result<SurfaceLook> {
    let eta = relative_index(object, 1.5046)?;
    let transmittance = transmittance(object, textures)?;
    let facets = match object.kind() {
        "roughdielectric" => facets(object, textures, 0.1)?,
        _ => SMOOTH,
    };
    Ok(SurfaceLook::plain(interface(eta, facets, transmittance)))
}

/// A diffuse base under a coat. In Mitsuba's linear model the coat reflects light back as if the base were white. Our
/// coat does not, so that its base gets the albedo with the same result.
fn plastic(object: &Object, textures: &mut MitsubaTextures) -> Result<SurfaceLook> {
    let eta = relative_index(object, 1.49)?;
    let paint = textures.share(object, "diffuse_reflectance", Rgb::splat(0.5))?;
    if textures.mean_share(object, "specular_reflectance", Rgb::ONE)? != Rgb::ONE {
        textures.skipped("left reflected light without the tint of", object);
    }
    let outside = fresnel::diffuse_mean(|cos| Rgb::splat(fresnel::dielectric(cos, eta).0)).x;
    let inside = 1.0 - (1.0 - outside) / (eta * eta);
    let is_nonlinear = object.boolean("nonlinear")?.unwrap_or(false);
    let rough = object.kind() == "roughplastic";
    let alpha = if rough { facets(object, textures, 0.1)?.alpha } else { 0.0 };
    if alpha >= SMOOTH_ALPHA {
        let phrase = "used glossy surfaces (GGX and Schlick's reflectance) for rough plastic:";
        textures.skipped(phrase, object);
        // The base of our glossy surfaces is linear.
        let dimmed = |a: Rgb| a * (1.0 - inside) / (Rgb::ONE - a * inside);
        let paint = if is_nonlinear { paint.mapped(dimmed) } else { paint };
        let bsdf = Bsdf::Glossy(Glossy::new(paint.color, 0.0, eta, alpha));
        return Ok(SurfaceLook { is_black_behind: true, ..SurfaceLook::painted(bsdf, paint) });
    }
    let brightened = |a: Rgb| a / (Rgb::splat(1.0 - inside) + a * inside);
    let paint = if is_nonlinear { paint } else { paint.mapped(brightened) };
    let bsdf = Bsdf::Coated(Coated::new(paint.color, eta));
    Ok(SurfaceLook { is_black_behind: true, ..SurfaceLook::painted(bsdf, paint) })
}

/// Disney's model, reduced to base, metal and glass.
fn principled(
    object: &Object,
    textures: &mut MitsubaTextures,
    is_thin: bool,
) -> Result<SurfaceLook> {
    let paint = textures.share(object, "base_color", Rgb::splat(0.5))?;
    let mut share = |name: &str, default: f32| {
        Ok::<_, Error>(textures.mean_share(object, name, Rgb::splat(default))?.x)
    };
    let roughness = share("roughness", 0.5)?;
    let (metallic, crossing) = (share("metallic", 0.0)?, share("spec_trans", 0.0)?);
    let mut left_out = Vec::new();
    for name in ["anisotropic", "sheen", "clearcoat", "flatness", "spec_tint", "diff_trans"] {
        if share(name, 0.0)? != 0.0 {
            left_out.push(name);
        }
    }
    let eta = match (object.get("eta")?, object.float("specular")?) {
        (Some(_), _) => index(object, "eta", 1.5)?,
        // From the reflectance at normal incidence, which is 0.08 times `specular`.
        (None, specular) => {
            let root = (0.08 * specular.unwrap_or(0.5).clamp(0.0, 1.0) as f32).sqrt();
            (1.0 + root) / (1.0 - root)
        }
    };
    if !left_out.is_empty() {
        textures.skipped(format!("left out {} of", list(left_out)), object);
    }
    textures.skipped("used the glossy or dielectric surface nearest to principled:", object);
    let alpha = roughness * roughness;
    if crossing > 0.5 {
        let tint = paint.mean();
        if is_thin {
            let sheet = ThinDielectric { eta, transmittance: tint };
            return Ok(SurfaceLook::plain(Bsdf::ThinDielectric(sheet)));
        }
        // Light crosses two surfaces of the object.
        let facets = Facets { model: FacetModel::Ggx, alpha };
        return Ok(SurfaceLook::plain(interface(eta, facets, tint.map(f32::sqrt))));
    }
    let bsdf = Bsdf::Glossy(Glossy::new(paint.color, metallic, eta, alpha));
    Ok(SurfaceLook::painted(bsdf, paint))
}

/// A look that only a share of the rays meets.
fn masked(
    look: SurfaceLook,
    opacity: &Paint,
    object: &Object,
    textures: &mut MitsubaTextures,
) -> SurfaceLook {
    let Some(texture) = &opacity.texture else {
        return SurfaceLook { opacity: Some((opacity.color.x, None)), ..look };
    };
    warn_of_two_maps(textures, &look, opacity.to_uv, object);
    // The share is the luminance, which is stored linearly.
    let shares = texture.map_texels(|texel| {
        let share = luminance(linear_color(texel) * opacity.color);
        let code = (255.0 * share).round().clamp(0.0, 255.0) as u8;
        [code, code, code, 255]
    });
    let to_uv = if look.albedo.is_some() { look.to_uv } else { opacity.to_uv };
    SurfaceLook { opacity: Some((1.0, Some(Arc::new(shares)))), to_uv, ..look }
}
