//! Textures of an MTL file.

use super::map::MapRecord;
use super::material::MtlMaterial;
use super::notes::Notes;
use crate::file_names::is_guess;
use crate::text::find;
use bdpm_core::base::error::Result;
use bdpm_core::scene::Texture;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Reads each picture of a library once.
pub(super) struct TextureReader<'a> {
    folder: &'a Path,
    /// By path, and whether the texture holds colors.
    read: HashMap<(PathBuf, bool), Result<Texture>>,
}

impl<'a> TextureReader<'a> {
    /// An empty cache of files relative to `folder`.
    pub fn new(folder: &'a Path) -> Self {
        Self { folder, read: HashMap::new() }
    }

    /// Adds the texture of a record, whose keyword is `keyword`, to the material.
    pub fn add(
        &mut self,
        keyword: &str,
        text: &str,
        material: &mut MtlMaterial,
        notes: &mut Notes,
    ) {
        let slot = match keyword {
            "map_Kd" => &mut material.albedo_texture,
            "map_d" => &mut material.opacity_texture,
            "map_Ke" => &mut material.emission_texture,
            "norm" => &mut material.normal_texture,
            _ => {
                notes.textures.insert(material.name.clone());
                return;
            }
        };
        let record = MapRecord::parse(text);
        for option in &record.ignored {
            notes.options.insert(format!("{keyword} {option} of {}", material.name));
        }
        // The last record of a kind counts.
        *slot = None;
        if record.name.is_empty() {
            notes.textures.insert(material.name.clone());
            return;
        }
        let Some(path) = find(self.folder, record.name) else {
            notes.missing.insert(record.name.to_owned());
            return;
        };
        if is_guess(self.folder, record.name, &path) {
            notes.guessed.insert(format!("{} as {}", record.name, path.display()));
        }
        let is_color = matches!(keyword, "map_Kd" | "map_Ke");
        let load =
            if is_color { crate::texture_file::load_colors } else { crate::texture_file::load };
        let read = self.read.entry((path, is_color)).or_insert_with_key(|(path, _)| load(path));
        match read {
            Ok(texture) => {
                *slot = Some(Arc::new(texture.clone().sampled(record.sampling)));
                let first = *material.to_uv.get_or_insert(record.to_uv);
                if first != record.to_uv {
                    notes.mappings.insert(material.name.clone());
                }
                if keyword == "norm" {
                    material.normal_scale = Some(record.strength);
                }
            }
            Err(error) => {
                notes.unreadable.insert(format!("{}: {}", record.name, error.problem()));
            }
        }
    }
}
