//! Textures of 8 bits per channel.

use crate::base::math::Rgb;
use crate::simd::{LANES, Vec3s};
use glam::{DVec3, Vec2, Vec3, Vec4};
use serde::Serialize;
use std::sync::{Arc, LazyLock};

/// A texture of 8 bits per channel. `u` runs right and `v` up over [0, 1]; [`Sampling`] defines
/// values outside.
#[derive(Clone, PartialEq, Eq, Hash)]
pub struct Texture {
    width: u32,
    height: u32,
    /// Red, green, blue and opacity, rows from the top. Clones share the texels.
    texels: Arc<[[u8; 4]]>,
    has_opacity: bool,
    sampling: Sampling,
}

/// Values of a texture between its texels and outside its edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize)]
pub struct Sampling {
    /// Wrapping outside the edges, along `u` and `v`.
    pub wrap: [Wrap; 2],
    /// If true, the nearest texel is the value; otherwise texels are interpolated.
    pub nearest: bool,
}

/// Continuation of a texture outside its edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize)]
pub enum Wrap {
    /// Repeated.
    #[default]
    Repeat,
    /// Repeated, every other time mirrored.
    Mirror,
    /// The value at the edge.
    Clamp,
}

/// Coordinates below it have an integer part of 32 bits.
const LARGE: f32 = (1_u32 << 30) as f32;

impl Wrap {
    /// All ways to wrap, by their names in files.
    pub const NAMES: &[&str] = &["repeat", "mirror", "clamp"];

    /// The name in files.
    pub fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }

    /// The way to wrap of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Repeat, Self::Mirror, Self::Clamp].into_iter().find(|wrap| wrap.name() == name)
    }
}

impl Wrap {
    /// The coordinate within [0, 1] that `x` maps to.
    #[inline]
    fn fold(self, x: f32) -> f32 {
        match self {
            // Differences may round up, and are NaN if `x` is infinite. (Remainders would be
            // library calls.)
            Self::Repeat if x.abs() < LARGE => x - floor(x) as f32,
            Self::Repeat => (x - x.floor()).min(1.0),
            Self::Mirror => (1.0 - (x - 2.0 * (0.5 * x).floor() - 1.0).abs()).max(0.0),
            Self::Clamp => x.clamp(0.0, 1.0),
        }
    }

    /// The texel that index `i`, at most one outside, maps to; any of them for others.
    #[inline]
    fn texel(self, i: i32, size: u32) -> usize {
        let size = size as i32;
        let inside = match self {
            Self::Repeat if i < 0 => i + size,
            // Two outside only where the nearest texel is taken, which has no other.
            Self::Repeat if i >= size => (i - size).min(size - 1),
            Self::Repeat => i,
            Self::Mirror | Self::Clamp => i.clamp(0, size - 1),
        };
        inside as usize
    }
}

/// [`Wrap::fold`] by the number of a wrapping, without a branch.
#[expect(clippy::manual_clamp, reason = "coordinates that are not numbers get a texel, too")]
#[inline(always)]
fn folded(wrap: u32, x: f32) -> f32 {
    let repeated = (x - x.floor()).min(1.0);
    let mirrored = (1.0 - (x - 2.0 * (0.5 * x).floor() - 1.0).abs()).max(0.0);
    let clamped = x.max(0.0).min(1.0);
    let other = if wrap == Wrap::Mirror as u32 { mirrored } else { clamped };
    if wrap == Wrap::Repeat as u32 { repeated } else { other }
}

/// [`Wrap::texel`] by the number of a wrapping, without a branch.
#[inline(always)]
fn wrapped(wrap: u32, i: i32, size: i32) -> i32 {
    let around = if i < 0 { i + size } else { i };
    let around = if around >= size { around - size } else { around };
    let around = if around >= size { size - 1 } else { around };
    let clamped = if i < 0 { 0 } else { i };
    let clamped = if clamped >= size { size - 1 } else { clamped };
    if wrap == Wrap::Repeat as u32 { around } else { clamped }
}

impl std::fmt::Debug for Texture {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Texture({}x{})", self.width, self.height)
    }
}

/// The greatest integer up to `x`, by instructions of any processor: the standard function is a
/// call.
#[inline]
fn floor(x: f32) -> i32 {
    let toward_zero = x as i32;
    toward_zero - i32::from((toward_zero as f32) > x)
}

/// Linear values of sRGB codes (IEC 61966-2-1).
static SRGB: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|code| {
        let x = code as f32 / 255.0;
        if x <= 0.04045 { x / 12.92 } else { ((x + 0.055) / 1.055).powf(2.4) }
    })
});

/// Stored numbers of codes, in [0, 1].
static STORED: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|code| code as f32 / 255.0));

impl Texture {
    /// A repeated, interpolated texture of `width` times `height` texels: red, green, blue and
    /// opacity, rows from the top.
    ///
    /// # Panics
    /// If the number of texels differs, or is 0.
    pub fn new(width: u32, height: u32, texels: Vec<[u8; 4]>) -> Self {
        assert!(!texels.is_empty() && texels.len() == width as usize * height as usize);
        let has_opacity = texels.iter().any(|texel| texel[3] != 255);
        let (texels, sampling) = (texels.into(), Sampling::default());
        Self { width, height, texels, has_opacity, sampling }
    }

    /// The texture with another sampling; it shares the texels.
    #[must_use]
    pub fn sampled(self, sampling: Sampling) -> Self {
        Self { sampling, ..self }
    }

    /// The texture with each texel changed, and the same sampling.
    #[must_use]
    pub fn map_texels(&self, change: impl Fn([u8; 4]) -> [u8; 4]) -> Self {
        let texels = self.texels().iter().map(|texel| change(*texel)).collect();
        Self::new(self.width, self.height, texels).sampled(self.sampling)
    }

    /// Width and height, texels.
    pub fn size(&self) -> [u32; 2] {
        [self.width, self.height]
    }

    /// All texels.
    pub fn texels(&self) -> &[[u8; 4]] {
        &self.texels
    }

    /// Sampling of the texture.
    pub fn sampling(&self) -> Sampling {
        self.sampling
    }

    /// Linear color at `uv` of a texture in sRGB.
    pub fn color(&self, uv: Vec2) -> Rgb {
        let linear = |[r, g, b, _]: [u8; 4]| {
            let table = &*SRGB;
            Vec4::new(table[r as usize], table[g as usize], table[b as usize], 0.0)
        };
        self.filtered(uv, linear).truncate()
    }

    /// Mean of the linear color.
    pub fn mean_color(&self) -> Rgb {
        let table = &*SRGB;
        let sum = self.sum(|code| f64::from(table[usize::from(code)]));
        (sum / self.texels.len() as f64).as_vec3()
    }

    /// Sum of the texels' `value` of red, green and blue.
    fn sum(&self, value: impl Fn(u8) -> f64) -> DVec3 {
        self.texels.iter().map(|&[r, g, b, _]| DVec3::from([r, g, b].map(&value))).sum()
    }

    /// Mean of the alpha channel, in [0, 1].
    pub fn mean_opacity(&self) -> f32 {
        let sum: u64 = self.texels.iter().map(|texel| u64::from(texel[3])).sum();
        (sum as f64 / (255.0 * self.texels.len() as f64)) as f32
    }

    /// Mean of each channel as stored, in [0, 1].
    pub fn mean_data(&self) -> Vec3 {
        (self.sum(f64::from) / (255.0 * self.texels.len() as f64)).as_vec3()
    }

    /// The numbers at `uv` as stored, in [0, 1].
    pub fn data(&self, uv: Vec2) -> Vec3 {
        let stored = |[r, g, b, _]: [u8; 4]| Vec4::from([r, g, b, 0].map(f32::from)) / 255.0;
        self.filtered(uv, stored).truncate()
    }

    /// The vector at `uv` of a normal map, of any length: right, up, and off the surface. Code 128
    /// is 0, the convention of programs that write maps; 127.5 would tilt flat maps by 0.2 degrees.
    pub fn vector(&self, uv: Vec2) -> Vec3 {
        Self::vector_of(self.data(uv))
    }

    /// [`Self::vector`] of these stored numbers.
    pub(super) fn vector_of(data: Vec3) -> Vec3 {
        (data * 255.0 - 128.0) / 127.0
    }

    /// Opacity at `uv`, in [0, 1]: the alpha channel if the texture has one, else the mean of the
    /// channels as stored.
    pub fn opacity(&self, uv: Vec2) -> f32 {
        let value = |[r, g, b, a]: [u8; 4]| {
            let sum = u32::from(r) + u32::from(g) + u32::from(b);
            Vec4::splat(if self.has_opacity { f32::from(a) } else { sum as f32 / 3.0 } / 255.0)
        };
        self.filtered(uv, value).x
    }

    /// Linear colors at coordinates of sixteen textures in sRGB; white without a texture.
    #[inline(always)] // part of the loop over vertices
    pub(super) fn colors(
        textures: &[Option<&Self>; LANES],
        uv: &[[f32; LANES]; 2],
        colors: &mut Vec3s,
    ) {
        Self::values(textures, uv, &SRGB, colors);
    }

    /// Numbers as stored, in [0, 1], at coordinates of sixteen textures; 1 without a texture.
    #[inline(never)] // few
    pub(super) fn data_of(
        textures: &[Option<&Self>; LANES],
        uv: &[[f32; LANES]; 2],
        data: &mut Vec3s,
    ) {
        Self::values(textures, uv, &STORED, data);
    }

    /// Values at coordinates of sixteen textures, by a table of the codes. Waiting for the texels
    /// of all together costs little more than waiting for those of one. (Closures and methods that
    /// are not always inlined would be calls here.)
    #[inline(always)]
    fn values(
        textures: &[Option<&Self>; LANES],
        uv: &[[f32; LANES]; 2],
        table: &[f32; 256],
        values: &mut Vec3s,
    ) {
        let mut size = [[1_i32; LANES]; 2];
        let mut wrap = [[0_u32; LANES]; 2];
        let mut nearest = [0.0; LANES];
        for lane in 0..LANES {
            if let Some(Self { width, height, sampling, .. }) = textures[lane] {
                (size[0][lane], size[1][lane]) = (*width as i32, *height as i32);
                wrap[0][lane] = sampling.wrap[0] as u32;
                wrap[1][lane] = sampling.wrap[1] as u32;
                nearest[lane] = if sampling.nearest { 1.0 } else { 0.0 };
            }
        }
        let (mut texel, mut between) = ([[[0_i32; LANES]; 2]; 2], [[0.0_f32; LANES]; 2]);
        for axis in 0..2 {
            for lane in 0..LANES {
                let (size, wrap) = (size[axis][lane], wrap[axis][lane]);
                let folded = folded(wrap, uv[axis][lane]);
                let folded = if axis == 0 { folded } else { 1.0 - folded };
                let position = folded * size as f32 - 0.5 * (1.0 - nearest[lane]);
                let index = floor(position);
                texel[axis][0][lane] = wrapped(wrap, index, size);
                texel[axis][1][lane] = wrapped(wrap, index + 1, size);
                between[axis][lane] = (position - index as f32) * (1.0 - nearest[lane]);
            }
        }
        let mut codes = [[[255_u8; 4]; 4]; LANES];
        for lane in 0..LANES {
            let Some(texture) = textures[lane] else { continue };
            let (left, right) = (texel[0][0][lane] as usize, texel[0][1][lane] as usize);
            let (top, bottom) = (texel[1][0][lane] as usize, texel[1][1][lane] as usize);
            let above = &texture.texels[top * texture.width as usize..];
            let below = &texture.texels[bottom * texture.width as usize..];
            codes[lane] = [above[left], above[right], below[left], below[right]];
        }
        for lane in 0..LANES {
            let [x, y] = [between[0][lane], between[1][lane]];
            let shares = [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y];
            let mut sum = Vec3::ZERO;
            for corner in 0..4 {
                let [r, g, b, _] = codes[lane][corner];
                let value = Vec3::new(table[r as usize], table[g as usize], table[b as usize]);
                sum += shares[corner] * value;
            }
            values.set(lane, sum);
        }
    }

    /// The upper and the lower left one of the texels around `uv`.
    #[inline]
    pub(super) fn rows_around(&self, uv: Vec2) -> [&[u8; 4]; 2] {
        let (left, _, _) = self.along(0, uv.x);
        let (top, bottom, _) = self.along(1, uv.y);
        [top, bottom].map(|row| &self.texels[row * self.width as usize + left])
    }

    /// The texels before and after a position along an axis, and the position between them.
    #[inline]
    fn along(&self, axis: usize, position: f32) -> (usize, usize, f32) {
        let Sampling { wrap, nearest } = self.sampling;
        let (wrap, size) = (wrap[axis], [self.width, self.height][axis]);
        let folded = wrap.fold(position);
        // Rows are from the top. Texel centers lie at halves.
        let folded = if axis == 0 { folded } else { 1.0 - folded };
        let position = folded * size as f32 - if nearest { 0.0 } else { 0.5 };
        let index = floor(position);
        (wrap.texel(index, size), wrap.texel(index + 1, size), position - index as f32)
    }

    /// The nearest texel, or the bilinear interpolation of the four around `uv`.
    fn filtered(&self, uv: Vec2, value: impl Fn([u8; 4]) -> Vec4) -> Vec4 {
        let (left, right, x) = self.along(0, uv.x);
        let (top, bottom, y) = self.along(1, uv.y);
        let texel =
            |column: usize, row: usize| value(self.texels[row * self.width as usize + column]);
        if self.sampling.nearest {
            return texel(left, top);
        }
        let above = texel(left, top).lerp(texel(right, top), x);
        let below = texel(left, bottom).lerp(texel(right, bottom), x);
        above.lerp(below, y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Black, white above red, green.
    fn picture() -> Texture {
        let texels = [[0, 0, 0, 255], [255, 255, 255, 255], [255, 0, 0, 255], [0, 255, 0, 255]];
        Texture::new(2, 2, texels.to_vec())
    }

    #[test]
    fn texel_centers_have_their_color_and_v_points_up() {
        let at = |u, v| picture().color(Vec2::new(u, v));
        assert_eq!(at(0.25, 0.75), Rgb::ZERO);
        assert_eq!(at(0.75, 0.75), Rgb::ONE);
        assert_eq!(at(0.25, 0.25), Rgb::X);
        assert_eq!(at(0.75, 0.25), Rgb::Y);
        assert_eq!(at(0.5, 0.75), Rgb::splat(0.5), "halfway in linear light");
        assert_eq!(at(0.5, 0.5), Rgb::new(0.5, 0.5, 0.25));
    }

    #[test]
    fn textures_repeat_outside_their_edges() {
        for (u, v) in [(0.3, 0.9), (0.0, 0.0), (0.99, 0.5)] {
            let once = picture().color(Vec2::new(u, v));
            for shift in [-3.0, 1.0, 7.0] {
                let again = picture().color(Vec2::new(u + shift, v - shift));
                assert!((once - again).length() < 1e-4, "{u} {v} {shift}");
            }
        }
        // Rounding stays within the texels.
        for uv in [Vec2::splat(-1e-20), Vec2::splat(1e15), Vec2::splat(-1e15), Vec2::splat(1.0)] {
            assert!(picture().color(uv).is_finite());
        }
    }

    #[test]
    fn colors_are_decoded_and_opacity_is_not() {
        let gray = Texture::new(1, 1, vec![[188, 188, 188, 255]]);
        assert!((gray.color(Vec2::ZERO).x - 0.503).abs() < 1e-3);
        assert!((gray.opacity(Vec2::ZERO) - 188.0 / 255.0).abs() < 1e-6);
        let clear = Texture::new(1, 1, vec![[188, 188, 188, 51]]);
        assert!((clear.opacity(Vec2::ZERO) - 0.2).abs() < 1e-6);
    }

    #[test]
    fn textures_continue_by_their_wrapping() {
        let at = |wrap, u, v| {
            picture().sampled(Sampling { wrap: [wrap; 2], nearest: false }).color(Vec2::new(u, v))
        };
        for (u, v) in [(0.3, 0.9_f32), (0.05, 0.6), (0.99, 0.5)] {
            let once = at(Wrap::Repeat, 0.25 + 0.5 * u, v.clamp(0.25, 0.75));
            for wrap in [Wrap::Mirror, Wrap::Clamp] {
                let off = at(wrap, 0.25 + 0.5 * u, v.clamp(0.25, 0.75)) - once;
                assert!(off.length() < 1e-5, "the same within it");
            }
            let mirrored = at(Wrap::Mirror, u, v);
            for (x, y) in [(-u, v), (u, 2.0 - v), (2.0 + u, -v), (4.0 - u, v)] {
                assert!((at(Wrap::Mirror, x, y) - mirrored).length() < 1e-4, "{x} {y}");
            }
        }
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            for x in [1e30, -1e30, f32::INFINITY, f32::NEG_INFINITY, -1e-20] {
                assert!(at(wrap, x, -x).is_finite(), "{wrap:?} {x}");
            }
        }
        assert_eq!(at(Wrap::Clamp, -7.0, 3.0), Rgb::ZERO);
        assert_eq!(at(Wrap::Clamp, 7.0, -3.0), Rgb::Y);
        let nearest = picture().sampled(Sampling { nearest: true, ..Sampling::default() });
        for (u, v, color) in [
            (0.01, 0.51, Rgb::ZERO),
            (0.49, 0.49, Rgb::X),
            (0.51, 0.99, Rgb::ONE),
            (1.7, 0.2, Rgb::Y),
        ] {
            assert_eq!(nearest.color(Vec2::new(u, v)), color, "{u} {v}");
        }
    }

    #[test]
    fn nearest_texels_of_one_row_or_column_are_found_at_its_edges() {
        for (width, height) in [(1, 1), (1, 3), (3, 1)] {
            let texels = vec![[188, 188, 188, 255]; (width * height) as usize];
            let texture = Texture::new(width, height, texels);
            let texture = texture.sampled(Sampling { nearest: true, ..Sampling::default() });
            for x in [0.0, 1.0, -1e-20, f32::INFINITY] {
                for y in [0.0, 1.0, -1e-20, f32::INFINITY] {
                    let at = Vec2::new(x, y);
                    texture.rows_around(at);
                    let mut colors = Vec3s::default();
                    let uv = [[x; LANES], [y; LANES]];
                    Texture::colors(&[Some(&texture); LANES], &uv, &mut colors);
                    assert_eq!(colors.get(3), texture.color(at));
                }
            }
        }
    }

    #[test]
    fn colors_of_sixteen_are_those_of_one() {
        let wraps = [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp];
        let pictures: Vec<_> = (0..LANES)
            .map(|i| {
                let wrap = [wraps[i % 3], wraps[i / 3 % 3]];
                picture().sampled(Sampling { wrap, nearest: i > 11 })
            })
            .collect();
        let textures = std::array::from_fn(|lane| (lane % 5 > 0).then(|| &pictures[lane]));
        let at = [-3.3, -1e-20, 0.0, 0.1, 0.3, 0.74, 1.0, 1.6, 1e12, -1e12, f32::INFINITY];
        for (i, &u) in at.iter().enumerate() {
            let v = at[(3 * i + 1) % at.len()];
            let mut colors = Vec3s::default();
            Texture::colors(&textures, &[[u; LANES], [v; LANES]], &mut colors);
            for (lane, texture) in textures.iter().enumerate() {
                let expected = texture.map_or(Rgb::ONE, |own: &Texture| own.color(Vec2::new(u, v)));
                assert!((colors.get(lane) - expected).length() < 1e-6, "{lane} {u} {v}");
            }
        }
    }

    #[test]
    fn data_are_read_as_stored() {
        let texture = Texture::new(1, 1, vec![[0, 51, 255, 255]]);
        assert!((texture.data(Vec2::ZERO) - Vec3::new(0.0, 0.2, 1.0)).length() < 1e-6);
        let flat = Texture::new(1, 1, vec![[128, 128, 255, 255]]);
        assert_eq!(flat.vector(Vec2::splat(0.3)), Vec3::Z);
    }
}
