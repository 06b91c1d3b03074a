//! Measured noise and times as a [`Problem`], and predictions for counts with standard errors.

use super::predict::{Predicted, Source};
use super::{CountLimits, MAX_CAMERA_PATHS, MIN_ITERATIONS, Objective, PerPixel, Problem};
use crate::adaptive::stopping::{MIN_ITERATIONS_TO_TARGET, Target};
use crate::timing::TimeModel;
use bdpm_core::base::error::{Error, Result};
use bdpm_core::film::counts::{CameraCounts, Counts};
use bdpm_core::film::radiance::box_filter;
use bdpm_core::noise::Coefficients;
use bdpm_core::noise::image::NoiseSample;
use serde::Serialize;
use std::ops::RangeInclusive;

/// The limit that ends a render.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Budget {
    /// Not known yet.
    Unbounded,
    /// A rendering time, seconds.
    Time(f64),
    /// An RMS to reach, luminance, W/(m^2 sr).
    Rms(f64),
}

impl Budget {
    /// The budget that ends at this pooled RMS of the region of `source`.
    ///
    /// # Errors
    /// If the target is a share of the mean luminance, and that is 0 or not known.
    pub fn to_target(target: Target, source: &Source) -> Result<Self> {
        let luminance = match (target, source) {
            (Target::Absolute(rms), _) => return Ok(Self::Rms(rms)),
            (_, Source::Measured(noise, region)) => {
                let sum: f64 = region.iter().map(|&i| noise.pixels[i].luminance).sum();
                sum / region.len() as f64
            }
            (_, Source::Given(_)) => {
                return Err(Error::new(
                    "the mean luminance is unknown: coefficients do not contain it",
                    "give the target RMS as luminance, without %",
                ));
            }
        };
        let rms = target.absolute(luminance);
        if rms > 0.0 {
            return Ok(Self::Rms(rms));
        }
        Err(Error::new(
            "the region is black, so that a noise in percent of it is undefined",
            "give the target RMS as luminance, without %, or another region",
        ))
    }
}

/// The noise of a region and the times of an image.
#[derive(Clone, Debug)]
pub struct MeasuredProblem<'a> {
    source: Source<'a>,
    /// Coefficients to search with: means over 5 by 5 pixels, at least 0.
    smoothed: Vec<Coefficients>,
    /// Luminance of each pixel, W/(m^2 sr).
    luminance: Vec<f64>,
    /// Weight of each pixel's variance, on average 1.
    weights: Vec<f64>,
    objective: Objective,
    pub(super) model: TimeModel,
}

impl<'a> MeasuredProblem<'a> {
    /// `source` and `model` belong to the same image.
    pub fn new(source: Source<'a>, objective: Objective, model: TimeModel) -> Self {
        let (smoothed, luminance) = match source {
            Source::Measured(noise, region) => {
                let all: Vec<_> = noise.pixels.iter().map(|p| p.noise.coefficients).collect();
                let luminance = region.iter().map(|&i| noise.pixels[i].luminance).collect();
                (smoothed(&all, (noise.width, noise.height), region), luminance)
            }
            Source::Given(coefficients) => (vec![coefficients.clamped()], vec![1.0]),
        };
        let weights = objective.weights(&luminance);
        Self { source, smoothed, luminance, weights, objective, model }
    }

    /// The problem of finding the best counts for a render with this budget. Enough iterations fit
    /// in it that the outliers of a single one do not matter, unless even the shortest sensible
    /// ones are too long.
    pub fn problem(&self, light_paths: RangeInclusive<u32>, budget: Budget) -> Problem {
        let unlimited = self.unlimited(light_paths, 1..=MAX_CAMERA_PATHS);
        match budget {
            Budget::Unbounded => unlimited,
            Budget::Time(time) => unlimited.limited_to(time / MIN_ITERATIONS),
            // The time depends on the counts, which depend on the time: a few rounds settle that.
            Budget::Rms(rms) => (0..4).fold(unlimited.clone(), |found, _| {
                let time = found.uniform().cost / (rms * rms);
                unlimited.limited_to(time / MIN_ITERATIONS_TO_TARGET as f64)
            }),
        }
    }

    fn unlimited(
        &self,
        light_paths: RangeInclusive<u32>,
        camera_paths: RangeInclusive<u32>,
    ) -> Problem {
        let bounds = CountLimits { light_paths, camera_paths, iteration_time: f64::INFINITY };
        Problem::new(&self.smoothed, &self.luminance, self.objective, self.model, &bounds)
    }

    /// The best light paths at one camera path in each pixel, unlimited in time.
    pub fn one_camera_path(&self, light_paths: RangeInclusive<u32>) -> Counts {
        let best = self.unlimited(light_paths, 1..=1).uniform();
        Counts::uniform(best.light_paths, best.camera_paths)
    }

    /// The counts of the whole image: one camera path for each pixel outside the region.
    pub fn whole_image(&self, found: PerPixel) -> Counts {
        let PerPixel { light_paths, camera_paths, .. } = found;
        let camera_paths = match self.source {
            Source::Measured(noise, region) => {
                let mut image = vec![1; noise.pixels.len()];
                region.iter().zip(camera_paths).for_each(|(&i, count)| image[i] = count);
                image
            }
            Source::Given(_) => camera_paths,
        };
        Counts { light_paths, camera_paths: CameraCounts::PerPixel(camera_paths) }
    }

    /// Root of the objective for one iteration by equation (1), luminance, W/(m^2 sr).
    pub fn rms(&self, counts: &Counts) -> Predicted {
        self.statistic(|coefficients| self.variance(coefficients, counts).max(0.0).sqrt())
    }

    /// The time that `other` takes for the noise that `counts` reach, over the time of `counts`.
    /// Both fluctuate together, so that the error is smaller than those of two [`Self::rms`].
    pub fn relative_time(&self, counts: &Counts, other: &Counts) -> Predicted {
        if counts == other {
            return Predicted { value: 1.0, error: None };
        }
        let times = self.model.at(other) / self.model.at(counts);
        self.statistic(|coefficients| {
            let variance = self.variance(coefficients, counts);
            // Without noise no counts are better than others.
            if variance > 0.0 { times * self.variance(coefficients, other) / variance } else { 1.0 }
        })
    }

    /// A function of the coefficients as measured, with its standard error. Only a percentile takes
    /// means over 5 by 5 pixels: that of single pixels would show how noisy the estimates are.
    fn statistic(&self, of: impl Fn(&[Coefficients]) -> f64) -> Predicted {
        let coefficients = |pixels: &[NoiseSample]| -> Vec<_> {
            pixels.iter().map(|pixel| pixel.coefficients).collect()
        };
        match (self.objective, self.source) {
            (Objective::MaxRms, Source::Measured(noise, region)) => {
                let all: Vec<_> = (0..noise.pixels.len()).collect();
                let (width, height) = (noise.width, noise.height);
                Source::Measured(noise, &all).statistic(|pixels| {
                    of(&smoothed(&coefficients(pixels), (width, height), region))
                })
            }
            _ => self.source.statistic(|pixels| of(&coefficients(pixels))),
        }
    }

    /// The objective for the coefficients of the region's pixels.
    fn variance(&self, coefficients: &[Coefficients], counts: &Counts) -> f64 {
        let n_light = f64::from(counts.light_paths);
        self.objective.aggregate(coefficients.iter().enumerate().map(|(i, pixel)| {
            let index = if let Source::Measured(_, region) = self.source { region[i] } else { i };
            let n_camera = f64::from(counts.camera_paths.at(index));
            self.weights[i] * pixel.variance(n_light, n_camera)
        }))
    }
}

/// Means over 5 by 5 pixels, at least 0, for the pixels of a region. `all` holds the coefficients
/// of the whole image.
fn smoothed(all: &[Coefficients], size: (u32, u32), region: &[usize]) -> Vec<Coefficients> {
    let pooled = of_neighborhoods(all, size);
    region.iter().map(|&i| pooled[i].clamped()).collect()
}

/// Means over 5 by 5 pixels.
pub(in crate::adaptive) fn of_neighborhoods(
    all: &[Coefficients],
    (width, height): (u32, u32),
) -> Vec<Coefficients> {
    let values: Vec<_> = all.iter().map(|c| [c.a, c.b, c.f]).collect();
    let pooled = box_filter(&values, width, height).into_iter();
    pooled.map(|[a, b, f]| Coefficients { a, b, f }).collect()
}
