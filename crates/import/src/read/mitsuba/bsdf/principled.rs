//! Disney's principled BSDF.

use super::super::object::Object;
use super::super::texture::Paints;
use super::AVERAGED;
use super::models::index;
use crate::look::{Look, ONE_MAP, Paint};
use crate::spectrum::ColorUse;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::scene::Texture;
use bdpm_core::scene::bsdf::{Bsdf, Principled, PrincipledParameters};
use glam::Affine2;
use std::sync::Arc;

/// The BSDF of solids.
pub(super) fn solid(object: &Object, paints: &mut Paints) -> Result<Look> {
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
    let eta = refractive_index(object, paints, parameters.spec_trans > 0.0)?;
    let parameters = PrincipledParameters { eta, ..parameters };
    for lobe in ["main_specular", "clearcoat", "diffuse_reflectance"] {
        let _ = object.float(&format!("{lobe}_sampling_rate"))?;
    }
    let bsdf = |base_color| {
        Bsdf::Principled(Principled::new(PrincipledParameters { base_color, ..parameters }))
    };
    let mut look = Look::painted(paint, bsdf);
    if data.texture.is_some() && !look.shares_map(data.to_uv) {
        paints.skipped(ONE_MAP, object);
    }
    look.material.metallic_roughness_texture = data.texture;
    Ok(look)
}

/// Refractive index of a principled surface, by itself or by `specular`, which is the reflectance
/// at normal incidence over .08. Glass has an index other than 1.
fn refractive_index(object: &Object, paints: &mut Paints, is_glass: bool) -> Result<f32> {
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
            paints.skipped(AVERAGED, object);
        }
        // Numbers are stored linearly.
        let texture = both.stored(|shares| shares);
        let factors = if texture.is_some() { Rgb::ONE } else { both.color };
        let [_, roughness, metallic] = factors.to_array().map(|share| share.clamp(0.0, 1.0));
        Ok(Self { roughness, metallic, texture, to_uv: both.to_uv })
    }
}

/// The principled BSDF of thin sheets: clear glass, a Lambertian sheet that transmits diffusely, or
/// a base alone.
pub(super) fn thin(object: &Object, paints: &mut Paints) -> Result<Look> {
    let paint = paints.share(object, "base_color", Rgb::splat(0.5))?;
    let mut number = |name: &str, default: f32, [low, high]: [f32; 2]| {
        let read = paints.mean(object, name, ColorUse::Unbounded, Rgb::splat(default))?;
        Ok::<_, Error>(read.x.clamp(low, high))
    };
    let crossing = number("spec_trans", 0.0, [0.0, 1.0])?;
    let reflected = 1.0 - 0.5 * number("diff_trans", 0.0, [0.0, 2.0])?;
    let eta = number("eta", 1.5, [0.1, 10.0])?;
    let share = (1.0 - crossing) * reflected;
    let parameters = PrincipledParameters {
        eta: 1.0,
        roughness: number("roughness", 0.5, [0.0, 1.0])?,
        sheen: share * number("sheen", 0.0, [0.0, 1.0])?,
        sheen_tint: number("sheen_tint", 0.0, [0.0, 1.0])?,
        flatness: number("flatness", 0.0, [0.0, 1.0])?,
        ..PrincipledParameters::default()
    };
    if crossing > 0.5 {
        paints.skipped("used a clear sheet for", object);
        return Ok(Look::sheet(eta, paint.mean()));
    }
    if crossing > 0.0 {
        paints.skipped("left out the clear transmission of", object);
    }
    let transmitted = (1.0 - crossing) * (1.0 - reflected);
    if transmitted > 0.0 {
        paints.skipped("left out sheen and retroreflection of the sheet", object);
        let part = |share: f32| Paint { color: paint.color * share, ..paint.clone() };
        return Ok(Look::translucent(part(share), part(transmitted)).0);
    }
    let bsdf = |color| {
        let base_color = color * share;
        Bsdf::Principled(Principled::new(PrincipledParameters { base_color, ..parameters }))
    };
    Ok(Look::painted(paint, bsdf))
}
