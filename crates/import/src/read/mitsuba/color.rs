//! Colors: RGB, and spectra converted to linear sRGB.

use super::object::{Object, words};
use crate::spectrum::{self, ColorUse, EQUAL_ENERGY};
use crate::srgb;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use glam::DVec3;

/// A color that was read.
pub struct ReadColor {
    pub rgb: Rgb,
    /// Whether it was converted from a spectrum.
    pub is_spectral: bool,
    /// Whether negative channels became 0.
    pub is_clamped: bool,
}

impl ReadColor {
    fn plain(rgb: Rgb) -> Self {
        Self { rgb, is_spectral: false, is_clamped: false }
    }

    fn spectral(rgb: Rgb) -> Self {
        Self { is_spectral: true, ..Self::plain(rgb) }
    }
}

/// Reads an element with the tag of a color.
///
/// # Errors
/// If its numbers are malformed, or those of a share are negative.
pub(super) fn read(object: &Object, color_use: ColorUse) -> Result<ReadColor> {
    let color = match (&object.element().tag[..], object.kind()) {
        ("float" | "integer" | "rgb" | "color", _) | ("spectrum", "rgb" | "srgb") => {
            ReadColor::plain(rgb(object)?)
        }
        ("srgb", _) => ReadColor::plain(encoded(object)?),
        ("blackbody", _) => {
            let text = object.attribute("temperature")?;
            let kelvin = object.parse(text.trim_end_matches(['K', 'k']))?;
            let scale = object.element().attribute("scale").map_or(Ok(1.0), |t| object.parse(t))?;
            blackbody(object, kelvin, scale)?
        }
        ("spectrum" | "texture", "blackbody") => {
            let kelvin = object.float("temperature")?.unwrap_or(5000.0);
            blackbody(object, kelvin, object.float("scale")?.unwrap_or(1.0))?
        }
        ("spectrum" | "texture", "uniform") => {
            ReadColor::plain(Rgb::splat(object.float("value")?.unwrap_or(1.0) as f32))
        }
        ("spectrum" | "texture", "d65") => {
            let scale = object.float("scale")?.unwrap_or(1.0) as f32;
            let own = object.get("value")?;
            if own.is_some_and(|own| own.kind() == "d65") {
                return Err(object.error("it is D65 of D65", "nest another color"));
            }
            let color = own.map(|own| read(&own, color_use)).transpose()?;
            ReadColor::plain(scale * color.map_or(Rgb::ONE, |color| color.rgb))
        }
        ("spectrum" | "texture", "regular" | "irregular") | ("spectrum", "") => {
            match samples(object)? {
                Some((nm, values)) => ReadColor::spectral(spectrum::color(&nm, &values, color_use)),
                None => uniform(object, color_use)?,
            }
        }
        (tag, kind) => {
            let problem = format!("a color was expected, not <{tag} type=\"{kind}\">");
            return Err(object.error(problem, "use rgb, srgb, spectrum, blackbody or float"));
        }
    };
    if color.rgb.is_finite() {
        let rgb = color.rgb;
        match color_use {
            _ if rgb.min_element() >= 0.0 => return Ok(color),
            // Only their squares matter. Fits of spectra have negative channels.
            ColorUse::Unbounded => return Ok(ReadColor { rgb: rgb.abs(), ..color }),
            ColorUse::Light => {
                return Ok(ReadColor { rgb: rgb.max(Rgb::ZERO), is_clamped: true, ..color });
            }
            ColorUse::Share => {}
        }
    }
    Err(object.error("the color is negative or too large", "give numbers of at least 0"))
}

fn rgb(object: &Object) -> Result<Rgb> {
    let text = object.element().attribute("value");
    if text.is_some_and(|text| text.trim().starts_with('#')) {
        return encoded(object);
    }
    match object.numbers()?[..] {
        [all] => Ok(Rgb::splat(all as f32)),
        [r, g, b] => Ok(DVec3::new(r, g, b).as_vec3()),
        _ => Err(wrong_count(object)),
    }
}

fn wrong_count(object: &Object) -> Error {
    object.error("it has neither one nor three numbers", "give red, green and blue")
}

/// `#rrggbb`, or three codes in [0, 1].
fn encoded(object: &Object) -> Result<Rgb> {
    let text = object.attribute("value")?.trim();
    let codes = match text.strip_prefix('#') {
        Some(digits) => {
            let number = u32::from_str_radix(digits, 16).ok().filter(|_| digits.len() == 6);
            let number = number
                .ok_or_else(|| object.error(format!("`{text}` is not a color"), "write #rrggbb"))?;
            [16, 8, 0].map(|shift| f64::from(number >> shift & 255) / 255.0)
        }
        None => match object.numbers()?[..] {
            [all] => [all; 3],
            [r, g, b] => [r, g, b],
            _ => return Err(wrong_count(object)),
        },
    };
    Ok(srgb::decode(codes))
}

/// Wavelengths, nm, and the values of a spectrum there: by lists, by `wavelength:value` pairs, or
/// by a file of pairs. `None` if it is one number or a color.
pub(super) fn samples(object: &Object) -> Result<Option<(Vec<f64>, Vec<f64>)>> {
    match object.kind() {
        "regular" => return regular(object).map(Some),
        "irregular" => {
            let list =
                |name: &str| object.string(name)?.map_or(Ok(vec![]), |t| object.parse_list(t));
            return Ok(Some((list("wavelengths")?, list("values")?)));
        }
        _ => {}
    }
    let Some(text) = object.element().attribute("value") else {
        let name = object.attribute("filename")?;
        let path = object.document.find_file(object.index, name);
        let path = path
            .ok_or_else(|| object.error(format!("there is no file `{name}`"), "check the name"))?;
        return spectrum::pairs(&path).map(Some);
    };
    if text.contains(':') {
        let (mut nm, mut values) = (Vec::new(), Vec::new());
        for word in words(text) {
            let (at, value) = word.split_once(':').unwrap_or((word, ""));
            nm.push(object.parse(at)?);
            values.push(object.parse(value)?);
        }
        return Ok(Some((nm, values)));
    }
    Ok(None)
}

/// A spectrum of one number, or of three.
fn uniform(object: &Object, color_use: ColorUse) -> Result<ReadColor> {
    let color = rgb(object)?;
    let is_uniform = color == Rgb::splat(color.x);
    // In Mitsuba 3 one number is the same power at all wavelengths, which is not the white of D65.
    if is_uniform && color_use == ColorUse::Light && !object.document.is_old {
        return Ok(ReadColor::plain(color.x * *EQUAL_ENERGY));
    }
    Ok(ReadColor::plain(color))
}

/// Values at equal distances.
fn regular(object: &Object) -> Result<(Vec<f64>, Vec<f64>)> {
    let ends = [("wavelength_min", 360.0), ("wavelength_max", 830.0)];
    let [low, high] = ends.map(|(name, default)| Ok(object.float(name)?.unwrap_or(default)));
    let (low, high) = (low?, high?);
    let values = object.string("values")?.map_or(Ok(vec![]), |text| object.parse_list(text))?;
    let last = values.len().saturating_sub(1).max(1) as f64;
    let nm = (0..values.len()).map(|i| low + (high - low) * i as f64 / last).collect();
    Ok((nm, values))
}

fn blackbody(object: &Object, kelvin: f64, scale: f64) -> Result<ReadColor> {
    if !(100.0..=1e6).contains(&kelvin) {
        let problem = format!("{kelvin} K is out of the range of temperatures");
        return Err(object.error(problem, "give 100 to 1000000 K"));
    }
    let rgb = (scale * spectrum::black_body(kelvin)).as_vec3();
    Ok(ReadColor::spectral(rgb))
}
