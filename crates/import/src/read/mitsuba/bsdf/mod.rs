//! BSDFs as looks: those that change or combine others.

mod models;
mod principled;

use super::document::MAX_DEPTH;
use super::object::Object;
use super::texture::Paints;
use crate::look::{Look, ONE_MAP, Paint};
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::Texture;
use bdpm_core::scene::bsdf::{Bsdf, Principled, PrincipledParameters};
use glam::Affine2;
use std::collections::HashMap;
use std::sync::Arc;

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
            "diffuse" => models::diffuse(object, paints),
            "roughdiffuse" => {
                paints.skipped("used Lambertian surfaces for rough diffuse ones:", object);
                models::diffuse(object, paints)
            }
            "conductor" | "roughconductor" => models::conductor(object, paints),
            "dielectric" | "roughdielectric" => models::dielectric(object, paints),
            "thindielectric" => models::sheet(object, paints),
            "difftrans" => {
                let transmitted = paints.share(object, "transmittance", Rgb::splat(0.5))?;
                Ok(Look::translucent(Paint::plain(Rgb::ZERO), transmitted).0)
            }
            "plastic" | "roughplastic" => models::plastic(object, paints),
            "principled" => principled::solid(object, paints),
            "principledthin" => principled::thin(object, paints),
            "phong" | "ward" => {
                paints.skipped("used only the diffuse part of", object);
                let paint = paints.share(object, "diffuse_reflectance", Rgb::splat(0.5))?;
                Ok(Look::painted(paint, lambertian))
            }
            "null" => {
                let mut look = Look { is_interface: true, ..without_bsdf(false) };
                look.material.opacity = Some(0.0);
                Ok(look)
            }
            "blendbsdf" => self.blend(object, paints, depth),
            "twosided" | "mask" | "normalmap" | "bumpmap" | "bump" | "mixturebsdf" | "coating"
            | "roughcoating" => {
                let mut nested = self.nested(object, paints, depth)?.into_iter();
                let first = nested.next();
                let look = first.ok_or_else(|| object.error("it has no BSDF within", "add one"))?;
                changed(object, look, nested.len() > 0, paints)
            }
            other => {
                let phrase = format!("used diffuse gray for BSDFs of type `{other}`:");
                paints.skipped(phrase, object);
                Ok(without_bsdf(false))
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
        let transmits = [&a, &b].iter().any(|look| look.material.bsdf.transmits_diffusely());
        // Mitsuba's `twosided` takes no BSDF that transmits.
        let [a, b] = [a, b].map(|look| if transmits { reflecting_both_ways(look) } else { look });
        if let Some((look, is_averaged)) = Look::mixed(&a, &b, &weight) {
            let is_black_behind = a.is_black_behind || b.is_black_behind;
            let look = Look { is_black_behind, ..look };
            if is_averaged {
                paints.skipped(AVERAGED, object);
            }
            return Ok(look);
        }
        if share > 0.0 && share < 1.0 {
            paints.skipped("used only the BSDF with more weight of", object);
        }
        Ok(if share > 0.5 { b } else { a })
    }
}

/// Phrase of the warning about pictures that are combined, but lie differently on a surface.
const AVERAGED: &str =
    "used the mean of a texture, whose coordinates differ from those of another, of";

/// The look of a surface without any BSDF: lamps are black.
pub(super) fn without_bsdf(is_lamp: bool) -> Look {
    Look::new(lambertian(Rgb::splat(if is_lamp { 0.0 } else { 0.5 })))
}

/// A Lambertian surface that scatters on one side only.
fn lambertian(albedo: Rgb) -> Bsdf {
    Bsdf::Lambertian { albedo, two_sided: false }
}

/// The look of a BSDF that changes the one in it, its first one if it has several.
fn changed(object: &Object, mut look: Look, has_more: bool, paints: &mut Paints) -> Result<Look> {
    let shares_map = match object.kind() {
        "twosided" => {
            if has_more {
                paints.skipped("used the front's BSDF for both sides of", object);
            }
            look.material.bsdf = two_sided(look.material.bsdf);
            return Ok(Look { is_black_behind: false, ..look });
        }
        "mask" => look.mask(&paints.share(object, "opacity", Rgb::splat(0.5))?),
        "normalmap" => {
            let Some((texture, to_uv)) = bend(object, "normalmap", paints)? else {
                return Ok(look);
            };
            look.bend(Arc::new(upright(&texture)), to_uv)
        }
        "bumpmap" | "bump" => {
            let scale = object.float("scale")?.unwrap_or(1.0) as f32;
            let Some((texture, to_uv)) = bend(object, "", paints)? else { return Ok(look) };
            look.bump(texture, scale, to_uv)
        }
        _ => {
            paints.skipped("used only the first BSDF of", object);
            return Ok(look);
        }
    };
    if !shares_map {
        paints.skipped(ONE_MAP, object);
    }
    Ok(look)
}

/// A Lambertian surface that scatters on one side only as one that scatters on both.
fn reflecting_both_ways(mut look: Look) -> Look {
    if let Bsdf::Lambertian { two_sided: false, .. } = look.material.bsdf {
        look.material.bsdf = two_sided(look.material.bsdf);
        look.is_black_behind = true;
    }
    look
}

fn two_sided(bsdf: Bsdf) -> Bsdf {
    match bsdf {
        Bsdf::Lambertian { albedo, .. } => Bsdf::Lambertian { albedo, two_sided: true },
        Bsdf::Principled(principled) => {
            let parameters = PrincipledParameters { two_sided: true, ..*principled.parameters() };
            Bsdf::Principled(Principled::new(parameters))
        }
        other => other,
    }
}

/// The picture of this name, or the first one, which bends normals.
fn bend(
    object: &Object,
    name: &str,
    paints: &mut Paints,
) -> Result<Option<(Arc<Texture>, Affine2)>> {
    let found = match object.get(name)? {
        Some(named) => Some(named),
        None => object.all("texture")?.into_iter().next(),
    };
    let child = found.ok_or_else(|| object.error("it has no texture", "add one"))?;
    let picture = paints.data(&child)?;
    // Mitsuba has this property since 3.7.1.
    if picture.is_some() && object.boolean("use_shadowing_function")?.unwrap_or(true) {
        let phrase = "left out the shadowing by bumps (`use_shadowing_function`) of";
        paints.skipped(phrase, object);
    }
    Ok(picture)
}

/// A normal map of Mitsuba, in which the code 127.5 stands for 0 and v points down, as one of ours.
fn upright(map: &Texture) -> Texture {
    let code = |x: f32| (128.0 + 127.0 * x).round().clamp(1.0, 255.0) as u8;
    let vector = |code: u8| f32::from(code) / 127.5 - 1.0;
    map.map_texels(|[r, g, b, _]| [code(vector(r)), code(-vector(g)), code(vector(b)), 255])
}
