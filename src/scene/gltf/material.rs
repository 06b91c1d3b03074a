//! What a glTF material becomes here; the table in `docs/scene-format.md` tells the same.

use super::factors::{Alpha, Factors};
use super::remarks::Remarks;
use super::texture::{Coverage, coverage};
use crate::bsdf::{Bsdf, Coated, Conductor, Reflectance, SMOOTH_ALPHA, ThinDielectric};
use crate::math::Rgb;
use crate::scene::Material;
use crate::scene::material_table::{DEFAULT_IOR, dielectric};
use crate::scene::mtl_material::COAT_ROUGHNESS;

/// The material, with remarks on what of it has no counterpart; `None` if it is nowhere to be seen.
pub(super) fn material(factors: &Factors, remarks: &mut Remarks) -> Option<Material> {
    let Factors { name, emission, base_texture, .. } = factors;
    let bsdf = bsdf(factors, remarks);
    let glass =
        matches!(bsdf, Bsdf::Dielectric(_) | Bsdf::RoughDielectric(_) | Bsdf::ThinDielectric(_));
    // Glass shows by itself what is behind it.
    let coverage = if glass { Coverage::Everywhere } else { covered(factors, remarks) };
    let opacity_texture = match coverage {
        Coverage::Everywhere => None,
        Coverage::Partly(picture) => Some(picture),
        Coverage::Nowhere => {
            remarks.chosen("left out what is of no opacity, of the material", name);
            return None;
        }
    };
    let emits = emission.max_element() > 0.0;
    let with_albedo = matches!(bsdf, Bsdf::Lambertian { .. } | Bsdf::Coated(_));
    for (left_out, what) in [
        (factors.normal_texture, "ignored the normal texture of"),
        (factors.unlit, "shaded what has no shading, the material"),
        (emits && factors.emissive_texture, "took the mean color of the emissive texture of"),
        (emits && factors.double_sided, "let only front sides emit light, of the material"),
        (emits && opacity_texture.is_some(), "filled the holes in the lamps of the material"),
        (base_texture.is_some() && !with_albedo && !glass, "took the mean base color of the metal"),
    ] {
        if left_out {
            remarks.skipped(what, name);
        }
    }
    let albedo_texture = base_texture.clone().filter(|_| with_albedo);
    let own = Material::new(name, bsdf);
    Some(Material { emission: *emission, albedo_texture, opacity_texture, ..own })
}

fn bsdf(factors: &Factors, remarks: &mut Remarks) -> Bsdf {
    let Factors { base_color, metalness, roughness, transmission, .. } = *factors;
    if factors.unlit {
        return Bsdf::diffuse(base_color);
    }
    let name = &factors.name;
    let alpha = roughness * roughness;
    let is_metal = metalness >= 0.5;
    let is_glass = !is_metal && transmission >= 0.5;
    let has_coat = factors.clearcoat >= 0.5 && factors.clearcoat_roughness < COAT_ROUGHNESS;
    let coat_is_lost = factors.clearcoat > 0.0 && (!has_coat || is_metal || is_glass);
    for (left_out, what) in [
        (factors.metallic_roughness_texture, "took the mean metalness and roughness of"),
        (metalness > 0.0 && metalness < 1.0, "rounded the metalness of"),
        (!is_metal && transmission > 0.0 && transmission < 1.0, "rounded the transmission of"),
        (coat_is_lost, "ignored the clear coat of"),
        (factors.clearcoat_texture && factors.clearcoat > 0.0, "ignored coat textures of"),
    ] {
        if left_out {
            remarks.skipped(what, name);
        }
    }
    if is_metal {
        let mean = factors.base_texture.as_ref().map_or(Rgb::ONE, |picture| picture.mean_color());
        let normal = base_color * mean;
        return Bsdf::Conductor(Conductor::new(Reflectance::Artist { normal }, alpha));
    }
    if is_glass {
        let tinted = factors.thick && factors.attenuation != Rgb::ONE;
        if tinted || base_color != Rgb::ONE || factors.base_texture.is_some() {
            remarks.skipped("ignored the color of the glass", name);
        }
        if factors.thick {
            return dielectric(factors.ior, alpha);
        }
        if alpha >= SMOOTH_ALPHA {
            remarks.skipped("ignored the roughness of the thin glass", name);
        }
        return Bsdf::ThinDielectric(ThinDielectric { eta: factors.ior });
    }
    match (has_coat, factors.ior) {
        (true, _) => Bsdf::Coated(Coated::new(base_color, DEFAULT_IOR)),
        (false, ior) if roughness < COAT_ROUGHNESS && ior > 1.0 => {
            Bsdf::Coated(Coated::new(base_color, ior))
        }
        _ => Bsdf::diffuse(base_color),
    }
}

/// Where the surface is.
fn covered(factors: &Factors, remarks: &mut Remarks) -> Coverage {
    let picture = factors.base_texture.as_ref();
    match factors.alpha {
        Alpha::Opaque => Coverage::Everywhere,
        Alpha::Mask(cutoff) => coverage(picture, factors.opacity, cutoff),
        Alpha::Blend => {
            let partly = |texel: &[u8; 4]| (1..255).contains(&texel[3]);
            let between = (f32::MIN_POSITIVE..1.0).contains(&factors.opacity);
            if between || picture.is_some_and(|picture| picture.texels().iter().any(partly)) {
                remarks.skipped("rounded the opacity of", &factors.name);
            }
            coverage(picture, factors.opacity, 0.5)
        }
    }
}
