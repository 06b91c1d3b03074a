//! Named textures, as a color times a picture of 8 bits per channel.

use super::params::{Param, Params};
use super::spectra::{self, ColorSpace};
use crate::file_names::is_guess;
use crate::look::{Encoding, Paint, Pictures, picture};
use crate::spectrum::ColorUse;
use crate::text::{RELATIVE_NAME, find, list};
use crate::warnings::{GroupedWarnings, Warning};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::{Sampling, Texture, Wrap};
use glam::{Affine2, Mat2, Vec2};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The textures of a scene, its pictures, and the warnings about all elements.
pub(super) struct Textures {
    /// Folder of the scene.
    pub folder: PathBuf,
    /// By name; those of type `float` and of type `spectrum` have names of their own.
    floats: HashMap<String, Paint>,
    colors: HashMap<String, Paint>,
    pictures: Pictures,
    pub warnings: GroupedWarnings,
    /// Warnings about other files.
    pub file_warnings: Vec<Warning>,
}

impl Textures {
    pub fn new(folder: &Path) -> Self {
        Self {
            folder: folder.to_owned(),
            floats: HashMap::new(),
            colors: HashMap::new(),
            pictures: Pictures::default(),
            warnings: GroupedWarnings::default(),
            file_warnings: Vec::new(),
        }
    }

    /// Makes a named texture.
    pub fn define(
        &mut self,
        name: &str,
        value_type: &str,
        params: &Params,
        space: ColorSpace,
    ) -> Result<()> {
        let is_float = match value_type {
            "float" => true,
            "spectrum" | "color" => false,
            other => {
                let problem = format!("textures of type `{other}` are unknown");
                return Err(params.location.error(problem, "use float or spectrum"));
            }
        };
        let paint = self.make(name, params, space, is_float)?;
        // Nothing of other types is read, as its own warning says.
        let is_known =
            matches!(&params.kind[..], "constant" | "scale" | "mix" | "checkerboard" | "imagemap");
        self.warn_of_unused(params, |_| is_known, name);
        if is_float {
            self.floats.insert(name.to_owned(), paint);
        } else {
            self.colors.insert(name.to_owned(), paint);
        }
        Ok(())
    }

    /// Warns of parameters of `owner` that nothing asked for.
    pub fn warn_of_unused(
        &mut self,
        params: &Params,
        is_relevant: impl Fn(&&str) -> bool,
        owner: &str,
    ) {
        let unused: Vec<&str> = params.unused().filter(is_relevant).collect();
        if !unused.is_empty() {
            self.warnings.skipped(format!("ignored {} of", list(unused)), owner);
        }
    }

    fn make(
        &mut self,
        name: &str,
        params: &Params,
        space: ColorSpace,
        is_float: bool,
    ) -> Result<Paint> {
        let part = |textures: &mut Self, key: &str, default: f32| {
            let found = textures.own_paint(params, key, space, is_float)?;
            Ok::<_, Error>(found.unwrap_or_else(|| Paint::plain(Rgb::splat(default))))
        };
        let (paint, is_averaged) = match &params.kind[..] {
            "constant" => (part(self, "value", 1.0)?, false),
            "scale" => {
                let (own, scale) = (part(self, "tex", 1.0)?, {
                    // The factor is a float even for colors.
                    let found = self.own_paint(params, "scale", space, true)?;
                    found.unwrap_or_else(|| Paint::plain(Rgb::ONE))
                });
                Paint::combined(&[&own, &scale], |colors| colors[0] * colors[1])
            }
            "mix" => {
                let (first, second) = (part(self, "tex1", 0.0)?, part(self, "tex2", 1.0)?);
                let amount = self.own_paint(params, "amount", space, true)?;
                let amount = amount.unwrap_or_else(|| Paint::plain(Rgb::splat(0.5)));
                Paint::combined(&[&first, &second, &amount], |colors| {
                    colors[0] + (colors[1] - colors[0]) * colors[2]
                })
            }
            "checkerboard" if params.float_or("dimension", 2.0)? == 2.0 => {
                let (first, second) = (part(self, "tex1", 1.0)?, part(self, "tex2", 0.0)?);
                let has_picture = first.texture.is_some() || second.texture.is_some();
                let (first, second) = (first.mean(), second.mean());
                let (color, texture) = picture([2, 2], &[second, first, first, second]);
                let sampling = Sampling { nearest: true, ..Sampling::default() };
                let texture = Some(Arc::new(texture.sampled(sampling)));
                // A period has two squares.
                let to_uv = Affine2::from_scale(Vec2::splat(0.5)) * self.mapping(name, params)?;
                (Paint { color, texture, to_uv }, has_picture)
            }
            "imagemap" => (self.image_map(name, params, is_float)?, false),
            other => {
                let phrase = format!("used gray instead of textures of type `{other}`:");
                self.warnings.skipped(phrase, name);
                (Paint::plain(Rgb::splat(0.5)), false)
            }
        };
        if is_averaged {
            self.warnings.skipped("used the means of pictures within", name);
        }
        Ok(paint)
    }

    fn image_map(&mut self, name: &str, params: &Params, is_float: bool) -> Result<Paint> {
        let Some(file) = params.text("filename")? else {
            return Err(params.error("the `filename` is missing", "add it"));
        };
        let file = file.to_owned();
        let encoding = match params.text("encoding")? {
            None | Some("sRGB") => Encoding::Stored,
            Some("linear") => Encoding::Linear,
            Some(other) => match other.strip_prefix("gamma ").map(|text| text.trim().parse()) {
                Some(Ok(gamma)) if (0.1..=10.0).contains(&gamma) => {
                    Encoding::Gamma(f32::to_bits(gamma))
                }
                _ => {
                    let problem = format!("the encoding is `{other}`");
                    return Err(params.error(problem, "use sRGB, linear or \"gamma 2.2\""));
                }
            },
        };
        let wrap = match params.text("wrap")? {
            None | Some("repeat") => Wrap::Repeat,
            Some("clamp") => Wrap::Clamp,
            Some("octahedralsphere") | Some("black") => {
                self.warnings.skipped("clamped instead of blackened outside its edges", name);
                Wrap::Clamp
            }
            Some(other) => {
                let problem = format!("`wrap` is `{other}`");
                return Err(params.error(problem, "use repeat, clamp or black"));
            }
        };
        let nearest = params.text("filter")? == Some("point");
        let _ = params.float("maxanisotropy")?;
        let (color, texture) = self.picture(params, &file, encoding)?;
        let texture = texture.sampled(Sampling { wrap: [wrap; 2], nearest });
        let to_uv = self.mapping(name, params)?;
        let paint = Paint { color, texture: Some(Arc::new(texture)), to_uv };
        let scale = params.float_or("scale", 1.0)? as f32;
        let is_inverted = params.boolean("invert", false)?;
        if scale == 1.0 && !is_inverted && !is_float {
            return Ok(paint);
        }
        Ok(paint.mapped(|color| {
            let color = if is_float { Rgb::splat(color.element_sum() / 3.0) } else { color };
            let color = color * scale;
            if is_inverted { (Rgb::ONE - color).max(Rgb::ZERO) } else { color.max(Rgb::ZERO) }
        }))
    }

    /// The picture in a file, relative to the scene.
    pub fn find(&mut self, params: &Params, name: &str) -> Result<PathBuf> {
        let missing = || params.error(format!("there is no file `{name}`"), RELATIVE_NAME);
        self.located(name).ok_or_else(missing)
    }

    /// A file of the scene, if there is one.
    pub fn located(&mut self, name: &str) -> Option<PathBuf> {
        let path = find(&self.folder, name)?;
        if is_guess(&self.folder, name, &path) {
            self.warnings.guessed(name);
        }
        Some(path)
    }

    /// An emission texture: a picture as colors.
    pub fn light_picture(&mut self, params: &Params, name: &str) -> Result<Paint> {
        let (color, texture) = self.picture(params, name, Encoding::Stored)?;
        let texture = texture.sampled(Sampling { wrap: [Wrap::Clamp; 2], nearest: false });
        Ok(Paint { color, texture: Some(Arc::new(texture)), to_uv: Affine2::IDENTITY })
    }

    /// A picture of numbers instead of colors, as it is stored.
    pub fn data(&mut self, params: &Params, name: &str) -> Result<Arc<Texture>> {
        let path = self.find(params, name)?;
        Ok(Arc::new(self.pictures.codes(&path, false)?))
    }

    fn picture(
        &mut self,
        params: &Params,
        name: &str,
        encoding: Encoding,
    ) -> Result<(Rgb, Texture)> {
        let path = self.find(params, name)?;
        self.pictures.get(&path, encoding)
    }

    /// The map of texture coordinates.
    fn mapping(&mut self, name: &str, params: &Params) -> Result<Affine2> {
        let kind = params.text("mapping")?.unwrap_or("uv");
        if kind != "uv" {
            let phrase = format!("used texture coordinates instead of the {kind} mapping of");
            self.warnings.skipped(phrase, name);
            return Ok(Affine2::IDENTITY);
        }
        let number = |name: &str, default| params.float_in(name, default, [-1e6, 1e6]);
        let scale = [number("uscale", 1.0)?, number("vscale", 1.0)?];
        let offset = [number("udelta", 0.0)?, number("vdelta", 0.0)?];
        let [scale, offset] = [scale, offset].map(|[u, v]| Vec2::new(u as f32, v as f32));
        Ok(Affine2::from_mat2_translation(Mat2::from_diagonal(scale), offset))
    }

    /// The paint of a parameter: a number, a color, or a texture by name.
    fn own_paint(
        &mut self,
        params: &Params,
        name: &str,
        space: ColorSpace,
        is_float: bool,
    ) -> Result<Option<Paint>> {
        let Some(param) = params.get(name) else { return Ok(None) };
        self.paint(param, space, is_float).map(Some)
    }

    fn paint(&mut self, param: &Param, space: ColorSpace, is_float: bool) -> Result<Paint> {
        if param.kind != "texture" {
            return Ok(Paint::plain(spectra::color(param, ColorUse::Share, space, &self.folder)?));
        }
        let name = param.values.texts.first().map_or("", String::as_str);
        let known = if is_float { &self.floats } else { &self.colors };
        known.get(name).cloned().ok_or_else(|| {
            let kind = if is_float { "float" } else { "spectrum" };
            let problem = format!("there is no texture `{name}` of type {kind}");
            param.location.error(problem, "define it before its first use")
        })
    }

    /// A reflectance: a color in [0, 1] or a texture.
    pub fn share(
        &mut self,
        params: &Params,
        name: &str,
        default: f32,
        (owner, space): (&str, ColorSpace),
    ) -> Result<Paint> {
        let found = self.own_paint(params, name, space, false)?;
        let paint = found.unwrap_or_else(|| Paint::plain(Rgb::splat(default)));
        if paint.color.max_element() > 1.0 {
            self.warnings.skipped("lowered to 1 the reflectance of", owner);
            return Ok(paint.mapped(|color| color.min(Rgb::ONE)));
        }
        Ok(paint)
    }

    /// A number; of a texture its mean.
    pub fn number(&mut self, params: &Params, name: &str, owner: &str) -> Result<Option<f32>> {
        let Some(paint) = self.own_paint(params, name, ColorSpace::Srgb, true)? else {
            return Ok(None);
        };
        if paint.texture.is_some() {
            self.warnings.skipped(format!("used the mean of the texture `{name}` of"), owner);
        }
        Ok(Some(paint.mean().x))
    }

    /// A number that may vary over the surface.
    pub fn varying(&mut self, params: &Params, name: &str) -> Result<Option<Paint>> {
        self.own_paint(params, name, ColorSpace::Srgb, true)
    }
}
