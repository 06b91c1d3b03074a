//! `[materials.NAME]`.

use super::klems::BsdfFiles;
use super::media::MediumTables;
use super::numbers::{color, inverse, number, point, roughness};
use super::textures::TextureFiles;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::base::names::{Names, for_line};
use bdpm_core::scene::bsdf::{
    Bsdf, Conductor, DiffuseTransmission, FacetModel, Glossy, Plastic, PrincipledParameters,
    Reflectance,
};
use bdpm_core::scene::{Material, RefractiveIndex};
use std::fmt::Write;

/// All materials, with unique names.
pub(super) struct MaterialTables<'a> {
    materials: &'a [Material],
    names: Vec<String>,
    media: &'a MediumTables<'a>,
}

impl<'a> MaterialTables<'a> {
    pub fn new(materials: &'a [Material], media: &'a MediumTables<'a>) -> Self {
        let mut names = Names::default();
        let name = |material: &Material| names.unique(for_line(&material.name, "material"));
        Self { materials, names: materials.iter().map(name).collect(), media }
    }

    /// The name of the material of this index as a string or a key.
    pub fn quoted(&self, index: u32) -> String {
        format!("\"{}\"", self.names[index as usize])
    }

    /// All tables.
    pub fn tables(&self, textures: &mut TextureFiles<'a>, bsdfs: &mut BsdfFiles) -> Result<String> {
        let mut text = String::new();
        for (material, name) in self.materials.iter().zip(&self.names) {
            let is_bare = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
            let key = if name.chars().all(is_bare) { name.clone() } else { format!("\"{name}\"") };
            let _ = write!(text, "\n[materials.{key}]\n");
            text += &keys(material).map_err(|problem| {
                let problem = format!("the material `{name}` cannot be written: {problem}");
                Error::new(problem, "change it in the original scene")
            })?;
            if let Bsdf::Klems(sheet) = &material.bsdf {
                let _ = writeln!(text, "file = \"{}\"", bsdfs.name(sheet.matrices(), name));
            }
            text += &self.media.keys(material.boundary.as_ref());
            text += &self::textures(material, name, textures);
        }
        Ok(text)
    }
}

/// The keys of a material without textures. The error is a property that scene files cannot
/// represent.
fn keys(material: &Material) -> std::result::Result<String, String> {
    let text = match material.bsdf {
        Bsdf::Lambertian { albedo, two_sided } => {
            let sides = if two_sided { "" } else { "two_sided = false\n" };
            format!("type = \"lambertian\"\nalbedo = {}\n{sides}", color(albedo))
        }
        Bsdf::Mirror { reflectance } => {
            format!("type = \"mirror\"\nreflectance = {}\n", color(reflectance))
        }
        bsdf if material.boundary.is_some() && bsdf.is_index_matched() => {
            "type = \"boundary\"\n".to_owned()
        }
        Bsdf::Dielectric(interface) => {
            let tint = transmittance(interface.transmittance);
            format!("type = \"dielectric\"\n{}{tint}", media(material, interface.eta)?)
        }
        Bsdf::RoughDielectric(interface) => {
            let indices = media(material, interface.eta())?;
            let tint = transmittance(interface.transmittance());
            let facets = facets(interface.model());
            let rough = roughness(interface.alpha());
            format!("type = \"dielectric\"\n{indices}{rough}{facets}{tint}")
        }
        Bsdf::ThinDielectric(sheet) => {
            let mut tint = transmittance(sheet.transmittance);
            if sheet.internal != Rgb::ONE {
                let _ = writeln!(tint, "internal_transmittance = {}", color(sheet.internal));
            }
            format!("type = \"thin-dielectric\"\nior = {}\n{tint}", number(sheet.eta))
        }
        Bsdf::Conductor(metal) => conductor(&metal),
        Bsdf::Coated(coated) => {
            let (albedo, ior) = (color(coated.albedo()), number(coated.eta()));
            format!("type = \"coated\"\nalbedo = {albedo}\nior = {ior}\n")
        }
        Bsdf::DiffuseTransmission(own) => sheet(material, &own),
        Bsdf::Klems(sheet) => format!("type = \"klems\"\nup = {}\n", point(sheet.up())),
        Bsdf::Plastic(surface) => plastic(&surface)?,
        Bsdf::Principled(surface) => principled(surface.parameters())?,
        Bsdf::Glossy(glossy) => {
            let (albedo, metallic) = (color(glossy.albedo()), number(glossy.metallic()));
            let ior = glossy_ior(&glossy).ok_or("its refractive index is lost")?;
            format!(
                "type = \"glossy\"\nalbedo = {albedo}\nior = {}\nmetallic = {metallic}\n{}",
                number(ior),
                roughness(glossy.alpha())
            )
        }
    };
    Ok(text + &surface(material))
}

/// The keys that materials of all types have.
fn surface(material: &Material) -> String {
    let mut text = String::new();
    if material.emission != Rgb::ZERO || material.emission_texture.is_some() {
        let _ = writeln!(text, "emission = {}", color(material.emission));
    }
    if material.two_sided_emission {
        text += "two_sided_emission = true\n";
    }
    if material.hidden_from_camera {
        text += "hidden = true\n";
    }
    if let Some(opacity) = material.opacity {
        let _ = writeln!(text, "opacity = {}", number(opacity));
    }
    text
}

/// The keys of a sheet that transmits diffusely. Factors of textures may have any sum, shares at
/// most 1.
fn sheet(material: &Material, sheet: &DiffuseTransmission) -> String {
    let is_textured = material.albedo_texture.is_some() || material.transmittance_texture.is_some();
    let [reflectance, transmittance] =
        if is_textured { [sheet.reflectance(), sheet.transmittance()] } else { sheet.shares() };
    let (reflectance, transmittance) = (color(reflectance), color(transmittance));
    format!(
        "type = \"diffuse-transmission\"\nreflectance = {reflectance}\n\
         transmittance = {transmittance}\n"
    )
}

/// The keys of a metal.
fn conductor(metal: &Conductor) -> String {
    let look = reflectance(metal.reflectance());
    let single = metal.single().map(|(model, tint)| {
        let tinted = tint != Rgb::ONE;
        let tint = if tinted { format!("tint = {}\n", color(tint)) } else { String::new() };
        format!("{}{tint}", facets(model))
    });
    let rough = roughness(metal.alpha());
    format!("type = \"metal\"\n{look}{rough}{}", single.unwrap_or_default())
}

/// The keys of a plastic.
fn plastic(plastic: &Plastic) -> std::result::Result<String, String> {
    let (albedo, tint, width) = (plastic.albedo(), plastic.tint(), plastic.facets());
    let mut text = format!("type = \"plastic\"\nalbedo = {}\n", color(albedo));
    text += &indices(plastic.eta())?;
    if width.alpha > 0.0 {
        text += &roughness(width.alpha);
        text += facets(width.model);
    }
    if tint != Rgb::ONE {
        let _ = writeln!(text, "tint = {}", color(tint));
    }
    if plastic.is_nonlinear() {
        text += "nonlinear = true\n";
    }
    Ok(text)
}

/// The keys of a principled surface, without those that have their defaults.
fn principled(parameters: &PrincipledParameters) -> std::result::Result<String, String> {
    let PrincipledParameters { base_color, roughness, eta, .. } = *parameters;
    let mut text = format!("type = \"principled\"\nalbedo = {}\n", color(base_color));
    text += &indices(eta)?;
    let _ = writeln!(text, "roughness = {}", number(roughness));
    for (key, value) in [
        ("anisotropic", parameters.anisotropic),
        ("metallic", parameters.metallic),
        ("transmission", parameters.spec_trans),
        ("specular_tint", parameters.spec_tint),
        ("sheen", parameters.sheen),
        ("sheen_tint", parameters.sheen_tint),
        ("flatness", parameters.flatness),
        ("clearcoat", parameters.clearcoat),
        ("clearcoat_gloss", parameters.clearcoat_gloss),
    ] {
        if value != 0.0 {
            let _ = writeln!(text, "{key} = {}", number(value));
        }
    }
    if !parameters.two_sided {
        text += "two_sided = false\n";
    }
    Ok(text)
}

/// The key of facets that scatter once.
fn facets(model: FacetModel) -> &'static str {
    match model {
        FacetModel::Correlated => "",
        FacetModel::Ggx => "facets = \"ggx\"\n",
        FacetModel::Beckmann => "facets = \"beckmann\"\n",
    }
}

/// The key of glass that is not clear.
fn transmittance(share: Rgb) -> String {
    if share == Rgb::ONE { String::new() } else { format!("transmittance = {}\n", color(share)) }
}

/// The textures that have an effect.
fn textures<'a>(material: &'a Material, name: &str, textures: &mut TextureFiles<'a>) -> String {
    let glossy = matches!(material.bsdf, Bsdf::Glossy(_) | Bsdf::Principled(_));
    let is_based =
        matches!(material.bsdf, Bsdf::Lambertian { .. } | Bsdf::Coated(_) | Bsdf::Plastic(_));
    let tinted = glossy || is_based;
    let normals = material.normal_map.as_ref();
    let albedo = material.albedo_texture.as_ref().filter(|_| tinted);
    let is_sheet = matches!(material.bsdf, Bsdf::DiffuseTransmission(_));
    let reflectance = material.albedo_texture.as_ref().filter(|_| is_sheet);
    let transmittance = material.transmittance_texture.as_ref().filter(|_| is_sheet);
    let data = material.metallic_roughness_texture.as_ref().filter(|_| glossy);
    let mut text = String::new();
    for (part, key, texture) in [
        ("albedo", "albedo_texture", albedo),
        ("reflectance", "reflectance_texture", reflectance),
        ("transmittance", "transmittance_texture", transmittance),
        ("metallic-roughness", "metallic_roughness_texture", data),
        ("opacity", "opacity_texture", material.opacity_texture.as_ref()),
        ("normal", "normal_texture", normals.map(|map| &map.texture)),
        ("emission", "emission_texture", material.emission_texture.as_ref()),
    ] {
        if let Some(texture) = texture {
            let _ = writeln!(text, "{key} = {}", textures.value(texture, name, part));
        }
    }
    if let Some(map) = normals.filter(|map| map.scale != 1.0) {
        let _ = writeln!(text, "normal_scale = {}", number(map.scale));
    }
    text
}

/// Indices of both media of a dielectric.
fn media(material: &Material, eta: f32) -> std::result::Result<String, String> {
    let Some(dispersion) = &material.dispersion else { return indices(eta) };
    let mut text = format!("ior = {}\n", medium(dispersion.inside()));
    if *dispersion.outside() != RefractiveIndex::Constant(1.0) {
        let _ = writeln!(text, "outside_ior = {}", medium(dispersion.outside()));
    }
    Ok(text)
}

/// The value of a key of a refractive index.
fn medium(index: &RefractiveIndex) -> String {
    let list = |values: &[f64]| {
        let values: Vec<String> = values.iter().map(|value| format!("{value:?}")).collect();
        format!("[{}]", values.join(", "))
    };
    match index {
        RefractiveIndex::Constant(index) => format!("{index:?}"),
        RefractiveIndex::Glass(_) => format!("\"{}\"", index.name().unwrap_or_default()),
        RefractiveIndex::Cauchy(terms) => format!("{{ cauchy = {} }}", list(terms)),
        RefractiveIndex::Sellmeier(terms) => {
            let pairs: Vec<String> = terms.iter().map(|pair| list(pair)).collect();
            format!("{{ sellmeier = [{}] }}", pairs.join(", "))
        }
        RefractiveIndex::Abbe { index, abbe } => format!("{{ d = {index:?}, abbe = {abbe:?} }}"),
        RefractiveIndex::Table(rows) => {
            let column = |i: usize| list(&rows.iter().map(|row| row[i]).collect::<Vec<_>>());
            format!("{{ nanometers = {}, values = {} }}", column(0), column(1))
        }
    }
}

/// `ior`, and `outside_ior` if the quotient of both exceeds the bounds of one key.
fn indices(eta: f32) -> std::result::Result<String, String> {
    if (0.1..=10.0).contains(&eta) {
        return Ok(format!("ior = {}\n", number(eta)));
    }
    let outside = if eta > 1.0 { 0.1 } else { 10.0 };
    let ior = inverse(eta, eta * outside, |ior| ior / outside);
    let ior = ior.filter(|ior| (0.1..=10.0).contains(ior));
    let ior = ior.ok_or(format!("its relative refractive index is {eta}"))?;
    Ok(format!("ior = {}\noutside_ior = {}\n", number(ior), number(outside)))
}

/// The refractive index with the reflectance at normal incidence of `glossy`.
fn glossy_ior(glossy: &Glossy) -> Option<f32> {
    let normal = glossy.normal_reflectance();
    let root = normal.sqrt();
    let reflectance = |ior: f32| Glossy::new(Rgb::ONE, 0.0, ior, 1.0).normal_reflectance();
    let guess = (1.0 + root) / (1.0 - root);
    let found = inverse(normal, guess, reflectance).filter(|ior| *ior <= 10.0);
    found.or_else(|| inverse(normal, 1.0 / guess, reflectance)).filter(|ior| *ior >= 0.1)
}

fn reflectance(reflectance: Reflectance) -> String {
    let name = Reflectance::NAMES.iter().find(|name| Reflectance::named(name) == Some(reflectance));
    match (reflectance, name) {
        (_, Some(name)) => format!("metal = \"{name}\"\n"),
        (Reflectance::Measured { eta, k }, _) => {
            format!("eta = {}\nk = {}\n", color(eta), color(k))
        }
        (Reflectance::Artist { normal }, _) => format!("reflectance = {}\n", color(normal)),
    }
}
