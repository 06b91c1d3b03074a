//! Material libraries (MTL): the diffuse color `Kd` and the emission `Ke`.
//!
//! Read here and not through `tobj`, which panics when a color has fewer than three numbers and
//! knows no lines.

use crate::bsdf::Bsdf;
use crate::error::Result;
use crate::math::Rgb;
use crate::scene::Material;
use crate::scene::text::{Lines, list, split_keyword};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Reflected share of light where nothing else is said.
pub(super) const DEFAULT_ALBEDO: f32 = 0.5;

/// A material that only reflects.
pub(super) fn grey(name: &str) -> Material {
    let bsdf = Bsdf::diffuse(Rgb::splat(DEFAULT_ALBEDO));
    Material { name: name.to_owned(), bsdf, emission: Rgb::ZERO }
}

/// Adds the materials of a library to those read before. Notes tell what was ignored.
///
/// # Errors
/// If the file cannot be read, a color is malformed, or a name is taken.
pub(super) fn load(
    path: &Path,
    materials: &mut BTreeMap<String, Material>,
    notes: &mut Vec<String>,
) -> Result<()> {
    let mut lines = Lines::open(path)?;
    let mut current: Option<Material> = None;
    let mut textures = BTreeSet::new();
    let mut transparent = BTreeSet::new();
    while lines.advance()? {
        let (keyword, rest) = split_keyword(lines.line());
        if keyword == "newmtl" {
            if let Some(done) = current.take() {
                materials.insert(done.name.clone(), done);
            }
            if rest.is_empty() {
                return Err(lines.error("the material has no name", "write a name after `newmtl`"));
            }
            if materials.contains_key(rest) {
                return Err(lines.error(
                    format!("the material `{rest}` is defined twice"),
                    "rename or remove one of the two",
                ));
            }
            current = Some(grey(rest));
            continue;
        }
        if !matches!(keyword, "Kd" | "Ke" | "d" | "Tr") && !keyword.starts_with("map_") {
            continue;
        }
        let Some(material) = &mut current else {
            return Err(lines.error(
                format!("`{keyword}` comes before any material"),
                "begin each material with `newmtl` and its name",
            ));
        };
        match keyword {
            "Kd" => {
                let color = color(&lines, rest)?;
                if color.max_element() > 1.0 {
                    notes.push(format!(
                        "{}:{}: the diffuse color {color} is above 1 and was clamped",
                        path.display(),
                        lines.number()
                    ));
                }
                material.bsdf = Bsdf::diffuse(color.min(Rgb::ONE));
            }
            "Ke" => material.emission = color(&lines, rest)?,
            "d" if rest.parse::<f32>().is_ok_and(|opacity| opacity < 1.0) => {
                transparent.insert(material.name.clone());
            }
            "Tr" if rest.parse::<f32>().is_ok_and(|transparency| transparency > 0.0) => {
                transparent.insert(material.name.clone());
            }
            "map_Kd" | "map_Ke" | "map_d" => {
                textures.insert(material.name.clone());
            }
            _ => {}
        }
    }
    if let Some(done) = current {
        materials.insert(done.name.clone(), done);
    }
    let mut ignored = |names: BTreeSet<String>, what: &str| {
        if !names.is_empty() {
            let names = list(names.iter().map(String::as_str));
            notes.push(format!("{}: ignored {what} of {names}", path.display()));
        }
    };
    ignored(textures, "the textures");
    ignored(transparent, "the transparency");
    Ok(())
}

/// Three numbers, or one for all channels.
fn color(lines: &Lines, text: &str) -> Result<Rgb> {
    let keyword = split_keyword(lines.line()).0;
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
