//! Colors: RGB, and spectra converted to linear sRGB.

use super::object::{Object, words};
use crate::{srgb, text};
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::Rgb;
use glam::{DMat3, DVec3};
use std::sync::LazyLock;

/// Uses of a color.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ColorUse {
    /// A share of light, in [0, 1], under the light of D65: white reflects all light.
    Share,
    /// Light: white is that of D65, and equals 1 1 1.
    Light,
    /// A refractive index, which has no white.
    Index,
}

/// A color that was read.
pub(crate) struct ReadColor {
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
                Some((nm, values)) => spectral(nm, values, color_use),
                None => spectrum(object, color_use)?,
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
            ColorUse::Index => return Ok(ReadColor { rgb: rgb.abs(), ..color }),
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
        let text = text::read(&path)?;
        let lines = text.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#'));
        let numbers = object.parse_list(&lines.collect::<Vec<_>>().join(" "))?;
        return Ok(Some(numbers.chunks_exact(2).map(|pair| (pair[0], pair[1])).unzip()));
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
fn spectrum(object: &Object, color_use: ColorUse) -> Result<ReadColor> {
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
    // Planck's law, W/(m^2 sr nm).
    let radiance = |nm: f64| {
        let m = nm * 1e-9;
        1.191_042_972e-16 / m.powi(5) / (1.438_776_877e-2 / (m * kelvin)).exp_m1() * 1e-9
    };
    let rgb = XYZ_TO_RGB * integral(|nm| scale * radiance(nm)) / luminous();
    Ok(ReadColor { rgb: rgb.as_vec3().max(Rgb::ZERO), is_spectral: true, is_clamped: false })
}

/// The color of a spectrum that is linear between its samples and 0 outside them.
pub(crate) fn spectral(nm: Vec<f64>, values: Vec<f64>, color_use: ColorUse) -> ReadColor {
    let at = |x: f64| {
        let after = nm.partition_point(|own| *own <= x);
        match (after.checked_sub(1).map(|i| (nm[i], values.get(i))), nm.get(after)) {
            (Some((a, Some(low))), Some(b)) => {
                let high = values.get(after).unwrap_or(low);
                low + (high - low) * (x - a) / (b - a)
            }
            (Some((a, Some(last))), None) if a == x => *last,
            _ => 0.0,
        }
    };
    let rgb = match color_use {
        ColorUse::Share => {
            let white = XYZ_TO_RGB * integral(d65);
            XYZ_TO_RGB * integral(|x| at(x) * d65(x)) / white
        }
        ColorUse::Light | ColorUse::Index => XYZ_TO_RGB * integral(at) / luminous(),
    };
    ReadColor { rgb: rgb.as_vec3().max(Rgb::ZERO), is_spectral: true, is_clamped: false }
}

/// Linear sRGB of CIE XYZ (IEC 61966-2-1), column by column.
const XYZ_TO_RGB: DMat3 = DMat3::from_cols_array(&[
    3.2406, -0.9689, 0.0557, -1.5372, 1.8758, -0.2040, -0.4986, 0.0415, 1.0570,
]);

/// The color of power 1 at all wavelengths.
static EQUAL_ENERGY: LazyLock<Rgb> =
    LazyLock::new(|| (XYZ_TO_RGB * integral(|_| 1.0) / luminous()).as_vec3());

/// XYZ of a spectrum, by steps of 1 nm.
fn integral(spectrum: impl Fn(f64) -> f64) -> DVec3 {
    (360..=830).map(f64::from).map(|nm| spectrum(nm) * matching(nm)).sum()
}

/// Y of power 1 at all wavelengths.
fn luminous() -> f64 {
    integral(|_| 1.0).y
}

/// The CIE 1931 color matching functions (Wyman, Sloan and Shirley 2013, the sums of lobes).
fn matching(nm: f64) -> DVec3 {
    let lobe = |peak: f64, center: f64, below: f64, above: f64| {
        let width = if nm < center { below } else { above };
        peak * (-0.5 * ((nm - center) / width).powi(2)).exp()
    };
    DVec3::new(
        lobe(1.056, 599.8, 37.9, 31.0) + lobe(0.362, 442.0, 16.0, 26.7)
            - lobe(0.065, 501.1, 20.4, 26.2),
        lobe(0.821, 568.8, 46.9, 40.5) + lobe(0.286, 530.9, 16.3, 31.1),
        lobe(1.217, 437.0, 11.8, 36.0) + lobe(0.681, 459.0, 26.0, 13.8),
    )
}

/// The CIE's standard illuminant D65, relative to 560 nm, from 360 to 780 nm by steps of 10 nm.
const D65: [f64; 43] = [
    46.64, 52.09, 49.98, 54.65, 82.75, 91.49, 93.43, 86.68, 104.86, 117.01, 117.81, 114.86, 115.92,
    108.81, 109.35, 107.80, 104.79, 107.69, 104.41, 104.05, 100.00, 96.33, 95.79, 88.69, 90.01,
    89.60, 87.70, 83.29, 83.70, 80.03, 80.21, 82.28, 78.28, 69.72, 71.61, 74.35, 61.60, 69.89,
    75.09, 63.59, 46.42, 66.81, 63.38,
];

fn d65(nm: f64) -> f64 {
    let position = ((nm - 360.0) / 10.0).clamp(0.0, (D65.len() - 1) as f64);
    let low = (position as usize).min(D65.len() - 2);
    D65[low] + (D65[low + 1] - D65[low]) * (position - low as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(color: Rgb, expected: [f32; 3], tolerance: f32) {
        let off = (color / Rgb::from_array(expected) - Rgb::ONE).abs().max_element();
        assert!(off < tolerance, "{color}, not {expected:?}");
    }

    #[test]
    fn spectra_have_the_colors_of_mitsuba() {
        // Results of `mitsuba` 3.9.1 in `scalar_rgb`. Our matching functions are fits.
        close(*EQUAL_ENERGY, [1.204_8, 0.948_3, 0.908_9], 0.01);
        let slope = || (vec![400.0, 500.0, 600.0, 700.0], vec![0.1, 0.2, 0.3, 0.4]);
        let (nm, values) = slope();
        close(spectral(nm, values, ColorUse::Share).rgb, [0.3408, 0.2429, 0.1403], 0.02);
        let (nm, values) = slope();
        close(spectral(nm, values, ColorUse::Light).rgb, [0.4021, 0.2314, 0.1245], 0.02);
        let flat = spectral(vec![360.0, 830.0], vec![0.5, 0.5], ColorUse::Share);
        close(flat.rgb, [0.5; 3], 1e-3);
    }
}
