//! What a glTF material becomes here; the table in `docs/scene-format.md` tells the same.

use super::factors::{Alpha, Factors};
use super::texture::{Coverage, blended, coverage};
use super::warnings::Remarks;
use crate::base::math::{Rgb, luminance};
use crate::import::mtl::material::COAT_ROUGHNESS;
use crate::import::scene_file::material::{DEFAULT_IOR, dielectric};
use crate::scene::Material;
use crate::scene::bsdf::{Bsdf, Coated, Glossy, SMOOTH_ALPHA, ThinDielectric};
use glam::Vec3;

/// The material, with remarks on what of it has no counterpart; `None` if it is nowhere to be seen.
pub(super) fn material(factors: &Factors, remarks: &mut Remarks) -> Option<Material> {
    let Factors { name, emission, base_texture, .. } = factors;
    let bsdf = bsdf(factors, remarks);
    let glass =
        matches!(bsdf, Bsdf::Dielectric(_) | Bsdf::RoughDielectric(_) | Bsdf::ThinDielectric(_));
    // Glass shows by itself what is behind it.
    let coverage = if glass { Coverage::Everywhere } else { covered(factors) };
    let (opacity_texture, opacity) = match coverage {
        Coverage::Everywhere => (None, None),
        Coverage::Partly(picture) => (Some(picture), None),
        Coverage::Share(picture, share) => (picture, Some(share)),
        Coverage::Nowhere => {
            remarks.chosen("left out what is of no opacity, of the material", name);
            return None;
        }
    };
    let emits = emission.max_element() > 0.0;
    for (left_out, what) in [
        (factors.unlit, "shaded what has no shading, the material"),
        (factors.has_other_uvs, "laid all textures like the first of the material"),
        (emits && factors.double_sided, "let only front sides emit light, of the material"),
        (
            emits && (opacity_texture.is_some() || opacity.is_some()),
            "filled the holes in the lamps of the material",
        ),
    ] {
        if left_out {
            remarks.skipped(what, name);
        }
    }
    let data = factors.metallic_roughness_texture.clone();
    Some(Material {
        emission: *emission,
        albedo_texture: base_texture.clone().filter(|_| !glass),
        metallic_roughness_texture: data.filter(|_| matches!(bsdf, Bsdf::Glossy(_))),
        opacity_texture,
        opacity,
        normal_map: factors.normal_map.clone(),
        emission_texture: factors.emissive_texture.clone().filter(|_| emits),
        ..Material::new(name, bsdf)
    })
}

fn bsdf(factors: &Factors, remarks: &mut Remarks) -> Bsdf {
    let Factors { base_color, metalness, roughness, transmission, clearcoat, ior, .. } = *factors;
    if factors.unlit {
        return Bsdf::diffuse(base_color);
    }
    let name = &factors.name;
    // What is not glossy counts by means.
    let data = factors.metallic_roughness_texture.as_ref();
    let layered = transmission > 0.0 || clearcoat > 0.0;
    let mean = data.filter(|_| layered).map_or(Vec3::ONE, |picture| picture.mean_data());
    let [metal_mean, roughness_mean] = [metalness * mean.z, roughness * mean.y];
    let is_metal = metal_mean >= 0.5;
    let is_glass = !is_metal && transmission >= 0.5;
    let is_coated =
        !is_metal && !is_glass && clearcoat >= 0.5 && factors.clearcoat_roughness < COAT_ROUGHNESS;
    for (left_out, what) in [
        ((is_glass || is_coated) && metal_mean > 0.0, "ignored the metal in"),
        (!is_metal && transmission > 0.0 && transmission < 1.0, "rounded the transmission of"),
        (clearcoat > 0.0 && !is_coated, "ignored the clear coat of"),
        (factors.clearcoat_texture && clearcoat > 0.0, "ignored coat textures of"),
        (is_glass && data.is_some(), "took the mean roughness of"),
    ] {
        if left_out {
            remarks.skipped(what, name);
        }
    }
    if is_glass {
        return glass(factors, roughness_mean * roughness_mean, remarks);
    }
    if is_coated {
        return Bsdf::Coated(Coated::new(base_color, DEFAULT_IOR));
    }
    let specular = luminance(factors.specular);
    if metalness < 1.0 && factors.specular != Rgb::splat(specular) {
        remarks.skipped("took the luminance of the specular color of", name);
    }
    // Of the index of the air nothing reflects but metal.
    if (ior <= 1.0 || specular == 0.0) && metalness == 0.0 {
        return Bsdf::diffuse(base_color);
    }
    let glossy = Glossy::new(base_color, metalness, ior, roughness * roughness);
    Bsdf::Glossy(if specular == 1.0 { glossy } else { glossy.reflecting(specular) })
}

fn glass(factors: &Factors, alpha: f32, remarks: &mut Remarks) -> Bsdf {
    let name = &factors.name;
    let picture = factors.base_texture.as_ref();
    if picture.is_some() {
        remarks.skipped("took the mean color of the glass", name);
    }
    let color = factors.base_color * picture.map_or(Rgb::ONE, |picture| picture.mean_color());
    if factors.thick {
        // Half of it, by Beer's law, at each of two crossings.
        let through = (color * factors.attenuation).map(f32::sqrt);
        return dielectric(factors.ior, alpha, through);
    }
    if alpha >= SMOOTH_ALPHA {
        remarks.skipped("ignored the roughness of the thin glass", name);
    }
    Bsdf::ThinDielectric(ThinDielectric { eta: factors.ior, transmittance: color })
}

/// Where the surface is.
fn covered(factors: &Factors) -> Coverage {
    let picture = factors.base_texture.as_ref();
    match factors.alpha {
        Alpha::Opaque => Coverage::Everywhere,
        Alpha::Mask(cutoff) => coverage(picture, factors.opacity, cutoff),
        Alpha::Blend => blended(picture, factors.opacity),
    }
}
