//! The checked numbers and pictures of a glTF material, with defaults: the input of `material.rs`.

use super::json::{GltfDocument, get};
use super::json_material::{IorExtension, MaterialJson, TextureInfo, Volume};
use super::texture::{GltfTextures, UvSource};
use super::{first_name, malformed};
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::{NormalMap, Texture};
use std::sync::Arc;

/// How the alpha of `baseColorFactor` and `baseColorTexture` is used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum AlphaMode {
    Opaque,
    /// The surface exists where alpha is at least this cutoff.
    Mask(f32),
    Blend,
}

/// A material in plain numbers. Shares are in [0, 1].
#[derive(Clone, Debug)]
pub(super) struct MaterialFactors {
    pub name: String,
    /// Linear, and its alpha.
    pub base_color: Rgb,
    pub opacity: f32,
    /// Texture that multiplies base color and opacity.
    pub base_texture: Option<Arc<Texture>>,
    pub alpha: AlphaMode,
    pub metalness: f32,
    pub roughness: f32,
    /// Texture that multiplies roughness (by green) and metalness (by blue).
    pub metallic_roughness_texture: Option<Arc<Texture>>,
    /// Radiance, W/(m^2 sr).
    pub emission: Rgb,
    pub emissive_texture: Option<Arc<Texture>>,
    pub normal_map: Option<NormalMap>,
    /// Texture coordinates of the first texture.
    pub uv_source: Option<UvSource>,
    /// Whether another texture has other texture coordinates.
    pub has_other_uvs: bool,
    /// 1.5 by default.
    pub ior: f32,
    /// 20 over the Abbe number, 0 by default.
    pub dispersion: f32,
    /// Factor of the reflectance at normal incidence of dielectrics. It includes the mean of its
    /// textures.
    pub specular: Rgb,
    /// It includes the mean of its texture.
    pub transmission: f32,
    /// Whether the surface bounds a volume instead of being a sheet.
    pub thick: bool,
    /// Color of white light after a distance in the volume, scene units, if it absorbs.
    pub attenuation: Option<(Rgb, f32)>,
    pub clearcoat: f32,
    pub clearcoat_roughness: f32,
    pub clearcoat_texture: bool,
    /// Whether rasterizers show back sides. This renderer always does.
    pub double_sided: bool,
    pub unlit: bool,
}

/// The material of this index, to which `element` refers, or the standard's default.
pub(super) fn factors(
    document: &GltfDocument,
    textures: &mut GltfTextures,
    index: Option<usize>,
    element: &str,
) -> Result<MaterialFactors> {
    let default = MaterialJson::default();
    let (material, element) = match index {
        None => (&default, "default material".to_owned()),
        Some(index) => {
            let material = get(&document.materials, "materials", index, element)?;
            (material, format!("materials[{index}]"))
        }
    };
    let name = first_name([&material.name], || element.clone());
    let at = |key: &str| format!("{element}.{key}");
    let share = |value: f32, key: &str| share(value, &element, key);
    let pbr = &material.pbr_metallic_roughness;
    let extensions = &material.extensions;

    let [r, g, b, a] = pbr.base_color_factor;
    let key = "pbrMetallicRoughness.baseColorFactor";
    let base_color = Rgb::new(share(r, key)?, share(g, key)?, share(b, key)?);
    let opacity = share(a, key)?;
    let mut picture = |info: &Option<TextureInfo>, key: &str| {
        info.as_ref().map_or(Ok(None), |info| textures.get(info, &at(key)))
    };
    let base_texture = picture(&pbr.base_color_texture, "pbrMetallicRoughness.baseColorTexture")?;
    let other = "pbrMetallicRoughness.metallicRoughnessTexture";
    let metallic_roughness = picture(&pbr.metallic_roughness_texture, other)?;
    let emissive = picture(&material.emissive_texture, "emissiveTexture")?;
    let transmission = &extensions.transmission;
    let key = "extensions.KHR_materials_transmission.transmissionTexture";
    let transmitted = picture(&transmission.transmission_texture, key)?;

    let own = &extensions.specular;
    let key = "extensions.KHR_materials_specular.specularTexture";
    let strengths = picture(&own.specular_texture, key)?;
    let key = "extensions.KHR_materials_specular.specularColorTexture";
    let tints = picture(&own.specular_color_texture, key)?;
    let strength = strengths.map_or(1.0, |picture| picture.mean_opacity())
        * share(own.specular_factor, "extensions.KHR_materials_specular.specularFactor")?;
    let tint = Rgb::from_array(own.specular_color_factor);
    if !(tint.is_finite() && tint.min_element() >= 0.0) {
        let key = at("extensions.KHR_materials_specular.specularColorFactor");
        return Err(malformed(key, "it is negative or not finite"));
    }
    let specular = strength * tint * tints.map_or(Rgb::ONE, |picture| picture.mean_color());

    let normals = material.normal_texture.as_ref();
    let normal_picture = picture(&normals.map(|normals| normals.info.clone()), "normalTexture")?;
    let normal_map = normal_picture
        .zip(normals)
        .map(|(texture, normals)| NormalMap { texture, scale: normals.scale.unwrap_or(1.0) });
    if normal_map.as_ref().is_some_and(|map| !(-100.0..=100.0).contains(&map.scale)) {
        return Err(malformed(at("normalTexture.scale"), "it is not from -100 to 100"));
    }

    let red = transmitted.map_or(1.0, |picture| picture.mean_data().x);
    let strength = extensions.emissive_strength.emissive_strength;
    let emission = Rgb::from_array(material.emissive_factor) * strength;
    if !(emission.is_finite() && emission.min_element() >= 0.0) {
        return Err(malformed(at("emissiveFactor"), "the emission is negative or not finite"));
    }
    let ior = match extensions.ior.ior {
        // In the extension 0 selects total reflection, which is meant for other material models.
        0.0 => IorExtension::default().ior,
        ior if (0.1..=10.0).contains(&ior) => ior,
        ior => {
            let key = at("extensions.KHR_materials_ior.ior");
            return Err(malformed(key, format!("it is {ior}, not from 0.1 to 10")));
        }
    };
    let dispersion = extensions.dispersion.dispersion;
    if !(0.0..=20.0).contains(&dispersion) {
        let key = at("extensions.KHR_materials_dispersion.dispersion");
        return Err(malformed(key, format!("it is {dispersion}, not from 0 to 20")));
    }
    let infos = [
        pbr.base_color_texture.as_ref(),
        pbr.metallic_roughness_texture.as_ref(),
        normals.map(|normals| &normals.info),
        material.emissive_texture.as_ref(),
    ];
    let uv_sources: Vec<UvSource> = infos.into_iter().flatten().map(UvSource::new).collect();
    if uv_sources.iter().any(|uv| !uv.is_finite()) {
        return Err(malformed(at("extensions"), "a KHR_texture_transform is not finite"));
    }
    let coat = &extensions.clearcoat;
    let coat_key = "extensions.KHR_materials_clearcoat";
    let coat_textures = [
        &coat.clearcoat_texture,
        &coat.clearcoat_roughness_texture,
        &coat.clearcoat_normal_texture,
    ];
    Ok(MaterialFactors {
        name,
        base_color,
        opacity,
        base_texture,
        alpha: alpha(material, &element)?,
        metalness: share(pbr.metallic_factor, "pbrMetallicRoughness.metallicFactor")?,
        roughness: share(pbr.roughness_factor, "pbrMetallicRoughness.roughnessFactor")?,
        metallic_roughness_texture: metallic_roughness,
        emission,
        emissive_texture: emissive,
        normal_map,
        uv_source: uv_sources.first().copied(),
        has_other_uvs: uv_sources.iter().any(|uv| *uv != uv_sources[0]),
        ior,
        dispersion,
        specular,
        transmission: red
            * share(transmission.transmission_factor, "extensions.KHR_materials_transmission")?,
        thick: extensions.volume.thickness_factor > 0.0,
        attenuation: attenuation(&extensions.volume, &element)?,
        clearcoat: share(coat.clearcoat_factor, coat_key)?,
        clearcoat_roughness: share(coat.clearcoat_roughness_factor, coat_key)?,
        clearcoat_texture: coat_textures.iter().any(|texture| texture.is_some()),
        double_sided: material.double_sided,
        unlit: extensions.unlit.is_some(),
    })
}

/// A number from 0 to 1, up to the rounding of exporters.
fn share(value: f32, element: &str, key: &str) -> Result<f32> {
    if (-1e-4..=1.0 + 1e-4).contains(&value) {
        return Ok(value.clamp(0.0, 1.0));
    }
    Err(malformed(format!("{element}.{key}"), format!("{value} is not between 0 and 1")))
}

/// Color that is left after a distance, scene units; `None` if the volume absorbs nothing.
fn attenuation(volume: &Volume, element: &str) -> Result<Option<(Rgb, f32)>> {
    let key = "extensions.KHR_materials_volume.attenuationColor";
    let [r, g, b] = volume.attenuation_color;
    let color = Rgb::new(share(r, element, key)?, share(g, element, key)?, share(b, element, key)?);
    let Some(distance) = volume.attenuation_distance else { return Ok(None) };
    if distance <= 0.0 || distance.is_nan() {
        let key = "extensions.KHR_materials_volume.attenuationDistance";
        return Err(malformed(format!("{element}.{key}"), "it is not positive"));
    }
    Ok((color != Rgb::ONE && distance.is_finite()).then_some((color, distance)))
}

fn alpha(material: &MaterialJson, element: &str) -> Result<AlphaMode> {
    let cutoff = material.alpha_cutoff.unwrap_or(0.5);
    if !cutoff.is_finite() {
        return Err(malformed(format!("{element}.alphaCutoff"), "it is not finite"));
    }
    match material.alpha_mode.as_deref() {
        None | Some("OPAQUE") => Ok(AlphaMode::Opaque),
        Some("MASK") => Ok(AlphaMode::Mask(cutoff)),
        Some("BLEND") => Ok(AlphaMode::Blend),
        Some(_) => {
            let problem = "it is none of OPAQUE, MASK and BLEND";
            Err(malformed(format!("{element}.alphaMode"), problem))
        }
    }
}
