//! What each setting may be, and how such an error gets out of a file.

use super::Strategy;
use super::length::LENGTH_ADVICE;
use crate::base::error::{Error, Result};
use serde::{Deserialize, Deserializer, de};

/// Separates problem and advice within the one string that a serde error carries.
pub(crate) const ADVICE: &str = "\u{1f}";

/// Hands an error through serde, which keeps nothing but a text; the scene loader splits it again.
pub(crate) fn as_serde<E: de::Error>(error: Error) -> E {
    E::custom(format_args!("{}{ADVICE}{}", error.problem(), error.advice()))
}

/// Reads a value and checks it at once, so that an error names its line.
pub(super) fn checked<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    from: D,
    check: impl FnOnce(&T) -> Result<()>,
) -> std::result::Result<Option<T>, D::Error> {
    let value = T::deserialize(from)?;
    check(&value).map_err(as_serde)?;
    Ok(Some(value))
}

/// Largest number of light paths: path ids take 31 bits.
pub const MAX_LIGHT_PATHS: u32 = 1 << 31;

pub(super) fn check_resolution(&[width, height]: &[u32; 2]) -> Result<()> {
    if (1..=65_536).contains(&width) && (1..=65_536).contains(&height) {
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

/// More iterations than teach light paths anything new. What they bring is kept until then: half a megabyte each at the most.
const MOST_GUIDE: u32 = 256;

pub(super) fn check_guide(&iterations: &u32) -> Result<()> {
    if iterations <= MOST_GUIDE {
        return Ok(());
    }
    Err(Error::new(
        format!("{iterations} iterations to learn a guide"),
        format!("give at most {MOST_GUIDE}, such as 32, or 0 for none"),
    ))
}

pub(super) fn check_radius(&radius: &f32) -> Result<()> {
    if radius > 0.0 && radius.is_finite() {
        return Ok(());
    }
    Err(Error::new(format!("the merge radius is {radius}"), LENGTH_ADVICE))
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

pub(super) fn check_scale(&scale: &f64) -> Result<()> {
    if scale >= 0.0 && scale <= f64::from(f32::MAX).sqrt() {
        return Ok(());
    }
    Err(Error::new(format!("the scale of merges is {scale}"), "give a number such as 0.4"))
}

pub(super) fn check_strategy(strategy: Strategy, merge_vertex: u32) -> Result<()> {
    if strategy == Strategy::Single || merge_vertex == 2 {
        return Ok(());
    }
    Err(Error::new(
        format!(
            "strategy `mis` merges at vertices 1 and 2, but the merge vertex is {merge_vertex}"
        ),
        "leave the merge vertex out or set it to 2: camera paths are cut there",
    ))
}

/// Reads a resolution such as 512x384.
#[cfg(feature = "cli")]
pub(super) fn parse_resolution(text: &str) -> std::result::Result<[u32; 2], &'static str> {
    let pixels = text.split_once(['x', 'X']).and_then(|(width, height)| {
        Some([width.trim().parse().ok()?, height.trim().parse().ok()?])
    });
    pixels.ok_or("give a width and a height, such as 512x384")
}

#[cfg(all(test, feature = "cli"))]
mod tests {
    use super::*;

    #[test]
    fn resolutions_are_two_numbers() {
        assert_eq!(parse_resolution("640x480"), Ok([640, 480]));
        for bad in ["", "640", "x", "640x", "640x-1", "640x480x3", "axb", "99999999999x1"] {
            assert!(parse_resolution(bad).is_err(), "{bad}");
        }
    }
}
