//! The JSON of materials and their pictures: the members that are read.

use super::json::{Unread, json_objects, json_records};
use serde::Deserialize;

json_objects! {
    struct ImageJson {
        uri: Option<String>,
        buffer_view: Option<usize>,
    }

    struct TextureJson {
        source: Option<usize>,
        sampler: Option<usize>,
        extensions: TextureSources,
    }

    struct TextureSources {
        #[serde(rename = "EXT_texture_webp")]
        webp: WebpSource,
    }

    struct WebpSource {
        source: Option<usize>,
    }

    struct Sampler {
        mag_filter: Option<u32>,
        wrap_s: Option<u32>,
        wrap_t: Option<u32>,
    }

    struct MaterialJson {
        name: String,
        pbr_metallic_roughness: Pbr,
        normal_texture: Option<NormalTextureInfo>,
        emissive_texture: Option<TextureInfo>,
        emissive_factor: [f32; 3],
        alpha_mode: Option<String>,
        alpha_cutoff: Option<f32>,
        double_sided: bool,
        extensions: MaterialExtensions,
    }

    struct Pbr {
        base_color_factor: [f32; 4] = [1.0; 4],
        base_color_texture: Option<TextureInfo>,
        metallic_factor: f32 = 1.0,
        roughness_factor: f32 = 1.0,
        metallic_roughness_texture: Option<TextureInfo>,
    }

    struct TextureExtensions {
        #[serde(rename = "KHR_texture_transform")]
        transform: Option<TextureTransform>,
    }

    struct TextureTransform {
        offset: [f32; 2],
        /// Radians.
        rotation: f32,
        scale: [f32; 2] = [1.0; 2],
        tex_coord: Option<u32>,
    }

    struct MaterialExtensions {
        #[serde(rename = "KHR_materials_clearcoat")]
        clearcoat: Clearcoat,
        #[serde(rename = "KHR_materials_diffuse_transmission")]
        diffuse_transmission: DiffuseTransmissionExtension,
        #[serde(rename = "KHR_materials_dispersion")]
        dispersion: DispersionExtension,
        #[serde(rename = "KHR_materials_emissive_strength")]
        emissive_strength: EmissiveStrength,
        #[serde(rename = "KHR_materials_ior")]
        ior: IorExtension,
        #[serde(rename = "KHR_materials_specular")]
        specular: Specular,
        #[serde(rename = "KHR_materials_transmission")]
        transmission: Transmission,
        #[serde(rename = "KHR_materials_unlit")]
        unlit: Option<Unread>,
        #[serde(rename = "KHR_materials_volume")]
        volume: Volume,
    }

    struct Clearcoat {
        clearcoat_factor: f32,
        clearcoat_texture: Option<TextureInfo>,
        clearcoat_roughness_factor: f32,
        clearcoat_roughness_texture: Option<TextureInfo>,
        clearcoat_normal_texture: Option<TextureInfo>,
    }

    struct DiffuseTransmissionExtension {
        diffuse_transmission_factor: f32,
        /// Its alpha multiplies the factor.
        diffuse_transmission_texture: Option<TextureInfo>,
        diffuse_transmission_color_factor: [f32; 3] = [1.0; 3],
        diffuse_transmission_color_texture: Option<TextureInfo>,
    }

    struct EmissiveStrength {
        emissive_strength: f32 = 1.0,
    }

    struct DispersionExtension {
        /// 20 over the Abbe number.
        dispersion: f32,
    }

    struct IorExtension {
        ior: f32 = 1.5,
    }

    struct Specular {
        specular_factor: f32 = 1.0,
        specular_texture: Option<TextureInfo>,
        specular_color_factor: [f32; 3] = [1.0; 3],
        specular_color_texture: Option<TextureInfo>,
    }

    struct Transmission {
        transmission_factor: f32,
        transmission_texture: Option<TextureInfo>,
    }

    struct Volume {
        thickness_factor: f32,
        attenuation_color: [f32; 3] = [1.0; 3],
        /// Infinite if it is not given.
        attenuation_distance: Option<f32>,
    }
}

json_records! {
    struct TextureInfo {
        index: usize,
        #[serde(default)]
        tex_coord: u32,
        #[serde(default)]
        extensions: TextureExtensions,
    }

    struct NormalTextureInfo {
        #[serde(flatten)]
        info: TextureInfo,
        scale: Option<f32>,
    }
}
