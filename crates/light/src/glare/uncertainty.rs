//! Uncertainties of the ratings of an image, by the noise of its pixels.

use super::{LuminanceImage, OUTSIDE, Sums, position_index};
use bdpm_core::base::photometry::LUMENS_PER_WATT;
use bdpm_core::base::quantiles::{NORMAL_95, student_95};
use std::f64::consts::{LN_10, PI};

/// Knowledge about the noise of the pixels of an image.
#[derive(Clone, Debug)]
pub(super) enum Noise {
    /// Nothing.
    Unknown,
    /// Variance of the luminance of each pixel, (cd/m^2)^2. Pixels are independent.
    Independent(Vec<f64>),
    /// Luminance of each pixel in each of several independent images of one view, cd/m^2. The
    /// pixels of an image may depend on each other.
    Repeated(Vec<Vec<f64>>),
}

/// Expanded uncertainties of the noise of an image, at a probability of 95 %.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct Expanded {
    /// Uncertainty of the daylight glare probability.
    pub dgp: f64,
    /// Uncertainty of the unified glare rating; `None` without a rating.
    pub ugr: Option<f64>,
    /// Uncertainty of the vertical illuminance, lx.
    pub vertical_illuminance: f64,
}

impl LuminanceImage {
    /// The image with the standard error of the luminance of each of its pixels, W/(m^2 sr), row by
    /// row. Errors of different pixels are taken as independent.
    ///
    /// # Panics
    /// If there is not one for each pixel.
    #[must_use]
    pub fn with_noise(self, noise: &[f32]) -> Self {
        assert_eq!(noise.len(), self.index.len(), "one standard error per pixel");
        let used = noise.iter().zip(&self.index).filter(|(_, index)| **index != OUTSIDE);
        let variance =
            |(noise, _): (&f32, _)| (f64::from(LUMENS_PER_WATT) * f64::from(*noise)).powi(2);
        Self { noise: Noise::Independent(used.map(variance).collect()), ..self }
    }

    /// The mean of independent images of one view. The spread of their ratings is the uncertainty,
    /// also if the pixels of an image share photons. With a single image it is unknown.
    ///
    /// # Panics
    /// If there is no image, or they differ in their pixels within the image circle.
    #[must_use]
    pub fn mean_of(images: &[Self]) -> Self {
        let mut mean = images[0].clone();
        assert!(images.iter().all(|image| image.index == mean.index), "images of one view");
        let luminances = |image: &Self| image.pixels.iter().map(|(_, _, own)| *own).collect();
        let repeated: Vec<Vec<f64>> = images.iter().map(luminances).collect();
        for (pixel, (_, _, luminance)) in mean.pixels.iter_mut().enumerate() {
            let sum: f64 = repeated.iter().map(|own| own[pixel]).sum();
            *luminance = sum / images.len() as f64;
        }
        Self { noise: Noise::Repeated(repeated), ..mean }
    }
}

/// Sums over the image by which it is rated.
pub(super) struct Totals {
    /// Vertical illuminance, lx.
    pub vertical: f64,
    /// Luminance of the background, cd/m^2.
    pub background: f64,
    /// Sum of `L^2 omega/P^2` over the sources.
    pub sum: f64,
}

/// Derivatives of vertical illuminance, DGP and UGR by the luminance of a pixel, or sums of them.
type Ratings = [f64; 3];

impl Totals {
    /// Uncertainties by linear propagation of the noise of the pixels, each of which belongs to the
    /// source `owner` or to the background.
    pub fn expanded(
        &self,
        image: &LuminanceImage,
        owner: &[Option<usize>],
        sources: &[Sums],
        is_rated: bool,
    ) -> Option<Expanded> {
        let derivatives = self.derivatives(image, owner, sources, is_rated);
        let [lux, dgp, ugr] = match &image.noise {
            Noise::Unknown => return None,
            Noise::Independent(variances) => {
                let mut sums = Ratings::default();
                for (own, variance) in derivatives.zip(variances) {
                    sums.iter_mut().zip(own).for_each(|(sum, own)| *sum += own * own * variance);
                }
                sums.map(|variance| NORMAL_95 * variance.sqrt())
            }
            Noise::Repeated(images) if images.len() < 2 => return None,
            Noise::Repeated(images) => of_spread(&projections(derivatives, images)),
        };
        Some(Expanded {
            dgp: if self.vertical > 0.0 { dgp } else { 0.0 },
            ugr: is_rated.then_some(ugr),
            vertical_illuminance: lux,
        })
    }

    /// Derivatives of the ratings by the luminance of each pixel.
    fn derivatives<'a>(
        &self,
        image: &'a LuminanceImage,
        owner: &'a [Option<usize>],
        sources: &[Sums],
        is_rated: bool,
    ) -> impl Iterator<Item = Ratings> + 'a {
        let Self { vertical, background, sum } = *self;
        let power = vertical.powf(-1.87);
        // Derivatives of the DGP by the vertical illuminance and by the sum, [`probability`]
        let contrast = 9.18e-2 / LN_10 / (1.0 + sum * power);
        let by_sum = contrast * power;
        let by_vertical = 5.87e-5 - 1.87 * contrast * sum * power / vertical;
        // Twice the luminance over the square of the position index of each source
        let strength =
            |own: &Sums| 2.0 * own.weight / own.solid_angle / position_index(own.center()).powi(2);
        let strengths: Vec<f64> = sources.iter().map(strength).collect();
        image.pixels.iter().zip(owner).map(move |((w, solid, _), owner)| {
            let cosine = w.z * solid;
            let of_sum = owner.map_or(0.0, |own| strengths[own] * solid);
            let of_background = if owner.is_none() { cosine / PI } else { 0.0 };
            let ugr = match is_rated {
                true => 8.0 / LN_10 * (of_sum / sum - of_background / background),
                false => 0.0,
            };
            [cosine, by_vertical * cosine + by_sum * of_sum, ugr]
        })
    }
}

/// Sums over the pixels of each image of its luminances times the derivatives of the ratings.
fn projections(derivatives: impl Iterator<Item = Ratings>, images: &[Vec<f64>]) -> Vec<Ratings> {
    let mut sums = vec![Ratings::default(); images.len()];
    for (pixel, own) in derivatives.enumerate() {
        for (sums, image) in sums.iter_mut().zip(images) {
            sums.iter_mut().zip(own).for_each(|(sum, own)| *sum += own * image[pixel]);
        }
    }
    sums
}

/// Expanded uncertainty of the mean of independent values of each rating, of which there are at
/// least two.
fn of_spread(values: &[Ratings]) -> Ratings {
    let count = values.len() as f64;
    let expanded = |rating: usize| {
        let mean = values.iter().map(|own| own[rating]).sum::<f64>() / count;
        let squares: f64 = values.iter().map(|own| (own[rating] - mean).powi(2)).sum();
        student_95(count - 1.0) * (squares / (count * (count - 1.0))).sqrt()
    };
    [0, 1, 2].map(expanded)
}
