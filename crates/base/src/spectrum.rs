//! The visible spectrum: wavelengths that paths draw where they meet dispersion, and their colors.
//!
//! Paths are RGB until they meet a dispersive surface. There they draw one of [`Wavelength::COUNT`]
//! wavelengths with the probability `P`, and their weight is multiplied by the color of the
//! wavelength over `P`. White is the daylight D65: the mean of these factors over the drawn
//! wavelengths is (1, 1, 1), because the sums below are normalized in `f64`. theory.md (47k)

use crate::math::{LUMINANCE, Rgb};
use glam::{DMat3, DVec3};
use std::sync::LazyLock;

/// A wavelength of light in air, one of a regular grid over the visible range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Wavelength(u16);

impl Wavelength {
    /// Number of wavelengths.
    pub const COUNT: usize = 1023;

    /// Limits of the visible range, nm.
    const RANGE: [f64; 2] = [380.0, 780.0];

    /// All wavelengths, in ascending order.
    #[inline]
    pub fn all() -> impl Iterator<Item = Self> {
        (1..=Self::COUNT as u16).map(Self)
    }

    /// The wavelength of this index, from 1 on; `None` for 0.
    ///
    /// # Panics
    /// If the index exceeds [`Self::COUNT`].
    #[inline]
    pub fn from_index(index: u32) -> Option<Self> {
        assert!(index <= Self::COUNT as u32, "a wavelength");
        (index > 0).then_some(Self(index as u16))
    }

    /// Index of the wavelength, from 1 on.
    #[inline]
    pub fn index(self) -> u32 {
        self.0.into()
    }

    /// The wavelength, nm.
    #[inline]
    pub fn nanometers(self) -> f64 {
        let [low, high] = Self::RANGE;
        low + (high - low) * (f64::from(self.0) - 0.5) / Self::COUNT as f64
    }

    /// Draws a wavelength by a number in [0, 1).
    #[inline]
    pub fn sample(u: f32) -> Self {
        let below = SPECTRUM.cumulative.partition_point(|&end| end <= f64::from(u));
        Self((below + 1).min(Self::COUNT) as u16)
    }

    /// Probability with which [`Self::sample`] draws the wavelength.
    #[inline]
    pub fn prob(self) -> f32 {
        SPECTRUM.prob[usize::from(self.0) - 1]
    }

    /// Wavelengths whose cumulative probabilities differ from that of this one by at most half of
    /// `width`. theory.md (47l): `h = width/2`.
    #[inline]
    pub fn neighbors(self, width: f64) -> Neighbors {
        let Spectrum { cumulative, middle, .. } = &*SPECTRUM;
        let own = usize::from(self.0) - 1;
        let [low, high] = [middle[own] - 0.5 * width, middle[own] + 0.5 * width];
        let first = middle.partition_point(|&other| other < low).min(own);
        let end = middle.partition_point(|&other| other <= high).max(own + 1);
        let before = if first > 0 { cumulative[first - 1] } else { 0.0 };
        Neighbors {
            first: first as u16 + 1,
            last: end as u16,
            prob: (cumulative[end - 1] - before) as f32,
        }
    }

    /// Color of the wavelength in linear Rec. 709 over [`Self::prob`]. Its luminance is positive.
    /// Channels are negative where the color is outside of the gamut; none is 0.
    #[inline]
    pub fn color(self) -> Rgb {
        SPECTRUM.color[usize::from(self.0) - 1]
    }
}

/// Consecutive wavelengths around one: see [`Wavelength::neighbors`].
#[derive(Clone, Copy, Debug)]
pub struct Neighbors {
    first: u16,
    last: u16,
    prob: f32,
}

impl Neighbors {
    /// Probability with which [`Wavelength::sample`] draws one of them.
    #[inline]
    pub fn prob(&self) -> f32 {
        self.prob
    }

    /// Tests whether a wavelength is one of them.
    #[inline]
    pub fn contains(&self, wavelength: Wavelength) -> bool {
        (self.first..=self.last).contains(&wavelength.0)
    }

    /// Factor of a merge of a photon of the wavelength `photon` with a camera path whose neighbors
    /// these are. Both weights have the color of their wavelength. The factor replaces the photon's
    /// color by a kernel, which is 0 unless the photon is one of the neighbors. The mean over the
    /// photon's wavelength of the factor times its color is 1. theory.md (47l)
    #[inline]
    pub fn merge_factor(&self, photon: Wavelength) -> Rgb {
        if self.contains(photon) { (self.prob * photon.color()).recip() } else { Rgb::ZERO }
    }
}

/// Weight of the squared channels of a color in the probability of its wavelength, beside its
/// squared luminance. With 0.02 one draw adds 9 % of its square to the second moment of the
/// luminance. With 0 it would add nothing, but the second moment of blue would be 64 instead of
/// 8.4: the eye is blind to the light at both ends of the spectrum that blue consists of.
const CHANNEL_WEIGHT: f64 = 0.02;

/// Tables of all wavelengths.
struct Spectrum {
    color: Vec<Rgb>,
    prob: Vec<f32>,
    /// Sums of the probabilities up to each wavelength, which it includes.
    cumulative: Vec<f64>,
    /// Sums of the probabilities up to the middle of each wavelength.
    middle: Vec<f64>,
}

static SPECTRUM: LazyLock<Spectrum> = LazyLock::new(|| {
    let shares = shares();
    let luminance = LUMINANCE.as_dvec3();
    let density = |share: &DVec3| {
        (share.dot(luminance).powi(2) + CHANNEL_WEIGHT * share.length_squared()).sqrt()
    };
    let total: f64 = shares.iter().map(density).sum();
    let probs: Vec<f64> = shares.iter().map(|share| density(share) / total).collect();
    let mut sum = 0.0;
    let cumulative: Vec<f64> = probs
        .iter()
        .map(|prob| {
            sum += prob;
            sum
        })
        .collect();
    let middle: Vec<f64> =
        cumulative.iter().zip(&probs).map(|(end, prob)| end - 0.5 * prob).collect();
    Spectrum {
        middle,
        cumulative,
        color: shares.iter().zip(&probs).map(|(share, prob)| (share / *prob).as_vec3()).collect(),
        prob: probs.iter().map(|&prob| prob as f32).collect(),
    }
});

/// Share of each wavelength in the channels of white: the sum over all wavelengths is (1, 1, 1).
fn shares() -> Vec<DVec3> {
    // Columns: XYZ of the primaries of Rec. 709 (ITU-R BT.709, with the white D65).
    let to_xyz = DMat3::from_cols_array_2d(&[
        [0.412_390_799_265_959, 0.212_639_005_871_510, 0.019_330_818_715_592],
        [0.357_584_339_383_878, 0.715_168_678_767_756, 0.119_194_779_794_626],
        [0.180_480_788_401_834, 0.072_192_315_360_734, 0.950_532_152_249_661],
    ]);
    let to_rgb = to_xyz.inverse();
    let all = Wavelength::all().map(|wavelength| {
        let place = (wavelength.nanometers() - FIRST) / STEP;
        let (row, part) = (place as usize, place.fract());
        let [low, high] = [OBSERVER_AND_DAYLIGHT[row], OBSERVER_AND_DAYLIGHT[row + 1]];
        let at = |column: usize| low[column] + part * (high[column] - low[column]);
        at(3) * (to_rgb * DVec3::new(at(0), at(1), at(2)))
    });
    let all: Vec<DVec3> = all.collect();
    let white: DVec3 = all.iter().sum();
    all.into_iter().map(|color| color / white).collect()
}

/// XYZ of a black body of this temperature, in kelvins, in no particular unit: Planck's law.
pub fn black_body_xyz(kelvin: f64) -> DVec3 {
    // The second radiation constant, nm K.
    const C2: f64 = 1.438_776_877e7;
    let radiance = |nm: f64| (nm / 560.0).powi(-5) / (C2 / (nm * kelvin)).exp_m1();
    let rows = OBSERVER_AND_DAYLIGHT.iter().enumerate();
    rows.map(|(index, &[x, y, z, _])| DVec3::new(x, y, z) * radiance(FIRST + STEP * index as f64))
        .sum()
}

/// First wavelength of the table, and its step, nm.
const FIRST: f64 = 380.0;
const STEP: f64 = 5.0;

/// Color matching functions of the CIE 1931 2-degree observer (x, y, z), and the relative power of
/// the illuminant D65: CIE 015:2018, tables 1 and 6; linear in between.
#[rustfmt::skip]
const OBSERVER_AND_DAYLIGHT: [[f64; 4]; 81] = [
    [0.001_368, 0.000_039, 0.006_450_001, 49.975_5],
    [0.002_236, 0.000_064, 0.010_549_99, 52.311_8],
    [0.004_243, 0.000_12, 0.020_050_01, 54.648_2],
    [0.007_65, 0.000_217, 0.036_21, 68.701_5],
    [0.014_31, 0.000_396, 0.067_850_01, 82.754_9],
    [0.023_19, 0.000_64, 0.110_2, 87.120_4],
    [0.043_51, 0.001_21, 0.207_4, 91.486],
    [0.077_63, 0.002_18, 0.371_3, 92.458_9],
    [0.134_38, 0.004, 0.645_6, 93.431_8],
    [0.214_77, 0.007_3, 1.039_050_1, 90.057],
    [0.283_9, 0.011_6, 1.385_6, 86.682_3],
    [0.328_5, 0.016_84, 1.622_96, 95.773_6],
    [0.348_28, 0.023, 1.747_06, 104.865],
    [0.348_06, 0.029_8, 1.782_6, 110.936],
    [0.336_2, 0.038, 1.772_11, 117.008],
    [0.318_7, 0.048, 1.744_1, 117.41],
    [0.290_8, 0.06, 1.669_2, 117.812],
    [0.251_1, 0.073_9, 1.528_1, 116.336],
    [0.195_36, 0.090_98, 1.287_64, 114.861],
    [0.142_1, 0.112_6, 1.041_9, 115.392],
    [0.095_64, 0.139_02, 0.812_950_1, 115.923],
    [0.057_950_01, 0.169_3, 0.616_2, 112.367],
    [0.032_01, 0.208_02, 0.465_18, 108.811],
    [0.014_7, 0.258_6, 0.353_3, 109.082],
    [0.004_9, 0.323, 0.272, 109.354],
    [0.002_4, 0.407_3, 0.212_3, 108.578],
    [0.009_3, 0.503, 0.158_2, 107.802],
    [0.029_1, 0.608_2, 0.111_7, 106.296],
    [0.063_27, 0.71, 0.078_249_99, 104.79],
    [0.109_6, 0.793_2, 0.057_250_01, 106.239],
    [0.165_5, 0.862, 0.042_16, 107.689],
    [0.225_749_9, 0.914_850_1, 0.029_84, 106.047],
    [0.290_4, 0.954, 0.020_3, 104.405],
    [0.359_7, 0.980_3, 0.013_4, 104.225],
    [0.433_449_9, 0.994_950_1, 0.008_749_999, 104.046],
    [0.512_050_1, 1.0, 0.005_749_999, 102.023],
    [0.594_5, 0.995, 0.003_9, 100.0],
    [0.678_4, 0.978_6, 0.002_749_999, 98.167_1],
    [0.762_1, 0.952, 0.002_1, 96.334_2],
    [0.842_5, 0.915_4, 0.001_8, 96.061_1],
    [0.916_3, 0.87, 0.001_650_001, 95.788],
    [0.978_6, 0.816_3, 0.001_4, 92.236_8],
    [1.026_3, 0.757, 0.001_1, 88.685_6],
    [1.056_7, 0.694_9, 0.001, 89.345_9],
    [1.062_2, 0.631, 0.000_8, 90.006_2],
    [1.045_6, 0.566_8, 0.000_6, 89.802_6],
    [1.002_6, 0.503, 0.000_34, 89.599_1],
    [0.938_4, 0.441_2, 0.000_24, 88.648_9],
    [0.854_449_9, 0.381, 0.000_19, 87.698_7],
    [0.751_4, 0.321, 0.000_1, 85.493_6],
    [0.642_4, 0.265, 0.000_05, 83.288_6],
    [0.541_9, 0.217, 0.000_03, 83.493_9],
    [0.447_9, 0.175, 0.000_02, 83.699_2],
    [0.360_8, 0.138_2, 0.000_01, 81.863],
    [0.283_5, 0.107, -0.0, 80.026_8],
    [0.218_7, 0.081_6, 0.0, 80.120_7],
    [0.164_9, 0.061, 0.0, 80.214_6],
    [0.121_2, 0.044_58, 0.0, 81.246_2],
    [0.087_4, 0.032, 0.0, 82.277_8],
    [0.063_6, 0.023_2, 0.0, 80.281],
    [0.046_77, 0.017, 0.0, 78.284_2],
    [0.032_9, 0.011_92, 0.0, 74.002_7],
    [0.022_7, 0.008_21, 0.0, 69.721_3],
    [0.015_84, 0.005_723, 0.0, 70.665_2],
    [0.011_359_16, 0.004_102, 0.0, 71.609_1],
    [0.008_110_916, 0.002_929, 0.0, 72.979],
    [0.005_790_346, 0.002_091, 0.0, 74.349],
    [0.004_109_457, 0.001_484, 0.0, 67.976_5],
    [0.002_899_327, 0.001_047, 0.0, 61.604],
    [0.002_049_19, 0.000_74, 0.0, 65.744_8],
    [0.001_439_971, 0.000_52, 0.0, 69.885_6],
    [0.000_999_949_3, 0.000_361_1, 0.0, 72.486_3],
    [0.000_690_078_6, 0.000_249_2, 0.0, 75.087],
    [0.000_476_021_3, 0.000_171_9, 0.0, 69.339_8],
    [0.000_332_301_1, 0.000_12, 0.0, 63.592_7],
    [0.000_234_826_1, 0.000_084_8, 0.0, 55.005_4],
    [0.000_166_150_5, 0.000_06, 0.0, 46.418_2],
    [0.000_117_413, 0.000_042_4, 0.0, 56.611_8],
    [0.000_083_075_3, 0.000_03, 0.0, 66.805_4],
    [0.000_058_706_5, 0.000_021_2, 0.0, 65.094_1],
    [0.000_041_509_9, 0.000_014_99, 0.0, 63.382_8],
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::luminance;
    use crate::rng::{Stream, StreamKey};

    #[test]
    fn mean_color_over_the_drawn_wavelengths_is_white() {
        let all = || Wavelength::all();
        let mean: DVec3 = all().map(|w| f64::from(w.prob()) * w.color().as_dvec3()).sum();
        assert!((mean - DVec3::ONE).abs().max_element() < 1e-5, "{mean}");
        assert!((all().map(|w| f64::from(w.prob())).sum::<f64>() - 1.0).abs() < 1e-5);
        for wavelength in all() {
            assert!(luminance(wavelength.color()) > 0.0);
            assert!(wavelength.color().abs().min_element() > 1e-5, "{wavelength:?}");
        }
    }

    #[test]
    fn table_has_the_white_point_of_d65_and_the_second_moments_of_its_doc() {
        // The chromaticity of D65: the normalization of the channels corrects less than 1e-3.
        let table = &OBSERVER_AND_DAYLIGHT;
        let xyz = [0, 1, 2].map(|c| table.iter().map(|row| row[c] * row[3]).sum::<f64>());
        let sum: f64 = xyz.iter().sum();
        assert!((xyz[0] / sum - 0.312_72).abs() < 1e-4 && (xyz[1] / sum - 0.329_03).abs() < 1e-4);
        let second = |value: &dyn Fn(Rgb) -> f32| -> f64 {
            let term = |w: Wavelength| f64::from(w.prob() * value(w.color()).powi(2));
            Wavelength::all().map(term).sum()
        };
        assert!((second(&luminance) - 1.09).abs() < 5e-3, "{}", second(&luminance));
        assert!((second(&|color| color.z) - 8.4).abs() < 0.05, "{}", second(&|color| color.z));
    }

    /// As docs/reference/output-files.md states: negative pixels of few paths are meant.
    #[test]
    fn every_wavelength_is_outside_of_rec_709_by_the_stated_amounts() {
        let colors = || Wavelength::all().map(Wavelength::color);
        assert!(colors().all(|color| color.min_element() < 0.0));
        let low = colors().fold(Rgb::ZERO, Rgb::min);
        let high = colors().fold(Rgb::ZERO, Rgb::max);
        assert!((low - Rgb::new(-2.3, -1.2, -0.2)).abs().max_element() < 0.05, "{low}");
        assert!((high - Rgb::new(6.1, 2.1, 8.3)).abs().max_element() < 0.05, "{high}");
    }

    #[test]
    fn wavelengths_are_drawn_by_their_probabilities() {
        let mut rng = StreamKey::new(1, Stream::Test, 54).rng(0);
        let (n, mut counts) = (1_000_000, vec![0.0; Wavelength::COUNT + 1]);
        for _ in 0..n {
            counts[Wavelength::sample(rng.next_1d()).index() as usize] += 1.0;
        }
        let chi2: f64 = Wavelength::all()
            .map(|w| {
                let expected = f64::from(n) * f64::from(w.prob());
                (counts[w.index() as usize] - expected).powi(2) / expected
            })
            .sum();
        // Mean 1022, standard deviation 45.
        assert!((chi2 - 1022.0).abs() < 4.0 * 45.2, "{chi2}");
        assert_eq!(Wavelength::sample(0.0).index(), 1);
        // The last wavelengths are rarer than the step of the numbers.
        assert!(Wavelength::sample(0.999_999_94).index() > 1015);
    }

    #[test]
    fn mean_merge_factor_over_the_photons_wavelength_is_1() {
        for (own, width) in [1, 10, 300, 512, 1000, 1023].into_iter().flat_map(|own| {
            [1e-9, 0.003, 0.06, 0.5, 1.0].map(|width| (Wavelength::from_index(own).unwrap(), width))
        }) {
            let near = own.neighbors(width);
            assert!(near.contains(own));
            let mean: DVec3 = Wavelength::all()
                .map(|photon| {
                    (photon.prob() * photon.color() * near.merge_factor(photon)).as_dvec3()
                })
                .sum();
            assert!((mean - DVec3::ONE).abs().max_element() < 1e-5, "{own:?} {width}: {mean}");
            let prob: f64 =
                Wavelength::all().filter(|w| near.contains(*w)).map(|w| f64::from(w.prob())).sum();
            assert!((prob / f64::from(near.prob()) - 1.0).abs() < 1e-5, "{own:?} {width}: {prob}");
        }
        let middle = Wavelength::from_index(480).unwrap();
        assert!((middle.neighbors(0.3).prob() - 0.3).abs() < 5e-3);
        // Half widths of the kernel, nm, at green, and toward the ends, where the eye sees little.
        let reach = |nanometers: f64| {
            let near = |w: &Wavelength| (w.nanometers() - nanometers).abs();
            let own = Wavelength::all().min_by(|a, b| near(a).total_cmp(&near(b))).unwrap();
            let near = own.neighbors(0.06);
            let all = Wavelength::all().filter(|other| near.merge_factor(*other) != Rgb::ZERO);
            let merged: Vec<f64> = all.map(Wavelength::nanometers).collect();
            [nanometers - merged[0], merged[merged.len() - 1] - nanometers]
        };
        for (nanometers, most) in [(450.0, 20.0), (500.0, 16.0), (550.0, 4.0), (600.0, 7.0)] {
            let [below, above] = reach(nanometers);
            assert!(below.max(above) < most, "{nanometers}: {below} {above}");
        }
        // Factors are bounded, so that rare wavelengths do not become outliers.
        for own in Wavelength::all() {
            let factor = (own.neighbors(0.06).merge_factor(own) * own.color()).x;
            assert!((15.0..35.0).contains(&factor), "{own:?}: {factor}");
        }
    }

    #[test]
    fn wavelengths_are_a_regular_grid() {
        let at = |index| Wavelength::from_index(index).map(Wavelength::nanometers);
        assert_eq!(at(0), None);
        assert!((at(512).unwrap() - 580.0).abs() < 1e-9);
        assert!((at(2).unwrap() - at(1).unwrap() - 400.0 / 1023.0).abs() < 1e-9);
    }
}
