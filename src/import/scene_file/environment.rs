//! `[environment]` of a scene file.

use super::Power;
use crate::base::error::{Error, Result};
use crate::base::math::Rgb;
use crate::import::text::open;
use crate::pictures::read_exr;
use crate::scene::lights::environment::Environment;
use serde::Deserialize;
use std::io::Read;
use std::path::Path;

/// `[environment]`
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(in crate::import) struct EnvironmentTable {
    /// EXR or HDR file, relative to the scene file's folder.
    file: Option<String>,
    /// Factor of the file, or the same radiance from everywhere.
    radiance: Option<Power>,
    #[serde(default)]
    turn_deg: f32,
}

impl EnvironmentTable {
    /// Reads the map.
    pub(in crate::import) fn environment(&self, folder: &Path) -> Result<Environment> {
        if !self.turn_deg.is_finite() {
            return Err(Error::new("`turn_deg` is not finite", "give an angle in degrees"));
        }
        let scale = self.radiance.map_or(Rgb::ONE, |radiance| radiance.0);
        let Some(file) = &self.file else {
            if self.radiance.is_none() {
                return Err(Error::new(
                    "the environment needs `file` or `radiance`",
                    "give an .exr or .hdr file, or the radiance from everywhere",
                ));
            }
            return Ok(Environment::new(1, 1, vec![scale], 0.0));
        };
        let path = folder.join(file);
        let (width, height, mut pixels) = read(&path)?;
        pixels.iter_mut().for_each(|pixel| *pixel *= scale);
        let finite = |pixel: &Rgb| pixel.is_finite() && pixel.min_element() >= 0.0;
        if let Some(index) = pixels.iter().position(|pixel| !finite(pixel)) {
            let (x, y) = (index as u32 % width, index as u32 / width);
            return Err(Error::new(
                format!("the environment's pixel ({x}, {y}) is {}", pixels[index]),
                "give finite radiances of at least 0",
            )
            .at(path));
        }
        Ok(Environment::new(width, height, pixels, self.turn_deg))
    }
}

/// Pixels of an image of radiances.
fn read(path: &Path) -> Result<(u32, u32, Vec<Rgb>)> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    match &extension[..] {
        "exr" => {
            let image = read_exr(path)?;
            let pixels = image.layer("").and_then(|layer| layer.to_rgb()).ok_or_else(|| {
                Error::new("the image has no channels R, G and B", "give a color image").at(path)
            })?;
            Ok((image.width, image.height, pixels))
        }
        "hdr" => read_hdr(path),
        _ => Err(Error::new(
            "the environment is neither an .exr nor an .hdr file",
            "convert it to one of these",
        )
        .at(path)),
    }
}

fn read_hdr(path: &Path) -> Result<(u32, u32, Vec<Rgb>)> {
    let broken = |problem: String| {
        Error::new(format!("cannot read it as an HDR image: {problem}"), "give an .hdr file")
            .at(path)
    };
    let mut bytes = Vec::new();
    open(path)?.read_to_end(&mut bytes).map_err(|e| Error::io("read", path, e))?;
    let mut decoder =
        zune_hdr::HdrDecoder::new(zune_jpeg::zune_core::bytestream::ZCursor::new(bytes));
    let values = decoder.decode().map_err(|e| broken(format!("{e:?}")))?;
    let (width, height) = decoder.dimensions().ok_or_else(|| broken("it has no size".into()))?;
    let pixels = values.chunks_exact(3).map(Rgb::from_slice).collect::<Vec<_>>();
    if pixels.is_empty() || pixels.len() != width * height {
        return Err(broken("its pixels are incomplete".into()));
    }
    Ok((width as u32, height as u32, pixels))
}
