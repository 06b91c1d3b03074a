//! Pictures, their texture coordinates and the coverage of their alpha channels.

use super::buffers::{self, Buffers};
use super::json::get;
use super::json_material::{TextureInfo, TextureTransform};
use super::malformed;
use crate::look::picture_file::{decode, map_texels};
use crate::warnings::GroupedWarnings;
use bdpm_core::base::error::Result;
use bdpm_core::scene::{Sampling, Texture, Wrap};
use glam::{Affine2, Mat2, Vec2};
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

/// Largest accepted picture, bytes.
const MAX_FILE: u64 = 1 << 30;

/// The pictures of a file, each read with its first use.
pub(super) struct GltfTextures<'a> {
    buffers: &'a Buffers<'a>,
    folder: &'a Path,
    /// `None` for pictures that cannot be read.
    read: HashMap<ImageSource<'a>, Option<Texture>>,
    /// Warnings about materials, meshes, and pictures that cannot be read.
    pub warnings: GroupedWarnings,
}

/// Source of a picture, which images may share.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
enum ImageSource<'a> {
    Uri(&'a str),
    View(usize),
}

impl<'a> GltfTextures<'a> {
    pub fn new(buffers: &'a Buffers<'a>, folder: &'a Path) -> Self {
        Self { buffers, folder, read: HashMap::new(), warnings: GroupedWarnings::default() }
    }

    /// The picture of the texture to which `element` refers; `None` if there is none that can be
    /// read, which a warning reports.
    ///
    /// # Errors
    /// If an index is out of range.
    pub fn get(&mut self, info: &TextureInfo, element: &str) -> Result<Option<Arc<Texture>>> {
        let document = self.buffers.document;
        let texture = get(&document.textures, "textures", info.index, element)?;
        let element = format!("textures[{}].source", info.index);
        let Some(index) = texture.extensions.webp.source.or(texture.source) else {
            let problem = format!("textures[{}] of an unknown format", info.index);
            self.warnings.unreadable(problem);
            return Ok(None);
        };
        let image = get(&document.images, "images", index, element)?;
        let element = format!("images[{index}]");
        let source = match (&image.uri, image.buffer_view) {
            (Some(uri), _) => ImageSource::Uri(uri),
            (None, Some(view)) => ImageSource::View(view),
            (None, None) => return Err(malformed(element, "it has neither uri nor bufferView")),
        };
        let sampling = self.sampling(info.index, texture.sampler)?;
        let picture = self.read(source, &element)?;
        Ok(picture.map(|picture| Arc::new(picture.sampled(sampling))))
    }

    /// Reads a picture. Clones share its texels.
    fn read(&mut self, source: ImageSource<'a>, element: &str) -> Result<Option<Texture>> {
        if let Some(read) = self.read.get(&source) {
            return Ok(read.clone());
        }
        let bytes = match source {
            ImageSource::Uri(uri) => {
                buffers::read(uri, self.folder, MAX_FILE, &format!("{element}.uri"))
            }
            ImageSource::View(view) => {
                Ok(self.buffers.view(view, format!("{element}.bufferView"))?.bytes.to_vec())
            }
        };
        let read = bytes.and_then(|bytes| decode(&bytes));
        let read = read.map_err(|e| match e.problem() {
            node if node.starts_with(element) => self.warnings.unreadable(node.to_owned()),
            problem => self.warnings.unreadable(format!("{element}: {problem}")),
        });
        let read = read.ok();
        self.read.insert(source, read.clone());
        Ok(read)
    }

    /// How the texture of this index is sampled.
    fn sampling(&self, texture: usize, sampler: Option<usize>) -> Result<Sampling> {
        let Some(index) = sampler else { return Ok(Sampling::default()) };
        let element = format!("textures[{texture}].sampler");
        let sampler = get(&self.buffers.document.samplers, "samplers", index, element)?;
        let wrap = |code: Option<u32>, key: &str| match code {
            None | Some(10_497) => Ok(Wrap::Repeat),
            Some(33_648) => Ok(Wrap::Mirror),
            Some(33_071) => Ok(Wrap::Clamp),
            Some(code) => {
                Err(malformed(format!("samplers[{index}].{key}"), format!("unknown {code}")))
            }
        };
        let wrap = [wrap(sampler.wrap_s, "wrapS")?, wrap(sampler.wrap_t, "wrapT")?];
        // Minification filters are ignored: many samples per pixel average the texels.
        Ok(Sampling { wrap, nearest: sampler.mag_filter == Some(9728) })
    }
}

/// The set of texture coordinates that a material uses, and their transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct UvSource {
    /// Index of the set.
    pub set: u32,
    map: Option<Affine2>,
}

impl UvSource {
    pub fn new(info: &TextureInfo) -> Self {
        let transform = info.extensions.transform.as_ref();
        let set = transform.and_then(|transform| transform.tex_coord).unwrap_or(info.tex_coord);
        let map = transform.map(|TextureTransform { offset, rotation, scale, .. }| {
            let (sin, cos) = rotation.sin_cos();
            // Counterclockwise, because v points down.
            let turn = Mat2::from_cols(Vec2::new(cos, -sin), Vec2::new(sin, cos));
            let stretch = Mat2::from_diagonal(Vec2::from_array(*scale));
            Affine2::from_mat2_translation(turn * stretch, Vec2::from_array(*offset))
        });
        Self { set, map }
    }

    /// Whether the transform is finite.
    pub fn is_finite(&self) -> bool {
        self.map.is_none_or(|map| map.is_finite())
    }

    /// Whether the directions of growing `u` and `v` are those of the coordinates in the file.
    pub fn keeps_tangents(&self) -> bool {
        self.map.is_none_or(|map| {
            let [along_u, along_v] = [map.matrix2.x_axis, map.matrix2.y_axis];
            along_u.x > 0.0 && along_v.y > 0.0 && along_u.y == 0.0 && along_v.x == 0.0
        })
    }

    /// Maps coordinates of the file, whose v points down, to those of [`Texture`].
    pub fn apply(&self, uv: Vec2) -> Vec2 {
        let uv = self.map.map_or(uv, |map| map.transform_point2(uv));
        // Coordinates may overflow. Textures repeat, so that any value serves.
        let uv = if uv.is_finite() { uv } else { Vec2::ZERO };
        Vec2::new(uv.x, 1.0 - uv.y)
    }
}

/// The part of a surface that exists.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Coverage {
    Everywhere,
    Nowhere,
    /// The part where this opacity is at least a half.
    Partly(Arc<Texture>),
    /// A share of the rays, times this opacity.
    Share(Option<Arc<Texture>>, f32),
}

/// Coverage by a share of the rays: the alpha channel times `factor`.
pub(super) fn blended(picture: Option<&Arc<Texture>>, factor: f32) -> Coverage {
    let has = |holds: fn(u8) -> bool| {
        picture.is_some_and(|picture| picture.texels().iter().any(|texel| holds(texel[3])))
    };
    if factor == 0.0 || picture.is_some() && !has(|alpha| alpha > 0) {
        return Coverage::Nowhere;
    }
    let picture = picture.filter(|_| has(|alpha| alpha < 255)).cloned();
    match picture {
        None if factor == 1.0 => Coverage::Everywhere,
        picture => Coverage::Share(picture, factor),
    }
}

/// Coverage of the part where the alpha channel times `factor` is at least `cutoff`. Opacities are
/// mapped linearly so that the cutoff becomes a half, which keeps the borders between texels.
pub(super) fn coverage(picture: Option<&Arc<Texture>>, factor: f32, cutoff: f32) -> Coverage {
    if cutoff <= 0.0 {
        return Coverage::Everywhere;
    }
    if factor < cutoff {
        return Coverage::Nowhere;
    }
    let Some(picture) = picture else { return Coverage::Everywhere };
    let slope = 0.5 / cutoff.max(factor - cutoff);
    let moved = std::array::from_fn::<u8, 256, _>(|code| {
        let alpha = code as f32 / 255.0 * factor;
        (255.0 * (0.5 + slope * (alpha - cutoff))).round().clamp(0.0, 255.0) as u8
    });
    let solid = |texel: &[u8; 4]| moved[usize::from(texel[3])] >= 128;
    if picture.texels().iter().all(solid) {
        return Coverage::Everywhere;
    }
    if !picture.texels().iter().any(solid) {
        return Coverage::Nowhere;
    }
    if (0..=255).all(|code: u8| moved[usize::from(code)] == code) {
        return Coverage::Partly(picture.clone());
    }
    let moved = map_texels(picture, |[r, g, b, a]| [r, g, b, moved[usize::from(a)]]);
    Coverage::Partly(Arc::new(moved))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn alphas(alphas: &[u8]) -> Arc<Texture> {
        let texels = alphas.iter().map(|alpha| [9, 9, 9, *alpha]).collect();
        Arc::new(Texture::new(alphas.len() as u32, 1, texels))
    }

    #[test]
    fn cutoffs_are_mapped_to_a_half() {
        let picture = alphas(&[0, 50, 51, 127, 128, 255]);
        assert_eq!(coverage(Some(&picture), 1.0, 0.5), Coverage::Partly(picture.clone()));
        for (factor, cutoff, from) in [(1.0, 0.2, 51), (1.0, 0.9, 230), (0.4, 0.2, 128)] {
            let Coverage::Partly(moved) = coverage(Some(&picture), factor, cutoff) else {
                panic!("{factor} {cutoff}")
            };
            for (old, new) in picture.texels().iter().zip(moved.texels()) {
                assert_eq!(old[3] >= from, new[3] >= 128, "{factor} {cutoff}: {old:?} {new:?}");
            }
        }
        assert_eq!(coverage(Some(&picture), 0.3, 0.5), Coverage::Nowhere);
        assert_eq!(coverage(Some(&picture), 1.0, 0.0), Coverage::Everywhere);
        assert_eq!(coverage(None, 0.6, 0.5), Coverage::Everywhere);
        assert_eq!(coverage(Some(&alphas(&[255, 200])), 1.0, 0.5), Coverage::Everywhere);
        assert_eq!(coverage(Some(&alphas(&[3, 20])), 1.0, 0.5), Coverage::Nowhere);
    }
}
