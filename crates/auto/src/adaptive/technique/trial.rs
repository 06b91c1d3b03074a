//! Measures one technique at given radii on a sample of the pixels: noise, merge bias and times.

use super::Guided;
use crate::timing::TimeModel;
use crate::timing::fit::fit;
use crate::timing::measure::{Phase, TimeSample};
use bdpm_core::accel::Intersect;
use bdpm_core::base::error::Result;
use bdpm_core::film::counts::Counts;
use bdpm_core::noise::image::NoiseImage;
use bdpm_core::noise::{Coefficients, Measure};
use bdpm_core::render::Renderer;
use bdpm_core::render::audit::brightest_path;
use bdpm_core::render::guiding::{
    LEARNING_CAMERA_PATHS, LEARNING_LIGHT_PATHS, LEARNING_PIXELS, LEARNING_ROUND, Learned,
};
use bdpm_core::render::{NestedPart, RenderConfig};
use bdpm_core::scene::lights::guide::Guide;
use bdpm_core::scene::{Emitter, Placement, Scene};
use bdpm_core::settings::Settings;
use bdpm_core::transport::kernel::ByClass;
use rayon::prelude::*;
use std::f64::consts::PI;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// Measured iterations of a trial: standard errors need 16 batches of two iterations.
const TRIAL_ITERATIONS: u64 = 32;

/// Light paths of an iteration of a trial, and camera paths of all its pixels together. Fewer
/// measure next to nothing, and more only repeat what they measure.
const TRIAL_PATHS: Range<f64> = 1024.0..16_384.0;

/// Minimum number of light paths of an iteration of a trial, which is less than [`TRIAL_PATHS`]
/// where they split.
const LEAST_LIGHT_PATHS: u32 = 128;

/// Camera paths per pixel of an iteration of a trial: the smallest number that can be measured, so
/// that a trial sees as many pixels as possible.
const TRIAL_CAMERA_PATHS: u32 = 2;

/// A trial ends after this factor of its time even if it has not done [`TRIAL_ITERATIONS`].
const TRIAL_PATIENCE: f64 = 1.3;

/// Factor on the light paths from the first timed iterations of a trial to the second, minimum and
/// maximum. The time per path and per pair must stand out from the fixed time.
const TIMED_RATIOS: [u32; 2] = [4, 16];

/// Camera paths per pixel of timed iterations, three times those of the others for the same reason.
const TIMED_CAMERA_PATHS: u32 = 6;

/// Minimum number of timed iterations of either kind, where they fit in the time.
const TRIAL_TIMED: u64 = 2;

/// Share of a trial's time for measured iterations. The rest is for timed ones.
const TRIAL_MEASURING: f64 = 0.75;

/// Added to the seed of the image, so that trials share no samples with it.
const TRIAL_SEED: u64 = 0x5eed_0ff0_7e57_ab1e;

/// Factor on the caustic radius of trials that measure one class of photons, if both radii are
/// equal. It changes the bias by far less than any trial can measure.
const RADIUS_RATIO: f32 = 0.999;

/// Pixels across and down at which the size of a pixel's footprint is computed.
const FOOTPRINTS: u32 = 16;

/// Side of the pixel of a meter at distance 1: its rays spread over a wide cone, so that details of
/// this size do not show.
const METER_PIXEL: f64 = 0.01;

/// Minimum number of iterations of learning: the first half learns and the second half tests the
/// guide.
const MIN_LEARNING: u32 = 2 * LEARNING_ROUND;

/// Maximum number of iterations of learning: the cells of the guide are then as small as pays.
const MAX_LEARNING: u32 = 64;

/// Learning is skipped if [`MIN_LEARNING`] iterations would exceed its time by more than this
/// factor.
const LEARNING_PATIENCE: f64 = 2.0;

/// A guide is used if it leaves at most this share of the second moment of the contribution of
/// light paths. A smaller gain does not pay for learning.
const WORTHWHILE_GUIDE: f64 = 0.9;

/// Part of the mean luminance that may be missing from a trial because of its merge bias.
pub const BIAS_TOLERANCE: f64 = 0.05;

/// Runs trials on a sample of the pixels of an image.
pub struct TrialRunner<'a> {
    /// Renders the whole image: learning uses it.
    whole: Renderer,
    scene: &'a Scene,
    /// One renderer for each lookup radius so far. Trials of equal lookup radius share its areas.
    renderers: Vec<Renderer>,
    /// The sample has one pixel of each square of this many by this many pixels.
    stride: u32,
    /// Where light paths of trials start.
    guide: Option<Arc<Guide>>,
    /// Wall-clock time of a path of either kind, seconds.
    per_path: f64,
    /// Light paths of an iteration of a trial.
    light_paths: u32,
    /// Light paths of an iteration that the memory allows.
    max_light_paths: u32,
    /// Pixels of the image.
    pixels: f64,
    /// Area of the surfaces on which photons are merged, scene units squared.
    area: f64,
    /// Radius of a disc of the area that a pixel sees, median over the image, scene units.
    pub footprint: f64,
}

/// Result of a trial.
pub struct Trial {
    /// Merge radii, scene units.
    pub radii: ByClass<f64>,
    /// The merges whose bias was measured, if any.
    pub nests: Option<NestedPart>,
    /// Noise of the sample of the pixels.
    pub noise: NoiseImage,
    /// Times of an iteration of the whole image.
    pub times: TimeModel,
    /// Second moment of the contribution of a light path to a camera path, relative, if photons
    /// were spread evenly over all surfaces.
    pub even: f64,
    /// Coefficients of light that the trial missed, relative.
    missed: Coefficients,
    /// Whether there were photons that merge at every vertex.
    pub has_caustic_photons: bool,
    /// Whether photons are merged.
    merges: bool,
}

impl Trial {
    /// Mean luminance of the sample, W/(m^2 sr).
    pub fn luminance(&self) -> f64 {
        let pixels = &self.noise.pixels;
        pixels.iter().map(|pixel| pixel.luminance).sum::<f64>() / pixels.len() as f64
    }

    /// Mean luminance that the sample has at least: two standard errors below the mean of the
    /// trial, as if all pixels saw the same photons.
    pub fn least_luminance(&self) -> f64 {
        let NoiseImage { pixels, iterations, light_paths, .. } = &self.noise;
        let (count, iterations) = (pixels.len() as f64, *iterations as f64);
        let sampled = pixels.iter().map(|pixel| pixel.noise.sampled).sum::<f64>() / count;
        let f = pixels.iter().map(|pixel| pixel.noise.coefficients.f.max(0.0)).sum::<f64>() / count;
        let error2 = (sampled / count + f / f64::from(*light_paths)) / iterations;
        self.luminance() - 2.0 * error2.sqrt()
    }

    /// Adds the noise of light that the trial missed, because it found it too rarely: the image has
    /// at least this mean luminance. If `n` paths miss a share `d` of the light, few of them carry
    /// it, and its second moment is about `n d^2`. theory.md (93f)
    pub fn set_missed_light(&mut self, least_luminance: f64) {
        let share = 1.0 - self.luminance() / least_luminance - BIAS_TOLERANCE;
        let square = if share > 0.0 && least_luminance > 0.0 { share * share } else { 0.0 };
        let NoiseImage { pixels, iterations, light_paths, camera_paths, .. } = &self.noise;
        let iterations = *iterations as f64;
        let camera = pixels.len() as f64 * f64::from(*camera_paths) * iterations * square;
        let light = f64::from(*light_paths) * iterations * square;
        self.missed = Coefficients {
            b: if self.merges { 0.0 } else { camera },
            f: if self.merges { light } else { 0.0 },
            ..Coefficients::default()
        };
    }

    /// Mean coefficients over weighted pixels. While few pixels have received photons, evenly
    /// spread light counts as one more pixel: theory.md (93e).
    pub fn relative(&self, weights: &[f64]) -> Coefficients {
        let weighted = self.noise.pixels.iter().zip(weights);
        let sum: Coefficients = weighted.map(|(pixel, &w)| pixel.noise.coefficients * w).sum();
        let mean = (sum * (weights.len() as f64).recip()).clamped();
        let more = (self.even - (mean.a + mean.f)).max(0.0) / (self.found(weights) + 1.0);
        Coefficients { f: mean.f + more, ..mean } + self.missed
    }

    /// Effective number of pixels that have received photons: theory.md (93e).
    pub fn found(&self, weights: &[f64]) -> f64 {
        let (mut sum, mut squares) = (0.0, 0.0);
        for (pixel, &weight) in self.noise.pixels.iter().zip(weights) {
            let Coefficients { a, f, .. } = pixel.noise.coefficients;
            sum += (a + f) * weight;
            squares += ((a + f) * weight).powi(2);
        }
        if squares > 0.0 { sum * sum / squares } else { 0.0 }
    }
}

impl<'a> TrialRunner<'a> {
    /// Prepares trials for the image of a renderer. The sample is as large as trials of `seconds`
    /// allow.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn new(renderer: &'a Renderer, seconds: f64) -> Result<Self> {
        let (scene, accel) = renderer.scene_and_accel();
        let settings = renderer.settings();
        let stride = |paths: f64| {
            let sample = paths / f64::from(TRIAL_CAMERA_PATHS);
            let stride = (settings.pixels() as f64 / sample).sqrt() as u32;
            stride.clamp(1, settings.width.min(settings.height))
        };
        let each = TRIAL_MEASURING * seconds / TRIAL_ITERATIONS as f64;
        let probe = stride(TRIAL_PATHS.start);
        // Half of the paths are light paths.
        let per_path = seconds_per_path(renderer, probe)?;
        let paths = 0.5 * each / per_path;
        let paths = paths.clamp(TRIAL_PATHS.start, TRIAL_PATHS.end);
        let stride = stride(paths);
        let (area, footprint) = (merging_area(scene), footprint(scene, &**accel, settings));
        let max_light_paths = renderer.most_light_paths();
        Ok(Self {
            whole: renderer.with_settings(Settings { guide: 0, ..settings.clone() })?,
            scene,
            renderers: vec![renderer.sample(Settings { guide: 0, ..settings.clone() }, stride)?],
            stride,
            guide: renderer.guide().cloned(),
            per_path,
            light_paths: (paths as u32).min(max_light_paths),
            max_light_paths,
            pixels: settings.pixels() as f64,
            area,
            footprint,
        })
    }

    /// Learns in about `seconds` where light paths should start, and starts those of trials there.
    /// Returns `None` if the time is too short or the guide does not pay.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn learn_guide(&mut self, seconds: f64) -> Result<Option<Guided>> {
        let start = Instant::now();
        let camera_paths = 2.0 * LEARNING_PIXELS * f64::from(LEARNING_CAMERA_PATHS);
        let iteration = self.per_path * (camera_paths + f64::from(LEARNING_LIGHT_PATHS));
        if f64::from(MIN_LEARNING) * iteration > LEARNING_PATIENCE * seconds {
            return Ok(None);
        }
        let goes_on = |done: u32, guide: &Guide| {
            let is_hopeless = done >= LEARNING_ROUND && guide.expected() > WORTHWHILE_GUIDE;
            let has_time = done < MAX_LEARNING && start.elapsed().as_secs_f64() < seconds;
            !is_hopeless && (done < MIN_LEARNING || has_time)
        };
        let Learned { guide, iterations, second_moment } = self.whole.learn_guide(goes_on)?;
        if iterations < MIN_LEARNING || second_moment > WORTHWHILE_GUIDE {
            return Ok(None);
        }
        self.guide = Some(guide);
        Ok(Some(Guided { iterations, second_moment }))
    }

    /// Tries the strategy, radii and weights of `settings` for `seconds`. The merges of `nests` are
    /// done at nested radii as well, which measures their bias.
    ///
    /// # Errors
    /// As [`Renderer::new`].
    pub fn trial(
        &mut self,
        settings: &Settings,
        nests: Option<NestedPart>,
        seconds: f64,
    ) -> Result<Trial> {
        let start = Instant::now();
        // As many photons as without splitting, so that trials of all techniques have similar
        // numbers of iterations.
        let light_paths = (self.light_paths / settings.splitting).max(LEAST_LIGHT_PATHS);
        let camera_paths = TRIAL_CAMERA_PATHS;
        let seed = settings.seed.wrapping_add(TRIAL_SEED);
        let mis_scales = Some(settings.mis_scales());
        // Trials have too few light paths for sets of them.
        let mut own = Settings {
            light_paths,
            camera_paths,
            seed,
            guide: 0,
            sobol_set: 1,
            mis_scales,
            ..settings.clone()
        };
        if matches!(nests, Some(NestedPart::Class(_))) && own.caustic_radius == own.radius {
            // With equal radii the nested radii would measure the bias of both classes together.
            own.caustic_radius *= RADIUS_RATIO;
        }
        let renderer = self.renderer(own.clone())?.guided(self.guide.clone());
        let batches = RenderConfig::with_pixel_batches();
        let mut renderer = renderer.configure(RenderConfig { nested_part: nests, ..batches })?;
        let elapsed = || start.elapsed().as_secs_f64();
        let (mut iterations, mut photons) = (0, 0);
        let measuring = TRIAL_MEASURING * seconds;
        while elapsed() < measuring
            || iterations < TRIAL_ITERATIONS && elapsed() < TRIAL_PATIENCE * measuring
            || iterations < 2
        {
            photons += renderer.iterate(Measure::Pairs).photons;
            renderer.check_interrupt()?;
            iterations += 1;
        }
        let noise = renderer.block().noise_image()?;
        let has_caustic_photons = renderer.found_caustic_photons();
        let mut samples = Vec::new();
        let share = 0.5 * (1.0 - TRIAL_MEASURING) * seconds;
        let (mut light_paths, mut per_light_path) = (light_paths, 0.0);
        for _ in 0..2 {
            renderer.begin_block(Counts::uniform(light_paths, TIMED_CAMERA_PATHS))?;
            let begun = elapsed();
            let mut timed = 0;
            while timed < 1
                || elapsed() < begun + share
                || timed < TRIAL_TIMED && elapsed() < TRIAL_PATIENCE * seconds
            {
                renderer.iterate(Measure::Off);
                renderer.check_interrupt()?;
                timed += 1;
            }
            samples.extend(times(&renderer));
            // As many more as fit in the time, within the ratios that separate the times.
            let threads = rayon::current_num_threads() as f64;
            let light = renderer.block().clock.times.light.as_secs_f64() / (timed as f64 * threads);
            per_light_path = light / f64::from(light_paths);
            let fits = share / light;
            let ratio = (fits as u32).clamp(TIMED_RATIOS[0], TIMED_RATIOS[1]);
            light_paths = light_paths.saturating_mul(ratio).min(self.max_light_paths);
        }
        let pixels = f64::from(noise.width * noise.height);
        let model = fit(&samples, pixels)?.model;
        // Two counts determine the fixed time badly: it is at most half of the measured time.
        let light_path = model.light_path.max(0.5 * per_light_path);
        Ok(Trial {
            radii: [own.caustic_radius, own.radius].map(f64::from),
            nests,
            noise,
            times: TimeModel { light_path, pixels: self.pixels, ..model },
            even: self.even(&own, photons as f64 / iterations as f64),
            missed: Coefficients::default(),
            merges: own.has_photons(),
            has_caustic_photons,
        })
    }
}

impl<'a> TrialRunner<'a> {
    /// Whether rough surfaces that paths pass through can show lamps that rays can hit. All
    /// strategies but `mis` find these lamps only by random sampling.
    pub fn mirrors_lamps_roughly(&self) -> bool {
        let lights = self.scene.lights();
        let are_hit = lights.has_environment() || !lights.emitters().iter().all(Emitter::is_delta);
        are_hit && self.scene.materials().iter().any(|material| material.bsdf.has_rough())
    }

    /// The largest luminance that a camera path is likely to find, W/(m^2 sr).
    pub fn brightest(&self) -> f64 {
        brightest_path(self.scene)
    }

    /// A renderer of the sample that shares areas with an earlier one of the same lookup radius,
    /// because trials see mostly the same surfaces.
    fn renderer(&mut self, settings: Settings) -> Result<Renderer> {
        let reach = settings.reach();
        if let Some(same) = self.renderers.iter().find(|own| own.settings().reach() == reach) {
            return same.sample(settings, self.stride);
        }
        let new = self.renderers[0].sample(settings.clone(), self.stride)?;
        self.renderers.push(new);
        self.renderer(settings)
    }

    /// Second moment if photons were spread evenly over all surfaces: a light path leaves `photons`
    /// on them, and a merge sees those of one disc. theory.md (93e).
    fn even(&self, settings: &Settings, photons: f64) -> f64 {
        // Camera paths that are not cut find the light that photons miss.
        if settings.strategy.continues() {
            return 0.0;
        }
        let reach = f64::from(settings.radius.max(settings.caustic_radius));
        let per_light_path = photons.max(1.0) / f64::from(settings.light_paths);
        (self.area / (PI * reach * reach * per_light_path)).max(1.0)
    }
}

/// Wall-clock time of a path of either kind, seconds, in trials of one pixel out of `stride`
/// squared.
fn seconds_per_path(renderer: &Renderer, stride: u32) -> Result<f64> {
    let light_paths = (TRIAL_PATHS.start as u32).min(renderer.most_light_paths());
    let camera_paths = TRIAL_CAMERA_PATHS;
    let settings = renderer.settings().clone();
    let own = Settings { light_paths, camera_paths, guide: 0, sobol_set: 1, ..settings };
    let mut probe = renderer.sample(own, stride)?;
    let paths = probe.settings().pixels() as f64 * f64::from(camera_paths) + f64::from(light_paths);
    // The first iteration meets cold caches.
    probe.iterate(Measure::Pairs);
    let start = Instant::now();
    probe.iterate(Measure::Pairs);
    probe.check_interrupt()?;
    Ok(start.elapsed().as_secs_f64() / paths)
}

/// Area of all surfaces on which photons are merged, scene units squared.
pub fn merging_area(scene: &Scene) -> f64 {
    let places = scene.placements().par_iter().enumerate();
    let area = |(place, placement): (usize, &Placement)| {
        if !scene.materials()[placement.material as usize].bsdf.merges() {
            return 0.0;
        }
        let triangles = 0..scene.mesh(placement).triangles.len() as u32;
        let area = |triangle| f64::from(scene.placed_triangle(place as u32, triangle).area());
        triangles.map(area).sum()
    };
    // The order of the sum does not depend on the number of threads.
    places.map(area).collect::<Vec<f64>>().iter().sum()
}

/// Mean times of the current block, by phase.
fn times(renderer: &Renderer) -> impl Iterator<Item = TimeSample> {
    let block = renderer.block();
    let (clock, threads) = (block.clock, rayon::current_num_threads());
    let light_paths = f64::from(block.counts.light_paths);
    let camera_paths = block.counts.camera_paths.mean();
    Phase::ALL.into_iter().map(move |phase| {
        let seconds = phase.time(&clock.times, threads).as_secs_f64() / clock.iterations as f64;
        TimeSample { phase, light_paths, camera_paths, seconds, error: None }
    })
}

/// Radius of a disc of the area that a pixel sees head-on, median over the image, scene units; that
/// of a unit square if nothing is seen.
fn footprint(scene: &Scene, accel: &dyn Intersect, settings: &Settings) -> f64 {
    let view = scene.camera.view_of(settings);
    let [w, h] = [settings.width, settings.height].map(|pixels| pixels as f32);
    // Offset between the two rays, pixels. A whole pixel may span the whole view.
    const PART: f32 = 0.1;
    let mut sides = Vec::new();
    for row in 0..FOOTPRINTS {
        for column in 0..FOOTPRINTS {
            let [x, y] = [(column, w), (row, h)]
                .map(|(i, pixels)| (i as f32 + 0.5) / FOOTPRINTS as f32 * pixels);
            let (ray, weight) = scene.camera_ray(&view, x, y, [0.5; 2]);
            let (next, _) = scene.camera_ray(&view, x + PART, y, [0.5; 2]);
            let hit = accel.closest_hit(&ray);
            if weight > 0.0 && !hit.is_miss() {
                if scene.meters().is_some() {
                    sides.push(METER_PIXEL * f64::from(hit.t));
                    continue;
                }
                // Rays of an orthographic camera differ by their origins alone.
                let offset = (next.origin - ray.origin).cross(ray.direction);
                let across = offset + hit.t * next.direction.cross(ray.direction);
                sides.push(f64::from(across.length() / PART));
            }
        }
    }
    sides.sort_by(f64::total_cmp);
    let side = sides.get(sides.len() / 2).copied().unwrap_or(1.0);
    side / PI.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bdpm_core::scene::backend::{Backend, build};
    use bdpm_core::settings::{Direct, Strategy};
    use bdpm_core::transport::photon::PhotonClass;
    use bdpm_load::load;

    #[test]
    fn equal_radii_measure_the_bias_of_each_class_separately() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/cornell-box-classic");
        let loaded = load(folder).unwrap();
        let own = Settings::resolve(&Default::default(), &loaded.defaults, loaded.scene.size());
        let own = own.unwrap();
        // Photons straight from the lamp are then of the class that merges at every vertex.
        let (direct, radius) = (Direct::PhotonMap, 8.0 * own.radius);
        let (width, height, light_paths) = (16, 16, 4000);
        let own =
            Settings { direct, radius, caustic_radius: radius, width, height, light_paths, ..own };
        let accel = build(Backend::Bvh, &loaded.scene).unwrap();
        let renderer = Renderer::new(&loaded.scene, &accel, own.clone()).unwrap();
        let mut runner = TrialRunner::new(&renderer, 0.0).unwrap();
        // Without time a trial takes two iterations, with equal samples each time.
        let mut nested = |class| -> Vec<f64> {
            let trial = runner.trial(&own, Some(NestedPart::Class(class)), 0.0).unwrap();
            trial.noise.pixels.iter().map(|pixel| pixel.noise.nested[1]).collect()
        };
        let [every, last] = [PhotonClass::Caustic, PhotonClass::Diffuse].map(&mut nested);
        let square = |values: &[f64]| values.iter().map(|d| d * d).sum::<f64>();
        let between: Vec<f64> = every.iter().zip(&last).map(|(a, b)| a - b).collect();
        assert!(square(&every) > 0.0 && square(&last) > 0.0);
        assert!(square(&between) > 0.1 * square(&every), "both classes have the same bias");
    }

    #[test]
    fn trial_that_is_darker_than_others_expects_more_noise() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes/cornell-box-classic");
        let loaded = load(folder).unwrap();
        let own = Settings::resolve(&Default::default(), &loaded.defaults, loaded.scene.size());
        let own = Settings { width: 16, height: 16, light_paths: 4000, ..own.unwrap() };
        let accel = build(Backend::Bvh, &loaded.scene).unwrap();
        let renderer = Renderer::new(&loaded.scene, &accel, own.clone()).unwrap();
        let mut runner = TrialRunner::new(&renderer, 0.0).unwrap();
        for strategy in [Strategy::Path, Strategy::CutMis] {
            let own = Settings { strategy, merge_vertex: 2, ..own.clone() };
            let mut trial = runner.trial(&own, None, 0.0).unwrap();
            let weights = vec![1.0; trial.noise.pixels.len()];
            trial.set_missed_light(trial.least_luminance());
            let alone = trial.relative(&weights);
            trial.set_missed_light(2.0 * trial.luminance());
            let missing = trial.relative(&weights) - alone;
            // theory.md (93f): half of the light is missing
            let noise = &trial.noise;
            let paths = match strategy {
                Strategy::Path => noise.pixels.len() as u64 * u64::from(noise.camera_paths),
                _ => u64::from(noise.light_paths),
            };
            let expected = (paths * noise.iterations) as f64 * (0.5 - BIAS_TOLERANCE).powi(2);
            let [less, more] = match strategy {
                Strategy::Path => [missing.f, missing.b],
                _ => [missing.b, missing.f],
            };
            assert!(less == 0.0 && (more / expected - 1.0).abs() < 1e-9, "{missing:?} {expected}");
        }
    }
}
