//! What a glTF material says, checked, with its defaults and pictures: what `material.rs` starts from.

use super::json::{Document, get};
use super::json_material::{Ior, Material, TextureInfo, Volume};
use super::texture::{Pictures, UvSource};
use super::{fault, first_name};
use crate::base::error::Result;
use crate::base::math::Rgb;
use crate::scene::{NormalMap, Texture};
use std::sync::Arc;

/// How `baseColorFactor`'s and `baseColorTexture`'s alpha counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Alpha {
    Opaque,
    /// There is a surface from this alpha on.
    Mask(f32),
    Blend,
}

/// A material in plain numbers. Shares are in [0, 1].
#[derive(Clone, Debug)]
pub(super) struct Factors {
    pub name: String,
    /// Linear, and its alpha.
    pub base_color: Rgb,
    pub opacity: f32,
    /// What both are multiplied with.
    pub base_texture: Option<Arc<Texture>>,
    pub alpha: Alpha,
    pub metalness: f32,
    pub roughness: f32,
    /// What both are multiplied with: roughness with green, metalness with blue.
    pub metallic_roughness_texture: Option<Arc<Texture>>,
    /// Radiance, W/(m^2 sr).
    pub emission: Rgb,
    pub emissive_texture: Option<Arc<Texture>>,
    pub normal_map: Option<NormalMap>,
    /// How the first texture lies on the surface.
    pub uv_source: Option<UvSource>,
    /// Whether another lies in another way.
    pub has_other_uvs: bool,
    /// 1.5 if nothing is said.
    pub ior: f32,
    /// What the reflectance of what is no metal is multiplied with at normal incidence, with the mean of its
    /// textures.
    pub specular: Rgb,
    /// With the mean of its texture.
    pub transmission: f32,
    /// Whether the surface bounds a volume rather than being a sheet.
    pub thick: bool,
    /// What is left of light that went through the volume where it is as thick as the material says.
    pub attenuation: Rgb,
    pub clearcoat: f32,
    pub clearcoat_roughness: f32,
    pub clearcoat_texture: bool,
    /// Whether rasterizers show backs, which are rendered anyway.
    pub double_sided: bool,
    pub unlit: bool,
}

/// The material of this index, which `place` refers to, or the standard's default.
pub(super) fn factors(
    document: &Document,
    pictures: &mut Pictures,
    index: Option<usize>,
    place: &str,
) -> Result<Factors> {
    let default = Material::default();
    let (material, place) = match index {
        None => (&default, "default material".to_owned()),
        Some(index) => {
            let material = get(&document.materials, "materials", index, place)?;
            (material, format!("materials[{index}]"))
        }
    };
    let name = first_name([&material.name], || place.clone());
    let at = |key: &str| format!("{place}.{key}");
    let share = |value: f32, key: &str| share(value, &place, key);
    let pbr = &material.pbr_metallic_roughness;
    let extensions = &material.extensions;

    let [r, g, b, a] = pbr.base_color_factor;
    let base_color = Rgb::new(
        share(r, "pbrMetallicRoughness.baseColorFactor")?,
        share(g, "pbrMetallicRoughness.baseColorFactor")?,
        share(b, "pbrMetallicRoughness.baseColorFactor")?,
    );
    let mut picture = |info: &Option<TextureInfo>, key: &str| {
        let found = info.as_ref().map(|info| pictures.get(info, &at(key))).transpose();
        found.map(Option::flatten)
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
        return Err(fault(key, "it is negative or not finite"));
    }
    let specular = strength * tint * tints.map_or(Rgb::ONE, |picture| picture.mean_color());

    let normals = material.normal_texture.as_ref();
    let normal_picture = picture(&normals.map(|normals| normals.info.clone()), "normalTexture")?;
    let normal_map = normal_picture.zip(normals).map(|(texture, normals)| {
        let scale = normals.scale;
        NormalMap { texture, scale }
    });
    if normal_map.as_ref().is_some_and(|map| !(-100.0..=100.0).contains(&map.scale)) {
        return Err(fault(at("normalTexture.scale"), "it is not from -100 to 100"));
    }

    let red = transmitted.map_or(1.0, |picture| picture.mean_data().x);
    let strength = extensions.emissive_strength.emissive_strength;
    let emission = Rgb::from_array(material.emissive_factor) * strength;
    if !(emission.is_finite() && emission.min_element() >= 0.0) {
        return Err(fault(at("emissiveFactor"), "the emission is negative or not finite"));
    }
    let ior = match extensions.ior.ior {
        // By the extension it stands for total reflection, which is for other material models.
        0.0 => Ior::default().ior,
        ior if (0.1..=10.0).contains(&ior) => ior,
        ior => {
            let key = at("extensions.KHR_materials_ior.ior");
            return Err(fault(key, format!("it is {ior}, not from 0.1 to 10")));
        }
    };
    let infos = [
        pbr.base_color_texture.as_ref(),
        pbr.metallic_roughness_texture.as_ref(),
        normals.map(|normals| &normals.info),
        material.emissive_texture.as_ref(),
    ];
    let uv_sources: Vec<UvSource> = infos.into_iter().flatten().map(UvSource::new).collect();
    if uv_sources.iter().any(|uv| !uv.is_finite()) {
        return Err(fault(at("extensions"), "a KHR_texture_transform is not finite"));
    }
    let coat = &extensions.clearcoat;
    let coat_textures = [
        &coat.clearcoat_texture,
        &coat.clearcoat_roughness_texture,
        &coat.clearcoat_normal_texture,
    ];
    Ok(Factors {
        name,
        base_color,
        opacity: share(a, "pbrMetallicRoughness.baseColorFactor")?,
        base_texture,
        alpha: alpha(material, &place)?,
        metalness: share(pbr.metallic_factor, "pbrMetallicRoughness.metallicFactor")?,
        roughness: share(pbr.roughness_factor, "pbrMetallicRoughness.roughnessFactor")?,
        metallic_roughness_texture: metallic_roughness,
        emission,
        emissive_texture: emissive,
        normal_map,
        uv_source: uv_sources.first().copied(),
        has_other_uvs: uv_sources.iter().any(|uv| *uv != uv_sources[0]),
        ior,
        specular,
        transmission: red
            * share(transmission.transmission_factor, "extensions.KHR_materials_transmission")?,
        thick: extensions.volume.thickness_factor > 0.0,
        attenuation: attenuation(&extensions.volume, &place)?,
        clearcoat: share(coat.clearcoat_factor, "extensions.KHR_materials_clearcoat")?,
        clearcoat_roughness: share(
            coat.clearcoat_roughness_factor,
            "extensions.KHR_materials_clearcoat",
        )?,
        clearcoat_texture: coat_textures.iter().any(|texture| texture.is_some()),
        double_sided: material.double_sided,
        unlit: extensions.unlit.is_some(),
    })
}

/// A number from 0 to 1, as far as exporters round.
fn share(value: f32, place: &str, key: &str) -> Result<f32> {
    if (-1e-4..=1.0 + 1e-4).contains(&value) {
        return Ok(value.clamp(0.0, 1.0));
    }
    Err(fault(format!("{place}.{key}"), format!("{value} is not between 0 and 1")))
}

/// What is left of light after the thickness of a volume, by Beer's law.
fn attenuation(volume: &Volume, place: &str) -> Result<Rgb> {
    let key = "extensions.KHR_materials_volume.attenuationColor";
    let [r, g, b] = volume.attenuation_color;
    let color = Rgb::new(share(r, place, key)?, share(g, place, key)?, share(b, place, key)?);
    let Some(distance) = volume.attenuation_distance else { return Ok(Rgb::ONE) };
    let lengths = volume.thickness_factor / distance;
    // Written so that NaN fails.
    if !(distance > 0.0 && lengths >= 0.0) {
        let key = "extensions.KHR_materials_volume.attenuationDistance";
        return Err(fault(format!("{place}.{key}"), "it is not positive"));
    }
    Ok(color.map(|share| if share > 0.0 { share.powf(lengths) } else { 0.0 }))
}

fn alpha(material: &Material, place: &str) -> Result<Alpha> {
    let cutoff = material.alpha_cutoff.unwrap_or(0.5);
    if !cutoff.is_finite() {
        return Err(fault(format!("{place}.alphaCutoff"), "it is not finite"));
    }
    match material.alpha_mode.as_deref() {
        None | Some("OPAQUE") => Ok(Alpha::Opaque),
        Some("MASK") => Ok(Alpha::Mask(cutoff)),
        Some("BLEND") => Ok(Alpha::Blend),
        Some(_) => {
            let problem = "it is none of OPAQUE, MASK and BLEND";
            Err(fault(format!("{place}.alphaMode"), problem))
        }
    }
}
