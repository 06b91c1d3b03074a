//! Conversion of glTF materials, by the table in `docs/reference/gltf.md`.

use super::factors::{AlphaMode, MaterialFactors};
use super::texture::{Coverage, blended, coverage};
use crate::scene_file::material::{DEFAULT_IOR, dielectric};
use crate::warnings::GroupedWarnings;
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::scene::bsdf::{Bsdf, Glossy, SMOOTH_ALPHA, ThinDielectric};
use bdpm_core::scene::{Dispersion, Material, Medium, MediumBoundary, RefractiveIndex};
use glam::Vec3;
use std::sync::Arc;

/// The material, with warnings about properties without a counterpart; `None` if it is invisible.
pub(super) fn material(
    factors: &MaterialFactors,
    warnings: &mut GroupedWarnings,
) -> Option<Material> {
    let MaterialFactors { name, emission, base_texture, .. } = factors;
    let bsdf = bsdf(factors, warnings);
    let glass =
        matches!(bsdf, Bsdf::Dielectric(_) | Bsdf::RoughDielectric(_) | Bsdf::ThinDielectric(_));
    // Glass is translucent by itself.
    let coverage = if glass { Coverage::Everywhere } else { covered(factors) };
    let (opacity_texture, opacity) = match coverage {
        Coverage::Everywhere => (None, None),
        Coverage::Partly(picture) => (Some(picture), None),
        Coverage::Share(picture, share) => (picture, Some(share)),
        Coverage::Nowhere => {
            warnings.chosen("left out surfaces without opacity of the material", name);
            return None;
        }
    };
    let emits = emission.max_element() > 0.0;
    let phrases = [
        (factors.unlit, "shaded the unlit material"),
        (
            factors.has_other_uvs,
            "used the texture coordinates of the first texture for all of the material",
        ),
        (emits && factors.double_sided, "let only front sides emit light of the material"),
        (
            emits && (opacity_texture.is_some() || opacity.is_some()),
            "ignored the opacity of the emissive material",
        ),
    ];
    warnings.skipped_if(phrases, name);
    // Coats have their own roughness.
    let data = factors.metallic_roughness_texture.clone().filter(|_| !is_coated(factors));
    let is_solid = matches!(bsdf, Bsdf::Dielectric(_) | Bsdf::RoughDielectric(_));
    let interior = factors.attenuation.filter(|_| glass && factors.thick);
    let interior =
        interior.map(|(color, distance)| Medium::absorbing(name, color, distance).into());
    Some(Material {
        boundary: interior
            .map(|interior| MediumBoundary { interior: Some(interior), exterior: None }),
        dispersion: dispersion(factors).filter(|_| is_solid).map(Arc::new),
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

/// Dispersion by `KHR_materials_dispersion`, as the extension defines it: by Cauchy's equation.
fn dispersion(factors: &MaterialFactors) -> Option<Dispersion> {
    let abbe = f64::from(20.0 / factors.dispersion);
    let inside = RefractiveIndex::Abbe { index: factors.ior.into(), abbe };
    // Indices near 1 with much dispersion may fall below the minimum.
    let inside = inside.checked().ok().filter(|_| abbe.is_finite())?;
    Dispersion::new(inside, RefractiveIndex::Constant(1.0))
}

/// Metalness and roughness with the means of their texture.
fn mean_metal_and_roughness(factors: &MaterialFactors) -> [f32; 2] {
    let picture = factors.metallic_roughness_texture.as_ref();
    let mean = picture.map_or(Vec3::ONE, |picture| picture.mean_data());
    [factors.metalness * mean.z, factors.roughness * mean.y]
}

/// Returns true if the surface becomes a coat over a diffuse base.
fn is_coated(factors: &MaterialFactors) -> bool {
    let MaterialFactors { unlit, clearcoat, transmission, .. } = *factors;
    let may_be = !unlit && clearcoat >= 0.5 && transmission < 0.5;
    may_be && mean_metal_and_roughness(factors)[0] < 0.5
}

fn bsdf(factors: &MaterialFactors, warnings: &mut GroupedWarnings) -> Bsdf {
    let MaterialFactors { base_color, metalness, roughness, transmission, clearcoat, ior, .. } =
        *factors;
    if factors.unlit {
        return Bsdf::diffuse(base_color);
    }
    let name = &factors.name;
    // Glass and coats take the means of textures.
    let data = factors.metallic_roughness_texture.as_ref();
    let layered = transmission > 0.0 || clearcoat > 0.0;
    let [metal_mean, roughness_mean] =
        if layered { mean_metal_and_roughness(factors) } else { [metalness, roughness] };
    let is_metal = metal_mean >= 0.5;
    let is_glass = !is_metal && transmission >= 0.5;
    let is_coated = is_coated(factors);
    let phrases = [
        ((is_glass || is_coated) && metal_mean > 0.0, "ignored the metal in"),
        (!is_metal && transmission > 0.0 && transmission < 1.0, "rounded the transmission of"),
        (clearcoat > 0.0 && !is_coated, "ignored the clear coat of"),
        (factors.clearcoat_texture && clearcoat > 0.0, "ignored coat textures of"),
        (is_glass && data.is_some(), "used the mean roughness of"),
    ];
    warnings.skipped_if(phrases, name);
    if is_glass {
        return glass(factors, roughness_mean * roughness_mean, warnings);
    }
    if is_coated {
        // The extension multiplies the base by 1 - F of the coat. Glossy surfaces conserve energy
        // likewise.
        let alpha = factors.clearcoat_roughness.powi(2);
        return Bsdf::Glossy(Glossy::new(base_color, 0.0, DEFAULT_IOR, alpha));
    }
    let specular = luminance(factors.specular);
    if metalness < 1.0 && factors.specular != Rgb::splat(specular) {
        warnings.skipped("used the luminance of the specular color of", name);
    }
    // With the refractive index of air only metal reflects.
    if (ior <= 1.0 || specular == 0.0) && metalness == 0.0 {
        return Bsdf::diffuse(base_color);
    }
    let glossy = Glossy::new(base_color, metalness, ior, roughness * roughness);
    Bsdf::Glossy(if specular == 1.0 { glossy } else { glossy.reflecting(specular) })
}

fn glass(factors: &MaterialFactors, alpha: f32, warnings: &mut GroupedWarnings) -> Bsdf {
    let name = &factors.name;
    let picture = factors.base_texture.as_ref();
    if picture.is_some() {
        warnings.skipped("used the mean color of the glass", name);
    }
    let color = factors.base_color * picture.map_or(Rgb::ONE, |picture| picture.mean_color());
    if factors.thick {
        // Light crosses the surface twice.
        return dielectric(factors.ior, alpha, color.map(f32::sqrt));
    }
    if alpha >= SMOOTH_ALPHA {
        warnings.skipped("ignored the roughness of the thin glass", name);
    }
    Bsdf::ThinDielectric(ThinDielectric { eta: factors.ior, transmittance: color })
}

/// The parts of the surface that exist.
fn covered(factors: &MaterialFactors) -> Coverage {
    let picture = factors.base_texture.as_ref();
    match factors.alpha {
        AlphaMode::Opaque => Coverage::Everywhere,
        AlphaMode::Mask(cutoff) => coverage(picture, factors.opacity, cutoff),
        AlphaMode::Blend => blended(picture, factors.opacity),
    }
}
