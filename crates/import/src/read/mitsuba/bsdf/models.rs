//! BSDFs of one surface.

use super::super::color;
use super::super::object::Object;
use super::super::texture::Paints;
use super::lambertian;
use crate::look::Look;
use crate::spectrum::{ColorUse, named};
use crate::text::list;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::RefractiveIndex;
use bdpm_core::scene::bsdf::{
    Bsdf, Conductor, FacetModel, Facets, Plastic, Reflectance, SMOOTH_ALPHA,
};

/// A Lambertian surface.
pub(super) fn diffuse(object: &Object, paints: &mut Paints) -> Result<Look> {
    // The old name of the property is valid as well.
    let has_old_name = object.get("diffuse_reflectance")?.is_some();
    let name = if has_old_name { "diffuse_reflectance" } else { "reflectance" };
    Ok(Look::painted(paints.share(object, name, Rgb::splat(0.5))?, lambertian))
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

/// A metal.
pub(super) fn conductor(object: &Object, paints: &mut Paints) -> Result<Look> {
    let tint = paints.mean_share(object, "specular_reflectance", Rgb::ONE)?;
    let default = if object.document.is_old { "Cu" } else { "none" };
    let name = object.string("material")?.unwrap_or(default);
    let mut part = |name: &str, default: f32| match object.get(name)? {
        Some(child) => paints.spectrum(&child, ColorUse::Unbounded, object),
        None => Ok(Rgb::splat(default)),
    };
    let indices = if object.get("eta")?.is_some() || object.get("k")?.is_some() {
        Some([part("eta", 0.0)?, part("k", 1.0)?])
    } else if name == "none" {
        None
    } else {
        Some(named::metal(name).ok_or_else(|| {
            let advice = format!("use one of {}, or give eta and k", list(named::metal_names()));
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
    Ok(Look { is_black_behind: true, ..Look::new(bsdf) })
}

/// A refractive index by number or name.
pub(super) fn index(object: &Object, paints: &mut Paints, name: &str, default: f32) -> Result<f32> {
    let Some(text) = object.string(name)? else { return Ok(default) };
    let known = text.trim().parse().ok().or_else(|| named::dielectric(text.trim()));
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

/// An interface, smooth or rough.
pub(super) fn dielectric(object: &Object, paints: &mut Paints) -> Result<Look> {
    let inside = medium(object, paints, "int_ior", 1.5046)?;
    let outside = medium(object, paints, "ext_ior", 1.000_277)?;
    let transmittance = transmittance(object, paints)?;
    Ok(Look::dielectric([inside, outside], facets(object, paints)?, transmittance))
}

/// A clear sheet.
pub(super) fn sheet(object: &Object, paints: &mut Paints) -> Result<Look> {
    let eta = relative_index(object, paints, 1.5046)?;
    Ok(Look::sheet(eta, transmittance(object, paints)?))
}

/// A diffuse base under a coat.
pub(super) fn plastic(object: &Object, paints: &mut Paints) -> Result<Look> {
    let eta = relative_index(object, paints, 1.49)?;
    let paint = paints.share(object, "diffuse_reflectance", Rgb::splat(0.5))?;
    let tint = paints.mean_share(object, "specular_reflectance", Rgb::ONE)?;
    let is_nonlinear = object.boolean("nonlinear")?.unwrap_or(false);
    let facets = facets(object, paints)?;
    let bsdf = |albedo| Bsdf::Plastic(Plastic::new(albedo, eta, facets, is_nonlinear).tinted(tint));
    Ok(Look { is_black_behind: true, ..Look::painted(paint, bsdf) })
}
