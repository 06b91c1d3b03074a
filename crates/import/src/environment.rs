//! Environments: maps of radiance.

use super::hdr;
use super::read::toml::sky::SkyTable;
use super::text::open;
use super::warnings::Warning;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use bdpm_core::image_io::{Metadata, NOISY, read_exr_display};
use bdpm_core::scene::{Environment, Inset, InsetGrid};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// An environment that the user requests.
#[derive(Clone, Debug, PartialEq)]
pub enum EnvironmentSource {
    /// A constant radiance from all directions, W/(m^2 sr).
    Radiance(Rgb),
    /// An `.exr` or `.hdr` file in longitude and latitude.
    File(PathBuf),
    /// A sky by the keys of a `[sky]` table, separated by commas.
    Sky(String),
}

impl FromStr for EnvironmentSource {
    type Err = Error;

    /// Parses one number, three numbers (red, green, blue) separated by commas, or else a file
    /// name.
    fn from_str(text: &str) -> Result<Self> {
        let numbers: Option<Vec<f32>> =
            text.split(',').map(|word| word.trim().parse().ok()).collect();
        let radiance = match numbers.as_deref() {
            None => return Ok(Self::File(text.into())),
            Some(&[grey]) => Rgb::splat(grey),
            Some(&[r, g, b]) => Rgb::new(r, g, b),
            Some(_) => Rgb::NAN,
        };
        if radiance.is_finite() && radiance.min_element() >= 0.0 {
            return Ok(Self::Radiance(radiance));
        }
        let problem = format!("`{text}` is not a radiance");
        Err(Error::new(problem, "give a number of at least 0, or three such as 0.8,0.9,1"))
    }
}

impl EnvironmentSource {
    /// A sky by the keys of a `[sky]` table, separated by commas, such as
    /// `model = "cie", cie_type = 1, diffuse_lx = 10000`.
    ///
    /// # Errors
    /// If there is no such sky.
    pub fn sky(keys: &str) -> Result<Self> {
        sky_of_keys(keys)?.environment().map_err(|error| in_keys(&error))?;
        Ok(Self::Sky(keys.to_owned()))
    }

    /// Reads the environment. Warnings report corrected pixels.
    ///
    /// # Errors
    /// If its file cannot be read.
    pub(super) fn environment(&self, warnings: &mut Vec<Warning>) -> Result<Environment> {
        match self {
            Self::Radiance(radiance) => Ok(Environment::new(1, 1, vec![*radiance], 0.0)),
            Self::File(path) => from_file(path, Rgb::ONE, 0.0, None, warnings),
            Self::Sky(keys) => sky_of_keys(keys)?.environment().map_err(|error| in_keys(&error)),
        }
    }
}

/// The table of a sky by its keys.
fn sky_of_keys(keys: &str) -> Result<SkyTable> {
    #[derive(serde::Deserialize)]
    struct Keys {
        sky: SkyTable,
    }
    let keys: Keys = toml::from_str(&format!("sky = {{ {keys} }}")).map_err(|error| {
        let advice = "give keys of [sky], such as model = 'cie', cie_type = 1, diffuse_lx = 10000";
        Error::new(format!("the sky cannot be read: {}", error.message()), advice)
    })?;
    Ok(keys.sky)
}

/// An error of a sky that is not in a file.
fn in_keys(error: &Error) -> Error {
    Error::new(format!("the given sky is not valid: {}", error.problem()), error.advice())
}

/// The environment in a file, times `scale` and turned by `turn_deg` degrees. Another file may be
/// an inset in place of a rectangle of pixels: its first column, first row, columns and rows.
/// Radiances that are negative or not finite become 0, with a warning.
///
/// # Errors
/// If a file cannot be read, or the inset is not within the map.
pub fn from_file(
    path: &Path,
    scale: Rgb,
    turn_deg: f32,
    inset: Option<(PathBuf, [u32; 4])>,
    warnings: &mut Vec<Warning>,
) -> Result<Environment> {
    let (width, height, pixels) = scaled(path, scale, warnings)?;
    let Some((file, [column, row, columns, rows])) = inset else {
        return Ok(Environment::new(width, height, pixels, turn_deg));
    };
    let (inset_width, inset_height, radiance) = scaled(&file, scale, warnings)?;
    let (replaced, size) = ([columns, rows], [inset_width, inset_height]);
    let grid = InsetGrid { first: [column, row], replaced, size };
    if !grid.fits([width, height]) {
        let problem = format!("the inset is not within the map of {width} by {height} pixels");
        return Err(Error::new(problem, "give [column, row, columns, rows] within it"));
    }
    let inset = Some(Inset { grid, radiance });
    Ok(Environment::with_inset(width, height, pixels, turn_deg, inset))
}

/// Pixels of a file times `scale`. Radiances that are negative or not finite become 0, with a
/// warning.
fn scaled(path: &Path, scale: Rgb, warnings: &mut Vec<Warning>) -> Result<(u32, u32, Vec<Rgb>)> {
    let (width, height, mut pixels) = read(path)?;
    let invalid = scale_pixels(&mut pixels, scale);
    if let Some(first) = invalid.first() {
        let (x, y) = (*first as u32 % width, *first as u32 / width);
        let (path, count) = (path.display(), invalid.len());
        let text = format!(
            "{path}: {count} pixels are negative or not finite, the first at ({x}, {y}), and became 0"
        );
        warnings.push(Warning::skipped(text));
    }
    Ok((width, height, pixels))
}

/// Multiplies radiances by `scale`. Those that are negative or not finite become 0; returns their
/// indices.
pub fn scale_pixels(pixels: &mut [Rgb], scale: Rgb) -> Vec<usize> {
    let mut invalid = Vec::new();
    for (index, pixel) in pixels.iter_mut().enumerate() {
        *pixel *= scale;
        if !(pixel.is_finite() && pixel.min_element() >= 0.0) {
            *pixel = Rgb::ZERO;
            invalid.push(index);
        }
    }
    invalid
}

/// An image of radiances.
pub struct RadianceImage {
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// Radiance, W/(m^2 sr), row by row from the top left.
    pub pixels: Vec<Rgb>,
    /// Standard error of the luminance of each pixel, W/(m^2 sr), if this program wrote it.
    pub noise: Option<Vec<f32>>,
    /// Metadata of this program; empty for `.hdr` files and files of other programs.
    pub metadata: Metadata,
}

/// Pixels of an image of radiances.
pub fn read(path: &Path) -> Result<(u32, u32, Vec<Rgb>)> {
    let RadianceImage { size: (width, height), pixels, .. } = read_radiance(path)?;
    Ok((width, height, pixels))
}

/// Reads an `.exr` or `.hdr` file.
///
/// # Errors
/// If the file cannot be read, or has no colors; names it.
pub fn read_radiance(path: &Path) -> Result<RadianceImage> {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    match &extension[..] {
        "exr" => {
            open(path)?; // refuses devices that never end
            let image = read_exr_display(path)?;
            let pixels = image.layer("").and_then(|layer| layer.to_rgb()).ok_or_else(|| {
                Error::new("the image has no channels R, G and B", "give a color image").at(path)
            })?;
            let size = (image.width, image.height);
            // The noise of an image is not that of what denoising made of it.
            let is_denoised = image.layer(NOISY).is_some();
            let noise = image.layer("rms").filter(|_| !is_denoised);
            let noise = noise.and_then(|layer| layer.channel("Y")).map(<[f32]>::to_vec);
            Ok(RadianceImage { size, pixels, noise, metadata: image.metadata })
        }
        "hdr" => {
            let (width, height, pixels) = hdr::read(path)?;
            let (size, metadata) = ((width, height), Metadata::new());
            Ok(RadianceImage { size, pixels, noise: None, metadata })
        }
        _ => {
            let problem = "the image is neither an .exr nor an .hdr file";
            Err(Error::new(problem, "convert it to one of these").at(path))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn radiances_parse_as_numbers_and_other_text_as_file_names() {
        let read = |text: &str| text.parse::<EnvironmentSource>();
        assert_eq!(read("0.5").unwrap(), EnvironmentSource::Radiance(Rgb::splat(0.5)));
        let color = Rgb::new(0.8, 0.9, 1.0);
        assert_eq!(read("0.8, 0.9,1").unwrap(), EnvironmentSource::Radiance(color));
        assert_eq!(read("sky.exr").unwrap(), EnvironmentSource::File("sky.exr".into()));
        for bad in ["-1", "1,2", "nan", "inf", "1,1,-1"] {
            let problem = read(bad).unwrap_err().to_string();
            assert!(problem.contains("is not a radiance"), "{problem}");
        }
    }
}
