//! Textures of `[materials.NAME]`: a file, or a file with its sampling.

use crate::look::Pictures;
use bdpm_core::base::error::Error;
use bdpm_core::scene::{Sampling, Texture, Wrap};
use serde::de::{self, MapAccess, SeqAccess, value::MapAccessDeserializer};
use serde::{Deserialize, Deserializer};
use std::fmt;
use std::path::Path;
use std::sync::Arc;

/// `"FILE"`, or `{ file = "FILE", wrap = ..., filter = ... }`: the derived function reads the
/// table.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields, remote = "Self")]
pub struct TextureTable {
    pub file: String,
    pub wrap: Option<Wraps>,
    pub filter: Option<FilterKind>,
}

/// Continuation of textures beyond their edges along `u` and `v`: one word for both, or two.
#[derive(Clone, Copy, Debug)]
pub struct Wraps(pub [Wrap; 2]);

/// Interpolation of textures between their texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FilterKind {
    Linear,
    Nearest,
}

fn wrap<E: de::Error>(name: &str) -> Result<Wrap, E> {
    Wrap::from_name(name).ok_or_else(|| E::unknown_variant(name, Wrap::NAMES))
}

impl<'de> Deserialize<'de> for Wraps {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl<'de> de::Visitor<'de> for Visitor {
            type Value = Wraps;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "`repeat`, `mirror`, `clamp`, or a list of two of them")
            }
            fn visit_str<E: de::Error>(self, name: &str) -> Result<Wraps, E> {
                Ok(Wraps([wrap(name)?; 2]))
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Wraps, A::Error> {
                let mut names = Vec::new();
                while let Some(name) = list.next_element::<String>()? {
                    names.push(name);
                }
                let [u, v] = &names[..] else {
                    return Err(de::Error::invalid_length(names.len(), &"two words, for u and v"));
                };
                Ok(Wraps([wrap(u)?, wrap(v)?]))
            }
        }
        from.deserialize_any(Visitor)
    }
}

impl<'de> Deserialize<'de> for TextureTable {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl<'de> de::Visitor<'de> for Visitor {
            type Value = TextureTable;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "the name of a file, or a table with the key `file`")
            }
            fn visit_str<E: de::Error>(self, file: &str) -> Result<TextureTable, E> {
                Ok(TextureTable { file: file.to_owned(), wrap: None, filter: None })
            }
            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<TextureTable, A::Error> {
                TextureTable::deserialize(MapAccessDeserializer::new(map))
            }
        }
        from.deserialize_any(Visitor)
    }
}

/// The textures of a scene file, each read once however many materials use it.
pub struct TomlTextures<'a> {
    folder: &'a Path,
    pictures: Pictures,
}

impl<'a> TomlTextures<'a> {
    /// An empty cache of files relative to `folder`.
    pub fn new(folder: &'a Path) -> Self {
        Self { folder, pictures: Pictures::default() }
    }

    /// The folder that names of files are relative to.
    pub fn folder(&self) -> &'a Path {
        self.folder
    }

    /// The texture in this file. Textures of one file share its texels.
    pub fn get(
        &mut self,
        file: &str,
        sampling: Sampling,
        is_color: bool,
    ) -> Result<Arc<Texture>, Error> {
        let path = self.folder.join(file);
        let advice = "give a PNG or JPEG file relative to the folder of the scene file";
        let failed = |problem: String| Error::new(problem, advice);
        if !path.is_file() {
            return Err(failed(format!("there is no texture `{file}`")));
        }
        let read = self.pictures.codes(&path, is_color);
        let read = read.map_err(|error| failed(format!("`{file}`: {}", error.problem())))?;
        Ok(Arc::new(read.sampled(sampling)))
    }
}
