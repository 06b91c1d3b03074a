//! Pixels from which a page computes the error of any mixture of lights.
//!
//! The error of a mixture is a mean over pixels, whose weights depend on the mixture. A page has no
//! room for all pixels of a large image. It has squares of them, mainly those with large errors.
//! Their weights make the errors of some mixtures exact: all lights together, each light alone, and
//! all lights with one of them off or dimmed. Smaller images are a single square, and the error of
//! every mixture is exact but for rounding.

mod choice;

use super::light_layers::LightImage;
use super::light_mix::{LightImages, MixtureError, SeededError, variance};
use bdpm_auto::adaptive::stopping::{AROUND_PIXEL, without_noise};
use bdpm_core::base::math::{Rgb, luminance};
use bdpm_core::image_io::{half_bits, half_value};
use choice::Reference;
use std::ops::Range;

/// Bytes of a light at a pixel of the sample: luminance and noise.
const PIXEL_BYTES: usize = 4;

/// Number of mixtures whose errors are compared with those of all pixels.
const COMPARED: usize = 4;

/// Squares of pixels, with what the lights contribute to them.
#[derive(Clone, Debug)]
pub struct MixtureSample {
    /// Width and height of the image, pixels.
    pub size: (u32, u32),
    /// The squares, in the order of their pixels in the lists of lights.
    pub squares: Vec<SampleSquare>,
    /// The lights, in the order of the images.
    pub lights: Vec<SampledLight>,
    /// Mean luminance without noise over mean luminance, with all lights on; `None` if the sample
    /// is the whole image.
    pub clean_share: Option<f64>,
    /// Maximum relative difference between the error by the sample and by all pixels, over some
    /// mixtures.
    pub largest_difference: f64,
}

/// A square of pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampleSquare {
    /// Left, upper, right and lower end of the pixels whose errors count.
    pub pixels: [u32; 4],
    /// Weight of their squared errors.
    pub weight: f64,
}

/// Contributions of a light to the pixels of a sample. The pixels of each square follow row by row,
/// with those around it on which the weights depend.
#[derive(Clone, Debug)]
pub struct SampledLight {
    /// Unit of `luminance` and `rms`, W/(m^2 sr).
    pub scale: f64,
    /// Luminance of each pixel as 16-bit float.
    pub luminance: Vec<u16>,
    /// Standard error of the luminance of each pixel before denoising as 16-bit float, if it is
    /// known.
    pub rms: Option<Vec<u16>>,
    /// Mean luminance of the image, W/(m^2 sr).
    pub mean: f64,
    /// Relative RMS of the merge bias.
    pub bias: f64,
    /// Relative RMS error after denoising, if the image was denoised; may be not a number.
    pub denoised: Option<f64>,
    /// Number that chose the random numbers, if it is known.
    pub seed: Option<u64>,
}

/// Numbers of a [`SampledLight`].
struct Values {
    luminance: Vec<f64>,
    rms: Option<Vec<f64>>,
}

impl SampleSquare {
    /// Left, upper, right and lower end of the pixels with their surroundings.
    pub fn stored(&self, (width, height): (u32, u32)) -> [u32; 4] {
        let ([left, top, right, bottom], around) = (self.pixels, AROUND_PIXEL as u32);
        [
            left.saturating_sub(around),
            top.saturating_sub(around),
            (right + around).min(width),
            (bottom + around).min(height),
        ]
    }

    /// Indices of the stored pixels in the image.
    fn indices(&self, size: (u32, u32)) -> impl Iterator<Item = usize> {
        let [left, top, right, bottom] = self.stored(size);
        let row = move |y: u32| (left..right).map(move |x| (y * size.0 + x) as usize);
        (top..bottom).flat_map(row)
    }
}

impl SampledLight {
    fn new(light: &LightImage, squares: &[SampleSquare], size: (u32, u32)) -> Self {
        let luminance = |at: usize| f64::from(luminance(light.radiance[at]));
        let all = 0..light.radiance.len();
        let mean = |sum: f64| sum / light.radiance.len() as f64;
        let scale = mean(all.clone().map(|at| luminance(at).abs()).sum());
        let scale = if scale > 0.0 && scale.is_finite() { scale } else { 1.0 };
        let half = |value: f64| half_bits((value / scale) as f32);
        let pixels = || squares.iter().flat_map(|square| square.indices(size));
        let rms = || pixels().map(|at| half(light.rms_at(at))).collect();
        Self {
            scale,
            luminance: pixels().map(|at| half(luminance(at))).collect(),
            rms: light.variance.is_some().then(rms),
            mean: mean(all.map(luminance).sum()),
            bias: light.errors.bias,
            denoised: light.errors.denoised,
            seed: light.errors.seed,
        }
    }

    fn values(&self) -> Values {
        let decoded = |bits: &Vec<u16>| {
            bits.iter().map(|own| self.scale * f64::from(half_value(*own))).collect()
        };
        Values { luminance: decoded(&self.luminance), rms: self.rms.as_ref().map(decoded) }
    }

    /// Error of a pixel of this luminance that is a relative error of 1. theory.md (70a)
    fn unit(&self, luminance: f64) -> f64 {
        let floor = 0.01 * self.mean * self.mean;
        if floor > 0.0 { (luminance * luminance + floor).sqrt() } else { 1.0 }
    }
}

impl MixtureSample {
    /// The error of the mixture with these factors; `None` if that of a light is not known.
    pub fn error(&self, factors: &[f64]) -> Option<MixtureError> {
        let values: Vec<Values> = self.lights.iter().map(SampledLight::values).collect();
        self.error_of(&values, factors)
    }

    fn error_of(&self, values: &[Values], factors: &[f64]) -> Option<MixtureError> {
        let pixels = f64::from(self.size.0) * f64::from(self.size.1);
        let mut squares = [0.0; 2];
        for (square, sums) in self.squares.iter().zip(self.sums(values, factors)) {
            squares[0] += square.weight * sums[0] / pixels;
            squares[1] += square.weight * sums[1] / pixels;
        }
        let on = self.lights.iter().zip(factors).filter(|(_, factor)| **factor > 0.0);
        let is_denoised = on.clone().any(|(light, _)| light.denoised.is_some());
        let is_known = on.clone().all(|(light, _)| match light.denoised {
            Some(error) => error.is_finite(),
            None => light.rms.is_some(),
        });
        if is_known { MixtureError::of(squares, is_denoised) } else { None }
    }

    /// Sums of the squared relative errors of noise and of bias over each square.
    fn sums(&self, values: &[Values], factors: &[f64]) -> Vec<[f64; 2]> {
        let all = self.lights.iter().zip(values).zip(factors.iter().copied());
        let on: Vec<(&SampledLight, &Values, f64)> = all
            .filter(|(_, factor)| *factor > 0.0)
            .map(|((light, values), factor)| (light, values, factor))
            .collect();
        let clean = self.clean(&on);
        let mean = match self.clean_share {
            None => clean.iter().sum::<f64>() / clean.len().max(1) as f64,
            Some(share) => share * on.iter().map(|(light, _, own)| own * light.mean).sum::<f64>(),
        };
        let floor = 0.01 * mean * mean;
        let weight = |clean: f64| if floor > 0.0 { 1.0 / (clean * clean + floor) } else { 1.0 };
        let at = |pixel: usize| {
            let [noise, bias] = squares(&on, pixel);
            [noise * weight(clean[pixel]), bias * weight(clean[pixel])]
        };
        let sum = |(square, range): (&SampleSquare, Range<usize>)| {
            let [left, top, right, _] = square.stored(self.size);
            let [from_x, from_y, to_x, to_y] = square.pixels;
            let mut sums = [0.0; 2];
            for (y, x) in (from_y..to_y).flat_map(|y| (from_x..to_x).map(move |x| (y, x))) {
                let index = (y - top) * (right - left) + (x - left);
                let [noise, bias] = at(range.start + index as usize);
                sums = [sums[0] + noise, sums[1] + bias];
            }
            sums
        };
        self.squares.iter().zip(self.ranges()).map(sum).collect()
    }

    /// Luminance without noise of all stored pixels, from which the weights follow.
    fn clean(&self, on: &[(&SampledLight, &Values, f64)]) -> Vec<f64> {
        let count = self.ranges().last().map_or(0, |range| range.end);
        let light = |at: usize| on.iter().map(|(_, own, factor)| factor * own.luminance[at]).sum();
        let luminance: Vec<f64> = (0..count).map(light).collect();
        let noise = |at: usize| -> Option<f64> {
            let errors: Option<Vec<SeededError>> = on
                .iter()
                .map(|(light, own, factor)| Some((light.seed, factor * own.rms.as_ref()?[at])))
                .collect();
            Some(variance(errors?.into_iter()))
        };
        let Some(variance) = (0..count).map(noise).collect::<Option<Vec<f64>>>() else {
            return luminance;
        };
        let clean = |(square, range): (&SampleSquare, Range<usize>)| {
            let [left, top, right, bottom] = square.stored(self.size);
            let size = (right - left, bottom - top);
            without_noise(&luminance[range.clone()], &variance[range], None, size)
        };
        self.squares.iter().zip(self.ranges()).flat_map(clean).collect()
    }

    /// Places of the squares in the lists of pixels.
    fn ranges(&self) -> impl Iterator<Item = Range<usize>> {
        self.squares.iter().scan(0, |end, square| {
            let [left, top, right, bottom] = square.stored(self.size);
            let start = *end;
            *end += ((right - left) * (bottom - top)) as usize;
            Some(start..*end)
        })
    }
}

/// Squared errors of noise and of bias of a pixel, W^2/(m^4 sr^2).
fn squares(on: &[(&SampledLight, &Values, f64)], pixel: usize) -> [f64; 2] {
    let noise = variance(on.iter().map(|(light, own, factor)| {
        let error = match light.denoised {
            Some(error) => error * light.unit(own.luminance[pixel]),
            None => own.rms.as_ref().map_or(f64::NAN, |rms| rms[pixel]),
        };
        (light.seed, factor * error)
    }));
    let raw = on.iter().filter(|(light, ..)| light.denoised.is_none());
    let bias = |(light, own, factor): &(&SampledLight, &Values, f64)| {
        factor * light.bias * light.unit(own.luminance[pixel])
    };
    let bias: f64 = raw.map(bias).sum();
    [noise, bias * bias]
}

impl LightImages {
    /// A sample of at most about this many bytes.
    pub fn sample(&self, bytes: usize) -> MixtureSample {
        let ((width, height), lights) = (self.size, self.lights.len());
        let pixels = width as usize * height as usize;
        let mut sample = MixtureSample {
            size: self.size,
            squares: vec![SampleSquare { pixels: [0, 0, width, height], weight: 1.0 }],
            lights: Vec::new(),
            clean_share: None,
            largest_difference: 0.0,
        };
        if pixels * lights * PIXEL_BYTES <= bytes {
            sample.read(self);
        } else {
            let references = Reference::all(self);
            let share = references.first().map_or(1.0, |all| all.clean_share);
            sample.clean_share = Some(share);
            sample.squares = choice::squares(self.size, &references, bytes / lights / PIXEL_BYTES);
            sample.read(self);
            sample.calibrate(&references);
        }
        sample.largest_difference = sample.difference(self);
        sample
    }
}

impl MixtureSample {
    /// Reads the pixels of the squares.
    fn read(&mut self, lights: &LightImages) {
        let light = |light: &LightImage| SampledLight::new(light, &self.squares, self.size);
        self.lights = lights.lights.iter().map(light).collect();
    }

    /// Maximum relative difference between the error by the sample and by all pixels, over some
    /// mixtures of all lights whose error is known.
    fn difference(&self, lights: &LightImages) -> f64 {
        let values: Vec<Values> = self.lights.iter().map(SampledLight::values).collect();
        let of = |number: usize| {
            let factors = compared_factors(lights, number);
            let own = self.error_of(&values, &factors)?.total;
            let wide: Vec<Rgb> = factors.iter().map(|own| Rgb::splat(*own as f32)).collect();
            let exact = lights.mixture(&wide).error?.total;
            (exact > 0.0).then(|| (own / exact - 1.0).abs())
        };
        (0..COMPARED).filter_map(of).fold(0.0, f64::max)
    }
}

/// Factors of a mixture, from 0 to 2 in single precision: an additive sequence in two dimensions.
fn compared_factors(lights: &LightImages, number: usize) -> Vec<f64> {
    let factor = |(index, light): (usize, &LightImage)| {
        let share = ((number + 1) as f64 * 0.754_877_7 + index as f64 * 0.569_840_3).fract();
        if light.has_error() { f64::from(2.0 * share as f32) } else { 0.0 }
    };
    lights.lights.iter().enumerate().map(factor).collect()
}

#[cfg(test)]
mod tests;
