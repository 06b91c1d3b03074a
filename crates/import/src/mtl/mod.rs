//! Reads material libraries (MTL).

mod map;
pub(super) mod material;
mod notes;
mod textures;

use super::lines::Lines;
use super::text::{read_lines, split_keyword};
use super::warnings::Warning;
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::Material;
use bdpm_core::scene::bsdf::Bsdf;
use glam::Affine2;
use material::MtlMaterial;
use notes::Notes;
use std::collections::BTreeMap;
use std::path::Path;
use textures::TextureReader;

/// A material of a library.
#[derive(Clone, Debug)]
pub(super) struct LibraryMaterial {
    pub material: Material,
    /// Map from the texture coordinates of meshes to those of the material's pictures.
    pub to_uv: Affine2,
}

/// Albedo of a material whose file gives none.
pub(super) const DEFAULT_ALBEDO: f32 = 0.5;

/// Returns a diffuse material of the default albedo.
pub(super) fn grey(name: &str) -> Material {
    let bsdf = Bsdf::diffuse(Rgb::splat(DEFAULT_ALBEDO));
    Material::new(name, bsdf)
}

/// Adds the materials of a library to those of earlier ones, and warnings about ignored content.
///
/// # Errors
/// If the file cannot be read, or a color is malformed.
pub(super) fn load(
    path: &Path,
    materials: &mut BTreeMap<String, LibraryMaterial>,
    notes: &mut Vec<Warning>,
) -> Result<()> {
    let text = read_lines(path)?;
    let mut lines = Lines::new(path, &text);
    let mut current: Option<MtlMaterial> = None;
    let mut ignored = Notes::default();
    let mut textures = TextureReader::new(path.parent().unwrap_or(Path::new("")));
    let maps = ["norm", "bump", "disp", "decal", "refl"];
    while lines.advance()? {
        let line = lines.text();
        let (keyword, rest) = split_keyword(&line);
        if keyword == "newmtl" {
            if let Some(done) = current.take() {
                ignored.finish(done, materials);
            }
            if rest.is_empty() {
                return Err(lines.error("the material has no name", "write a name after `newmtl`"));
            }
            if materials.contains_key(rest) {
                ignored.twice.insert(rest.to_owned());
            }
            current = Some(MtlMaterial { name: rest.to_owned(), ..MtlMaterial::default() });
            continue;
        }
        if keyword.is_empty() || keyword.starts_with('#') {
            continue;
        }
        let map = maps.contains(&keyword) || keyword.starts_with("map_");
        if !(map || KNOWN.contains(&keyword)) {
            if !INVISIBLE.contains(&keyword) && ignored.unknown.len() < MAX_UNKNOWN {
                ignored.unknown.insert(keyword.to_owned());
            }
            continue;
        }
        let Some(material) = &mut current else {
            return Err(lines.error(
                format!("`{keyword}` comes before any material"),
                "begin each material with `newmtl` and its name",
            ));
        };
        match keyword {
            "Kd" => material.diffuse = Some(reflectance(&lines, rest, path, notes)?),
            "Ks" => material.specular = Some(reflectance(&lines, rest, path, notes)?),
            "Ke" => material.emission = Some(color(&lines, rest)?),
            "Ns" => material.exponent = Some(number(&lines, rest, 0.0, 1e9)?),
            "Ni" => material.ior = Some(number(&lines, rest, 0.0, 10.0)?),
            "Pr" => material.roughness = Some(number(&lines, rest, 0.0, 1.0)?),
            "Pm" => material.metalness = Some(number(&lines, rest, 0.0, 1.0)?),
            "d" => material.opacity = Some(number(&lines, rest, 0.0, 1.0)?),
            "Tr" => material.opacity = Some(1.0 - number(&lines, rest, 0.0, 1.0)?),
            // Some programs write a spectrum or a color in XYZ.
            "Tf" => material.filter = color(&lines, rest).ok().filter(|own| own.is_finite()),
            "illum" => material.model = Some(number(&lines, rest, 0.0, 10.0)? as u8),
            _ => {}
        }
        if map {
            textures.add(keyword, rest, material, &mut ignored);
        }
    }
    if let Some(done) = current {
        ignored.finish(done, materials);
    }
    ignored.into_warnings(path, notes);
    Ok(())
}

/// Records without a texture that are read.
const KNOWN: [&str; 11] = ["Kd", "Ks", "Ke", "Ns", "Ni", "d", "Tr", "Tf", "illum", "Pr", "Pm"];

/// Records that do not change the image: ambient light, and the sharpness of reflections of maps.
const INVISIBLE: [&str; 4] = ["Ka", "Km", "sharpness", "newmtl"];

/// Maximum number of unknown records in the warning.
const MAX_UNKNOWN: usize = 8;

/// Parses a number within bounds and ignores the rest of the line.
fn number(lines: &Lines, text: &str, low: f32, high: f32) -> Result<f32> {
    let line = lines.text();
    let keyword = split_keyword(&line).0;
    // The standard has `d -halo 0.5`, an opacity that depends on the angle. The option is ignored.
    let text = text.strip_prefix("-halo").unwrap_or(text);
    let number = text.split_whitespace().next().and_then(|word| word.parse::<f32>().ok());
    number.filter(|number| (low..=high).contains(number)).ok_or_else(|| {
        lines.error(
            format!("`{keyword}` is no number from {low} to {high}"),
            format!("write one, such as `{keyword} {}`", if high > 1.0 { "2" } else { "0.5" }),
        )
    })
}

/// Parses a color and clamps it to 1, with a warning.
fn reflectance(lines: &Lines, text: &str, path: &Path, notes: &mut Vec<Warning>) -> Result<Rgb> {
    let color = color(lines, text)?;
    if color.max_element() > 1.0 {
        let what = match split_keyword(&lines.text()).0 {
            "Ks" => "specular",
            _ => "diffuse",
        };
        let (path, line) = (path.display(), lines.number());
        let note = format!("{path}:{line}: the {what} color {color} is above 1 and was clamped");
        notes.push(Warning::skipped(note));
    }
    Ok(color.min(Rgb::ONE))
}

/// Parses three numbers, or one for all channels.
fn color(lines: &Lines, text: &str) -> Result<Rgb> {
    let line = lines.text();
    let keyword = split_keyword(&line).0;
    let numbers: Option<Vec<f32>> =
        text.split_whitespace().take(4).map(|w| w.parse().ok()).collect();
    let color = match numbers.as_deref() {
        Some(&[grey]) => Rgb::splat(grey),
        Some(&[r, g, b]) => Rgb::new(r, g, b),
        _ => {
            return Err(lines.error(
                format!("`{keyword}` needs three numbers"),
                format!("write red, green and blue, such as `{keyword} 0.5 0.5 0.5`"),
            ));
        }
    };
    if !(color.is_finite() && color.min_element() >= 0.0) {
        return Err(lines.error(
            format!("`{keyword}` is negative or not finite"),
            "give finite numbers of at least 0",
        ));
    }
    Ok(color)
}
