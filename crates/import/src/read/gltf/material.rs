//! Conversion of glTF materials, by the table in `docs/reference/gltf.md`.

use super::json::{GltfDocument, get};
use super::json_material::{IorExtension, MaterialJson, TextureInfo};
use super::texture::{Coverage, GltfTextures, UvSource, blended, coverage};
use super::{first_name, malformed};
use crate::look::{DEFAULT_IOR, Look, ONE_MAP, Paint, correlated, in_vacuum, picture_of};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::scene::bsdf::{Bsdf, Glossy, SMOOTH_ALPHA};
use bdpm_core::scene::{Material, Medium, MediumBoundary, NormalMap, RefractiveIndex, Texture};
use glam::Vec3;
use std::sync::Arc;

/// A material with its name.
pub(super) struct GltfLook {
    pub name: String,
    /// `None` if it is invisible.
    pub look: Option<Look>,
    /// Texture coordinates of the first texture.
    pub uv_source: Option<UvSource>,
}

/// The material of this index, to which `element` refers, or the standard's default.
pub(super) fn look(
    document: &GltfDocument,
    textures: &mut GltfTextures,
    index: Option<usize>,
    element: &str,
) -> Result<GltfLook> {
    let default = MaterialJson::default();
    let (json, element) = match index {
        None => (&default, "default material".to_owned()),
        Some(index) => {
            let json = get(&document.materials, "materials", index, element)?;
            (json, format!("materials[{index}]"))
        }
    };
    let name = first_name([&json.name], || element.clone());
    let mut reader = MaterialReader { json, element, name, textures };
    let (uv_source, has_other_uvs) = reader.uv_source()?;
    let look = reader.look(has_other_uvs)?;
    Ok(GltfLook { name: reader.name, look, uv_source })
}

/// Reads one material. Shares in its JSON are in [0, 1], up to the rounding of exporters.
struct MaterialReader<'r, 'a> {
    json: &'r MaterialJson,
    /// The element of the file.
    element: String,
    name: String,
    textures: &'r mut GltfTextures<'a>,
}

/// The numbers and pictures of the metallic-roughness model.
struct Base {
    color: Rgb,
    metalness: f32,
    roughness: f32,
    /// Factors of roughness (green) and metalness (blue).
    data: Option<Arc<Texture>>,
    /// Metalness and roughness with the means of the picture.
    means: [f32; 2],
}

/// What is above or within a surface.
struct Layers {
    ior: f32,
    /// Factor of the reflectance at normal incidence of dielectrics. It includes the mean of its
    /// textures.
    specular: Rgb,
    /// It includes the mean of its texture.
    transmission: f32,
    /// Factor, without its texture.
    diffuse_transmission: f32,
    clearcoat: f32,
    clearcoat_roughness: f32,
}

/// The phrase of a warning about sheets that transmit diffusely.
const HIGHLIGHTS: &str = "ignored the highlights of the translucent material";

/// How a surface becomes one BSDF.
#[derive(Clone, Copy, PartialEq)]
enum Model {
    Unlit,
    Glass,
    Translucent,
    Coated,
    MetallicRoughness,
}

impl MaterialReader<'_, '_> {
    fn look(&mut self, has_other_uvs: bool) -> Result<Option<Look>> {
        let (base, picture) = self.base()?;
        let emission_picture = self.picture(&self.json.emissive_texture, "emissiveTexture")?;
        let layers = self.layers()?;
        let normal_map = self.normal_map()?;
        let emission = self.emission()?;
        let interior = self.interior()?;
        let abbe = self.abbe()?;
        let model = self.model(&base, &layers);
        let is_thick = self.json.extensions.volume.thickness_factor > 0.0;
        let mut look = match model {
            Model::Unlit => Look::new(Bsdf::diffuse(base.color)),
            Model::Glass if is_thick => self.solid_glass(&base, &layers, picture.as_ref(), abbe),
            Model::Glass => self.sheet(&base, &layers, picture.as_ref()),
            Model::Translucent => self.translucent(&base, &layers, picture.clone())?,
            // The extension multiplies the base by 1 - F of the coat. Glossy surfaces conserve
            // energy likewise.
            Model::Coated => {
                let alpha = layers.clearcoat_roughness.powi(2);
                Look::new(Bsdf::Glossy(Glossy::new(base.color, 0.0, DEFAULT_IOR, alpha)))
            }
            Model::MetallicRoughness => Look::new(self.metallic_roughness(&base, &layers)),
        };
        let is_glass = model == Model::Glass;
        // Glass is translucent by itself.
        let covered = self.covered(picture.as_ref())?;
        let coverage = if is_glass { Coverage::Everywhere } else { covered };
        let (opacity_texture, opacity) = match coverage {
            Coverage::Everywhere => (None, None),
            Coverage::Partly(picture) => (Some(picture), None),
            Coverage::Share(picture, share) => (picture, Some(share)),
            Coverage::Nowhere => {
                let phrase = "left out surfaces without opacity of the material";
                self.textures.warnings.chosen(phrase, &self.name);
                return Ok(None);
            }
        };
        let emits = emission.max_element() > 0.0;
        self.skipped_if([
            (model == Model::Unlit, "shaded the unlit material"),
            (has_other_uvs, ONE_MAP),
        ]);
        let is_glossy = matches!(look.material.bsdf, Bsdf::Glossy(_));
        look.material = Material {
            boundary: interior.filter(|_| is_glass && is_thick),
            emission,
            albedo_texture: look.material.albedo_texture.take().or(picture.filter(|_| !is_glass)),
            // Coats have their own roughness.
            metallic_roughness_texture: base.data.filter(|_| is_glossy && model != Model::Coated),
            opacity_texture,
            opacity,
            normal_map,
            emission_texture: emission_picture.filter(|_| emits),
            two_sided_emission: emits && self.json.double_sided,
            ..look.material
        };
        Ok(Some(look))
    }

    /// Each phrase whose condition is met describes something that the image lacks.
    fn skipped_if<const N: usize>(&mut self, phrases: [(bool, &str); N]) {
        self.textures.warnings.skipped_if(phrases, &self.name);
    }

    fn malformed(&self, key: &str, problem: impl std::fmt::Display) -> Error {
        malformed(format!("{}.{key}", self.element), problem)
    }

    fn picture(&mut self, info: &Option<TextureInfo>, key: &str) -> Result<Option<Arc<Texture>>> {
        let element = format!("{}.{key}", self.element);
        info.as_ref().map_or(Ok(None), |info| self.textures.get(info, &element))
    }

    /// A number from 0 to 1, up to the rounding of exporters.
    fn share(&self, value: f32, key: &str) -> Result<f32> {
        if (-1e-4..=1.0 + 1e-4).contains(&value) {
            return Ok(value.clamp(0.0, 1.0));
        }
        Err(self.malformed(key, format!("{value} is not between 0 and 1")))
    }

    /// A number from `low` to `high`.
    fn within(&self, value: f32, [low, high]: [f32; 2], key: &str) -> Result<f32> {
        if (low..=high).contains(&value) {
            return Ok(value);
        }
        Err(self.malformed(key, format!("it is {value}, not from {low} to {high}")))
    }

    fn color(&self, [r, g, b]: [f32; 3], key: &str) -> Result<Rgb> {
        Ok(Rgb::new(self.share(r, key)?, self.share(g, key)?, self.share(b, key)?))
    }

    /// Amounts of light, times `factor`.
    fn light(&self, color: [f32; 3], factor: f32, key: &str, problem: &str) -> Result<Rgb> {
        let light = Rgb::from_array(color) * factor;
        if light.is_finite() && light.min_element() >= 0.0 {
            return Ok(light);
        }
        Err(self.malformed(key, problem))
    }

    /// The metallic-roughness model, and the picture of base color and opacity.
    fn base(&mut self) -> Result<(Base, Option<Arc<Texture>>)> {
        let pbr = &self.json.pbr_metallic_roughness;
        let [r, g, b, _] = pbr.base_color_factor;
        let color = self.color([r, g, b], "pbrMetallicRoughness.baseColorFactor")?;
        let key = "pbrMetallicRoughness.baseColorTexture";
        let picture = self.picture(&pbr.base_color_texture, key)?;
        let key = "pbrMetallicRoughness.metallicRoughnessTexture";
        let data = self.picture(&pbr.metallic_roughness_texture, key)?;
        let metalness = self.share(pbr.metallic_factor, "pbrMetallicRoughness.metallicFactor")?;
        let roughness = self.share(pbr.roughness_factor, "pbrMetallicRoughness.roughnessFactor")?;
        let mean = data.as_ref().map_or(Vec3::ONE, |picture| picture.mean_data());
        let means = [metalness * mean.z, roughness * mean.y];
        Ok((Base { color, metalness, roughness, data, means }, picture))
    }

    fn layers(&mut self) -> Result<Layers> {
        let own = &self.json.extensions;
        let key = "extensions.KHR_materials_transmission";
        let transmission = &own.transmission;
        let picture = self
            .picture(&transmission.transmission_texture, &format!("{key}.transmissionTexture"))?;
        let red = picture.map_or(1.0, |picture| picture.mean_data().x);
        let transmission = red * self.share(transmission.transmission_factor, key)?;
        let diffuse_transmission = self.share(
            own.diffuse_transmission.diffuse_transmission_factor,
            "extensions.KHR_materials_diffuse_transmission.diffuseTransmissionFactor",
        )?;
        let key = "extensions.KHR_materials_clearcoat";
        let [clearcoat, clearcoat_roughness] =
            [own.clearcoat.clearcoat_factor, own.clearcoat.clearcoat_roughness_factor]
                .map(|value| self.share(value, key));
        let ior = match own.ior.ior {
            // In the extension 0 selects total reflection, which is meant for other material
            // models.
            0.0 => IorExtension::default().ior,
            ior => self.within(ior, [0.1, 10.0], "extensions.KHR_materials_ior.ior")?,
        };
        Ok(Layers {
            ior,
            specular: self.specular()?,
            transmission,
            diffuse_transmission,
            clearcoat: clearcoat?,
            clearcoat_roughness: clearcoat_roughness?,
        })
    }

    fn specular(&mut self) -> Result<Rgb> {
        let own = &self.json.extensions.specular;
        let key = |name: &str| format!("extensions.KHR_materials_specular.{name}");
        let strengths = self.picture(&own.specular_texture, &key("specularTexture"))?;
        let tints = self.picture(&own.specular_color_texture, &key("specularColorTexture"))?;
        let strength = strengths.map_or(1.0, |picture| picture.mean_opacity())
            * self.share(own.specular_factor, &key("specularFactor"))?;
        let problem = "it is negative or not finite";
        let tint =
            self.light(own.specular_color_factor, 1.0, &key("specularColorFactor"), problem)?;
        Ok(strength * tint * tints.map_or(Rgb::ONE, |picture| picture.mean_color()))
    }

    fn normal_map(&mut self) -> Result<Option<NormalMap>> {
        let Some(normals) = &self.json.normal_texture else { return Ok(None) };
        let picture = self.picture(&Some(normals.info.clone()), "normalTexture")?;
        let scale = normals.scale.unwrap_or(1.0);
        if picture.is_some() && !(-100.0..=100.0).contains(&scale) {
            return Err(self.malformed("normalTexture.scale", "it is not from -100 to 100"));
        }
        Ok(picture.map(|texture| NormalMap { texture, scale }))
    }

    /// Radiance, W/(m^2 sr).
    fn emission(&self) -> Result<Rgb> {
        let strength = self.json.extensions.emissive_strength.emissive_strength;
        let problem = "the emission is negative or not finite";
        self.light(self.json.emissive_factor, strength, "emissiveFactor", problem)
    }

    /// The medium behind the surface, if it absorbs anything.
    fn interior(&self) -> Result<Option<MediumBoundary>> {
        let volume = &self.json.extensions.volume;
        let key = |name: &str| format!("extensions.KHR_materials_volume.{name}");
        let color = self.color(volume.attenuation_color, &key("attenuationColor"))?;
        let Some(distance) = volume.attenuation_distance else { return Ok(None) };
        if distance <= 0.0 || distance.is_nan() {
            return Err(self.malformed(&key("attenuationDistance"), "it is not positive"));
        }
        let absorbs = color != Rgb::ONE && distance.is_finite();
        Ok(absorbs.then(|| {
            let medium = Arc::new(Medium::absorbing(&self.name, color, distance));
            MediumBoundary { interior: Some(medium), exterior: None }
        }))
    }

    /// Abbe number by `KHR_materials_dispersion`; infinite without dispersion.
    fn abbe(&self) -> Result<f64> {
        let key = "extensions.KHR_materials_dispersion.dispersion";
        let dispersion = self.json.extensions.dispersion.dispersion;
        Ok(f64::from(20.0 / self.within(dispersion, [0.0, 20.0], key)?))
    }

    /// Chooses the BSDF, with warnings about layers that it leaves out.
    fn model(&mut self, base: &Base, layers: &Layers) -> Model {
        if self.json.extensions.unlit.is_some() {
            return Model::Unlit;
        }
        let Layers { transmission, clearcoat, .. } = *layers;
        // Glass and coats take the means of textures.
        let is_layered = transmission > 0.0 || clearcoat > 0.0;
        let metal = if is_layered { base.means[0] } else { base.metalness };
        let is_metal = metal >= 0.5;
        let is_glass = !is_metal && transmission >= 0.5;
        let is_coated = clearcoat >= 0.5 && transmission < 0.5 && base.means[0] < 0.5;
        let coat = &self.json.extensions.clearcoat;
        let has_coat_textures = coat.clearcoat_texture.is_some()
            || coat.clearcoat_roughness_texture.is_some()
            || coat.clearcoat_normal_texture.is_some();
        let is_share = transmission > 0.0 && transmission < 1.0;
        self.skipped_if([
            ((is_glass || is_coated) && metal > 0.0, "ignored the metal in"),
            (!is_metal && is_share, "rounded the transmission of"),
            (clearcoat > 0.0 && !is_coated, "ignored the clear coat of"),
            (has_coat_textures && clearcoat > 0.0, "ignored coat textures of"),
            (is_glass && base.data.is_some(), "used the mean roughness of"),
        ]);
        match (is_glass, is_coated) {
            (true, _) => Model::Glass,
            _ if self.is_translucent(base, layers) => Model::Translucent,
            (_, true) => Model::Coated,
            _ => Model::MetallicRoughness,
        }
    }

    /// Whether a surface that is not glass transmits diffuse light.
    fn is_translucent(&mut self, base: &Base, layers: &Layers) -> bool {
        let transmits = layers.diffuse_transmission > 0.0;
        let is_metal = base.means[0] >= 0.5;
        self.skipped_if([(transmits && is_metal, "ignored the diffuse transmission of the metal")]);
        transmits && !is_metal
    }

    /// A thin sheet: the diffuse base is divided between reflection by the base color and
    /// transmission by a color of its own.
    fn translucent(
        &mut self,
        base: &Base,
        layers: &Layers,
        picture: Option<Arc<Texture>>,
    ) -> Result<Look> {
        let own = &self.json.extensions.diffuse_transmission;
        let key = |name: &str| format!("extensions.KHR_materials_diffuse_transmission.{name}");
        let factor = layers.diffuse_transmission;
        let name = key("diffuseTransmissionColorFactor");
        let color = self.color(own.diffuse_transmission_color_factor, &name)?;
        let shares =
            self.picture(&own.diffuse_transmission_texture, &key("diffuseTransmissionTexture"))?;
        let name = key("diffuseTransmissionColorTexture");
        let colors = self.picture(&own.diffuse_transmission_color_texture, &name)?;
        let has_volume = self.json.extensions.volume.thickness_factor > 0.0;
        self.skipped_if([
            (base.means[0] > 0.0, "ignored the metal in"),
            (layers.ior > 1.0 && layers.specular != Rgb::ZERO, HIGHLIGHTS),
            (layers.clearcoat >= 0.5, "ignored the clear coat of"),
            (has_volume, "left out the volume behind the thin sheet"),
        ]);
        // All textures share one map: see `uv_source`.
        let paint = |color, texture| Paint { texture, ..Paint::plain(color) };
        let (reflected, transmitted) = (paint(base.color, picture), paint(color, colors));
        let Some(shares) = shares else {
            let scaled = |paint: Paint, share: f32| Paint { color: paint.color * share, ..paint };
            let (reflected, transmitted) =
                (scaled(reflected, 1.0 - factor), scaled(transmitted, factor));
            return Ok(Look::translucent(reflected, transmitted).0);
        };
        let (largest, alphas) =
            picture_of(&shares, |texel| Rgb::splat(f32::from(texel[3]) / 255.0));
        let share = paint(factor * largest, Some(Arc::new(alphas)));
        let rest = |both: &[Rgb]| both[0] * (Rgb::ONE - both[1]);
        let (reflected, _) = Paint::combined(&[&reflected, &share], rest);
        let (transmitted, _) = Paint::combined(&[&transmitted, &share], |both| both[0] * both[1]);
        Ok(Look::translucent(reflected, transmitted).0)
    }

    fn metallic_roughness(&mut self, base: &Base, layers: &Layers) -> Bsdf {
        let Base { color, metalness, roughness, .. } = *base;
        let specular = luminance(layers.specular);
        let is_tinted = metalness < 1.0 && layers.specular != Rgb::splat(specular);
        self.skipped_if([(is_tinted, "used the luminance of the specular color of")]);
        // With the refractive index of air only metal reflects.
        if (layers.ior <= 1.0 || specular == 0.0) && metalness == 0.0 {
            return Bsdf::diffuse(color);
        }
        let glossy = Glossy::new(color, metalness, layers.ior, roughness * roughness);
        Bsdf::Glossy(if specular == 1.0 { glossy } else { glossy.reflecting(specular) })
    }

    /// The color of glass, and its GGX width.
    fn glass(&mut self, base: &Base, picture: Option<&Arc<Texture>>) -> (Rgb, f32) {
        self.skipped_if([(picture.is_some(), "used the mean color of the glass")]);
        let mean = picture.map_or(Rgb::ONE, |picture| picture.mean_color());
        let roughness = base.means[1];
        (base.color * mean, roughness * roughness)
    }

    /// The surface of a volume.
    fn solid_glass(
        &mut self,
        base: &Base,
        layers: &Layers,
        picture: Option<&Arc<Texture>>,
        abbe: f64,
    ) -> Look {
        let (color, alpha) = self.glass(base, picture);
        let mut indices = in_vacuum(layers.ior);
        // By Cauchy's equation. Indices near 1 with much dispersion may fall below the minimum.
        let inside = RefractiveIndex::Abbe { index: layers.ior.into(), abbe }.checked();
        if let Some(inside) = inside.ok().filter(|_| abbe.is_finite()) {
            indices[0] = inside;
        }
        // Light crosses the surface twice.
        Look::dielectric(indices, correlated(alpha), color.map(f32::sqrt))
    }

    /// Glass without a volume.
    fn sheet(&mut self, base: &Base, layers: &Layers, picture: Option<&Arc<Texture>>) -> Look {
        let (color, alpha) = self.glass(base, picture);
        self.skipped_if([(alpha >= SMOOTH_ALPHA, "ignored the roughness of the thin glass")]);
        Look::sheet(layers.ior, color)
    }

    /// The parts of the surface that exist.
    fn covered(&self, picture: Option<&Arc<Texture>>) -> Result<Coverage> {
        let [.., alpha] = self.json.pbr_metallic_roughness.base_color_factor;
        let opacity = self.share(alpha, "pbrMetallicRoughness.baseColorFactor")?;
        let cutoff = self.json.alpha_cutoff.unwrap_or(0.5);
        if !cutoff.is_finite() {
            return Err(self.malformed("alphaCutoff", "it is not finite"));
        }
        match self.json.alpha_mode.as_deref() {
            None | Some("OPAQUE") => Ok(Coverage::Everywhere),
            Some("MASK") => Ok(coverage(picture, opacity, cutoff)),
            Some("BLEND") => Ok(blended(picture, opacity)),
            Some(_) => Err(self.malformed("alphaMode", "it is none of OPAQUE, MASK and BLEND")),
        }
    }

    /// Texture coordinates of the first texture, and whether another texture has other ones.
    fn uv_source(&self) -> Result<(Option<UvSource>, bool)> {
        let pbr = &self.json.pbr_metallic_roughness;
        let transmission = &self.json.extensions.diffuse_transmission;
        let infos = [
            pbr.base_color_texture.as_ref(),
            pbr.metallic_roughness_texture.as_ref(),
            self.json.normal_texture.as_ref().map(|normals| &normals.info),
            self.json.emissive_texture.as_ref(),
            transmission.diffuse_transmission_texture.as_ref(),
            transmission.diffuse_transmission_color_texture.as_ref(),
        ];
        let sources: Vec<UvSource> = infos.into_iter().flatten().map(UvSource::new).collect();
        if sources.iter().any(|uv| !uv.is_finite()) {
            return Err(self.malformed("extensions", "a KHR_texture_transform is not finite"));
        }
        Ok((sources.first().copied(), sources.iter().any(|uv| *uv != sources[0])))
    }
}
