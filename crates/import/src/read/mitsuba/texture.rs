//! Textures: pictures and checkerboards, as a color times a picture of 8 bits per channel.

use super::color;
use super::object::Object;
use crate::look::picture_file::wrap_named;
use crate::look::{Encoding, Paint, Pictures, picture};
use crate::spectrum::ColorUse;
use crate::warnings::GroupedWarnings;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::{Sampling, Texture, Wrap};
use glam::{Affine2, DAffine3, DVec3, Mat2, Vec2};
use std::sync::Arc;

const UNSUPPORTED_TEXTURE: &str = "used gray instead of textures that are not supported:";

/// The pictures of a scene, and the warnings about all elements.
#[derive(Default)]
pub(super) struct Paints {
    pictures: Pictures,
    pub warnings: GroupedWarnings,
}

impl Paints {
    /// Warns that the image lacks something of an element.
    pub fn skipped(&mut self, phrase: impl Into<String>, object: &Object) {
        self.warnings.skipped(phrase, &object.label());
    }

    /// Warns that something was chosen for an element.
    pub fn chosen(&mut self, phrase: impl Into<String>, object: &Object) {
        self.warnings.chosen(phrase, &object.label());
    }

    /// The color of this name of a BSDF or an emitter, or the default one.
    pub fn paint(
        &mut self,
        object: &Object,
        name: &str,
        color_use: ColorUse,
        default: Rgb,
    ) -> Result<Paint> {
        let Some(child) = object.get(name)? else { return Ok(Paint::plain(default)) };
        if child.element().tag == "texture" && !is_color(&child) {
            match child.kind() {
                "bitmap" => return self.bitmap(&child),
                "checkerboard" => return self.checkerboard(&child),
                _ => self.skipped(UNSUPPORTED_TEXTURE, &child),
            }
            return Ok(Paint::plain(Rgb::splat(0.5)));
        }
        let mut color = self.spectrum(&child, color_use, object)?;
        if color_use == ColorUse::Share && color.max_element() > 1.0 {
            self.skipped("lowered to 1 the reflectance of", object);
            color = color.min(Rgb::ONE);
        }
        Ok(Paint::plain(color))
    }

    /// The color of the element `child` of `owner`.
    pub fn spectrum(&mut self, child: &Object, color_use: ColorUse, owner: &Object) -> Result<Rgb> {
        let read = color::read(child, color_use)?;
        if read.is_spectral {
            self.chosen("converted to linear sRGB the spectra of", owner);
        }
        if read.is_clamped {
            self.skipped("used 0 for the negative channels of the light of", owner);
        }
        Ok(read.rgb)
    }

    /// The color of this name, which is a share of light.
    pub fn share(&mut self, object: &Object, name: &str, default: Rgb) -> Result<Paint> {
        self.paint(object, name, ColorUse::Share, default)
    }

    /// The mean color of this name, for properties that support no textures.
    pub fn mean(
        &mut self,
        object: &Object,
        name: &str,
        color_use: ColorUse,
        default: Rgb,
    ) -> Result<Rgb> {
        let paint = self.paint(object, name, color_use, default)?;
        if paint.texture.is_some() {
            self.skipped(format!("used the mean of the texture `{name}` of"), object);
        }
        Ok(paint.mean())
    }

    /// The mean color of this name, which is a share of light.
    pub fn mean_share(&mut self, object: &Object, name: &str, default: Rgb) -> Result<Rgb> {
        self.mean(object, name, ColorUse::Share, default)
    }

    /// A picture of numbers instead of colors: the texture, as it is stored; `None` for textures
    /// that are no pictures.
    pub fn data(&mut self, object: &Object) -> Result<Option<(Arc<Texture>, Affine2)>> {
        if object.kind() != "bitmap" {
            self.skipped("left out the normals or bumps by", object);
            return Ok(None);
        }
        let sampling = sampling(object)?;
        let (_, texture) = self.pictures.get(&object.file()?, Encoding::Stored)?;
        let _ = object.boolean("raw")?;
        Ok(Some((Arc::new(texture.sampled(sampling)), to_uv(object)?)))
    }

    fn bitmap(&mut self, object: &Object) -> Result<Paint> {
        let sampling = sampling(object)?;
        // Old files set a gamma of 1 for linear numbers.
        let is_linear =
            object.boolean("raw")?.unwrap_or(false) || object.float("gamma")? == Some(1.0);
        let encoding = if is_linear { Encoding::Linear } else { Encoding::Colors };
        let (color, texture) = self.pictures.get(&object.file()?, encoding)?;
        let texture = Some(Arc::new(texture.sampled(sampling)));
        Ok(Paint { color, texture, to_uv: to_uv(object)? })
    }

    fn checkerboard(&mut self, object: &Object) -> Result<Paint> {
        let mut color = |name: &str, default: f32| match object.get(name)? {
            // A nested texture might refer to this one.
            Some(child) if child.element().tag == "texture" && !is_color(&child) => {
                self.skipped(UNSUPPORTED_TEXTURE, object);
                Ok(Rgb::splat(0.5))
            }
            _ => Ok(self.share(object, name, Rgb::splat(default))?.color),
        };
        let (first, second) = (color("color0", 0.4)?, color("color1", 0.2)?);
        // Rows from the top, because v points down.
        let (color, texture) = picture([2, 2], &[first, second, second, first]);
        let sampling = Sampling { nearest: true, ..Sampling::default() };
        Ok(Paint {
            color,
            texture: Some(Arc::new(texture.sampled(sampling))),
            to_uv: to_uv(object)?,
        })
    }
}

fn is_color(object: &Object) -> bool {
    matches!(
        object.kind(),
        "uniform" | "d65" | "blackbody" | "regular" | "irregular" | "rgb" | "srgb"
    )
}

fn sampling(object: &Object) -> Result<Sampling> {
    let wrap = |name: &str, default: Wrap| {
        let Some(word) = object.string(name)? else { return Ok(default) };
        wrap_named(word).ok_or_else(|| {
            object.error(format!("`{name}` is `{word}`"), "use repeat, mirror or clamp")
        })
    };
    let both = wrap("wrap_mode", Wrap::Repeat)?;
    let wrap = [wrap("wrap_mode_u", both)?, wrap("wrap_mode_v", both)?];
    Ok(Sampling { wrap, nearest: object.string("filter_type")? == Some("nearest") })
}

/// The planar part of the map to texture coordinates. In Mitsuba v points down, here it points up.
fn to_uv(object: &Object) -> Result<Affine2> {
    let map: DAffine3 = object.map("to_uv")?;
    let flat = |v: DVec3| Vec2::new(v.x as f32, v.y as f32);
    let (x, y) = (flat(map.matrix3.x_axis), flat(map.matrix3.y_axis));
    let own = Affine2::from_mat2_translation(Mat2::from_cols(x, y), flat(map.translation));
    // Properties of Mitsuba 0.6.
    let old =
        |name: &str, default: f64| Ok::<_, Error>(object.float(name)?.unwrap_or(default) as f32);
    let both = old("uvscale", 1.0)?;
    let scale = Vec2::new(old("uscale", f64::from(both))?, old("vscale", f64::from(both))?);
    let offset = Vec2::new(old("uoffset", 0.0)?, old("voffset", 0.0)?);
    let map = own * Affine2::from_scale_angle_translation(scale, 0.0, offset);
    if map.is_finite() {
        let flip = Affine2::from_scale_angle_translation(Vec2::new(1.0, -1.0), 0.0, Vec2::Y);
        return Ok(flip * map * flip);
    }
    Err(object
        .error("the numbers of its map of texture coordinates are too large", "use smaller ones"))
}
