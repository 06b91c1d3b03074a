//! Colors: RGB, spectra and temperatures as linear sRGB.

use super::params::{Param, Params};
use crate::file_names::find_exact;
use crate::spectrum::named::neutral_metal;
use crate::spectrum::{self, ColorUse, chromaticity, of_unit_luminance, unzip};
use crate::text;
use bdpm_core::base::error::Result;
use bdpm_core::base::math::Rgb;
use bdpm_core::scene::RefractiveIndex;
use glam::{DMat3, DVec3};
use std::path::Path;

/// Color spaces of `rgb` values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum ColorSpace {
    #[default]
    Srgb,
    DciP3,
    Rec2020,
    Aces,
}

impl ColorSpace {
    /// The space of this name in `ColorSpace` directives.
    pub fn named(name: &str) -> Option<Self> {
        Some(match name {
            "srgb" => Self::Srgb,
            "dci-p3" => Self::DciP3,
            "rec2020" => Self::Rec2020,
            "aces2065-1" => Self::Aces,
            _ => return None,
        })
    }

    /// Linear sRGB of a color in the space. The spaces but ACES have the white of D65; white stays
    /// white in all.
    fn to_srgb(self, color: DVec3) -> DVec3 {
        let rows = match self {
            Self::Srgb => return color,
            Self::DciP3 => [
                [1.224_940, -0.224_940, 0.0],
                [-0.042_057, 1.042_057, 0.0],
                [-0.019_638, -0.078_636, 1.098_274],
            ],
            Self::Rec2020 => [
                [1.660_491, -0.587_641, -0.072_850],
                [-0.124_550, 1.132_900, -0.008_349],
                [-0.018_151, -0.100_579, 1.118_730],
            ],
            Self::Aces => [
                [2.521_686, -1.134_131, -0.387_555],
                [-0.276_480, 1.372_719, -0.096_239],
                [-0.015_378, -0.152_975, 1.168_353],
            ],
        };
        DMat3::from_cols_array_2d(&rows).transpose() * color
    }
}

/// The color of a parameter. Emission of spectra and temperatures gets the luminance 1, as pbrt
/// scales it.
///
/// # Errors
/// If its values are malformed.
pub(super) fn color(
    param: &Param,
    color_use: ColorUse,
    space: ColorSpace,
    folder: &Path,
) -> Result<Rgb> {
    let numbers = &param.values.numbers[..];
    let of_spectrum = |(nm, values): (Vec<f64>, Vec<f64>)| {
        let rgb = spectrum::color(&nm, &values, color_use);
        if color_use == ColorUse::Light { of_unit_luminance(rgb.as_dvec3()) } else { rgb }
    };
    let rgb = match (&param.kind[..], numbers, &param.values.texts[..]) {
        ("rgb" | "color", [r, g, b], _) => space.to_srgb(DVec3::new(*r, *g, *b)).as_vec3(),
        ("float", [number], _) => Rgb::splat(*number as f32),
        ("blackbody", [kelvin], _) if (100.0..=1e6).contains(kelvin) => {
            let rgb = of_unit_luminance(spectrum::black_body(*kelvin));
            if color_use == ColorUse::Share { rgb / rgb.max_element() } else { rgb }
        }
        ("blackbody", ..) => {
            let advice = "give one temperature from 100 to 1000000 K";
            return Err(param.location.error("it is not a temperature", advice));
        }
        ("spectrum", [], [name]) => match named(name, color_use) {
            Some(color) => color,
            None => of_spectrum(file(param, name, folder)?),
        },
        ("spectrum", pairs @ [_, ..], _) if pairs.len().is_multiple_of(2) => {
            let (nm, values) = unzip(pairs);
            if nm.windows(2).any(|pair| pair[0] >= pair[1]) {
                let problem = "the wavelengths do not grow";
                return Err(param.location.error(problem, "sort the samples by wavelength"));
            }
            of_spectrum((nm, values))
        }
        (kind, ..) => {
            let problem = format!("`{}` is not a color of type `{kind}`", param.name);
            let advice = "give three numbers as rgb, pairs or a name as spectrum, or a temperature";
            return Err(param.location.error(problem, advice));
        }
    };
    if rgb.is_finite() {
        return Ok(rgb.max(Rgb::ZERO));
    }
    Err(param.location.error("the color is too large", "give smaller numbers"))
}

/// One number as a refractive index, or the mean of a spectrum at visible wavelengths.
pub(super) fn index(params: &Params, name: &str, default: f64, folder: &Path) -> Result<f32> {
    let Some(param) = params.get(name) else { return Ok(default as f32) };
    let value = match param.values.texts.first().and_then(|text| glass(text)) {
        Some(glass) => glass.at_d() as f32,
        None => {
            let color = color(param, ColorUse::Unbounded, ColorSpace::Srgb, folder)?;
            if param.kind == "float" { color.x } else { color.y }
        }
    };
    if (0.1..=10.0).contains(&value) {
        return Ok(value);
    }
    let problem = format!("the refractive index is {value}");
    Err(param.location.error(problem, "give a number from 0.1 to 10"))
}

/// The refractive index of a dielectric, which may depend on the wavelength.
pub(super) fn medium(
    params: &Params,
    name: &str,
    default: f64,
    folder: &Path,
) -> Result<RefractiveIndex> {
    let constant = || Ok(RefractiveIndex::Constant(index(params, name, default, folder)?.into()));
    let Some(param) = params.get(name) else { return constant() };
    let (nm, values) = match (&param.kind[..], &param.values.texts[..]) {
        ("spectrum", [text]) => match glass(text) {
            Some(glass) => return Ok(glass),
            None if named(text, ColorUse::Unbounded).is_some() => return constant(),
            None => file(param, text, folder)?,
        },
        ("spectrum", []) => unzip(&param.values.numbers),
        _ => return constant(),
    };
    RefractiveIndex::of_samples(nm, values).map_err(|error| {
        let problem = format!("`{name}`: {}", error.problem());
        param
            .location
            .error(problem, "give pairs of wavelengths, which grow, and indices from 0.1 to 10")
    })
}

/// Pairs of a file.
fn file(param: &Param, name: &str, folder: &Path) -> Result<(Vec<f64>, Vec<f64>)> {
    // Names of spectra are no files, so only exact names are.
    let Some(path) = find_exact(folder, name) else {
        let problem = format!("there is neither a spectrum nor a file `{name}`");
        return Err(param.location.error(problem, text::RELATIVE_NAME));
    };
    spectrum::pairs(&path)
}

/// CIE illuminants and their chromaticities for the 2 degree observer (CIE 15).
const ILLUMINANTS: [(&str, [f64; 2]); 15] = [
    ("A", [0.447_58, 0.407_45]),
    ("D50", [0.345_67, 0.358_51]),
    ("D65", [0.312_72, 0.329_03]),
    ("F1", [0.313_10, 0.337_27]),
    ("F2", [0.372_08, 0.375_29]),
    ("F3", [0.409_10, 0.394_30]),
    ("F4", [0.440_18, 0.403_29]),
    ("F5", [0.313_79, 0.345_31]),
    ("F6", [0.377_90, 0.388_35]),
    ("F7", [0.312_92, 0.329_33]),
    ("F8", [0.345_88, 0.358_75]),
    ("F9", [0.374_17, 0.372_81]),
    ("F10", [0.346_09, 0.359_86]),
    ("F11", [0.380_52, 0.377_13]),
    ("F12", [0.436_95, 0.404_41]),
];

/// A built-in spectrum.
fn named(name: &str, color_use: ColorUse) -> Option<Rgb> {
    if let Some(illuminant) = name.strip_prefix("stdillum-") {
        let found = ILLUMINANTS.iter().find(|(own, _)| *own == illuminant)?;
        let white = found.0 == "D65";
        return Some(if white { Rgb::ONE } else { chromaticity(found.1[0], found.1[1]) });
    }
    if let Some(metal) = name.strip_prefix("metal-") {
        let (metal, is_index) = match metal.strip_suffix("-eta") {
            Some(metal) => (metal, true),
            None => (metal.strip_suffix("-k")?, false),
        };
        // Brass: values at about 650, 550 and 450 nm (Querry 1985).
        let brass = [Rgb::new(0.444, 0.527, 1.094), Rgb::new(3.695, 2.765, 1.829)];
        let [eta, k] = if metal == "CuZn" { brass } else { neutral_metal(metal)? };
        return Some(if is_index { eta } else { k });
    }
    let index = glass(name)?.at_d() as f32;
    (color_use == ColorUse::Unbounded).then(|| Rgb::splat(index))
}

/// The glass of this name.
fn glass(name: &str) -> Option<RefractiveIndex> {
    RefractiveIndex::named(match name.strip_prefix("glass-")? {
        "BK7" => "N-BK7",
        "BAF10" => "N-BAF10",
        "FK51A" => "N-FK51A",
        "LASF9" => "LASF9",
        "SF5" | "F5" => "SF5",
        "SF10" | "F10" => "SF10",
        "SF11" | "F11" => "SF11",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::base::math::luminance;

    #[test]
    fn illuminants_have_luminance_1_and_their_hue() {
        let a = named("stdillum-A", ColorUse::Light).unwrap();
        let body = of_unit_luminance(spectrum::black_body(2856.0));
        assert!((luminance(a) - 1.0).abs() < 1e-5);
        // Illuminant A is a black body of 2856 K.
        assert!((a - body).abs().max_element() < 0.03, "{a} {body}");
        assert_eq!(named("stdillum-D65", ColorUse::Light), Some(Rgb::ONE));
    }

    #[test]
    fn white_is_white_in_all_color_spaces() {
        for name in ["srgb", "dci-p3", "rec2020", "aces2065-1"] {
            let white = ColorSpace::named(name).unwrap().to_srgb(DVec3::ONE);
            assert!((white - DVec3::ONE).abs().max_element() < 1e-4, "{name}: {white}");
        }
    }
}
