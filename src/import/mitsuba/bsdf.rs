//! How surfaces scatter.

use super::color;
use super::color::Meaning;
use super::document::MAX_DEPTH;
use super::metals;
use super::object::Object;
use super::texture::{Paint, Pictures};
use super::warnings::Remarks;
use crate::base::error::Result;
use crate::base::math::Rgb;
use crate::import::scene_file::material::interface;
use crate::import::text::list;
use crate::scene::Texture;
use crate::scene::bsdf::{
    Bsdf, Coated, Conductor, FacetModel, Facets, Glossy, Reflectance, SMOOTH_ALPHA, ThinDielectric,
    fresnel,
};
use glam::Affine2;
use std::collections::HashMap;
use std::sync::Arc;

/// What a BSDF becomes.
#[derive(Clone)]
pub(super) struct Look {
    pub bsdf: Bsdf,
    /// What the albedo is multiplied with.
    pub albedo: Option<Arc<Texture>>,
    /// Of all its textures.
    pub to_uv: Affine2,
    /// Share of the rays that meet it, with the picture that this is multiplied with.
    pub opacity: Option<(f32, Option<Arc<Texture>>)>,
    pub normals: Option<Normals>,
    /// Whether Mitsuba shows it black from behind, and this renderer does not.
    pub is_black_behind: bool,
}

/// How normals are bent.
#[derive(Clone)]
pub(super) enum Normals {
    /// By a map of normals.
    Map(Arc<Texture>),
    /// By heights, times so much.
    Bumps(Arc<Texture>, f32),
}

impl Look {
    fn plain(bsdf: Bsdf) -> Self {
        let (albedo, opacity, normals, to_uv) = (None, None, None, Affine2::IDENTITY);
        Self { bsdf, albedo, to_uv, opacity, normals, is_black_behind: false }
    }

    /// Of a surface without any BSDF: lamps are black.
    pub fn unsaid(is_lamp: bool) -> Self {
        Self::plain(lambertian(Rgb::splat(if is_lamp { 0.0 } else { 0.5 })))
    }

    fn painted(bsdf: Bsdf, paint: Paint) -> Self {
        Self { albedo: paint.texture, to_uv: paint.to_uv, ..Self::plain(bsdf) }
    }
}

/// The BSDFs of a scene.
#[derive(Default)]
pub(super) struct Bsdfs {
    /// By element, for those that many refer to.
    known: HashMap<usize, Look>,
}

/// What BSDFs are read with.
pub(super) struct With<'a> {
    pub pictures: &'a mut Pictures,
    pub remarks: &'a mut Remarks,
}

impl Bsdfs {
    /// The look of a BSDF, which is nested so deep in others.
    pub fn look(&mut self, object: &Object, with: &mut With, depth: usize) -> Result<Look> {
        if let Some(known) = self.known.get(&object.index) {
            return Ok(known.clone());
        }
        if depth > MAX_DEPTH {
            let problem = "it refers to itself, or is nested too deep";
            return Err(object.error(problem, "nest BSDFs less"));
        }
        let look = self.read(object, with, depth)?;
        self.known.insert(object.index, look.clone());
        Ok(look)
    }

    fn read(&mut self, object: &Object, with: &mut With, depth: usize) -> Result<Look> {
        match object.kind() {
            "diffuse" => diffuse(object, with),
            "roughdiffuse" => {
                with.remarks
                    .skipped("took Lambertian surfaces for rough diffuse ones:", &object.label());
                diffuse(object, with)
            }
            "conductor" | "roughconductor" => conductor(object, with),
            "dielectric" | "roughdielectric" => dielectric(object, with),
            "thindielectric" => {
                let eta = relative_index(object, 1.5046)?;
                let transmittance = crossing(object, with)?;
                Ok(Look::plain(Bsdf::ThinDielectric(ThinDielectric { eta, transmittance })))
            }
            "plastic" | "roughplastic" => plastic(object, with),
            "principled" => principled(object, with, false),
            "principledthin" => principled(object, with, true),
            "phong" | "ward" => {
                with.remarks.skipped("took the diffuse part alone of", &object.label());
                let paint = with.paint(object, "diffuse_reflectance", Rgb::splat(0.5))?;
                Ok(Look::painted(lambertian(paint.color), paint))
            }
            "null" => Ok(Look { opacity: Some((0.0, None)), ..Look::unsaid(false) }),
            "twosided" => {
                let nested = self.nested(object, with, depth)?;
                if nested.len() > 1 {
                    with.remarks
                        .skipped("took the front's BSDF for both sides of", &object.label());
                }
                let mut look = first(object, nested)?;
                if let Bsdf::Lambertian { two_sided, .. } = &mut look.bsdf {
                    *two_sided = true;
                }
                Ok(Look { is_black_behind: false, ..look })
            }
            "mask" => {
                let look = first(object, self.nested(object, with, depth)?)?;
                let opacity = with.paint(object, "opacity", Rgb::splat(0.5))?;
                Ok(masked(look, &opacity, object, with))
            }
            "normalmap" => {
                let look = first(object, self.nested(object, with, depth)?)?;
                let Some(child) = one_texture(object, "normalmap")? else { return Ok(look) };
                let (texture, to_uv) = with.pictures.data(&child)?;
                let texels = texture.texels().iter();
                // Of codes up to 255 a half is 0, and v points down.
                let code = |x: f32| (128.0 + 127.0 * x).round().clamp(1.0, 255.0) as u8;
                let vector = |code: u8| f32::from(code) / 127.5 - 1.0;
                let texels = texels.map(|[r, g, b, _]| {
                    [code(vector(*r)), code(-vector(*g)), code(vector(*b)), 255]
                });
                let [width, height] = texture.size();
                let map = Texture::new(width, height, texels.collect()).sampled(texture.sampling());
                with.bent(look, Normals::Map(Arc::new(map)), to_uv, object)
            }
            "bumpmap" | "bump" => {
                let look = first(object, self.nested(object, with, depth)?)?;
                let scale = object.float("scale")?.unwrap_or(1.0) as f32;
                let Some(child) = one_texture(object, "")? else { return Ok(look) };
                let (texture, to_uv) = with.pictures.data(&child)?;
                with.bent(look, Normals::Bumps(texture, scale), to_uv, object)
            }
            "blendbsdf" => self.blend(object, with, depth),
            "mixturebsdf" | "coating" | "roughcoating" => {
                with.remarks.skipped("took the first BSDF alone of", &object.label());
                first(object, self.nested(object, with, depth)?)
            }
            other => {
                let phrase = format!("took diffuse grey for BSDFs of type `{other}`:");
                with.remarks.skipped(phrase, &object.label());
                Ok(Look::unsaid(false))
            }
        }
    }

    fn nested(&mut self, object: &Object, with: &mut With, depth: usize) -> Result<Vec<Look>> {
        let nested = object.all("bsdf")?;
        nested.iter().map(|one| self.look(one, with, depth + 1)).collect()
    }

    /// Of two diffuse ones their mean, else the one with more weight.
    fn blend(&mut self, object: &Object, with: &mut With, depth: usize) -> Result<Look> {
        let weight = with.paint(object, "weight", Rgb::splat(0.5))?;
        let share = weight.mean().x.clamp(0.0, 1.0);
        let Ok([a, b]) = <[Look; 2]>::try_from(self.nested(object, with, depth)?) else {
            return Err(object.error("it has not two BSDFs", "give two"));
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
            if weight.texture.is_none() {
                return Ok(Look::plain(Bsdf::Lambertian {
                    albedo: mixed(weight.color),
                    two_sided,
                }));
            }
            let paint = weight.mapped(mixed);
            return Ok(Look::painted(Bsdf::Lambertian { albedo: paint.color, two_sided }, paint));
        }
        if share > 0.0 && share < 1.0 {
            with.remarks.skipped("took the BSDF of more weight alone of", &object.label());
        }
        Ok(if share > 0.5 { b } else { a })
    }
}

impl With<'_> {
    fn paint(&mut self, object: &Object, name: &str, unsaid: Rgb) -> Result<Paint> {
        self.pictures.paint(object, name, Meaning::Share, unsaid, self.remarks)
    }

    /// The same where no texture can be.
    fn even(&mut self, object: &Object, name: &str, unsaid: Rgb) -> Result<Rgb> {
        let paint = self.paint(object, name, unsaid)?;
        if paint.texture.is_some() {
            let phrase = format!("took the mean of the texture `{name}` of");
            self.remarks.skipped(phrase, &object.label());
        }
        Ok(paint.mean())
    }

    /// A look with bent normals, where texture coordinates are the same for all textures.
    fn bent(
        &mut self,
        look: Look,
        normals: Normals,
        to_uv: Affine2,
        object: &Object,
    ) -> Result<Look> {
        // Since 3.7.1; earlier ones have none.
        if object.boolean("use_shadowing_function")?.unwrap_or(true) {
            let phrase = "left out that bumps shadow themselves (`use_shadowing_function`), of";
            self.remarks.skipped(phrase, &object.label());
        }
        self.one_map(&look, to_uv, object);
        let to_uv = if look.albedo.is_some() { look.to_uv } else { to_uv };
        Ok(Look { normals: Some(normals), to_uv, ..look })
    }

    fn one_map(&mut self, look: &Look, to_uv: Affine2, object: &Object) {
        if look.albedo.is_some() && look.to_uv != to_uv {
            let phrase = "took the texture coordinates of the albedo's texture for all of";
            self.remarks.skipped(phrase, &object.label());
        }
    }
}

fn first(object: &Object, nested: Vec<Look>) -> Result<Look> {
    nested.into_iter().next().ok_or_else(|| object.error("it has no BSDF within", "add one"))
}

/// The texture of this name, or the only one.
fn one_texture<'a>(object: &Object<'a>, name: &str) -> Result<Option<Object<'a>>> {
    if let Some(found) = object.get(name)? {
        return Ok(Some(found));
    }
    let found = object.all("texture")?.into_iter().next();
    found.map(Some).ok_or_else(|| object.error("it has no texture", "add one"))
}

/// Of what is not rough.
const SMOOTH: Facets = Facets { model: FacetModel::Ggx, alpha: 0.0 };

/// One side alone scatters.
fn lambertian(albedo: Rgb) -> Bsdf {
    Bsdf::Lambertian { albedo, two_sided: false }
}

fn diffuse(object: &Object, with: &mut With) -> Result<Look> {
    // The old name of the property counts as well.
    let name = if object.get("diffuse_reflectance")?.is_some() {
        "diffuse_reflectance"
    } else {
        "reflectance"
    };
    let paint = with.paint(object, name, Rgb::splat(0.5))?;
    Ok(Look::painted(lambertian(paint.color), paint))
}

/// Facets of a rough surface, of the width that is given or else `unsaid`.
fn facets(object: &Object, with: &mut With, unsaid: f32) -> Result<Facets> {
    let mut width = |name: &str| -> Result<Option<f32>> {
        if object.get(name)?.is_none() {
            return Ok(None);
        }
        Ok(Some(with.even(object, name, Rgb::splat(unsaid))?.x))
    };
    let (both, u, v) = (width("alpha")?, width("alpha_u")?, width("alpha_v")?);
    let both = both.unwrap_or(unsaid);
    let (u, v) = (u.unwrap_or(both), v.unwrap_or(both));
    if u != v {
        let phrase = "took facets of the same width along u and v (the root of their product) for";
        with.remarks.skipped(phrase, &object.label());
    }
    let model = match object.string("distribution")? {
        None | Some("beckmann") => FacetModel::Beckmann,
        Some("ggx") => FacetModel::Ggx,
        Some(other) => {
            let phrase = format!("took Beckmann's facets for `{other}`:");
            with.remarks.skipped(phrase, &object.label());
            FacetModel::Beckmann
        }
    };
    let _ = object.boolean("sample_visible")?;
    let alpha = if u == v { u } else { (u * v).sqrt() };
    Ok(Facets { model, alpha })
}

fn conductor(object: &Object, with: &mut With) -> Result<Look> {
    let tint = with.even(object, "specular_reflectance", Rgb::ONE)?;
    let material = object.string("material")?;
    let has_indices = object.get("eta")?.is_some() || object.get("k")?.is_some();
    let unsaid = if object.document.is_old { "Cu" } else { "none" };
    let indices = match material {
        _ if has_indices => {
            let mut part = |name: &str, unsaid: f32| -> Result<Rgb> {
                let Some(child) = object.get(name)? else { return Ok(Rgb::splat(unsaid)) };
                let read = color::read(&child, Meaning::Index)?;
                if read.is_measured {
                    with.remarks.chosen("made linear sRGB of the spectra of", &object.label());
                }
                Ok(read.rgb)
            };
            Some([part("eta", 0.0)?, part("k", 1.0)?])
        }
        name if name.unwrap_or(unsaid) == "none" => None,
        name => {
            let name = name.unwrap_or(unsaid);
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
        "roughconductor" => facets(object, with, 0.1)?,
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
    Ok(Look { is_black_behind: true, ..Look::plain(bsdf) })
}

/// A metal of Mitsuba's facets.
fn metal(reflectance: Reflectance, tint: Rgb, facets: Facets) -> Bsdf {
    Bsdf::Conductor(Conductor::once(reflectance, facets, tint))
}

/// A refractive index by number or name.
fn index(object: &Object, name: &str, unsaid: f32) -> Result<f32> {
    let Some(text) = object.string(name)? else { return Ok(unsaid) };
    let known = text.trim().parse().ok().or_else(|| metals::dielectric(text.trim()));
    known.filter(|index: &f32| (0.1..=10.0).contains(index)).ok_or_else(|| {
        let problem = format!("`{name}` is `{text}`");
        object.error(problem, "give a number from 0.1 to 10, or a name such as bk7, water or air")
    })
}

/// Of the inside over the outside.
fn relative_index(object: &Object, unsaid: f32) -> Result<f32> {
    Ok(index(object, "int_ior", unsaid)? / index(object, "ext_ior", 1.000_277)?)
}

/// What light that crosses a dielectric is multiplied with; what it reflects is not tinted.
fn crossing(object: &Object, with: &mut With) -> Result<Rgb> {
    if with.even(object, "specular_reflectance", Rgb::ONE)? != Rgb::ONE {
        with.remarks.skipped("left reflected light without the tint of", &object.label());
    }
    with.even(object, "specular_transmittance", Rgb::ONE)
}

fn dielectric(object: &Object, with: &mut With) -> Result<Look> {
    let eta = relative_index(object, 1.5046)?;
    let transmittance = crossing(object, with)?;
    let facets = match object.kind() {
        "roughdielectric" => facets(object, with, 0.1)?,
        _ => SMOOTH,
    };
    Ok(Look::plain(interface(eta, facets, transmittance)))
}

/// A diffuse base under a coat. In Mitsuba's linear one light that the coat's inside reflects comes back as if the
/// base were white; the base of our coat, in which it does not, gets the albedo that leads to the same.
fn plastic(object: &Object, with: &mut With) -> Result<Look> {
    let eta = relative_index(object, 1.49)?;
    let paint = with.paint(object, "diffuse_reflectance", Rgb::splat(0.5))?;
    if with.even(object, "specular_reflectance", Rgb::ONE)? != Rgb::ONE {
        with.remarks.skipped("left reflected light without the tint of", &object.label());
    }
    let outside = fresnel::diffuse_mean(|cos| Rgb::splat(fresnel::dielectric(cos, eta).0)).x;
    let inside = 1.0 - (1.0 - outside) / (eta * eta);
    let is_nonlinear = object.boolean("nonlinear")?.unwrap_or(false);
    let rough = object.kind() == "roughplastic";
    let alpha = if rough { facets(object, with, 0.1)?.alpha } else { 0.0 };
    if alpha >= SMOOTH_ALPHA {
        let phrase = "took glossy surfaces (GGX and Schlick's reflectance) for rough plastic:";
        with.remarks.skipped(phrase, &object.label());
        // Its base is linear.
        let dimmed = |a: Rgb| a * (1.0 - inside) / (Rgb::ONE - a * inside);
        let paint = if is_nonlinear { paint.mapped(dimmed) } else { paint };
        let bsdf = Bsdf::Glossy(Glossy::new(paint.color, 0.0, eta, alpha));
        return Ok(Look { is_black_behind: true, ..Look::painted(bsdf, paint) });
    }
    let brightened = |a: Rgb| a / (Rgb::splat(1.0 - inside) + a * inside);
    let paint = if is_nonlinear { paint } else { paint.mapped(brightened) };
    let bsdf = Bsdf::Coated(Coated::new(paint.color, eta));
    Ok(Look { is_black_behind: true, ..Look::painted(bsdf, paint) })
}

/// Disney's model, as far as it is base, metal and glass.
fn principled(object: &Object, with: &mut With, is_thin: bool) -> Result<Look> {
    let label = object.label();
    let paint = with.paint(object, "base_color", Rgb::splat(0.5))?;
    let mut share = |name: &str, unsaid: f32| {
        Ok::<_, crate::base::error::Error>(with.even(object, name, Rgb::splat(unsaid))?.x)
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
        // From the reflectance at normal incidence, 0.08 of it.
        (None, specular) => {
            let root = (0.08 * specular.unwrap_or(0.5).clamp(0.0, 1.0) as f32).sqrt();
            (1.0 + root) / (1.0 - root)
        }
    };
    if !left_out.is_empty() {
        with.remarks.skipped(format!("left out {} of", list(left_out)), &label);
    }
    with.remarks.skipped("took the glossy or dielectric surface nearest to principled:", &label);
    let alpha = roughness * roughness;
    if crossing > 0.5 {
        let tint = paint.mean();
        if is_thin {
            let sheet = ThinDielectric { eta, transmittance: tint };
            return Ok(Look::plain(Bsdf::ThinDielectric(sheet)));
        }
        // Light crosses twice what is seen through.
        let facets = Facets { model: FacetModel::Ggx, alpha };
        return Ok(Look::plain(interface(eta, facets, tint.map(f32::sqrt))));
    }
    let bsdf = Bsdf::Glossy(Glossy::new(paint.color, metallic, eta, alpha));
    Ok(Look::painted(bsdf, paint))
}

/// A look that is there for a share of the rays.
fn masked(look: Look, opacity: &Paint, object: &Object, with: &mut With) -> Look {
    let Some(texture) = &opacity.texture else {
        return Look { opacity: Some((opacity.color.x, None)), ..look };
    };
    with.one_map(&look, opacity.to_uv, object);
    // As its brightness, which is stored as it is.
    let shares: Vec<Rgb> = {
        let color = |[r, g, b, _]: &[u8; 4]| {
            crate::import::srgb::decode([*r, *g, *b].map(|code| f64::from(code) / 255.0))
        };
        texture.texels().iter().map(color).collect()
    };
    let texels = shares.iter().map(|color| {
        let share = crate::base::math::luminance(*color * opacity.color);
        let code = (255.0 * share).round().clamp(0.0, 255.0) as u8;
        [code, code, code, 255]
    });
    let [width, height] = texture.size();
    let shares = Texture::new(width, height, texels.collect()).sampled(texture.sampling());
    let to_uv = if look.albedo.is_some() { look.to_uv } else { opacity.to_uv };
    Look { opacity: Some((1.0, Some(Arc::new(shares)))), to_uv, ..look }
}
