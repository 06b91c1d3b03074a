//! Reads material libraries (MTL).

mod map;
mod material;
mod textures;

use super::obj::Looks;
use crate::lines::Lines;
use crate::text::{read_lines, split_keyword};
use crate::warnings::{GroupedWarnings, Warning};
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use material::MtlMaterial;
use std::collections::BTreeSet;
use std::path::Path;
use textures::TextureReader;

/// Adds the materials of a library to those of earlier ones, and warnings about ignored content.
///
/// # Errors
/// If the file cannot be read, or a color is malformed.
pub(super) fn load(path: &Path, looks: &mut Looks, warnings: &mut Vec<Warning>) -> Result<()> {
    let text = read_lines(path)?;
    let mut library = Library {
        lines: Lines::new(path, &text),
        textures: TextureReader::new(path.parent().unwrap_or(Path::new(""))),
        current: None,
        unknown: BTreeSet::new(),
        clamped: Vec::new(),
        warnings: GroupedWarnings::default(),
    };
    while library.lines.advance()? {
        library.record(looks)?;
    }
    library.finish(looks);
    let Library { clamped, unknown, warnings: mut grouped, .. } = library;
    unknown.iter().for_each(|record| grouped.skipped("ignored the records", record));
    warnings.extend(clamped.into_iter().map(Warning::skipped));
    warnings.extend(grouped.into_warnings(&path.display().to_string()));
    Ok(())
}

/// A library that is being read.
struct Library<'a> {
    lines: Lines<'a>,
    textures: TextureReader<'a>,
    /// The material of the records that follow.
    current: Option<MtlMaterial>,
    /// The first records that are not known.
    unknown: BTreeSet<String>,
    /// Texts about colors above 1, with their lines.
    clamped: Vec<String>,
    warnings: GroupedWarnings,
}

/// Records without a texture that are read.
const KNOWN: [&str; 11] = ["Kd", "Ks", "Ke", "Ns", "Ni", "d", "Tr", "Tf", "illum", "Pr", "Pm"];

/// Records of textures besides those that begin with `map_`.
const MAPS: [&str; 5] = ["norm", "bump", "disp", "decal", "refl"];

/// Records that do not change the image: ambient light, and the sharpness of reflections of maps.
const INVISIBLE: [&str; 3] = ["Ka", "Km", "sharpness"];

/// Maximum number of unknown records in the warning.
const MAX_UNKNOWN: usize = 8;

impl Library<'_> {
    fn record(&mut self, looks: &mut Looks) -> Result<()> {
        let line = self.lines.text().into_owned();
        let (keyword, rest) = split_keyword(&line);
        let is_map = MAPS.contains(&keyword) || keyword.starts_with("map_");
        match keyword {
            "newmtl" => return self.begin(rest, looks),
            _ if is_map || KNOWN.contains(&keyword) => {}
            _ => {
                let is_ignored = keyword.is_empty() || keyword.starts_with('#');
                let is_invisible = is_ignored || INVISIBLE.contains(&keyword);
                if !is_invisible && self.unknown.len() < MAX_UNKNOWN {
                    self.unknown.insert(keyword.to_owned());
                }
                return Ok(());
            }
        }
        let Some(material) = &mut self.current else {
            return Err(self.lines.error(
                format!("`{keyword}` comes before any material"),
                "begin each material with `newmtl` and its name",
            ));
        };
        if is_map {
            self.textures.add(keyword, rest, material, &mut self.warnings);
            return Ok(());
        }
        let value = Value { lines: &self.lines, keyword, text: rest };
        match keyword {
            "Kd" => material.diffuse = Some(value.reflectance("diffuse", &mut self.clamped)?),
            "Ks" => material.specular = Some(value.reflectance("specular", &mut self.clamped)?),
            "Ke" => material.emission = Some(value.color()?),
            "Ns" => material.exponent = Some(value.number(0.0, 1e9)?),
            "Ni" => material.ior = Some(value.number(0.0, 10.0)?),
            "Pr" => material.roughness = Some(value.number(0.0, 1.0)?),
            "Pm" => material.metalness = Some(value.number(0.0, 1.0)?),
            "d" => material.opacity = Some(value.number(0.0, 1.0)?),
            "Tr" => material.opacity = Some(1.0 - value.number(0.0, 1.0)?),
            // Some programs write a spectrum or a color in XYZ.
            "Tf" => material.filter = value.color().ok().filter(|own| own.is_finite()),
            _ => material.model = Some(value.number(0.0, 10.0)? as u8),
        }
        Ok(())
    }

    /// Begins the material `name`.
    fn begin(&mut self, name: &str, looks: &mut Looks) -> Result<()> {
        self.finish(looks);
        if name.is_empty() {
            let advice = "write a name after `newmtl`";
            return Err(self.lines.error("the material has no name", advice));
        }
        if looks.contains_key(name) {
            self.warnings.skipped("ignored all but the last definition of", name);
        }
        self.current = Some(MtlMaterial { name: name.to_owned(), ..MtlMaterial::default() });
        Ok(())
    }

    /// Adds the current material.
    fn finish(&mut self, looks: &mut Looks) {
        if let Some(material) = self.current.take() {
            let look = material.look(&mut self.warnings);
            looks.insert(material.name, look);
        }
    }
}

/// The value of a record.
struct Value<'a> {
    lines: &'a Lines<'a>,
    keyword: &'a str,
    text: &'a str,
}

impl Value<'_> {
    /// A number within bounds; the rest of the line has no effect.
    fn number(&self, low: f32, high: f32) -> Result<f32> {
        let keyword = self.keyword;
        // The standard has `d -halo 0.5`, an opacity that depends on the angle. The option is
        // ignored.
        let text = self.text.strip_prefix("-halo").unwrap_or(self.text);
        let number = text.split_whitespace().next().and_then(|word| word.parse::<f32>().ok());
        number.filter(|number| (low..=high).contains(number)).ok_or_else(|| {
            self.lines.error(
                format!("`{keyword}` is no number from {low} to {high}"),
                format!("write one, such as `{keyword} {}`", if high > 1.0 { "2" } else { "0.5" }),
            )
        })
    }

    /// A color, clamped to 1 with a warning.
    fn reflectance(&self, name: &str, clamped: &mut Vec<String>) -> Result<Rgb> {
        let color = self.color()?;
        if color.max_element() > 1.0 {
            let place = self.lines.place();
            clamped.push(format!("{place}: the {name} color {color} is above 1 and was clamped"));
        }
        Ok(color.min(Rgb::ONE))
    }

    /// Three numbers, or one for all channels.
    fn color(&self) -> Result<Rgb> {
        let keyword = self.keyword;
        let numbers: Option<Vec<f32>> =
            self.text.split_whitespace().take(4).map(|word| word.parse().ok()).collect();
        let color = match numbers.as_deref() {
            Some(&[grey]) => Rgb::splat(grey),
            Some(&[r, g, b]) => Rgb::new(r, g, b),
            _ => {
                return Err(self.lines.error(
                    format!("`{keyword}` needs three numbers"),
                    format!("write red, green and blue, such as `{keyword} 0.5 0.5 0.5`"),
                ));
            }
        };
        if !(color.is_finite() && color.min_element() >= 0.0) {
            return Err(self.lines.error(
                format!("`{keyword}` is negative or not finite"),
                "give finite numbers of at least 0",
            ));
        }
        Ok(color)
    }
}
