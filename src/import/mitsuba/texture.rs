//! Textures: pictures and checkerboards, as a color times a picture of 8 bits.

use super::color;
use super::color::Meaning;
use super::object::Object;
use super::warnings::Remarks;
use crate::base::error::Result;
use crate::base::math::Rgb;
use crate::import::environment;
use crate::import::srgb;
use crate::scene::{Sampling, Texture, Wrap};
use glam::{Affine2, DAffine3, DVec3, Mat2, Vec2};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A color, or one that varies over a surface.
#[derive(Clone, Debug)]
pub(super) struct Paint {
    /// The color, or what the texture is multiplied with.
    pub color: Rgb,
    pub texture: Option<Arc<Texture>>,
    /// From the texture coordinates of shapes to those of the texture, of which v points down.
    pub to_uv: Affine2,
}

impl Paint {
    pub fn plain(color: Rgb) -> Self {
        Self { color, texture: None, to_uv: Affine2::IDENTITY }
    }

    /// Its mean, of textures over all of the picture.
    pub fn mean(&self) -> Rgb {
        self.color * self.texture.as_ref().map_or(Rgb::ONE, |texture| texture.mean_color())
    }

    /// The paint with another color at each place.
    pub fn mapped(&self, change: impl Fn(Rgb) -> Rgb) -> Self {
        let Some(texture) = &self.texture else {
            return Self { color: change(self.color), ..self.clone() };
        };
        let texels = texture.texels().iter();
        let colors = texels.map(|[r, g, b, _]| {
            change(self.color * srgb::decode([*r, *g, *b].map(|code| f64::from(code) / 255.0)))
        });
        let colors: Vec<Rgb> = colors.collect();
        let [width, height] = texture.size();
        let (color, texture) = picture(width, height, &colors, texture.sampling());
        Self { color, texture: Some(texture), to_uv: self.to_uv }
    }
}

/// Linear colors as a picture and what it is multiplied with: each channel's largest value is exact.
fn picture(width: u32, height: u32, colors: &[Rgb], sampling: Sampling) -> (Rgb, Arc<Texture>) {
    let most = colors.iter().copied().fold(Rgb::ZERO, Rgb::max);
    let scale = Rgb::select(most.cmpgt(Rgb::ZERO), most, Rgb::ONE);
    let texel = |color: &Rgb| {
        let [r, g, b] = srgb::encode(*color / scale);
        let code = |value: f64| (255.0 * value).round() as u8;
        [code(r), code(g), code(b), 255]
    };
    let texels = colors.iter().map(texel).collect();
    (most, Arc::new(Texture::new(width, height, texels).sampled(sampling)))
}

const NO_TEXTURE: &str = "took grey instead of textures that it cannot have:";

/// The pictures of a scene, each read once.
#[derive(Default)]
pub(super) struct Pictures {
    /// By file and whether its numbers are linear: what it is multiplied with as well.
    read: HashMap<(PathBuf, bool), (Rgb, Texture)>,
}

impl Pictures {
    /// The color of this name of a BSDF or an emitter, or the given one.
    pub fn paint(
        &mut self,
        object: &Object,
        name: &str,
        meaning: Meaning,
        unsaid: Rgb,
        remarks: &mut Remarks,
    ) -> Result<Paint> {
        let Some(child) = object.get(name)? else { return Ok(Paint::plain(unsaid)) };
        if child.element().tag == "texture"
            && let Some(paint) = self.texture(&child, remarks)?
        {
            return Ok(paint);
        }
        if child.element().tag == "texture" && !is_color(&child) {
            remarks.skipped(NO_TEXTURE, &child.label());
            return Ok(Paint::plain(Rgb::splat(0.5)));
        }
        let read = color::read(&child, meaning)?;
        if read.is_measured {
            remarks.chosen("made linear sRGB of the spectra of", &object.label());
        }
        let mut color = read.rgb;
        if meaning == Meaning::Share && color.max_element() > 1.0 {
            remarks
                .skipped("lowered to 1 what reflects more light than there is:", &object.label());
            color = color.min(Rgb::ONE);
        }
        Ok(Paint::plain(color))
    }

    /// A texture that is a picture or a checkerboard.
    fn texture(&mut self, object: &Object, remarks: &mut Remarks) -> Result<Option<Paint>> {
        match object.kind() {
            "bitmap" => self.bitmap(object).map(Some),
            "checkerboard" => self.checkerboard(object, remarks).map(Some),
            _ => Ok(None),
        }
    }

    /// A picture as numbers rather than colors: the texture, as it is stored.
    pub fn data(&mut self, object: &Object) -> Result<(Arc<Texture>, Affine2)> {
        if object.kind() != "bitmap" {
            return Err(object.error("only a bitmap can be here", "use <texture type=\"bitmap\">"));
        }
        let sampling = sampling(object)?;
        let (_, texture) = self.read(&object.file()?, false)?;
        let _ = object.boolean("raw")?;
        Ok((Arc::new(texture.sampled(sampling)), to_uv(object)?))
    }

    fn bitmap(&mut self, object: &Object) -> Result<Paint> {
        let sampling = sampling(object)?;
        // Old files say so by a gamma of 1.
        let is_linear =
            object.boolean("raw")?.unwrap_or(false) || object.float("gamma")? == Some(1.0);
        let (color, texture) = self.read(&object.file()?, is_linear)?;
        Ok(Paint {
            color,
            texture: Some(Arc::new(texture.sampled(sampling))),
            to_uv: to_uv(object)?,
        })
    }

    fn read(&mut self, path: &Path, is_linear: bool) -> Result<(Rgb, Texture)> {
        let key = (path.to_owned(), is_linear);
        if let Some(known) = self.read.get(&key) {
            return Ok(known.clone());
        }
        let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
        let made = if matches!(&extension[..], "exr" | "hdr") {
            let (width, height, mut pixels) = environment::read(path)?;
            for pixel in &mut pixels {
                let usable = pixel.is_finite();
                *pixel = if usable { pixel.max(Rgb::ZERO) } else { Rgb::ZERO };
            }
            let (color, texture) = picture(width, height, &pixels, Sampling::default());
            (color, Arc::unwrap_or_clone(texture))
        } else {
            let texture = Texture::load(path)?;
            if is_linear {
                let colors = texture.texels().iter().map(|[r, g, b, _]| {
                    Rgb::new(f32::from(*r), f32::from(*g), f32::from(*b)) / 255.0
                });
                let colors: Vec<Rgb> = colors.collect();
                let [width, height] = texture.size();
                let (color, texture) = picture(width, height, &colors, Sampling::default());
                (color, Arc::unwrap_or_clone(texture))
            } else {
                (Rgb::ONE, texture)
            }
        };
        self.read.insert(key, made.clone());
        Ok(made)
    }

    fn checkerboard(&mut self, object: &Object, remarks: &mut Remarks) -> Result<Paint> {
        let mut color = |name: &str, unsaid: f32| match object.get(name)? {
            // A texture in a texture might be that one again.
            Some(child) if child.element().tag == "texture" && !is_color(&child) => {
                remarks.skipped(NO_TEXTURE, &object.label());
                Ok(Rgb::splat(0.5))
            }
            _ => Ok(self.paint(object, name, Meaning::Share, Rgb::splat(unsaid), remarks)?.color),
        };
        let (first, second) = (color("color0", 0.4)?, color("color1", 0.2)?);
        let sampling = Sampling { nearest: true, ..Sampling::default() };
        // Rows from the top: v points down.
        let (color, texture) = picture(2, 2, &[first, second, second, first], sampling);
        Ok(Paint { color, texture: Some(texture), to_uv: to_uv(object)? })
    }
}

fn is_color(object: &Object) -> bool {
    matches!(
        object.kind(),
        "uniform" | "d65" | "blackbody" | "regular" | "irregular" | "rgb" | "srgb"
    )
}

fn sampling(object: &Object) -> Result<Sampling> {
    let one = |name: &str| match object.string(name)? {
        None | Some("repeat") => Ok(Some(Wrap::Repeat)),
        Some("mirror") => Ok(Some(Wrap::Mirror)),
        Some("clamp") => Ok(Some(Wrap::Clamp)),
        Some(other) => {
            let problem = format!("`{name}` is `{other}`");
            Err(object.error(problem, "use repeat, mirror or clamp"))
        }
    };
    let both = one("wrap_mode")?.unwrap_or_default();
    let own = |name: &str| match object.get(name)? {
        Some(_) => Ok(one(name)?.unwrap_or(both)),
        None => Ok::<_, crate::base::error::Error>(both),
    };
    let wrap = [own("wrap_mode_u")?, own("wrap_mode_v")?];
    Ok(Sampling { wrap, nearest: object.string("filter_type")? == Some("nearest") })
}

/// The plane's part of the map to texture coordinates.
fn to_uv(object: &Object) -> Result<Affine2> {
    let map: DAffine3 = object.map("to_uv")?;
    let flat = |v: DVec3| Vec2::new(v.x as f32, v.y as f32);
    let (x, y) = (flat(map.matrix3.x_axis), flat(map.matrix3.y_axis));
    let own = Affine2::from_mat2_translation(Mat2::from_cols(x, y), flat(map.translation));
    // As Mitsuba 0.6 has it.
    let old = |name: &str, unsaid: f64| {
        Ok::<_, crate::base::error::Error>(object.float(name)?.unwrap_or(unsaid) as f32)
    };
    let both = old("uvscale", 1.0)?;
    let scale = Vec2::new(old("uscale", f64::from(both))?, old("vscale", f64::from(both))?);
    let offset = Vec2::new(old("uoffset", 0.0)?, old("voffset", 0.0)?);
    let map = own * Affine2::from_scale_angle_translation(scale, 0.0, offset);
    if map.is_finite() {
        return Ok(map);
    }
    Err(object.error("its map of texture coordinates has too large numbers", "give smaller ones"))
}
