//! Pictures: textures as PNG, each once, and the environment as EXR.

use super::folder::Folder;
use super::names::{Names, for_file};
use crate::base::error::Result;
use crate::image_io::{Image, Layer, Metadata, write_exr};
use crate::scene::{Environment, Sampling, Texture, Wrap};
use std::collections::HashMap;
use std::io::{self, Write};
use std::path::Path;

/// The textures that were asked for.
#[derive(Default)]
pub(super) struct Pictures<'a> {
    names: Names,
    pictures: Vec<(&'a Texture, String)>,
    /// Index of each, by where its texels are, which textures share.
    known: HashMap<*const [u8; 4], usize>,
}

impl<'a> Pictures<'a> {
    /// A texture as the value of a key; its file is named after the first use.
    pub fn value(&mut self, texture: &'a Texture, material: &str, part: &str) -> String {
        let index = *self.known.entry(texture.texels().as_ptr()).or_insert_with(|| {
            let name = self.names.unique(for_file(&format!("{material}-{part}"), part));
            self.pictures.push((texture, format!("textures/{name}.png")));
            self.pictures.len() - 1
        });
        let file = &self.pictures[index].1;
        let Sampling { wrap, nearest } = texture.sampling();
        if texture.sampling() == Sampling::default() {
            return format!("\"{file}\"");
        }
        let mut keys = format!("file = \"{file}\"");
        match wrap {
            [Wrap::Repeat, Wrap::Repeat] => {}
            [u, v] if u == v => keys += &format!(", wrap = \"{}\"", u.name()),
            [u, v] => keys += &format!(", wrap = [\"{}\", \"{}\"]", u.name(), v.name()),
        }
        if nearest {
            keys += ", filter = \"nearest\"";
        }
        format!("{{ {keys} }}")
    }

    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.pictures.iter().map(|(_, file)| file.as_str())
    }

    pub fn write(&self, out: &Folder) -> Result<()> {
        for (texture, file) in &self.pictures {
            out.write_part(file, |to| write_png(texture, to))?;
        }
        Ok(())
    }
}

fn write_png(texture: &Texture, to: &mut dyn Write) -> io::Result<()> {
    let [width, height] = texture.size();
    let opaque = texture.texels().iter().all(|texel| texel[3] == 255);
    let mut encoder = png::Encoder::new(to, width, height);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_color(if opaque { png::ColorType::Rgb } else { png::ColorType::Rgba });
    let mut writer = encoder.write_header()?;
    if opaque {
        let texels: Vec<u8> = texture.texels().iter().flat_map(|t| [t[0], t[1], t[2]]).collect();
        writer.write_image_data(&texels)?;
    } else {
        writer.write_image_data(texture.texels().as_flattened())?;
    }
    Ok(writer.finish()?)
}

pub(super) fn write_environment(environment: &Environment, path: &Path) -> Result<()> {
    let ([width, height], radiance, _) = environment.parts();
    let layers = vec![Layer::rgb("", radiance)];
    write_exr(path, &Image { width, height, layers, metadata: Metadata::new() })
}
