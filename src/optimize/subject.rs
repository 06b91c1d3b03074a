//! Measured noise and times as a problem, and what counts lead to by them.

use super::{Bounds, LEAST_ITERATIONS, Objective, PerPixel, Problem};
use crate::counts::{CameraCounts, Counts};
use crate::film::pool;
use crate::noise::Coefficients;
use crate::noise::image::NoiseSample;
use crate::noise::predict::{Predicted, Source};
use crate::timing::TimeModel;
use serde::Serialize;
use std::ops::RangeInclusive;

/// Far more camera paths per pixel than can pay.
const MOST_CAMERA_PATHS: u32 = 1 << 16;

/// Iterations up to a target at the least, as many as `bdpm render` takes.
const LEAST_TO_TARGET: f64 = crate::goal::LEAST_ITERATIONS as f64;

/// When rendering ends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum End {
    /// That is open.
    Open,
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
                let all = noise.pixels.iter().map(|pixel| pixel.noise.coefficients);
                let all: Vec<_> = all.map(|c| [c.a, c.b, c.f]).collect();
                let pooled = pool(&all, noise.width, noise.height);
                let smoothed = |&i: &usize| {
                    let [a, b, f] = pooled[i];
                    Coefficients { a, b, f }.clamped()
                };
                let luminance = region.iter().map(|&i| noise.pixels[i].luminance).collect();
                (region.iter().map(smoothed).collect(), luminance)
            }
            Source::Given(coefficients) => (vec![coefficients.clamped()], vec![1.0]),
        };
        let weights = objective.weights(&luminance);
        Self { source, smoothed, luminance, weights, objective, model }
    }

    /// The problem of finding the best counts for rendering up to `end`. So many iterations fit in
    /// that time that a single one does not matter.
    pub fn problem(&self, light_paths: RangeInclusive<u32>, end: End) -> Problem {
        let problem = |iteration_time| {
            let (light_paths, camera_paths) = (light_paths.clone(), 1..=MOST_CAMERA_PATHS);
            let bounds = Bounds { light_paths, camera_paths, iteration_time };
            Problem::new(&self.smoothed, &self.luminance, self.objective, self.model, &bounds)
        };
        match end {
            End::Open => problem(f64::INFINITY),
            End::Time(time) => problem(time / LEAST_ITERATIONS),
            // The time depends on the counts, which depend on the time: a few rounds settle that.
            End::Rms(rms) => (0..4).fold(problem(f64::INFINITY), |found, _| {
                problem(found.uniform().cost / (rms * rms) / LEAST_TO_TARGET)
            }),
        }
    }

    /// The best light paths at one camera path in each pixel, unlimited in time.
    pub fn one_camera_path(&self, light_paths: RangeInclusive<u32>) -> Counts {
        let bounds = Bounds { light_paths, camera_paths: 1..=1, iteration_time: f64::INFINITY };
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

    /// Root of the objective for one iteration by (1), luminance, W/(m^2 sr). It is about the
    /// coefficients as measured, neither pooled nor clamped.
    pub fn rms(&self, counts: &Counts) -> Predicted {
        self.source.statistic(|pixels| self.variance(pixels, counts).max(0.0).sqrt())
    }

    /// The time that `other` takes for the same noise, over that of `counts`. Both share their
    /// fluctuations, so that its error is smaller than those of two [`Self::rms`].
    pub fn gain(&self, counts: &Counts, other: &Counts) -> Predicted {
        let times = self.time(other) / self.time(counts);
        self.source.statistic(|pixels| {
            let variance = self.variance(pixels, counts);
            // Without noise nothing is gained.
            if variance > 0.0 { times * self.variance(pixels, other) / variance } else { 1.0 }
        })
    }

    fn variance(&self, pixels: &[NoiseSample], counts: &Counts) -> f64 {
        let n_light = f64::from(counts.light_paths);
        self.objective.aggregate(pixels.iter().enumerate().map(|(i, pixel)| {
            let index = if let Source::Measured(_, region) = self.source { region[i] } else { i };
            let n_camera = f64::from(counts.camera_paths.at(index));
            self.weights[i] * pixel.coefficients.variance(n_light, n_camera)
        }))
    }
}
