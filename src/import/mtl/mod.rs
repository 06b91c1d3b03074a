//! Reads material libraries (MTL).

pub(super) mod material;

use super::lines::Lines;
use super::text::{find, list, problems, read_lines, split_keyword};
use super::warnings::Warning;
use crate::base::error::Result;
use crate::base::math::Rgb;
use crate::scene::bsdf::Bsdf;
use crate::scene::{Material, Texture};
use material::MtlMaterial;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

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
    materials: &mut BTreeMap<String, Material>,
    notes: &mut Vec<Warning>,
) -> Result<()> {
    let text = read_lines(path)?;
    let mut lines = Lines::new(path, &text);
    let mut current: Option<MtlMaterial> = None;
    let mut ignored = Notes::default();
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
        let known = ["Kd", "Ks", "Ke", "Ns", "Ni", "d", "Tr", "illum", "Pr", "Pm"];
        let is_map = keyword.starts_with("map_") || keyword == "norm";
        if !known.contains(&keyword) && !is_map {
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
            "illum" => material.model = Some(number(&lines, rest, 0.0, 10.0)? as u8),
            _ => {}
        }
        let map = match keyword {
            "map_Kd" => Some(&mut material.albedo_texture),
            "map_d" => Some(&mut material.opacity_texture),
            "map_Ke" => Some(&mut material.emission_texture),
            "norm" => Some(&mut material.normal_texture),
            _ => None,
        };
        match map {
            Some(map) if !rest.is_empty() && !rest.starts_with('-') => match texture(path, rest) {
                Some(Ok(texture)) => *map = Some(texture),
                Some(Err(error)) => {
                    *map = None;
                    ignored.unreadable.insert(format!("{rest}: {}", error.problem()));
                }
                None => {
                    *map = None;
                    ignored.missing.insert(rest.to_owned());
                }
            },
            _ if is_map => drop(ignored.textures.insert(material.name.clone())),
            _ => {}
        }
    }
    if let Some(done) = current {
        ignored.finish(done, materials);
    }
    if !ignored.unreadable.is_empty() {
        let all = problems(ignored.unreadable.iter().map(String::as_str));
        let note = format!("{}: ignored some textures: {all}", path.display());
        notes.push(Warning::skipped(note));
    }
    for (names, what) in [
        (ignored.twice, "all but the last definition of"),
        (ignored.missing, "some textures, for there are no files"),
        (ignored.textures, "some textures (of another use, or with options) of"),
        (ignored.highlights, "the highlights (`Ks` with `Kd`) of"),
        (ignored.transparent, "the opacity of 0 of"),
    ] {
        if !names.is_empty() {
            let names = list(names.iter().map(String::as_str));
            let note = format!("{}: ignored {what} {names}", path.display());
            notes.push(Warning::skipped(note));
        }
    }
    Ok(())
}

/// Names of the materials and textures that warnings mention.
#[derive(Default)]
struct Notes {
    /// Materials with several definitions.
    twice: BTreeSet<String>,
    /// Textures that do not exist.
    missing: BTreeSet<String>,
    /// Textures that cannot be read, each with the reason.
    unreadable: BTreeSet<String>,
    /// Materials with textures of an unsupported kind.
    textures: BTreeSet<String>,
    /// Materials whose highlight was ignored.
    highlights: BTreeSet<String>,
    /// Materials whose opacity of 0 was ignored.
    transparent: BTreeSet<String>,
}

impl Notes {
    /// Adds a material after its last record.
    fn finish(&mut self, records: MtlMaterial, materials: &mut BTreeMap<String, Material>) {
        let (material, ignored) = records.material();
        if ignored.highlight {
            self.highlights.insert(material.name.clone());
        }
        if ignored.transparency {
            self.transparent.insert(material.name.clone());
        }
        materials.insert(material.name.clone(), material);
    }
}

/// Loads the texture of this file name. Returns `None` if there is no such file.
fn texture(library: &Path, name: &str) -> Option<Result<Arc<Texture>>> {
    let path = find(library.parent().unwrap_or(Path::new("")), name)?;
    Some(Texture::load(&path).map(Arc::new))
}

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
