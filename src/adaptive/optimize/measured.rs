//! Measured noise and times as a problem, and what counts lead to by them.

use super::predict::{Predicted, Source};
use super::{CountLimits, Objective, PerPixel, Problem};
use crate::film::counts::{CameraCounts, Counts};
use crate::film::radiance::box_filter;
use crate::noise::Coefficients;
use crate::noise::image::NoiseSample;
use crate::settings::policy::{LEAST_ITERATIONS, LEAST_ITERATIONS_TO_TARGET, MOST_CAMERA_PATHS};
use crate::timing::TimeModel;
use serde::Serialize;
use std::ops::RangeInclusive;

/// When rendering ends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum End {
    /// That is open.
    Unbounded,
    /// After so many seconds.
    Time(f64),
    /// At this RMS, luminance, W/(m^2 sr).
    Rms(f64),
}

/// The noise of a region and the times of an image.
#[derive(Clone, Debug)]
pub struct Subject<'a> {
    source: Source<'a>,
    /// Coefficients to search with: means over 5 by 5 pixels, at least 0.
    smoothed: Vec<Coefficients>,
    /// Luminance of each pixel, W/(m^2 sr).
    luminance: Vec<f64>,
    /// Weight of each pixel's variance, on average 1.
    weights: Vec<f64>,
    objective: Objective,
    model: TimeModel,
}

impl<'a> Subject<'a> {
    /// Noise and times of the same image.
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

    /// The problem of finding the best counts for rendering up to `end`. So many iterations fit in
    /// that time that a single one does not matter, unless not even the shortest sensible ones do.
    pub fn problem(&self, light_paths: RangeInclusive<u32>, end: End) -> Problem {
        let problem = |iteration_time| {
            let (light_paths, camera_paths) = (light_paths.clone(), 1..=MOST_CAMERA_PATHS);
            let bounds = CountLimits { light_paths, camera_paths, iteration_time };
            Problem::new(&self.smoothed, &self.luminance, self.objective, self.model, &bounds)
        };
        let unlimited = problem(f64::INFINITY);
        let least = unlimited.least_sensible_time();
        match end {
            End::Unbounded => unlimited,
            End::Time(time) => problem((time / LEAST_ITERATIONS).max(least)),
            // The time depends on the counts, which depend on the time: a few rounds settle that.
            End::Rms(rms) => (0..4).fold(unlimited, |found, _| {
                let longest =
                    found.uniform().cost / (rms * rms) / LEAST_ITERATIONS_TO_TARGET as f64;
                problem(longest.max(least))
            }),
        }
    }

    /// The best light paths at one camera path in each pixel, unlimited in time.
    pub fn one_camera_path(&self, light_paths: RangeInclusive<u32>) -> Counts {
        let bounds =
            CountLimits { light_paths, camera_paths: 1..=1, iteration_time: f64::INFINITY };
        let (pixels, luminance) = (&self.smoothed, &self.luminance);
        let best = Problem::new(pixels, luminance, self.objective, self.model, &bounds).uniform();
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

    /// Time of one iteration, seconds.
    pub fn time(&self, counts: &Counts) -> f64 {
        self.model.iteration(f64::from(counts.light_paths), counts.camera_paths.mean())
    }

    /// Root of the objective for one iteration by (1), luminance, W/(m^2 sr).
    pub fn rms(&self, counts: &Counts) -> Predicted {
        self.statistic(|coefficients| self.variance(coefficients, counts).max(0.0).sqrt())
    }

    /// The time that `other` takes for the same noise, over that of `counts`. Both share their
    /// fluctuations, so that its error is smaller than those of two [`Self::rms`].
    pub fn relative_time(&self, counts: &Counts, other: &Counts) -> Predicted {
        if counts == other {
            return Predicted { value: 1.0, error: None };
        }
        let times = self.time(other) / self.time(counts);
        self.statistic(|coefficients| {
            let variance = self.variance(coefficients, counts);
            // Without noise nothing is gained.
            if variance > 0.0 { times * self.variance(coefficients, other) / variance } else { 1.0 }
        })
    }

    /// A function of the coefficients as measured, with its standard error. Only a percentile is
    /// about means over 5 by 5 pixels: that of single pixels would tell how noisy they are.
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

/// Means over 5 by 5 pixels, at least 0, of the pixels of a region; `all` are those of the image.
fn smoothed(
    all: &[Coefficients],
    (width, height): (u32, u32),
    region: &[usize],
) -> Vec<Coefficients> {
    let values: Vec<_> = all.iter().map(|c| [c.a, c.b, c.f]).collect();
    let pooled = box_filter(&values, width, height);
    let smoothed = |&i: &usize| {
        let [a, b, f] = pooled[i];
        Coefficients { a, b, f }.clamped()
    };
    region.iter().map(smoothed).collect()
}
