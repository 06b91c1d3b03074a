//! Bounds of the settings, and their errors.

use super::length::LENGTH_ADVICE;
use bdpm_base::error::{Error, Result};
use bdpm_base::simd::LANES;
use bdpm_base::simd::sobol::MAX_POINTS;
use serde::{Deserialize, Deserializer, de};
use std::ops::RangeInclusive;

/// Separates problem and advice in the text of a serde error.
pub const ADVICE: &str = "\u{1f}";

/// Turns an error into a serde error, which keeps only a text. The scene loader splits it into its
/// parts.
pub fn as_serde<E: de::Error>(error: Error) -> E {
    E::custom(format_args!("{}{ADVICE}{}", error.problem(), error.advice()))
}

/// Deserializes and checks a value, so that an error names its line.
pub(super) fn checked<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    from: D,
    check: impl FnOnce(&T) -> Result<()>,
) -> std::result::Result<Option<T>, D::Error> {
    let value = T::deserialize(from)?;
    check(&value).map_err(as_serde)?;
    Ok(Some(value))
}

/// Maximum number of light paths: path ids take 31 bits.
pub const MAX_LIGHT_PATHS: u32 = 1 << 31;

/// Maximum width and height of an image, pixels.
pub const MAX_IMAGE_SIDE: u32 = 65_536;

pub(super) fn check_resolution(&[width, height]: &[u32; 2]) -> Result<()> {
    if [width, height].iter().all(|side| (1..=MAX_IMAGE_SIDE).contains(side)) {
        return Ok(());
    }
    Err(Error::new(
        format!("the resolution is {width}x{height} pixels"),
        "give a width and a height between 1 and 65536, such as 512x512",
    ))
}

pub(crate) fn check_light_paths(&count: &u32) -> Result<()> {
    if (1..=MAX_LIGHT_PATHS).contains(&count) {
        return Ok(());
    }
    Err(Error::new(
        format!("{count} light paths per iteration"),
        format!("give between 1 and {MAX_LIGHT_PATHS} light paths"),
    ))
}

pub(crate) fn check_camera_paths(&count: &u32) -> Result<()> {
    if count > 0 {
        return Ok(());
    }
    Err(Error::new("0 camera paths per pixel", "give at least 1 camera path per pixel"))
}

/// Maximum number of iterations to learn a guide from: more of them add nothing, and each takes up
/// to half a megabyte.
const MAX_GUIDE: u32 = 256;

pub(super) fn check_guide(&iterations: &u32) -> Result<()> {
    if iterations <= MAX_GUIDE {
        return Ok(());
    }
    Err(Error::new(
        format!("{iterations} iterations to learn a guide"),
        format!("give at most {MAX_GUIDE}, such as 32, or 0 for none"),
    ))
}

/// Sizes of sets of light paths besides 1.
const SOBOL_SETS: std::ops::RangeInclusive<u32> = LANES as u32..=MAX_POINTS;

pub(super) fn check_sobol_set(&size: &u32) -> Result<()> {
    if size == 1 || SOBOL_SETS.contains(&size) && size.is_power_of_two() {
        return Ok(());
    }
    let [least, most] = [SOBOL_SETS.start(), SOBOL_SETS.end()];
    Err(Error::new(
        format!("sets of {size} light paths"),
        format!(
            "give a power of two from {least} to {most}, such as 4096, or 1 for independent light paths"
        ),
    ))
}

/// Maximum factor of splitting: more continuations of a path only repeat it.
const MAX_SPLITTING: u32 = 64;

pub(super) fn check_splitting(&factor: &u32) -> Result<()> {
    if (1..=MAX_SPLITTING).contains(&factor) {
        return Ok(());
    }
    Err(Error::new(
        format!("splitting by {factor}"),
        format!("give 1 to {MAX_SPLITTING}; 1 splits no light path"),
    ))
}

/// Maximum number of shadow rays that learn the visibility of lights: more of them add nothing.
const MAX_LIGHT_VISIBILITY: u32 = 1 << 24;

pub(super) fn check_light_visibility(&rays: &u32) -> Result<()> {
    if rays <= MAX_LIGHT_VISIBILITY {
        return Ok(());
    }
    Err(Error::new(
        format!("{rays} shadow rays to learn the visibility of lights"),
        format!("give at most {MAX_LIGHT_VISIBILITY}, such as 500000, or 0 for none"),
    ))
}

pub(super) fn check_radius(&radius: &f32) -> Result<()> {
    if radius > 0.0 && radius.is_finite() {
        return Ok(());
    }
    Err(Error::new(format!("the merge radius is {radius}"), LENGTH_ADVICE))
}

/// Range of the radii of merges in media over those at surfaces.
pub const MEDIUM_SCALES: RangeInclusive<f64> = 0.01..=1000.0;

pub(super) fn check_medium_scale(&scale: &f64) -> Result<()> {
    if MEDIUM_SCALES.contains(&scale) {
        return Ok(());
    }
    let (least, most) = (MEDIUM_SCALES.start(), MEDIUM_SCALES.end());
    Err(Error::new(
        format!("the radii in media are {scale} times those at surfaces"),
        format!("give a factor from {least} to {most}, such as 2"),
    ))
}

/// Range of the share of the merges in media that are done.
pub const MEDIUM_SHARES: RangeInclusive<f64> = 1e-4..=1.0;

pub(super) fn check_medium_share(&share: &f64) -> Result<()> {
    if MEDIUM_SHARES.contains(&share) {
        return Ok(());
    }
    let least = MEDIUM_SHARES.start();
    Err(Error::new(
        format!("{share} of the merges in media are done"),
        format!("give a share from {least} to 1, such as 0.1"),
    ))
}

/// The built-in [`Settings::wavelength_width`](super::Settings::wavelength_width).
pub const DEFAULT_WAVELENGTH_WIDTH: f64 = 0.06;

/// Range of the share of the spectrum within which wavelengths merge.
const WAVELENGTH_WIDTHS: RangeInclusive<f64> = 0.001..=1.0;

pub(super) fn check_wavelength_width(&width: &f64) -> Result<()> {
    if WAVELENGTH_WIDTHS.contains(&width) {
        return Ok(());
    }
    let (least, most) = (WAVELENGTH_WIDTHS.start(), WAVELENGTH_WIDTHS.end());
    Err(Error::new(
        format!("wavelengths merge within {width} of the spectrum"),
        format!("give a share from {least} to {most}, such as {DEFAULT_WAVELENGTH_WIDTH}"),
    ))
}

pub(super) fn check_merge_vertex(&vertex: &u32) -> Result<()> {
    if (1..=255).contains(&vertex) {
        return Ok(());
    }
    Err(Error::new(
        format!("merge vertex {vertex}"),
        "give the number of the diffuse vertex at which camera paths are cut, 1 to 255",
    ))
}
