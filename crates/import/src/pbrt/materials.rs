//! Materials.

use super::params::Params;
use super::spectra::{self, ColorSpace};
use super::textures::Textures;
use crate::mitsuba::color::ColorUse;
use crate::paint::Paint;
use crate::scene_file::material::interface;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::bsdf::{
    Bsdf, Coated, Conductor, FacetModel, Facets, Glossy, Plastic, Reflectance, SMOOTH_ALPHA,
    ThinDielectric,
};
use bdpm_core::scene::{Dispersion, RefractiveIndex, Texture};
use glam::Affine2;
use std::collections::HashMap;
use std::rc::Rc;
use std::sync::Arc;

/// Maximum depth of nested `mix` materials.
const MAX_DEPTH: usize = 32;

/// A material of the graphics state.
#[derive(Clone)]
pub(super) enum MaterialRef {
    /// The material of scenes that name none: diffuse gray.
    Default,
    Own(Rc<MaterialSource>),
    /// By name, with the place of its use.
    Named(String),
}

/// A material as the file defines it.
pub(super) struct MaterialSource {
    /// Name, or the type of a material without name.
    pub name: String,
    pub params: Params,
    pub color_space: ColorSpace,
}

/// The material properties of a surface.
#[derive(Clone)]
pub(super) struct Look {
    pub name: String,
    pub bsdf: Bsdf,
    pub dispersion: Option<Arc<Dispersion>>,
    /// Texture that multiplies the albedo.
    pub albedo: Option<Arc<Texture>>,
    /// Map of texture coordinates.
    pub to_uv: Affine2,
    pub normal_map: Option<Arc<Texture>>,
    /// Whether rays pass it as if it were not there.
    pub is_interface: bool,
}

impl Look {
    fn plain(bsdf: Bsdf) -> Self {
        let (albedo, to_uv, normal_map) = (None, Affine2::IDENTITY, None);
        Self {
            name: String::new(),
            bsdf,
            dispersion: None,
            albedo,
            to_uv,
            normal_map,
            is_interface: false,
        }
    }

    /// The look of a boundary of media that does not refract.
    pub fn index_matched(self) -> Self {
        Self { bsdf: Bsdf::ThinDielectric(ThinDielectric::new(1.0)), ..self }
    }

    fn painted(bsdf: Bsdf, paint: Paint) -> Self {
        Self { albedo: paint.texture, to_uv: paint.to_uv, ..Self::plain(bsdf) }
    }
}

/// The materials of a scene.
#[derive(Default)]
pub(super) struct Materials {
    named: HashMap<String, Rc<MaterialSource>>,
    /// By the address of the source, which `named`, the graphics state or `kept` keeps alive.
    looks: HashMap<*const MaterialSource, Look>,
    kept: Vec<Rc<MaterialSource>>,
}

impl Materials {
    pub fn define(&mut self, source: MaterialSource) {
        self.named.insert(source.name.clone(), Rc::new(source));
    }

    pub fn is_known(&self, name: &str) -> bool {
        self.named.contains_key(name)
    }

    /// The look of a material, and a number that identifies it.
    pub fn look(
        &mut self,
        material: &MaterialRef,
        user: &Params,
        textures: &mut Textures,
    ) -> Result<(Look, usize)> {
        let source = match material {
            MaterialRef::Default => {
                let look = Look::plain(Bsdf::diffuse(Rgb::splat(0.5)));
                return Ok((Look { name: "default".into(), ..look }, 0));
            }
            MaterialRef::Own(source) => source.clone(),
            MaterialRef::Named(name) => self.find(name, user)?,
        };
        let look = self.of_source(&source, textures, 0)?;
        Ok((look, Rc::as_ptr(&source) as usize))
    }

    fn find(&self, name: &str, user: &Params) -> Result<Rc<MaterialSource>> {
        self.named.get(name).cloned().ok_or_else(|| {
            let advice = "define it by MakeNamedMaterial before its first use";
            user.location.error(format!("there is no material `{name}`"), advice)
        })
    }

    fn of_source(
        &mut self,
        source: &Rc<MaterialSource>,
        textures: &mut Textures,
        depth: usize,
    ) -> Result<Look> {
        if let Some(known) = self.looks.get(&Rc::as_ptr(source)) {
            return Ok(known.clone());
        }
        let params = &source.params;
        if depth > MAX_DEPTH {
            let problem = "the material refers to itself, or is nested too deep";
            return Err(params.error(problem, "nest materials less"));
        }
        let look = if params.kind == "mix" {
            self.mix(source, textures, depth)?
        } else {
            make(source, textures)?
        };
        let mut look = Look { name: source.name.clone(), ..look };
        if let Some(name) = params.text("normalmap")? {
            look.normal_map = Some(textures.data(params, name)?);
        }
        if params.get("displacement").is_some() {
            textures.warnings.skipped("left out the displacement of", &source.name);
        }
        let unused: Vec<&str> = params.unused().filter(|name| !IRRELEVANT.contains(name)).collect();
        if !unused.is_empty() {
            let phrase = format!("ignored {} of", crate::text::list(unused));
            textures.warnings.skipped(phrase, &source.name);
        }
        self.looks.insert(Rc::as_ptr(source), look.clone());
        self.kept.push(source.clone());
        Ok(look)
    }

    /// The mean of two diffuse materials, else the material with more weight.
    fn mix(
        &mut self,
        source: &MaterialSource,
        textures: &mut Textures,
        depth: usize,
    ) -> Result<Look> {
        let params = &source.params;
        let names = params.get("materials").map_or(&[][..], |param| &param.values.texts[..]);
        let [first, second] = names else {
            return Err(params.error("`materials` does not name two materials", "name two"));
        };
        let found = [first, second].map(|name| self.find(name, params));
        let [first, second] = found;
        let (first, second) = (first?, second?);
        let a = self.of_source(&first, textures, depth + 1)?;
        let b = self.of_source(&second, textures, depth + 1)?;
        let amount = textures.varying(params, "amount")?;
        let amount = amount.unwrap_or_else(|| Paint::plain(Rgb::splat(0.5)));
        let share = amount.mean().x.clamp(0.0, 1.0);
        if let (Bsdf::Lambertian { albedo, .. }, Bsdf::Lambertian { albedo: other, .. }) =
            (a.bsdf, b.bsdf)
            && !(a.is_interface || b.is_interface)
        {
            let paint = |look: &Look, color: Rgb| Paint {
                color,
                texture: look.albedo.clone(),
                to_uv: look.to_uv,
            };
            let (paint, is_averaged) =
                Paint::combined(&[&paint(&a, albedo), &paint(&b, other), &amount], |colors| {
                    colors[0] + (colors[1] - colors[0]) * colors[2].clamp(Rgb::ZERO, Rgb::ONE)
                });
            if is_averaged {
                textures.warnings.skipped("used the means of pictures within", &source.name);
            }
            return Ok(Look::painted(Bsdf::diffuse(paint.color), paint));
        }
        if share > 0.0 && share < 1.0 {
            textures.warnings.skipped("used only the material with more weight of", &source.name);
        }
        Ok(if share > 0.5 { b } else { a })
    }
}

/// Parameters without an effect on the image here.
const IRRELEVANT: &[&str] = &["type", "maxdepth", "nsamples", "thickness", "g", "albedo"];

fn make(source: &MaterialSource, textures: &mut Textures) -> Result<Look> {
    let MaterialSource { name, params, color_space } = source;
    let owner = (&name[..], *color_space);
    let folder = textures.folder.clone();
    Ok(match &params.kind[..] {
        "diffuse" => {
            let paint = textures.share(params, "reflectance", 0.5, owner)?;
            Look::painted(Bsdf::diffuse(paint.color), paint)
        }
        "coateddiffuse" => {
            let paint = textures.share(params, "reflectance", 0.5, owner)?;
            warn_of_absorption(params, textures, name)?;
            let eta = spectra::index(params, "eta", 1.5, &folder)?;
            coated(paint, eta, alpha(params, textures, "", name)?)
        }
        "conductor" => conductor(params, textures, "", owner)?,
        "coatedconductor" => {
            textures.warnings.skipped("left out the coat of the metal", name);
            for part in ["interface.roughness", "interface.uroughness", "interface.vroughness"] {
                let _ = params.get(part);
            }
            let _ = params.get("interface.eta");
            conductor(params, textures, "conductor.", owner)?
        }
        "dielectric" => {
            let medium = spectra::medium(params, "eta", 1.5, &folder)?;
            let alpha = alpha(params, textures, "", name)?;
            let facets = Facets { model: FacetModel::Correlated, alpha };
            let bsdf = interface(medium.at_d() as f32, facets, Rgb::ONE);
            let dispersion = Dispersion::new(medium, RefractiveIndex::Constant(1.0));
            Look { dispersion: dispersion.map(Arc::new), ..Look::plain(bsdf) }
        }
        "thindielectric" => {
            let eta = spectra::index(params, "eta", 1.5, &folder)?;
            Look::plain(Bsdf::ThinDielectric(ThinDielectric::new(eta)))
        }
        "diffusetransmission" => {
            let reflected = textures.share(params, "reflectance", 0.25, owner)?;
            let transmitted = textures.share(params, "transmittance", 0.25, owner)?;
            let scale = params.float_in("scale", 1.0, [0.0, 1e6])? as f32;
            let phrase = "reflected instead of transmitted the light through";
            textures.warnings.skipped(phrase, name);
            let sum = |colors: &[Rgb]| (scale * (colors[0] + colors[1])).min(Rgb::ONE);
            let (paint, _) = Paint::combined(&[&reflected, &transmitted], sum);
            Look::painted(Bsdf::diffuse(paint.color), paint)
        }
        "interface" | "none" | "" => Look { is_interface: true, ..Look::plain(BLACK) },
        "subsurface" => {
            textures.warnings.skipped("used a coated surface for subsurface scattering in", name);
            let paint = textures.share(params, "reflectance", 0.5, owner)?;
            let eta = spectra::index(params, "eta", 1.33, &folder)?;
            for part in ["mfp", "sigma_a", "sigma_s", "scale", "name"] {
                let _ = params.get(part);
            }
            coated(paint, eta, alpha(params, textures, "", name)?)
        }
        "measured" => {
            textures.warnings.skipped("used a glossy gray surface for the measured material", name);
            let _ = params.get("filename");
            Look::plain(Bsdf::Glossy(Glossy::new(Rgb::splat(0.5), 0.0, 1.5, 0.3)))
        }
        "hair" => {
            textures.warnings.skipped("used a diffuse surface for hair of", name);
            for part in ["eumelanin", "pheomelanin", "sigma_a", "beta_m", "beta_n", "alpha", "eta"]
            {
                let _ = params.get(part);
            }
            let paint = textures.share(params, "reflectance", 0.3, owner)?;
            Look::painted(Bsdf::diffuse(paint.color), paint)
        }
        other => {
            let problem = format!("materials of type `{other}` are unknown");
            let advice = "use a material of pbrt-v4, such as diffuse; convert scenes of pbrt-v3 by its --upgrade";
            return Err(params.location.error(problem, advice));
        }
    })
}

const BLACK: Bsdf = Bsdf::diffuse(Rgb::ZERO);

fn warn_of_absorption(params: &Params, textures: &mut Textures, name: &str) -> Result<()> {
    let absorbs = params.get("albedo").is_some_and(|param| {
        param.kind == "texture" || param.values.numbers.iter().any(|number| *number != 0.0)
    });
    if absorbs {
        textures.warnings.skipped("left out the medium between coat and base of", name);
    }
    Ok(())
}

/// GGX width by the parameters whose names begin with `prefix`.
fn alpha(params: &Params, textures: &mut Textures, prefix: &str, owner: &str) -> Result<f32> {
    let name = |name: &str| format!("{prefix}{name}");
    let both = textures.number(params, &name("roughness"), owner)?.unwrap_or(0.0);
    let u = textures.number(params, &name("uroughness"), owner)?.unwrap_or(both);
    let v = textures.number(params, &name("vroughness"), owner)?.unwrap_or(both);
    let width = |roughness: f32| {
        let is_remapped = params.boolean("remaproughness", true)?;
        let width = if is_remapped { roughness.max(0.0).sqrt() } else { roughness };
        Ok::<_, Error>(width.clamp(0.0, 1.0))
    };
    let (u, v) = (width(u)?, width(v)?);
    if u != v {
        let phrase = "used one width of facets along u and v (the root of their product) for";
        textures.warnings.skipped(phrase, owner);
    }
    Ok(if u == v { u } else { (u * v).sqrt() })
}

/// A diffuse base under a dielectric coat. Light that the coat reflects back to the base is part of
/// both models.
fn coated(paint: Paint, eta: f32, alpha: f32) -> Look {
    let bsdf = if alpha < SMOOTH_ALPHA {
        Bsdf::Coated(Coated::new(paint.color, eta))
    } else {
        let facets = Facets { model: FacetModel::Correlated, alpha };
        Bsdf::Plastic(Plastic::new(paint.color, eta, facets, true))
    };
    Look::painted(bsdf, paint)
}

fn conductor(
    params: &Params,
    textures: &mut Textures,
    prefix: &str,
    (name, space): (&str, ColorSpace),
) -> Result<Look> {
    let folder = textures.folder.clone();
    let alpha = alpha(params, textures, prefix, name)?;
    let reflectance = if params.get("reflectance").is_some() {
        let paint = textures.share(params, "reflectance", 0.5, (name, space))?;
        if paint.texture.is_some() {
            textures.warnings.skipped("used the mean of the texture `reflectance` of", name);
        }
        // The imaginary part for the index 1 that has this reflectance at normal incidence.
        let share = paint.mean().clamp(Rgb::ZERO, Rgb::splat(0.9999));
        let k = 2.0 * share.map(f32::sqrt) / (Rgb::ONE - share).map(f32::sqrt);
        Reflectance::Measured { eta: Rgb::ONE, k }
    } else {
        let mut part = |part: &str, default: Rgb| match params.get(&format!("{prefix}{part}")) {
            Some(param) if param.kind == "texture" => {
                textures.warnings.skipped("used copper for textured indices of", name);
                Ok(default)
            }
            Some(param) => spectra::color(param, ColorUse::Index, space, &folder),
            None => Ok(default),
        };
        let [eta, k] = crate::mitsuba::metals::metal("Cu").expect("it is in the table");
        let (eta, k) = (part("eta", eta)?, part("k", k)?);
        Reflectance::Measured { eta: eta.max(Rgb::splat(1e-3)), k }
    };
    let facets = Facets { model: FacetModel::Ggx, alpha };
    Ok(Look::plain(Bsdf::Conductor(Conductor::once(reflectance, facets, Rgb::ONE))))
}
