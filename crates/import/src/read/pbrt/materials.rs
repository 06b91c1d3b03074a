//! Materials.

use super::params::Params;
use super::spectra::{self, ColorSpace};
use super::textures::Textures;
use crate::look::{Look, ONE_MAP, Paint, correlated};
use crate::spectrum::{ColorUse, named};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::RefractiveIndex;
use bdpm_core::scene::bsdf::{
    Bsdf, Coated, Conductor, FacetModel, Facets, Glossy, Plastic, Reflectance, SMOOTH_ALPHA,
};
use glam::Affine2;
use std::collections::HashMap;
use std::rc::Rc;

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

    /// The look of a material with its name, and a number that identifies it.
    pub fn look(
        &mut self,
        material: &MaterialRef,
        user: &Params,
        textures: &mut Textures,
    ) -> Result<(Look, usize)> {
        let source = match material {
            MaterialRef::Default => {
                let mut look = Look::gray();
                look.material.name = "default".to_owned();
                return Ok((look, 0));
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
        let mut look = if params.kind == "mix" {
            self.mix(source, textures, depth)?
        } else {
            MaterialReader { source, textures }.look()?
        };
        look.material.name.clone_from(&source.name);
        if let Some(name) = params.text("normalmap")? {
            let texture = textures.data(params, name)?;
            let shares_map = look.bend(texture, Affine2::IDENTITY);
            textures.warnings.skipped_if([(!shares_map, ONE_MAP)], &source.name);
        }
        if params.get("displacement").is_some() {
            textures.warnings.skipped("left out the displacement of", &source.name);
        }
        let is_relevant = |name: &&str| !IRRELEVANT.contains(name);
        textures.warn_of_unused(params, is_relevant, &source.name);
        self.looks.insert(Rc::as_ptr(source), look.clone());
        self.kept.push(source.clone());
        Ok(look)
    }

    /// The mean of two materials that only scatter diffusely, else the material with more weight.
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
        let [a, b] = [first, second].map(|name| {
            let source = self.find(name, params)?;
            self.of_source(&source, textures, depth + 1)
        });
        let (a, b) = (a?, b?);
        let amount = textures.varying(params, "amount")?;
        let amount = amount.unwrap_or_else(|| Paint::plain(Rgb::splat(0.5)));
        let share = amount.mean().x.clamp(0.0, 1.0);
        if let Some((look, is_averaged)) = Look::mixed(&a, &b, &amount) {
            let phrase = "used the means of pictures within";
            textures.warnings.skipped_if([(is_averaged, phrase)], &source.name);
            return Ok(look);
        }
        if share > 0.0 && share < 1.0 {
            textures.warnings.skipped("used only the material with more weight of", &source.name);
        }
        Ok(if share > 0.5 { b } else { a })
    }
}

/// Parameters without an effect on the image here.
const IRRELEVANT: &[&str] = &["type", "maxdepth", "nsamples", "thickness", "g", "albedo"];

/// Reads one material that is no mixture.
struct MaterialReader<'a> {
    source: &'a MaterialSource,
    textures: &'a mut Textures,
}

impl MaterialReader<'_> {
    fn look(&mut self) -> Result<Look> {
        Ok(match &self.source.params.kind[..] {
            "diffuse" => Look::painted(self.share("reflectance", 0.5)?, Bsdf::diffuse),
            "coateddiffuse" => {
                let absorbs = self.source.params.get("albedo").is_some_and(|param| {
                    let is_positive = param.values.numbers.iter().any(|number| *number != 0.0);
                    param.kind == "texture" || is_positive
                });
                self.skipped_if(absorbs, "left out the medium between coat and base of");
                self.coated(1.5)?
            }
            "conductor" => self.conductor("")?,
            "coatedconductor" => {
                self.skipped_if(true, "left out the coat of the metal");
                self.ignore(
                    "interface.roughness interface.uroughness interface.vroughness interface.eta",
                );
                self.conductor("conductor.")?
            }
            "dielectric" => {
                let params = &self.source.params;
                let medium = spectra::medium(params, "eta", 1.5, &self.textures.folder)?;
                let indices = [medium, RefractiveIndex::Constant(1.0)];
                Look::dielectric(indices, correlated(self.alpha("")?), Rgb::ONE)
            }
            "thindielectric" => Look::sheet(self.eta(1.5)?, Rgb::ONE),
            "diffusetransmission" => self.diffuse_transmission()?,
            "interface" | "none" | "" => {
                Look { is_interface: true, ..Look::new(Bsdf::diffuse(Rgb::ZERO)) }
            }
            "subsurface" => {
                self.skipped_if(true, "used a coated surface for subsurface scattering in");
                self.ignore("mfp sigma_a sigma_s scale name");
                self.coated(1.33)?
            }
            "measured" => {
                self.skipped_if(true, "used a glossy gray surface for the measured material");
                self.ignore("filename");
                Look::new(Bsdf::Glossy(Glossy::new(Rgb::splat(0.5), 0.0, 1.5, 0.3)))
            }
            "hair" => {
                self.skipped_if(true, "used a diffuse surface for hair of");
                self.ignore("eumelanin pheomelanin sigma_a beta_m beta_n alpha eta");
                Look::painted(self.share("reflectance", 0.3)?, Bsdf::diffuse)
            }
            other => {
                let problem = format!("materials of type `{other}` are unknown");
                let advice = "use a material of pbrt-v4, such as diffuse; convert scenes of \
                              pbrt-v3 by its --upgrade";
                return Err(self.source.params.location.error(problem, advice));
            }
        })
    }

    fn skipped_if(&mut self, condition: bool, phrase: &str) {
        self.textures.warnings.skipped_if([(condition, phrase)], &self.source.name);
    }

    /// Marks parameters as used whose effect a warning says to be missing.
    fn ignore(&self, names: &str) {
        for name in names.split(' ') {
            let _ = self.source.params.get(name);
        }
    }

    fn share(&mut self, name: &str, default: f32) -> Result<Paint> {
        let MaterialSource { name: owner, params, color_space } = self.source;
        self.textures.share(params, name, default, (owner, *color_space))
    }

    fn eta(&self, default: f64) -> Result<f32> {
        spectra::index(&self.source.params, "eta", default, &self.textures.folder)
    }

    /// Width of facets by the parameters whose names begin with `prefix`.
    fn alpha(&mut self, prefix: &str) -> Result<f32> {
        let MaterialSource { name: owner, params, .. } = self.source;
        let mut number =
            |name: &str| self.textures.number(params, &format!("{prefix}{name}"), owner);
        let both = number("roughness")?.unwrap_or(0.0);
        let (u, v) = (number("uroughness")?.unwrap_or(both), number("vroughness")?.unwrap_or(both));
        let width = |roughness: f32| {
            let is_remapped = params.boolean("remaproughness", true)?;
            let width = if is_remapped { roughness.max(0.0).sqrt() } else { roughness };
            Ok::<_, Error>(width.clamp(0.0, 1.0))
        };
        let (u, v) = (width(u)?, width(v)?);
        let phrase = "used one width of facets along u and v (the root of their product) for";
        self.skipped_if(u != v, phrase);
        Ok(if u == v { u } else { (u * v).sqrt() })
    }

    /// A diffuse base under a dielectric coat. Light that the coat reflects back to the base is
    /// part of both models.
    fn coated(&mut self, default_eta: f64) -> Result<Look> {
        let paint = self.share("reflectance", 0.5)?;
        let (eta, alpha) = (self.eta(default_eta)?, self.alpha("")?);
        Ok(Look::painted(paint, |albedo| {
            if alpha < SMOOTH_ALPHA {
                Bsdf::Coated(Coated::new(albedo, eta))
            } else {
                Bsdf::Plastic(Plastic::new(albedo, eta, correlated(alpha), true))
            }
        }))
    }

    fn diffuse_transmission(&mut self) -> Result<Look> {
        let reflected = self.share("reflectance", 0.25)?;
        let transmitted = self.share("transmittance", 0.25)?;
        let scale = self.source.params.float_in("scale", 1.0, [0.0, 1e6])? as f32;
        let scaled = |paint: Paint| match scale {
            1.0 => paint,
            _ => paint.mapped(|color| (scale * color).min(Rgb::ONE)),
        };
        let (reflected, transmitted) = (scaled(reflected), scaled(transmitted));
        // The factor of the picture is its largest value.
        let (sum, _) = Paint::combined(&[&reflected, &transmitted], |both| both[0] + both[1]);
        let gains = sum.color.max_element() > 1.0 + 1e-3;
        let (look, shares_map) = Look::translucent(reflected, transmitted);
        self.skipped_if(gains, "scaled reflectance and transmittance to a sum of 1 in");
        self.skipped_if(!shares_map, ONE_MAP);
        Ok(look)
    }

    /// A metal by the parameters whose names begin with `prefix`.
    fn conductor(&mut self, prefix: &str) -> Result<Look> {
        let alpha = self.alpha(prefix)?;
        let reflectance = if self.source.params.get("reflectance").is_some() {
            let paint = self.share("reflectance", 0.5)?;
            let is_textured = paint.texture.is_some();
            self.skipped_if(is_textured, "used the mean of the texture `reflectance` of");
            // The imaginary part for the index 1 that has this reflectance at normal incidence.
            let share = paint.mean().clamp(Rgb::ZERO, Rgb::splat(0.9999));
            let k = 2.0 * share.map(f32::sqrt) / (Rgb::ONE - share).map(f32::sqrt);
            Reflectance::Measured { eta: Rgb::ONE, k }
        } else {
            let [eta, k] = named::metal("Cu").expect("it is in the table");
            let eta = self.metal_index(&format!("{prefix}eta"), eta)?.max(Rgb::splat(1e-3));
            Reflectance::Measured { eta, k: self.metal_index(&format!("{prefix}k"), k)? }
        };
        let facets = Facets { model: FacetModel::Ggx, alpha };
        Ok(Look::new(Bsdf::Conductor(Conductor::once(reflectance, facets, Rgb::ONE))))
    }

    fn metal_index(&mut self, name: &str, default: Rgb) -> Result<Rgb> {
        let MaterialSource { params, color_space, .. } = self.source;
        match params.get(name) {
            Some(param) if param.kind == "texture" => {
                self.skipped_if(true, "used copper for textured indices of");
                Ok(default)
            }
            Some(param) => {
                spectra::color(param, ColorUse::Unbounded, *color_space, &self.textures.folder)
            }
            None => Ok(default),
        }
    }
}
