//! Colors that may vary over a surface: a color times a picture of 8 bits per channel.

use super::picture_file::{linear_color, map_texels};
use crate::srgb;
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::Texture;
use glam::{Affine2, Vec2};
use std::sync::Arc;

/// A color, or one that varies over a surface.
#[derive(Clone, Debug)]
pub struct Paint {
    /// The color, or the factor of the texture.
    pub color: Rgb,
    pub texture: Option<Arc<Texture>>,
    /// Map from the texture coordinates of shapes to those of the texture; v points up.
    pub to_uv: Affine2,
}

impl Paint {
    /// The same color everywhere.
    pub fn plain(color: Rgb) -> Self {
        Self { color, texture: None, to_uv: Affine2::IDENTITY }
    }

    /// The mean color over the whole picture.
    pub fn mean(&self) -> Rgb {
        self.color * self.texture.as_ref().map_or(Rgb::ONE, |texture| texture.mean_color())
    }

    /// The color at texture coordinates whose v points up.
    fn at(&self, uv: Vec2) -> Rgb {
        self.color * self.texture.as_ref().map_or(Rgb::ONE, |texture| texture.color(uv))
    }

    /// The paint with another color at each point.
    pub fn mapped(&self, change: impl Fn(Rgb) -> Rgb) -> Self {
        let Some(texture) = &self.texture else { return Self::plain(change(self.color)) };
        let (color, texture) =
            picture_of(texture, |texel| change(self.color * linear_color(texel)));
        Self { color, texture: Some(Arc::new(texture)), to_uv: self.to_uv }
    }

    /// Numbers at each point, from 0 to 1, as texels store them without a transfer curve; `None` if
    /// they do not vary.
    pub fn stored(&self, numbers: impl Fn(Rgb) -> Rgb) -> Option<Arc<Texture>> {
        let texture = self.texture.as_ref()?;
        Some(Arc::new(map_texels(texture, |texel| {
            let own = numbers(linear_color(texel) * self.color);
            let [r, g, b] = own.to_array().map(|x| (255.0 * x).round().clamp(0.0, 255.0) as u8);
            [r, g, b, 255]
        })))
    }

    /// A function of several paints at each point, and whether the pictures of some became their
    /// means, because their texture coordinates differ from those of the first picture.
    pub fn combined(paints: &[&Self], color: impl Fn(&[Rgb]) -> Rgb) -> (Self, bool) {
        let pictured = |paint: &&&Self| paint.texture.is_some();
        let Some(first) = paints.iter().find(pictured) else {
            let colors: Vec<Rgb> = paints.iter().map(|paint| paint.color).collect();
            return (Self::plain(color(&colors)), false);
        };
        let mut is_averaged = false;
        let own: Vec<Self> = paints
            .iter()
            .map(|paint| {
                let fits = paint.texture.is_none() || paint.to_uv == first.to_uv;
                is_averaged |= !fits;
                if fits { (*paint).clone() } else { Self::plain(paint.mean()) }
            })
            .collect();
        let textures = own.iter().filter_map(|paint| paint.texture.as_ref());
        let Some(largest) = textures.max_by_key(|texture| texture.size()[0]) else {
            unreachable!("the first picture fits itself")
        };
        let [width, height] = largest.size();
        let texel = |index: u32| {
            let (x, y) = (index % width, index / width);
            let uv =
                Vec2::new((x as f32 + 0.5) / width as f32, 1.0 - (y as f32 + 0.5) / height as f32);
            color(&own.iter().map(|paint| paint.at(uv)).collect::<Vec<_>>())
        };
        let colors: Vec<Rgb> = (0..width * height).map(texel).collect();
        let (color, made) = picture([width, height], &colors);
        let texture = Some(Arc::new(made.sampled(largest.sampling())));
        (Self { color, texture, to_uv: first.to_uv }, is_averaged)
    }
}

/// Encodes linear colors as a picture, and returns its factor as well: the largest value of each
/// channel is exact.
pub fn picture([width, height]: [u32; 2], colors: &[Rgb]) -> (Rgb, Texture) {
    let largest = colors.iter().copied().fold(Rgb::ZERO, Rgb::max);
    let scale = Rgb::select(largest.cmpgt(Rgb::ZERO), largest, Rgb::ONE);
    let texel = |color: &Rgb| {
        let [r, g, b] = srgb::encode(*color / scale);
        let code = |value: f64| (255.0 * value).round() as u8;
        [code(r), code(g), code(b), 255]
    };
    (largest, Texture::new(width, height, colors.iter().map(texel).collect()))
}

/// Encodes the linear colors of texels as [`picture`] does, with the sampling of `texture`.
pub fn picture_of(texture: &Texture, color: impl Fn([u8; 4]) -> Rgb) -> (Rgb, Texture) {
    let colors: Vec<Rgb> = texture.texels().iter().map(|texel| color(*texel)).collect();
    let (factor, picture) = picture(texture.size(), &colors);
    (factor, picture.sampled(texture.sampling()))
}
