//! White balance: chromatic adaptation from the color that should look gray to the white of the
//! display.

use super::auto_exposure;
use super::primaries::{Primaries, adaptation, converted, white};
use bdpm_base::error::{Error, Result};
use bdpm_base::math::Rgb;
use bdpm_base::spectrum::black_body_xyz;
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::str::FromStr;

/// The color that should look gray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum WhiteBalance {
    /// The mean color of the image ("gray world"), in which bright pixels count at most as white.
    GrayWorld,
    /// The color of light of this temperature, kelvin.
    Kelvin(f64),
    /// A color of the image: linear Rec. 709 in any unit.
    Color(Rgb),
    /// The mean color of the 5x5 pixels around this column and row.
    Pixel([u32; 2]),
}

const ADVICE: &str = "give `auto`, kelvins such as 3000, a pixel such as 200,150, or a color such \
                      as 1.2,1,0.6";

/// Temperatures of light: those of the daylight of the CIE, and of fire.
const KELVINS: std::ops::RangeInclusive<f64> = 1000.0..=25_000.0;

impl FromStr for WhiteBalance {
    type Err = Error;

    /// Reads `auto`, or one number (kelvins), two (column and row of a pixel) or three (a color).
    fn from_str(text: &str) -> Result<Self> {
        if text.trim() == "auto" {
            return Ok(Self::GrayWorld);
        }
        let numbers = text.split(',').map(|word| word.trim().parse::<f64>());
        let numbers = numbers.collect::<std::result::Result<Vec<f64>, _>>().unwrap_or_default();
        let is_pixel = |own: f64| own.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(&own);
        match numbers[..] {
            [kelvin] if KELVINS.contains(&kelvin) => Ok(Self::Kelvin(kelvin)),
            [kelvin] => {
                let advice = "give 1000 to 25000 kelvins";
                Err(Error::new(format!("{kelvin} K is no color temperature of light"), advice))
            }
            [x, y] if is_pixel(x) && is_pixel(y) => Ok(Self::Pixel([x as u32, y as u32])),
            [r, g, b] if [r, g, b].iter().all(|own| own.is_finite() && *own >= 0.0) => {
                Ok(Self::Color(DVec3::new(r, g, b).as_vec3()))
            }
            _ => Err(Error::new(format!("`{text}` is no white balance"), ADVICE)),
        }
    }
}

impl WhiteBalance {
    /// The adaptation of an image of `width` columns from its gray to white. A black image stays
    /// unchanged under [`Self::GrayWorld`].
    ///
    /// # Errors
    /// If the color that should be gray is black, or the pixel is outside.
    pub fn adaptation(&self, width: u32, pixels: &[Rgb]) -> Result<Adaptation> {
        let xyz = match self {
            Self::Kelvin(kelvin) => Some(temperature_xyz(*kelvin)),
            Self::Color(color) => gray_xyz(color.as_dvec3()),
            Self::Pixel(at) => gray_xyz(mean_around(*at, width, pixels)?),
            Self::GrayWorld => match gray_world(pixels) {
                Some(mean) => gray_xyz(mean),
                None => Some(D65),
            },
        };
        xyz.and_then(Adaptation::new).ok_or_else(|| {
            let problem = "the color that should be gray is black";
            Error::new(problem, ADVICE)
        })
    }
}

/// XYZ of the white D65, of luminance 1.
const D65: DVec3 = DVec3::new(0.3127 / 0.3290, 1.0, 0.3583 / 0.3290);

/// XYZ of a color of Rec. 709, scaled to luminance 1. `None` if that is impossible.
fn gray_xyz(color: DVec3) -> Option<DVec3> {
    let xyz = Primaries::REC_709.to_xyz()? * (color / color.max_element());
    let xyz = xyz / xyz.y;
    xyz.is_finite().then_some(xyz)
}

/// XYZ of light of a temperature, of luminance 1: a black body up to 4000 K, daylight of the CIE
/// from 5000 K, and a mixture between them.
fn temperature_xyz(kelvin: f64) -> DVec3 {
    let share = ((kelvin - 4000.0) / 1000.0).clamp(0.0, 1.0);
    let body = black_body_xyz(kelvin);
    body / body.y * (1.0 - share) + daylight_xyz(kelvin.max(4000.0)) * share
}

/// XYZ of daylight of a correlated color temperature from 4000 to 25,000 K, of luminance 1: CIE
/// 015:2018, equations 4.1 to 4.3.
fn daylight_xyz(kelvin: f64) -> DVec3 {
    let [c0, c1, c2, c3] = match kelvin <= 7000.0 {
        true => [0.244_063, 0.099_11e3, 2.967_8e6, -4.607_0e9],
        false => [0.237_040, 0.247_48e3, 1.901_8e6, -2.006_4e9],
    };
    let t = 1.0 / kelvin;
    let x = c0 + t * (c1 + t * (c2 + t * c3));
    let y = -0.275 + x * (2.870 - x * 3.0);
    white([x, y]).expect("y is positive")
}

/// Mean color, if the image is not black. Pixels count by `E/(1 + E m)` with their largest channel
/// `m` and the automatic exposure `E`, so that lamps and windows count at most as white.
fn gray_world(pixels: &[Rgb]) -> Option<DVec3> {
    let exposure = f64::from(auto_exposure(pixels));
    let term = |pixel: &Rgb| {
        let exposed = exposure * pixel.max(Rgb::ZERO).as_dvec3();
        let is_known = pixel.is_finite() && exposed.is_finite();
        if is_known { exposed / (1.0 + exposed.max_element()) } else { DVec3::ZERO }
    };
    // Partial sums of fixed parts: the result does not depend on the number of threads.
    let sums: Vec<DVec3> =
        pixels.par_chunks(1 << 14).map(|part| part.iter().map(term).sum::<DVec3>()).collect();
    let sum: DVec3 = sums.into_iter().sum();
    (sum.max_element() > 0.0).then_some(sum)
}

/// Mean color of up to 5x5 pixels.
fn mean_around([x, y]: [u32; 2], width: u32, pixels: &[Rgb]) -> Result<DVec3> {
    let height = (pixels.len() / width.max(1) as usize) as u32;
    if x >= width || y >= height {
        let problem = format!("the pixel {x},{y} is not within {width}x{height} pixels");
        return Err(Error::new(problem, "give the column and row of a pixel, from 0"));
    }
    let near = |at: u32, size: u32| at.saturating_sub(2)..=at.saturating_add(2).min(size - 1);
    let rows = near(y, height).flat_map(|row| near(x, width).map(move |column| (row, column)));
    let colors = rows.map(|(row, column)| pixels[row as usize * width as usize + column as usize]);
    Ok(colors.filter(|color| color.is_finite()).map(|color| color.max(Rgb::ZERO).as_dvec3()).sum())
}

/// A map of colors that makes one color gray and keeps its luminance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adaptation {
    /// From linear Rec. 709 to linear Rec. 709.
    map: DMat3,
    /// XYZ of the color that becomes gray, of luminance 1.
    gray: DVec3,
}

impl Adaptation {
    /// Adaptation from a color of luminance 1. The cones of Bradford's adaptation respond to all
    /// colors without negative channels and to all [`KELVINS`], so that the map is finite.
    fn new(gray: DVec3) -> Option<Self> {
        let to_xyz = Primaries::REC_709.to_xyz()?;
        let map = to_xyz.inverse() * adaptation(gray, D65) * to_xyz;
        map.is_finite().then_some(Self { map, gray })
    }

    /// Adapts all pixels. Channels outside of the gamut become 0; pixels that are not finite are
    /// unchanged.
    pub fn apply(&self, pixels: &mut [Rgb]) {
        pixels.par_iter_mut().for_each(|pixel| *pixel = converted(self.map, *pixel));
    }

    /// CIE chromaticities `x` and `y` of the color that becomes gray.
    pub fn chromaticity(&self) -> [f64; 2] {
        let sum = self.gray.element_sum();
        [self.gray.x / sum, self.gray.y / sum]
    }

    /// Correlated color temperature of the color that becomes gray, kelvin, by McCamy's formula
    /// (1992); `None` outside of its range from 2000 to 12,500 K.
    pub fn correlated_temperature(&self) -> Option<f64> {
        let [x, y] = self.chromaticity();
        let n = (x - 0.3320) / (0.1858 - y);
        let kelvin = 5520.33 + n * (6823.3 + n * (3525.0 + n * 449.0));
        (2000.0..=12_500.0).contains(&kelvin).then_some(kelvin)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_base::math::luminance;

    fn adapted(balance: WhiteBalance, mut pixels: Vec<Rgb>) -> Vec<Rgb> {
        let width = pixels.len() as u32;
        balance.adaptation(width, &pixels).unwrap().apply(&mut pixels);
        pixels
    }

    fn is_gray(color: Rgb) -> bool {
        color.max_element() - color.min_element() < 1e-4 * color.max_element()
    }

    #[test]
    fn values_are_auto_kelvins_pixels_and_colors() {
        let read = |text: &str| text.parse::<WhiteBalance>();
        assert_eq!(read("auto").unwrap(), WhiteBalance::GrayWorld);
        assert_eq!(read("3000").unwrap(), WhiteBalance::Kelvin(3000.0));
        assert_eq!(read("20, 7").unwrap(), WhiteBalance::Pixel([20, 7]));
        assert_eq!(read("1,0.5,.25").unwrap(), WhiteBalance::Color(Rgb::new(1.0, 0.5, 0.25)));
        for bad in ["", "warm", "1,2,3,4", "-1,2", "0.5,2", "nan,1,1", "1,-1,1", "inf,1,1"] {
            let shown = read(bad).unwrap_err().to_string();
            assert!(shown.contains("is no white balance\nhelp: give `auto`"), "{bad}: {shown}");
        }
        for bad in ["0", "999", "30000", "nan"] {
            let shown = read(bad).unwrap_err().to_string();
            assert!(shown.contains("no color temperature"), "{bad}: {shown}");
        }
    }

    #[test]
    fn chosen_color_becomes_gray_and_keeps_its_luminance() {
        let warm = Rgb::new(2.0, 1.0, 0.3);
        for balance in [WhiteBalance::Color(0.1 * warm), WhiteBalance::Pixel([1, 0])] {
            let pixels = adapted(balance, vec![warm; 4]);
            assert!(is_gray(pixels[0]), "{}", pixels[0]);
            assert!((luminance(pixels[0]) / luminance(warm) - 1.0).abs() < 1e-4);
        }
        let outside = WhiteBalance::Pixel([4, 0]).adaptation(4, &[warm; 4]).unwrap_err();
        assert!(outside.to_string().contains("the pixel 4,0 is not within 4x1"), "{outside}");
    }

    #[test]
    fn gray_world_ignores_lamps_black_and_broken_pixels() {
        let wall = Rgb::new(1.0, 0.8, 0.5);
        let mut pixels = vec![wall; 1000];
        pixels.extend([Rgb::new(0.0, 0.0, 1e6), Rgb::NAN, Rgb::ZERO, Rgb::splat(f32::INFINITY)]);
        let balanced = adapted(WhiteBalance::GrayWorld, pixels)[0];
        assert!(balanced.max_element() / balanced.min_element() < 1.02, "{balanced}");
        let black = vec![Rgb::ZERO; 3];
        assert_eq!(adapted(WhiteBalance::GrayWorld, black.clone()), black);
    }

    #[test]
    fn temperatures_have_the_published_chromaticities() {
        let xy = |kelvin| {
            let adaptation = WhiteBalance::Kelvin(kelvin).adaptation(1, &[Rgb::ONE]).unwrap();
            (adaptation.chromaticity(), adaptation.correlated_temperature())
        };
        // Illuminant A is a black body of 2856 K; D50, D65 and D75 are CIE 015.
        for (kelvin, expected) in [
            (2856.0, [0.447_58, 0.407_45]),
            (5003.0, [0.345_67, 0.358_50]),
            (6504.0, [0.312_72, 0.329_03]),
            (7504.0, [0.299_03, 0.314_88]),
        ] {
            let (found, temperature) = xy(kelvin);
            for (found, expected) in found.into_iter().zip(expected) {
                assert!((found - expected).abs() < 5e-4, "{kelvin}: {found} {expected}");
            }
            assert!((temperature.unwrap() / kelvin - 1.0).abs() < 0.01, "{temperature:?}");
        }
        // No jump between both kinds of light.
        for kelvin in [4000.0, 5000.0, 7000.0] {
            let ([a, b], _) = xy(kelvin - 0.5);
            let ([c, d], _) = xy(kelvin + 0.5);
            assert!((a - c).abs() < 2e-4 && (b - d).abs() < 2e-4, "{kelvin}");
        }
        for kelvin in [1000.0, 25_000.0] {
            xy(kelvin);
        }
    }

    #[test]
    fn daylight_changes_little_and_warm_light_loses_red() {
        let gray = vec![Rgb::ONE; 2];
        let day = adapted(WhiteBalance::Kelvin(6504.0), gray.clone())[0];
        assert!((day - Rgb::ONE).abs().max_element() < 2e-3, "{day}");
        let [r, g, b] = adapted(WhiteBalance::Kelvin(3000.0), gray)[0].to_array();
        assert!(r < 0.8 * g && b > 1.5 * g, "{r} {g} {b}");
    }

    #[test]
    fn saturated_colors_become_gray_and_black_is_refused() {
        for color in [Rgb::X, Rgb::Y, Rgb::Z, Rgb::new(1e-20, 0.0, 1e-20)] {
            let pixel = adapted(WhiteBalance::Color(color), vec![color])[0];
            assert!(is_gray(pixel), "{pixel}");
        }
        for balance in [WhiteBalance::Color(Rgb::ZERO), WhiteBalance::Pixel([0, 0])] {
            let shown = balance.adaptation(1, &[Rgb::ZERO]).unwrap_err().to_string();
            assert!(shown.contains("should be gray is black\nhelp: give `auto`"), "{shown}");
        }
    }
}
