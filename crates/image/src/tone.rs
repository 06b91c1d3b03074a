//! Tone mapping of the preview: exposure, tone curve, sRGB.

use super::tone_curves::{agx, filmic};
use bdpm_base::math::{Rgb, luminance};
use serde::{Deserialize, Serialize};

/// Curve that maps exposed radiance to a display.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ToneCurve {
    /// The sRGB curve: colors below 0.7 are exact, brighter ones roll off toward white.
    #[default]
    Srgb,
    /// AgX: wide range, bright colors approach white.
    Agx,
    /// Hable's filmic curve: soft contrast in shadows and highlights, per channel.
    Filmic,
}

/// Conversion of radiance to the 8-bit pixels of a preview.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToneMapping {
    /// Curve from exposed radiance to display values.
    pub curve: ToneCurve,
    /// Exposure relative to [`auto_exposure`], stops: 1 doubles the brightness.
    pub stops: f32,
}

impl ToneMapping {
    /// The factor from radiance to display brightness for an image of these pixels.
    pub fn exposure(&self, pixels: &[Rgb]) -> f32 {
        (auto_exposure(pixels) * self.stops.exp2()).clamp(f32::MIN_POSITIVE, f32::MAX)
    }

    /// An 8-bit sRGB pixel. Negative values and NaN are black.
    #[inline]
    pub fn apply(&self, radiance: Rgb, exposure: f32) -> [u8; 3] {
        match self.curve {
            ToneCurve::Srgb => tone_map(radiance, exposure),
            ToneCurve::Agx => agx(exposed(radiance, exposure)).to_array().map(code),
            ToneCurve::Filmic => {
                let display = exposed(radiance, exposure).to_array().map(filmic);
                display.map(|value| code(srgb_transfer(value)))
            }
        }
    }
}

/// Radiance times exposure, with 0 in place of negative values and NaN, at most `f32::MAX`.
#[inline]
fn exposed(radiance: Rgb, exposure: f32) -> Rgb {
    let positive = |value: f32| if value > 0.0 { value.min(f32::MAX) } else { 0.0 };
    Rgb::from_array((radiance * exposure).to_array().map(positive))
}

/// The 8-bit code of a display value in [0, 1].
#[inline]
fn code(display: f32) -> u8 {
    (255.0 * display).round() as u8
}

/// Display value of the geometric mean of the image's luminance, in units of display white.
const KEY: f64 = 0.2;

/// Number of pixels that determine the exposure of a larger image, at least.
const MAX_EXPOSURE_PIXELS: usize = 1 << 20;

/// Display values below this are unchanged; brighter ones bend toward white.
const SHOULDER: f32 = 0.7;

/// The factor from radiance to display brightness, where 1 is white.
///
/// It puts the geometric mean of the luminance at 0.2, about the reflectance of a room's walls seen
/// in the light of the room. Black and nearly black pixels (below 1/1000 of the mean: a background,
/// the view past an open box) do not count, nor do ones that are not finite. The logarithm keeps a
/// visible lamp from darkening all the rest: a lamp 50 times brighter than its room that covers
/// 2 % of the image lowers the exposure by 8 %. A black image has exposure 1.
pub fn auto_exposure(pixels: &[Rgb]) -> f32 {
    // Of millions of pixels, an even selection suffices.
    let step = (pixels.len() / MAX_EXPOSURE_PIXELS).max(1);
    let lit = || {
        let values = pixels.iter().step_by(step).map(|&pixel| f64::from(luminance(pixel)));
        values.filter(|y| y.is_finite() && *y > 0.0)
    };
    let mean_of = |sum: f64, count: usize| sum / count.max(1) as f64;
    let floor = 1e-3 * mean_of(lit().sum(), lit().count());
    let counted = || lit().filter(|&y| y >= floor);
    if counted().next().is_none() {
        return 1.0;
    }
    let log_mean = mean_of(counted().map(f64::ln).sum(), counted().count());
    // Extreme radiances stay within what an f32 can express.
    (KEY / log_mean.exp()).clamp(f64::from(f32::MIN_POSITIVE), f64::from(f32::MAX)) as f32
}

/// An 8-bit sRGB pixel: the exposed radiance, each channel rolled off above 0.7 so that lamps
/// approach white smoothly, through the exact piecewise sRGB transfer curve. Negative values and
/// NaN are black.
#[inline]
pub fn tone_map(radiance: Rgb, exposure: f32) -> [u8; 3] {
    (radiance * exposure).to_array().map(|value| {
        let display = srgb_transfer(roll_off(value.max(0.0)));
        code(display)
    })
}

/// The identity below the shoulder, then an exponential approach to 1; value and slope are
/// continuous.
#[inline]
fn roll_off(value: f32) -> f32 {
    let room = 1.0 - SHOULDER;
    if value <= SHOULDER { value } else { 1.0 - room * ((SHOULDER - value) / room).exp() }
}

/// The opto-electronic transfer of IEC 61966-2-1 on [0, 1].
#[inline]
fn srgb_transfer(linear: f32) -> f32 {
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn brighter_is_never_darker() {
        let mut last = 0;
        let mut seen = [false; 256];
        for step in 0..100_000 {
            let [r, g, b] = tone_map(Rgb::splat(step as f32 * 5e-5), 1.0);
            assert!(r == g && g == b && r >= last, "step {step}: {r} after {last}");
            last = r;
            seen[r as usize] = true;
        }
        assert!(seen.iter().all(|&seen| seen), "every gray is reached, also white");
    }

    #[test]
    fn black_stays_black_and_no_input_is_bad() {
        assert_eq!(tone_map(Rgb::ZERO, 1e30), [0; 3]);
        assert_eq!(tone_map(Rgb::new(f32::NAN, -1.0, f32::NEG_INFINITY), 1.0), [0; 3]);
        assert_eq!(tone_map(Rgb::splat(f32::INFINITY), 1.0), [255; 3]);
        assert_eq!(tone_map(Rgb::splat(f32::MAX), f32::MAX), [255; 3]);
        for image in [&[][..], &[Rgb::ZERO; 9], &[Rgb::splat(f32::NAN)], &[Rgb::splat(-1.0)]] {
            assert_eq!(auto_exposure(image), 1.0);
        }
        for value in [f32::MIN_POSITIVE, 1e-45, 1.0, f32::MAX] {
            let exposure = auto_exposure(&[Rgb::splat(value); 4]);
            assert!(exposure > 0.0 && exposure.is_finite(), "{value}: {exposure}");
        }
    }

    #[test]
    fn every_curve_is_monotone_from_black_to_white_and_accepts_all_input() {
        for curve in [ToneCurve::Srgb, ToneCurve::Agx, ToneCurve::Filmic] {
            let mapping = ToneMapping { curve, stops: 0.0 };
            let gray = |value: f32| mapping.apply(Rgb::splat(value), 1.0)[1];
            let mut last = 0;
            for step in 0..4000 {
                let value = gray((step as f32 * 0.01 - 20.0).exp2());
                assert!(value >= last, "{curve:?} at step {step}: {value} after {last}");
                last = value;
            }
            assert_eq!((gray(0.0), last), (0, 255), "{curve:?}");
            let bad = Rgb::new(f32::NAN, -1.0, f32::NEG_INFINITY);
            assert_eq!(mapping.apply(bad, 1.0), [0; 3], "{curve:?}");
            assert_eq!(mapping.apply(Rgb::splat(f32::INFINITY), 1.0), [255; 3], "{curve:?}");
        }
    }

    #[test]
    fn default_mapping_is_the_srgb_curve_and_stops_double_the_exposure() {
        let pixels = [Rgb::new(0.1, 0.5, 2.0); 4];
        let plain = ToneMapping::default();
        let exposure = plain.exposure(&pixels);
        assert_eq!(exposure, auto_exposure(&pixels));
        assert_eq!(plain.apply(pixels[0], exposure), tone_map(pixels[0], exposure));
        let brighter = ToneMapping { stops: 3.0, ..plain };
        assert_eq!(brighter.exposure(&pixels), 8.0 * exposure);
        for stops in [-1e9, 1e9] {
            let extreme = ToneMapping { stops, ..plain }.exposure(&pixels);
            assert!(extreme > 0.0 && extreme.is_finite(), "{stops}");
        }
    }

    #[test]
    fn the_transfer_curve_is_that_of_the_standard() {
        // 18 % gray is 118; the two pieces meet; white is white.
        assert_eq!(tone_map(Rgb::splat(0.18), 1.0), [118; 3]);
        assert!((srgb_transfer(0.003_130_8) - srgb_transfer(0.003_131)).abs() < 1e-5);
        assert!((srgb_transfer(1.0) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn exposure_follows_the_room_and_not_the_lamp_or_the_background() {
        let room = vec![Rgb::splat(0.3); 960];
        let plain = auto_exposure(&room);
        assert!((plain - 0.2 / 0.3).abs() < 1e-5, "{plain}");
        // Twice the light, half the exposure.
        let brighter: Vec<Rgb> = room.iter().map(|&pixel| 2.0 * pixel).collect();
        assert!((2.0 * auto_exposure(&brighter) - plain).abs() < 1e-5);
        let mut background = room.clone();
        background.resize(5000, Rgb::ZERO);
        assert_eq!(auto_exposure(&background), plain);
        let mut lamp = room;
        lamp.resize(980, Rgb::splat(15.0));
        let with_lamp = auto_exposure(&lamp);
        assert!(with_lamp < plain && with_lamp > 0.91 * plain, "{with_lamp}");
    }
}
