//! A lane of the race: iterations of a technique at its real radii and number of light paths, on a
//! sample of the pixels.

use super::model::ImageMeasurement;
use super::start_up::StartUp;
use super::trial_runner::TrialRunner;
use super::{Candidate, largest_sobol_set};
use crate::adaptive::count_choice::LEAST_SUFFIX_PATHS;
use crate::adaptive::stopping::luminances;
use crate::timing::TimeModel;
use bdpm_core::base::error::Result;
use bdpm_core::noise::{Coefficients, Measure};
use bdpm_core::render::annulus_moments::annulus_bias2;
use bdpm_core::render::block::{self, Block, CombinedImage};
use bdpm_core::render::{RenderConfig, Renderer};
use bdpm_core::settings::Settings;
use std::time::{Duration, Instant};

/// Camera paths per pixel of an iteration: the smallest number that can be measured, so that a lane
/// sees as many pixels as possible.
pub const LANE_CAMERA_PATHS: u32 = 2;

/// Minimum number of iterations of a round: one that is not measured tells the times, and its
/// neighbors the noise.
const MIN_ITERATIONS: u64 = 3;

/// Minimum number of light paths of an iteration.
const LEAST_LIGHT_PATHS: f64 = 1024.0;

/// Added to the seed of the image, so that lanes share no samples with it or with trials.
const LANE_SEED: u64 = 0x1a9e_5eed_0fa2_ace5;

/// Iterations of a technique on a sample of the pixels.
pub struct Lane {
    renderer: Renderer,
    /// Times of an iteration of the sample, as trials predict them.
    expected: TimeModel,
    /// Pixels of the image.
    pixels: f64,
    /// Index of the areas of its radii, which other lanes and trials share.
    areas: usize,
    /// Thread time of areas in iterations that were not measured.
    area_time: Duration,
}

/// What a lane has measured.
pub struct LaneMeasurement {
    /// Noise, bias and times.
    pub image: ImageMeasurement,
    /// Time that the whole image needs to compute areas; `None` without areas.
    pub start_up: Option<StartUp>,
    /// Mean luminance, W/(m^2 sr).
    pub luminance: f64,
    /// Its bounds, two standard errors apart from it, as if all pixels saw the same photons.
    pub bounds: [f64; 2],
    /// Paths of the kind that may have missed light: light paths if there are photons.
    pub paths: f64,
}

/// Size of the iterations of lanes.
#[derive(Clone, Copy)]
pub struct LaneShape {
    /// One pixel of each square of this many by this many pixels.
    pub stride: u32,
    /// Time of the light paths of an iteration with their merges, seconds.
    pub light: f64,
    /// Whether light paths are in sets.
    pub has_sets: bool,
}

impl TrialRunner<'_> {
    /// A lane of the race without iterations.
    pub fn lane(
        &mut self,
        candidate: &Candidate,
        settings: &Settings,
        LaneShape { stride, light, has_sets }: LaneShape,
    ) -> Result<Lane> {
        let own = candidate.apply(settings);
        let mis_scales = Some(own.mis_scales());
        let pixels = self.pixels / f64::from(stride).powi(2);
        let TimeModel { light_path, merge_pair, .. } = candidate.times;
        let per_light_path = light_path + merge_pair * pixels * f64::from(LANE_CAMERA_PATHS);
        let least = if own.has_cache() { LEAST_SUFFIX_PATHS.into() } else { LEAST_LIGHT_PATHS };
        let fits = (light / per_light_path).max(least);
        let light_paths =
            (fits.min(f64::from(own.light_paths)) as u32).clamp(1, self.max_light_paths);
        let sobol_set =
            if has_sets && own.has_photons() { largest_sobol_set(light_paths) } else { 1 };
        let own = Settings {
            light_paths: light_paths / sobol_set * sobol_set,
            camera_paths: LANE_CAMERA_PATHS,
            seed: own.seed.wrapping_add(LANE_SEED),
            guide: 0,
            sobol_set,
            mis_scales,
            ..own
        };
        let (renderer, areas) = self.sample(own, stride, RenderConfig::default())?;
        let sampled = renderer.settings().pixels() as f64;
        Ok(Lane {
            renderer,
            expected: TimeModel { pixels: sampled, ..candidate.times },
            pixels: candidate.times.pixels,
            areas,
            area_time: Duration::ZERO,
        })
    }
}

impl Lane {
    /// Renders for some seconds. Every second iteration is measured.
    pub fn go_on(&mut self, runner: &mut TrialRunner, seconds: f64) -> Result<()> {
        let growth = &mut runner.areas[self.areas].1;
        let begun = Instant::now();
        let camera_paths = f64::from(LANE_CAMERA_PATHS) * self.expected.pixels;
        let mut done = 0;
        while done < MIN_ITERATIONS || begun.elapsed().as_secs_f64() < seconds {
            let number = self.renderer.iterations();
            let measure = if number.is_multiple_of(2) { Measure::Pairs } else { Measure::Off };
            let before = self.renderer.area_work();
            self.renderer.iterate(measure);
            let work = self.renderer.area_work().since(before);
            growth.add_of_lane(number as usize, camera_paths, work);
            if measure == Measure::Off {
                self.area_time += work.time;
            }
            self.renderer.check_interrupt()?;
            done += 1;
        }
        Ok(())
    }

    /// Luminance of each pixel of the sample, without the contribution of noise to its square.
    pub fn luminances(&self) -> Vec<f64> {
        let blocks = self.renderer.blocks();
        luminances(&CombinedImage::new(blocks, vec![1.0; blocks.len()]))
    }

    /// What the iterations so far have measured, with these weights of the pixels' squared errors;
    /// `None` before noise and times are known.
    pub fn measured(&self, runner: &TrialRunner, weights: &[f64]) -> Option<LaneMeasurement> {
        let (blocks, growth) = (self.renderer.blocks(), &runner.areas[self.areas].1);
        let Block { film, counts, .. } = self.renderer.block();
        let cells = weights.len() as f64;
        let coefficients = block::coefficients(blocks)?;
        let weighted = |(own, weight): (&Coefficients, &f64)| *own * *weight;
        let relative: Coefficients = coefficients.iter().zip(weights).map(weighted).sum();
        let relative = (relative * cells.recip()).clamped();
        // All iterations are sampled, and only some measure coefficients: rare light is in the
        // former.
        let sampled = film.cell_variance()?;
        let sampled: f64 = sampled.iter().zip(weights).map(|(own, weight)| own * weight).sum();
        let sampled = sampled * film.iterations as f64 / cells;
        let n_light = f64::from(counts.light_paths);
        let predicted = relative.variance(n_light, counts.camera_paths.mean());
        let more_noise = (sampled / predicted).max(1.0);
        let image = CombinedImage::new(blocks, vec![1.0]);
        let (variance, _) = image.pooled_variance()?;
        let f = coefficients.iter().map(|own| own.f.max(0.0)).sum::<f64>() / cells;
        let iterations = film.iterations as f64;
        let error2 = variance / cells + f / (n_light * iterations);
        let settings = self.renderer.settings();
        let (luminance, has_photons) = (image.mean_luminance(), settings.has_photons());
        let each =
            if has_photons { n_light } else { self.expected.pixels * f64::from(LANE_CAMERA_PATHS) };
        Some(LaneMeasurement {
            image: ImageMeasurement {
                radii: [settings.caustic_radius, settings.radius].map(f64::from),
                coefficients: relative * (more_noise * image.set_factor()),
                annulus_bias2: annulus_bias2(blocks, &[1.0], weights),
                times: self.times()?,
            },
            start_up: growth.start_up(rayon::current_num_threads()).filter(|_| has_photons),
            luminance,
            bounds: [-2.0, 2.0].map(|errors| luminance + errors * error2.sqrt()),
            paths: each * iterations,
        })
    }

    /// Times of an iteration of the whole image, without areas: each phase of the prediction times
    /// what it took over what was predicted. `None` before the first iteration that is not
    /// measured.
    fn times(&self) -> Option<TimeModel> {
        let Block { clock, counts, .. } = self.renderer.block();
        if clock.iterations == 0 {
            return None;
        }
        let n_light = f64::from(counts.light_paths);
        let threads = rayon::current_num_threads() as f64;
        let seconds = |time: Duration| time.as_secs_f64() / clock.iterations as f64;
        let [fixed, light, camera, merge] =
            self.expected.parts(n_light, counts.camera_paths.mean());
        let ratio = |took: f64, expected: f64| if expected > 0.0 { took / expected } else { 1.0 };
        let busy = |time: Duration| seconds(time) / threads;
        let areas = busy(self.area_time);
        let light = ratio(busy(clock.times.light), light);
        let camera = ratio(busy(clock.times.camera), camera);
        let merge = ratio((busy(clock.times.merge) - areas).max(0.0), merge);
        let busy = TimeModel {
            fixed: 0.0,
            light_path: light * self.expected.light_path,
            camera_path: camera * self.expected.camera_path,
            look_up: merge * self.expected.look_up,
            merge_pair: merge * self.expected.merge_pair,
            ..self.expected
        };
        // Threads wait for each other, in proportion to what they do.
        let wall = (seconds(clock.times.wall) - areas).max(0.0);
        let fixed = fixed.min(0.5 * wall);
        let waits = ratio(wall - fixed, busy.iteration(n_light, counts.camera_paths.mean()));
        Some(TimeModel { fixed, pixels: self.pixels, ..busy.scaled(waits) })
    }
}
