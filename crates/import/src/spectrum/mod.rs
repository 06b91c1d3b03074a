//! Colors of spectra as linear sRGB, and tables of spectra by name.

pub mod named;

use crate::text;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::base::math::{Rgb, luminance};
use glam::{DMat3, DVec3};
use std::path::Path;
use std::sync::LazyLock;

/// Uses of a color.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorUse {
    /// A share of light, in [0, 1], under the light of D65: white reflects all light.
    Share,
    /// Light: white is that of D65, and equals 1 1 1.
    Light,
    /// A coefficient of a medium or a refractive index. No light colors it: a constant stays gray.
    Unbounded,
}

/// Reads pairs of wavelength, nm, and value from a file of numbers. `#` begins a comment.
///
/// # Errors
/// If the file cannot be read, or holds anything else. Names the file.
pub fn pairs(path: &Path) -> Result<(Vec<f64>, Vec<f64>)> {
    let content = text::read(path)?;
    let words = content
        .lines()
        .map(|line| line.split('#').next().unwrap_or_default())
        .flat_map(|line| line.split([' ', '\t', ',', '\r']))
        .filter(|word| !word.is_empty());
    let finite = |word: &str| word.parse().ok().filter(|number: &f64| number.is_finite());
    let numbers: Option<Vec<f64>> = words.map(finite).collect();
    let numbers = numbers.filter(|numbers| !numbers.is_empty()).ok_or_else(|| {
        Error::new("this is not a list of numbers", "give pairs of wavelength and value").at(path)
    })?;
    Ok(unzip(&numbers))
}

/// Wavelengths and values of pairs in a row.
pub fn unzip(pairs: &[f64]) -> (Vec<f64>, Vec<f64>) {
    pairs.chunks_exact(2).map(|pair| (pair[0], pair[1])).unzip()
}

/// Radiance of a black body per wavelength, W/(m^2 sr nm), as a color: its mean weighted by the
/// color matching functions.
pub fn black_body(kelvin: f64) -> DVec3 {
    // Planck's law.
    let radiance = |nm: f64| {
        let m = nm * 1e-9;
        1.191_042_972e-16 / m.powi(5) / (1.438_776_877e-2 / (m * kelvin)).exp_m1() * 1e-9
    };
    (XYZ_TO_RGB * integral(radiance) / luminous()).max(DVec3::ZERO)
}

/// The color with the CIE chromaticities `x` and `y`, of luminance 1.
pub fn chromaticity(x: f64, y: f64) -> Rgb {
    of_unit_luminance(XYZ_TO_RGB * DVec3::new(x / y, 1.0, (1.0 - x - y) / y))
}

/// A color scaled to luminance 1, without its negative channels. Black stays black.
pub fn of_unit_luminance(rgb: DVec3) -> Rgb {
    let rgb = rgb.max(DVec3::ZERO);
    // Any scale serves, so the largest channel becomes 1 before the numbers lose digits.
    let rgb = (rgb / rgb.max_element().max(f64::MIN_POSITIVE)).as_vec3();
    let y = luminance(rgb);
    if y > 0.0 { rgb / y } else { rgb }
}

/// The color of a spectrum that is linear between its samples and 0 outside them.
pub fn color(nm: &[f64], values: &[f64], color_use: ColorUse) -> Rgb {
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
        // Relative to white, so that constants are gray.
        ColorUse::Share | ColorUse::Unbounded => {
            let white = XYZ_TO_RGB * integral(d65);
            XYZ_TO_RGB * integral(|x| at(x) * d65(x)) / white
        }
        ColorUse::Light => XYZ_TO_RGB * integral(at) / luminous(),
    };
    rgb.as_vec3().max(Rgb::ZERO)
}

/// Linear sRGB of CIE XYZ (IEC 61966-2-1), column by column.
const XYZ_TO_RGB: DMat3 = DMat3::from_cols_array(&[
    3.2406, -0.9689, 0.0557, -1.5372, 1.8758, -0.2040, -0.4986, 0.0415, 1.0570,
]);

/// The color of power 1 at all wavelengths.
pub static EQUAL_ENERGY: LazyLock<Rgb> =
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
        let (nm, values) = ([400.0, 500.0, 600.0, 700.0], [0.1, 0.2, 0.3, 0.4]);
        close(color(&nm, &values, ColorUse::Share), [0.3408, 0.2429, 0.1403], 0.02);
        close(color(&nm, &values, ColorUse::Light), [0.4021, 0.2314, 0.1245], 0.02);
        let flat = color(&[360.0, 830.0], &[0.5, 0.5], ColorUse::Share);
        close(flat, [0.5; 3], 1e-3);
        // `sigma_t` of a medium in `mitsuba` 3.9.1, which then lowers it to 1 like a share.
        let flat = color(&[400.0, 700.0], &[1.5, 1.5], ColorUse::Unbounded);
        close(flat, [1.493, 1.4996, 1.4924], 0.01);
    }

    #[test]
    fn black_bodies_have_the_hue_of_their_temperature() {
        let color = |kelvin| of_unit_luminance(black_body(kelvin));
        assert!((luminance(color(2856.0)) - 1.0).abs() < 1e-5);
        let day = color(6500.0);
        assert!((day - Rgb::ONE).abs().max_element() < 0.1, "{day}");
        // Embers are red. Of colder bodies, whose light nobody sees, colors are numbers still.
        let ember = color(800.0);
        assert!(ember.x > 2.0 && ember.y < 0.6 && ember.z == 0.0, "{ember}");
        assert!(color(100.0).is_finite() && color(100.0).min_element() >= 0.0);
    }
}
