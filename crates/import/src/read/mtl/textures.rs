//! Textures of an MTL file.

use super::map::MapRecord;
use super::material::MtlMaterial;
use crate::file_names::is_guess;
use crate::look::{ONE_MAP, Pictures};
use crate::text::find;
use crate::warnings::GroupedWarnings;
use std::path::Path;
use std::sync::Arc;

/// Phrase of the warning about textures without a use here.
const OTHER_USE: &str = "ignored some textures (of another use) of";

/// Reads each picture of a library once.
pub(super) struct TextureReader<'a> {
    folder: &'a Path,
    pictures: Pictures,
}

impl<'a> TextureReader<'a> {
    /// An empty cache of files relative to `folder`.
    pub fn new(folder: &'a Path) -> Self {
        Self { folder, pictures: Pictures::default() }
    }

    /// Adds the texture of a record, whose keyword is `keyword`, to the material. The last record
    /// of a kind counts.
    pub fn add(
        &mut self,
        keyword: &str,
        text: &str,
        material: &mut MtlMaterial,
        warnings: &mut GroupedWarnings,
    ) {
        let slot = match keyword {
            "map_Kd" => &mut material.albedo_texture,
            "map_d" => &mut material.opacity_texture,
            "map_Ke" => &mut material.emission_texture,
            "norm" => &mut material.normal_texture,
            _ => return warnings.skipped(OTHER_USE, &material.name),
        };
        *slot = None;
        let MapRecord { name, to_uv, sampling, strength, ignored } = MapRecord::parse(text);
        for option in &ignored {
            let option = format!("{keyword} {option} of {}", material.name);
            warnings.skipped("ignored some options of textures:", &option);
        }
        if name.is_empty() {
            return warnings.skipped(OTHER_USE, &material.name);
        }
        let Some(path) = find(self.folder, name) else {
            return warnings.skipped("ignored some textures, for there are no files", name);
        };
        if is_guess(self.folder, name, &path) {
            let guess = format!("{name} as {}", path.display());
            warnings.chosen("found textures under other names:", &guess);
        }
        let is_color = matches!(keyword, "map_Kd" | "map_Ke");
        match self.pictures.codes(&path, is_color) {
            Ok(texture) => {
                *slot = Some(Arc::new(texture.sampled(sampling)));
                if *material.to_uv.get_or_insert(to_uv) != to_uv {
                    warnings.skipped(ONE_MAP, &material.name);
                }
                if keyword == "norm" {
                    material.normal_scale = Some(strength);
                }
            }
            Err(error) => warnings.unreadable(format!("{name}: {}", error.problem())),
        }
    }
}
