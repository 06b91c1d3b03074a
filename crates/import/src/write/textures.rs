//! TextureFiles: textures as PNG, each once, and the environment as EXR.

use super::folder::ExportFolder;
use crate::look::picture_file::wrap_name;
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use bdpm_core::base::names::{Names, for_file};
use bdpm_core::image_io::{Image, Layer, Metadata, write_exr};
use bdpm_core::scene::{Environment, Sampling, Texture, Wrap};
use std::collections::HashMap;
use std::io::{self, Write};
use std::path::Path;

/// The textures in use.
#[derive(Default)]
pub(super) struct TextureFiles<'a> {
    names: Names,
    textures: Vec<(&'a Texture, String)>,
    /// Index of each texture by the address of its texels, which textures share.
    known: HashMap<*const [u8; 4], usize>,
}

impl<'a> TextureFiles<'a> {
    /// A texture as the value of a key. The name of its file is that of its first use.
    pub fn value(&mut self, texture: &'a Texture, material: &str, part: &str) -> String {
        let index = *self.known.entry(texture.texels().as_ptr()).or_insert_with(|| {
            let name = self.names.unique(for_file(&format!("{material}-{part}"), part));
            self.textures.push((texture, format!("textures/{name}.png")));
            self.textures.len() - 1
        });
        let file = &self.textures[index].1;
        let Sampling { wrap, nearest } = texture.sampling();
        if texture.sampling() == Sampling::default() {
            return format!("\"{file}\"");
        }
        let mut keys = format!("file = \"{file}\"");
        match wrap {
            [Wrap::Repeat, Wrap::Repeat] => {}
            [u, v] if u == v => keys += &format!(", wrap = \"{}\"", wrap_name(u)),
            [u, v] => keys += &format!(", wrap = [\"{}\", \"{}\"]", wrap_name(u), wrap_name(v)),
        }
        if nearest {
            keys += ", filter = \"nearest\"";
        }
        format!("{{ {keys} }}")
    }

    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.textures.iter().map(|(_, file)| file.as_str())
    }

    pub fn write(&self, out: &ExportFolder) -> Result<()> {
        for (texture, file) in &self.textures {
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
    let [width, height] = environment.size();
    write_map(path, [width, height], environment.pixels().collect())
}

/// Writes the inset of an environment, if it has one.
pub(super) fn write_inset(environment: &Environment, path: &Path) -> Result<()> {
    let Some((grid, pixels)) = environment.inset() else { return Ok(()) };
    write_map(path, grid.size, pixels.collect())
}

fn write_map(path: &Path, [width, height]: [u32; 2], radiance: Vec<Rgb>) -> Result<()> {
    let layers = vec![Layer::rgb("", &radiance)];
    write_exr(path, &Image { width, height, layers, metadata: Metadata::new() })
}
