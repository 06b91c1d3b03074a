//! The pictures of a scene, each read once.

use super::paint::{picture, picture_of};
use super::{pfm, picture_file};
use crate::environment;
use crate::read::extension;
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::Texture;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Meaning of the numbers in a picture file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Encoding {
    /// sRGB codes, or those of the gamma that the file names.
    Colors,
    /// Codes as they are: sRGB codes, or numbers such as normals.
    Stored,
    /// Linear colors, which become codes.
    Linear,
    /// Linear colors to the power of 1 over the exponent with these bits, which become codes.
    Gamma(u32),
}

/// Reads each picture once for each meaning of its numbers. Textures of one file share its texels.
#[derive(Default)]
pub struct Pictures {
    /// The factor of each picture, and the picture.
    read: HashMap<(PathBuf, Encoding), (Rgb, Texture)>,
}

impl Pictures {
    /// The picture in a file of 8-bit codes, whose factor is 1.
    ///
    /// # Errors
    /// If the file cannot be read. Names it.
    pub fn codes(&mut self, path: &Path, is_color: bool) -> Result<Texture> {
        let encoding = if is_color { Encoding::Colors } else { Encoding::Stored };
        Ok(self.cached(path, encoding, || codes(path, encoding))?.1)
    }

    /// The factor of the picture in a file of codes or of floating-point numbers, and the picture.
    ///
    /// # Errors
    /// If the file cannot be read. Names it.
    pub fn get(&mut self, path: &Path, encoding: Encoding) -> Result<(Rgb, Texture)> {
        self.cached(path, encoding, || {
            if !matches!(&extension(path)[..], "exr" | "hdr" | "pfm") {
                return codes(path, encoding);
            }
            let (width, height, mut pixels) = radiances(path)?;
            for pixel in &mut pixels {
                *pixel = if pixel.is_finite() { pixel.max(Rgb::ZERO) } else { Rgb::ZERO };
            }
            Ok(picture([width, height], &pixels))
        })
    }

    fn cached(
        &mut self,
        path: &Path,
        encoding: Encoding,
        read: impl FnOnce() -> Result<(Rgb, Texture)>,
    ) -> Result<(Rgb, Texture)> {
        let key = (path.to_owned(), encoding);
        if let Some(known) = self.read.get(&key) {
            return Ok(known.clone());
        }
        let made = read()?;
        self.read.insert(key, made.clone());
        Ok(made)
    }
}

fn codes(path: &Path, encoding: Encoding) -> Result<(Rgb, Texture)> {
    let linear = |[r, g, b, _]: [u8; 4]| Rgb::new(f32::from(r), f32::from(g), f32::from(b)) / 255.0;
    Ok(match encoding {
        Encoding::Colors => (Rgb::ONE, picture_file::load_colors(path)?),
        Encoding::Stored => (Rgb::ONE, picture_file::load(path)?),
        Encoding::Linear => picture_of(&picture_file::load(path)?, linear),
        Encoding::Gamma(bits) => {
            let gamma = f32::from_bits(bits);
            picture_of(&picture_file::load(path)?, |texel| linear(texel).powf(gamma))
        }
    })
}

/// Width, height and pixels of a picture of floating-point numbers.
pub fn radiances(path: &Path) -> Result<(u32, u32, Vec<Rgb>)> {
    if extension(path) == "pfm" { pfm::read(path) } else { environment::read(path) }
}
