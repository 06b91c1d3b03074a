//! BSDFs as materials.

use super::color::{self, ColorUse};
use super::document::MAX_DEPTH;
use super::metals;
use super::object::Object;
use super::texture::Paints;
use crate::paint::Paint;
use crate::scene_file::material::interface;
use crate::text::list;
use crate::texture_file::linear_color;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::scene::bsdf::{
    Bsdf, Conductor, FacetModel, Facets, Plastic, Principled, PrincipledParameters, Reflectance,
    SMOOTH_ALPHA, ThinDielectric,
};
use bdpm_core::scene::{Dispersion, RefractiveIndex, Texture};
use glam::Affine2;
use std::collections::HashMap;
use std::sync::Arc;

/// The material properties of a BSDF.
#[derive(Clone)]
pub(super) struct Look {
    pub bsdf: Bsdf,
    pub dispersion: Option<Arc<Dispersion>>,
    /// Texture that multiplies the albedo.
    pub albedo: Option<Arc<Texture>>,
    /// Texture that multiplies roughness and metallic share.
    pub metallic_roughness: Option<Arc<Texture>>,
    /// Map of texture coordinates, for all paints.
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

impl Look {
    fn plain(bsdf: Bsdf) -> Self {
        Self {
            bsdf,
            dispersion: None,
            albedo: None,
            metallic_roughness: None,
            to_uv: Affine2::IDENTITY,
            opacity: None,
            normals: None,
            is_black_behind: false,
        }
    }

    /// The look of a surface without any BSDF: lamps are black.
    pub fn without_bsdf(is_lamp: bool) -> Self {
        Self::plain(lambertian(Rgb::splat(if is_lamp { 0.0 } else { 0.5 })))
    }

    /// The look of a boundary of media that does not refract.
    pub fn index_matched() -> Self {
        Self::plain(Bsdf::ThinDielectric(ThinDielectric::new(1.0)))
    }

    fn painted(bsdf: Bsdf, paint: Paint) -> Self {
        Self { albedo: paint.texture, to_uv: paint.to_uv, ..Self::plain(bsdf) }
    }
}

/// The BSDFs of a scene.
#[derive(Default)]
pub(super) struct BsdfCache {
    /// By element, because many shapes may refer to one.
    known: HashMap<usize, Look>,
}

impl BsdfCache {
    /// The look of a BSDF, which is nested in `depth` others.
    pub fn look(&mut self, object: &Object, paints: &mut Paints, depth: usize) -> Result<Look> {
        if let Some(known) = self.known.get(&object.index) {
            return Ok(known.clone());
        }
        if depth > MAX_DEPTH {
            let problem = "it refers to itself, or is nested too deep";
            return Err(object.error(problem, "nest BSDFs less"));
        }
        let look = self.read(object, paints, depth)?;
        self.known.insert(object.index, look.clone());
        Ok(look)
    }

    fn read(&mut self, object: &Object, paints: &mut Paints, depth: usize) -> Result<Look> {
        match object.kind() {
            "diffuse" => diffuse(object, paints),
            "roughdiffuse" => {
                paints.skipped("used Lambertian surfaces for rough diffuse ones:", object);
                diffuse(object, paints)
            }
            "conductor" | "roughconductor" => conductor(object, paints),
            "dielectric" | "roughdielectric" => dielectric(object, paints),
            "thindielectric" => {
                let eta = relative_index(object, paints, 1.5046)?;
                let transmittance = transmittance(object, paints)?;
                Ok(Look::plain(Bsdf::ThinDielectric(ThinDielectric { eta, transmittance })))
            }
            "plastic" | "roughplastic" => plastic(object, paints),
            "principled" => principled(object, paints),
            "principledthin" => principled_thin(object, paints),
            "phong" | "ward" => {
                paints.skipped("used only the diffuse part of", object);
                let paint = paints.share(object, "diffuse_reflectance", Rgb::splat(0.5))?;
                Ok(Look::painted(lambertian(paint.color), paint))
            }
            "null" => Ok(Look { opacity: Some((0.0, None)), ..Look::without_bsdf(false) }),
            "twosided" => {
                let nested = self.nested(object, paints, depth)?;
                if nested.len() > 1 {
                    paints.skipped("used the front's BSDF for both sides of", object);
                }
                let mut look = first(object, nested)?;
                match &mut look.bsdf {
                    Bsdf::Lambertian { two_sided, .. } => *two_sided = true,
                    Bsdf::Principled(principled) => {
                        let two_sided =
                            PrincipledParameters { two_sided: true, ..*principled.parameters() };
                        *principled = Principled::new(two_sided);
                    }
                    _ => {}
                }
                Ok(Look { is_black_behind: false, ..look })
            }
            "mask" => {
                let look = first(object, self.nested(object, paints, depth)?)?;
                let opacity = paints.share(object, "opacity", Rgb::splat(0.5))?;
                Ok(masked(look, &opacity, object, paints))
            }
            "normalmap" => {
                let look = first(object, self.nested(object, paints, depth)?)?;
                let Some(child) = one_texture(object, "normalmap")? else { return Ok(look) };
                let Some((texture, to_uv)) = paints.data(&child)? else { return Ok(look) };
                // The code 127.5 stands for 0, and v points down.
                let code = |x: f32| (128.0 + 127.0 * x).round().clamp(1.0, 255.0) as u8;
                let vector = |code: u8| f32::from(code) / 127.5 - 1.0;
                let map = texture.map_texels(|[r, g, b, _]| {
                    [code(vector(r)), code(-vector(g)), code(vector(b)), 255]
                });
                bent(paints, look, NormalSource::Map(Arc::new(map)), to_uv, object)
            }
            "bumpmap" | "bump" => {
                let look = first(object, self.nested(object, paints, depth)?)?;
                let scale = object.float("scale")?.unwrap_or(1.0) as f32;
                let Some(child) = one_texture(object, "")? else { return Ok(look) };
                let Some((texture, to_uv)) = paints.data(&child)? else { return Ok(look) };
                bent(paints, look, NormalSource::Bumps(texture, scale), to_uv, object)
            }
            "blendbsdf" => self.blend(object, paints, depth),
            "mixturebsdf" | "coating" | "roughcoating" => {
                paints.skipped("used only the first BSDF of", object);
                first(object, self.nested(object, paints, depth)?)
            }
            other => {
                let phrase = format!("used diffuse gray for BSDFs of type `{other}`:");
                paints.skipped(phrase, object);
                Ok(Look::without_bsdf(false))
            }
        }
    }

    fn nested(&mut self, object: &Object, paints: &mut Paints, depth: usize) -> Result<Vec<Look>> {
        let nested = object.all("bsdf")?;
        nested.iter().map(|one| self.look(one, paints, depth + 1)).collect()
    }

    /// The mean of two diffuse BSDFs, else the BSDF with more weight.
    fn blend(&mut self, object: &Object, paints: &mut Paints, depth: usize) -> Result<Look> {
        let weight = paints.share(object, "weight", Rgb::splat(0.5))?;
        let share = weight.mean().x.clamp(0.0, 1.0);
        let Ok([a, b]) = <[Look; 2]>::try_from(self.nested(object, paints, depth)?) else {
            return Err(object.error("it does not have two BSDFs", "give two"));
        };
        let is_plain =
            |look: &Look| look.albedo.is_none() && look.opacity.is_none() && look.normals.is_none();
        if let (
            Bsdf::Lambertian { albedo, two_sided },
            Bsdf::Lambertian { albedo: other, two_sided: also },
        ) = (a.bsdf, b.bsdf)
            && is_plain(&a)
            && is_plain(&b)
            && two_sided == also
        {
            let mixed = |share: Rgb| albedo + (other - albedo) * share;
            let paint = weight.mapped(mixed);
            return Ok(Look::painted(Bsdf::Lambertian { albedo: paint.color, two_sided }, paint));
        }
        if share > 0.0 && share < 1.0 {
            paints.skipped("used only the BSDF with more weight of", object);
        }
        Ok(if share > 0.5 { b } else { a })
    }
}

/// A look with bent normals. All textures share one map of texture coordinates.
fn bent(
    paints: &mut Paints,
    look: Look,
    normals: NormalSource,
    to_uv: Affine2,
    object: &Object,
) -> Result<Look> {
    // Mitsuba has this property since 3.7.1.
    if object.boolean("use_shadowing_function")?.unwrap_or(true) {
        let phrase = "left out the shadowing by bumps (`use_shadowing_function`) of";
        paints.skipped(phrase, object);
    }
    warn_of_two_maps(paints, &look, to_uv, object);
    let to_uv = if look.albedo.is_some() { look.to_uv } else { to_uv };
    Ok(Look { normals: Some(normals), to_uv, ..look })
}

/// Warns if a texture needs other coordinates than the albedo's.
fn warn_of_two_maps(paints: &mut Paints, look: &Look, to_uv: Affine2, object: &Object) {
    if look.albedo.is_some() && look.to_uv != to_uv {
        let phrase = "used the texture coordinates of the albedo's texture for all of";
        paints.skipped(phrase, object);
    }
}

fn first(object: &Object, nested: Vec<Look>) -> Result<Look> {
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

/// A Lambertian surface that scatters on one side only.
fn lambertian(albedo: Rgb) -> Bsdf {
    Bsdf::Lambertian { albedo, two_sided: false }
}

fn diffuse(object: &Object, paints: &mut Paints) -> Result<Look> {
    // The old name of the property is valid as well.
    let has_old_name = object.get("diffuse_reflectance")?.is_some();
    let name = if has_old_name { "diffuse_reflectance" } else { "reflectance" };
    let paint = paints.share(object, name, Rgb::splat(0.5))?;
    Ok(Look::painted(lambertian(paint.color), paint))
}

/// Facets of a surface, which is smooth unless the name of its type begins with `rough`.
fn facets(object: &Object, paints: &mut Paints) -> Result<Facets> {
    if !object.kind().starts_with("rough") {
        return Ok(Facets { model: FacetModel::Ggx, alpha: 0.0 });
    }
    let mut width = |name: &str, default: f32| {
        Ok::<_, Error>(paints.mean_share(object, name, Rgb::splat(default))?.x)
    };
    let both = width("alpha", 0.1)?;
    let (u, v) = (width("alpha_u", both)?, width("alpha_v", both)?);
    if u != v {
        let phrase = "used one width of facets along u and v (the root of their product) for";
        paints.skipped(phrase, object);
    }
    let model = match object.string("distribution")? {
        None | Some("beckmann") => FacetModel::Beckmann,
        Some("ggx") => FacetModel::Ggx,
        Some(other) => {
            paints.skipped(format!("used Beckmann's facets for `{other}`:"), object);
            FacetModel::Beckmann
        }
    };
    let _ = object.boolean("sample_visible")?;
    let alpha = if u == v { u } else { (u * v).sqrt() };
    Ok(Facets { model, alpha })
}

fn conductor(object: &Object, paints: &mut Paints) -> Result<Look> {
    let tint = paints.mean_share(object, "specular_reflectance", Rgb::ONE)?;
    let default = if object.document.is_old { "Cu" } else { "none" };
    let name = object.string("material")?.unwrap_or(default);
    let indices = if object.get("eta")?.is_some() || object.get("k")?.is_some() {
        let mut part = |name: &str, default: f32| match object.get(name)? {
            Some(child) => paints.spectrum(&child, ColorUse::Index, object),
            None => Ok(Rgb::splat(default)),
        };
        Some([part("eta", 0.0)?, part("k", 1.0)?])
    } else if name == "none" {
        None
    } else {
        Some(metals::metal(name).ok_or_else(|| {
            let advice = format!("use one of {}, or give eta and k", list(metals::metal_names()));
            object.error(format!("unknown material `{name}`"), &advice)
        })?)
    };
    let outside = index(object, paints, "ext_eta", 1.0)?;
    let facets = facets(object, paints)?;
    let reflectance = match indices {
        None => Reflectance::Artist { normal: Rgb::ONE },
        Some([eta, k]) => Reflectance::Measured { eta: eta / outside, k: k / outside },
    };
    let bsdf = match indices {
        None if facets.alpha < SMOOTH_ALPHA => Bsdf::Mirror { reflectance: tint },
        _ => Bsdf::Conductor(Conductor::once(reflectance, facets, tint)),
    };
    Ok(Look { is_black_behind: true, ..Look::plain(bsdf) })
}

/// A refractive index by number or name.
fn index(object: &Object, paints: &mut Paints, name: &str, default: f32) -> Result<f32> {
    let Some(text) = object.string(name)? else { return Ok(default) };
    let known = text.trim().parse().ok().or_else(|| metals::dielectric(text.trim()));
    let known = known.filter(|index: &f32| index.is_finite()).ok_or_else(|| {
        let problem = format!("`{name}` is `{text}`");
        object.error(problem, "give a number from 0.1 to 10, or a name such as bk7, water or air")
    })?;
    if !(0.1..=10.0).contains(&known) {
        paints.skipped("used the nearest refractive index from 0.1 to 10 for that of", object);
    }
    Ok(known.clamp(0.1, 10.0))
}

/// A refractive index by number or name, or by a spectrum, which disperses.
fn medium(
    object: &Object,
    paints: &mut Paints,
    name: &str,
    default: f32,
) -> Result<RefractiveIndex> {
    if let Some(child) = object.get(name)?
        && matches!(&child.element().tag[..], "spectrum" | "texture")
        && let Some((nm, values)) = color::samples(&child)?
    {
        return RefractiveIndex::of_samples(nm, values).map_err(|error| {
            let advice = "give wavelengths that grow, and indices from 0.1 to 10";
            object.error(format!("`{name}`: {}", error.problem()), advice)
        });
    }
    Ok(RefractiveIndex::Constant(index(object, paints, name, default)?.into()))
}

/// Refractive index of the inside, relative to the outside.
fn relative_index(object: &Object, paints: &mut Paints, default: f32) -> Result<f32> {
    let inside = index(object, paints, "int_ior", default)?;
    Ok(inside / index(object, paints, "ext_ior", 1.000_277)?)
}

/// Factor of light that crosses a dielectric. Reflected light is not tinted.
fn transmittance(object: &Object, paints: &mut Paints) -> Result<Rgb> {
    warn_of_reflected_tint(object, paints)?;
    paints.mean_share(object, "specular_transmittance", Rgb::ONE)
}

fn warn_of_reflected_tint(object: &Object, paints: &mut Paints) -> Result<()> {
    if paints.mean_share(object, "specular_reflectance", Rgb::ONE)? != Rgb::ONE {
        paints.skipped("left reflected light without the tint of", object);
    }
    Ok(())
}

fn dielectric(object: &Object, paints: &mut Paints) -> Result<Look> {
    let inside = medium(object, paints, "int_ior", 1.5046)?;
    let outside = medium(object, paints, "ext_ior", 1.000_277)?;
    let eta = inside.at_d() as f32 / outside.at_d() as f32;
    let transmittance = transmittance(object, paints)?;
    let bsdf = interface(eta, facets(object, paints)?, transmittance);
    let dispersion = Dispersion::new(inside, outside).map(Arc::new);
    Ok(Look { dispersion, ..Look::plain(bsdf) })
}

/// A diffuse base under a coat.
fn plastic(object: &Object, paints: &mut Paints) -> Result<Look> {
    let eta = relative_index(object, paints, 1.49)?;
    let paint = paints.share(object, "diffuse_reflectance", Rgb::splat(0.5))?;
    let tint = paints.mean_share(object, "specular_reflectance", Rgb::ONE)?;
    let is_nonlinear = object.boolean("nonlinear")?.unwrap_or(false);
    let facets = facets(object, paints)?;
    let bsdf = Bsdf::Plastic(Plastic::new(paint.color, eta, facets, is_nonlinear).tinted(tint));
    Ok(Look { is_black_behind: true, ..Look::painted(bsdf, paint) })
}

/// Disney's principled BSDF.
fn principled(object: &Object, paints: &mut Paints) -> Result<Look> {
    let paint = paints.share(object, "base_color", Rgb::splat(0.5))?;
    let data = ShareTexture::read(object, paints)?;
    let mut share =
        |name: &str| Ok::<_, Error>(paints.mean_share(object, name, Rgb::ZERO)?.x.clamp(0.0, 1.0));
    let parameters = PrincipledParameters {
        base_color: paint.color,
        roughness: data.roughness,
        metallic: data.metallic,
        anisotropic: share("anisotropic")?,
        spec_trans: share("spec_trans")?,
        spec_tint: share("spec_tint")?,
        sheen: share("sheen")?,
        sheen_tint: share("sheen_tint")?,
        flatness: share("flatness")?,
        clearcoat: share("clearcoat")?,
        clearcoat_gloss: share("clearcoat_gloss")?,
        eta: 1.0,
        two_sided: false,
    };
    let eta = principled_index(object, paints, parameters.spec_trans > 0.0)?;
    let parameters = PrincipledParameters { eta, ..parameters };
    for lobe in ["main_specular", "clearcoat", "diffuse_reflectance"] {
        let _ = object.float(&format!("{lobe}_sampling_rate"))?;
    }
    let look = Look::painted(Bsdf::Principled(Principled::new(parameters)), paint);
    let Some(texture) = data.texture else { return Ok(look) };
    warn_of_two_maps(paints, &look, data.to_uv, object);
    let to_uv = if look.albedo.is_some() { look.to_uv } else { data.to_uv };
    Ok(Look { metallic_roughness: Some(texture), to_uv, ..look })
}

/// Refractive index of a principled surface, by itself or by `specular`, which is the reflectance
/// at normal incidence over .08. Glass has an index other than 1.
fn principled_index(object: &Object, paints: &mut Paints, is_glass: bool) -> Result<f32> {
    if object.get("eta")?.is_some() {
        let eta = index(object, paints, "eta", 1.5)?;
        return Ok(if is_glass && eta == 1.0 { 1.001 } else { eta });
    }
    let specular = object.float("specular")?.unwrap_or(0.5).clamp(0.0, 1.0) as f32;
    let specular = if is_glass && specular == 0.0 { 1e-3 } else { specular };
    Ok(2.0 / (1.0 - (0.08 * specular).sqrt()) - 1.0)
}

/// Roughness and metallic share of a principled surface, which may vary over it.
struct ShareTexture {
    roughness: f32,
    metallic: f32,
    /// The factors of both, in green and blue.
    texture: Option<Arc<Texture>>,
    to_uv: Affine2,
}

impl ShareTexture {
    fn read(object: &Object, paints: &mut Paints) -> Result<Self> {
        let roughness = paints.share(object, "roughness", Rgb::splat(0.5))?;
        let metallic = paints.share(object, "metallic", Rgb::ZERO)?;
        let shares = |colors: &[Rgb]| Rgb::new(0.0, luminance(colors[0]), luminance(colors[1]));
        let (both, is_averaged) = Paint::combined(&[&roughness, &metallic], shares);
        if is_averaged {
            let phrase =
                "used the mean of a texture, whose coordinates differ from those of another, of";
            paints.skipped(phrase, object);
        }
        let Some(texture) = &both.texture else {
            let [_, roughness, metallic] = both.color.to_array().map(|share| share.clamp(0.0, 1.0));
            return Ok(Self { roughness, metallic, texture: None, to_uv: both.to_uv });
        };
        // Numbers are stored linearly.
        let texture = texture.map_texels(|texel| {
            let shares = linear_color(texel) * both.color;
            let [r, g, b] = shares.to_array().map(|x| (255.0 * x).round().clamp(0.0, 255.0) as u8);
            [r, g, b, 255]
        });
        let texture = Some(Arc::new(texture));
        Ok(Self { roughness: 1.0, metallic: 1.0, texture, to_uv: both.to_uv })
    }
}

/// The principled BSDF of thin sheets: clear glass, or a base whose transmission of diffuse light
/// is left out.
fn principled_thin(object: &Object, paints: &mut Paints) -> Result<Look> {
    let paint = paints.share(object, "base_color", Rgb::splat(0.5))?;
    let mut number = |name: &str, default: f32, [low, high]: [f32; 2]| {
        let read = paints.mean(object, name, ColorUse::Index, Rgb::splat(default))?;
        Ok::<_, Error>(read.x.clamp(low, high))
    };
    let crossing = number("spec_trans", 0.0, [0.0, 1.0])?;
    let reflected = 1.0 - 0.5 * number("diff_trans", 0.0, [0.0, 2.0])?;
    let eta = number("eta", 1.5, [0.1, 10.0])?;
    let share = (1.0 - crossing) * reflected;
    let parameters = PrincipledParameters {
        base_color: paint.color * share,
        eta: 1.0,
        roughness: number("roughness", 0.5, [0.0, 1.0])?,
        sheen: share * number("sheen", 0.0, [0.0, 1.0])?,
        sheen_tint: number("sheen_tint", 0.0, [0.0, 1.0])?,
        flatness: number("flatness", 0.0, [0.0, 1.0])?,
        ..PrincipledParameters::default()
    };
    if crossing > 0.5 {
        paints.skipped("used a clear sheet for", object);
        let sheet = ThinDielectric { eta, transmittance: paint.mean() };
        return Ok(Look::plain(Bsdf::ThinDielectric(sheet)));
    }
    if share < 1.0 {
        paints.skipped("used only the reflection of diffuse light of", object);
    }
    Ok(Look::painted(Bsdf::Principled(Principled::new(parameters)), paint))
}

/// A look that only a share of the rays meets.
fn masked(look: Look, opacity: &Paint, object: &Object, paints: &mut Paints) -> Look {
    let Some(texture) = &opacity.texture else {
        return Look { opacity: Some((opacity.color.x, None)), ..look };
    };
    warn_of_two_maps(paints, &look, opacity.to_uv, object);
    // The share is the luminance, which is stored linearly.
    let shares = texture.map_texels(|texel| {
        let share = luminance(linear_color(texel) * opacity.color);
        let code = (255.0 * share).round().clamp(0.0, 255.0) as u8;
        [code, code, code, 255]
    });
    let to_uv = if look.albedo.is_some() { look.to_uv } else { opacity.to_uv };
    Look { opacity: Some((1.0, Some(Arc::new(shares)))), to_uv, ..look }
}
