//! Runs trials of techniques on a sample of the pixels of an image.

use super::Guided;
use super::seen_surfaces::{footprint, merging_area};
use super::start_up::CellGrowth;
use super::trial::Trial;
use crate::adaptive::count_choice::LEAST_SUFFIX_PATHS;
use crate::timing::TimeModel;
use crate::timing::fit::fit;
use crate::timing::measure::Recorder;
use bdpm_core::base::error::Result;
use bdpm_core::film::counts::Counts;
use bdpm_core::noise::{Coefficients, Measure};
use bdpm_core::render::Renderer;
use bdpm_core::render::audit::brightest_path;
use bdpm_core::render::guiding::{
    LEARNING_CAMERA_PATHS, LEARNING_LIGHT_PATHS, LEARNING_PIXELS, LEARNING_ROUND, Learned,
};
use bdpm_core::render::{NestedPart, RenderConfig};
use bdpm_core::scene::Scene;
use bdpm_core::scene::lights::guide::Guide;
use bdpm_core::settings::Settings;
use bdpm_core::transport::photon::PhotonClass;
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

/// Runs trials on a sample of the pixels of an image.
pub struct TrialRunner<'a> {
    /// Renders the whole image: learning uses it.
    whole: Renderer,
    scene: &'a Scene,
    /// One renderer for each lookup radius so far, and the cells that its trials needed. Trials of
    /// equal lookup radius share its areas.
    pub(super) areas: Vec<(Renderer, CellGrowth)>,
    /// The sample has one pixel of each square of this many by this many pixels.
    stride: u32,
    /// Where light paths of trials start.
    pub(super) guide: Option<Arc<Guide>>,
    /// Wall-clock time of a path of either kind, seconds.
    per_path: f64,
    /// Light paths of an iteration of a trial.
    light_paths: u32,
    /// Light paths of an iteration that the memory allows.
    pub(super) max_light_paths: u32,
    /// Pixels of the image.
    pub(super) pixels: f64,
    /// Area of the surfaces on which photons are merged, scene units squared.
    area: f64,
    /// Radius of a disc of the area that a pixel sees, median over the image, scene units.
    pub footprint: f64,
}

impl<'a> TrialRunner<'a> {
    /// Prepares trials for the image of a renderer. The sample is as large as trials of `seconds`
    /// allow.
    pub fn new(renderer: &'a Renderer, seconds: f64) -> Result<Self> {
        let (scene, accel) = renderer.scene_and_accel();
        let settings = renderer.settings();
        let stride = |paths: f64| stride(settings, paths / f64::from(TRIAL_CAMERA_PATHS));
        let each = TRIAL_MEASURING * seconds / TRIAL_ITERATIONS as f64;
        let probe = stride(TRIAL_PATHS.start);
        // Half of the paths are light paths.
        let per_path = seconds_per_path(renderer, probe)?;
        let paths = 0.5 * each / per_path;
        let paths = paths.clamp(TRIAL_PATHS.start, TRIAL_PATHS.end);
        let stride = stride(paths);
        let (area, footprint) = (merging_area(scene), footprint(scene, &**accel, settings));
        let max_light_paths = renderer.most_light_paths();
        let unguided = Settings { guide: 0, ..settings.clone() };
        Ok(Self {
            whole: renderer.with_settings(unguided.clone())?,
            scene,
            areas: vec![(renderer.sample(unguided.clone(), stride)?, CellGrowth::default())],
            stride,
            guide: renderer.learned_guide(),
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
    pub fn trial(
        &mut self,
        settings: &Settings,
        nests: Option<PhotonClass>,
        seconds: f64,
    ) -> Result<Trial> {
        let begun = Instant::now();
        let settings = self.settings_of_trial(settings, nests);
        let nested_part = nests.map(NestedPart::Class);
        let config = RenderConfig { nested_part, ..RenderConfig::with_pixel_batches() };
        let (mut renderer, known) = self.sample(settings.clone(), self.stride, config)?;
        let growth = &mut self.areas[known].1;
        let photons = measure_noise(&mut renderer, begun, seconds, growth)?;
        let start_up = growth.start_up(rayon::current_num_threads());
        let noise = renderer.block().noise_image()?;
        let has_caustic_photons = renderer.found_caustic_photons();
        let pixels = f64::from(noise.width * noise.height);
        let model =
            self.measure_times(&mut renderer, settings.light_paths, pixels, begun, seconds)?;
        Ok(Trial {
            radii: [settings.caustic_radius, settings.radius].map(f64::from),
            nests,
            noise,
            times: TimeModel { pixels: self.pixels, ..model },
            start_up: start_up.filter(|_| settings.has_photons()),
            even: self.even(&settings, photons),
            missed: Coefficients::default(),
            merges: settings.has_photons(),
            has_caustic_photons,
        })
    }

    /// Settings of a trial of the technique of `settings`.
    fn settings_of_trial(&self, settings: &Settings, nests: Option<PhotonClass>) -> Settings {
        // As many photons as without splitting, so that trials of all techniques have similar
        // numbers of iterations.
        let least = if settings.has_cache() { LEAST_SUFFIX_PATHS } else { LEAST_LIGHT_PATHS };
        let light_paths = (self.light_paths / settings.continuations()).max(least);
        // Trials have too few light paths for sets of them.
        let mut of_trial = Settings {
            light_paths,
            camera_paths: TRIAL_CAMERA_PATHS,
            seed: settings.seed.wrapping_add(TRIAL_SEED),
            guide: 0,
            sobol_set: 1,
            mis_scales: Some(settings.mis_scales()),
            ..settings.clone()
        };
        if nests.is_some() && of_trial.caustic_radius == of_trial.radius {
            // With equal radii the nested radii would measure the bias of both classes together.
            of_trial.caustic_radius *= RADIUS_RATIO;
        }
        of_trial
    }

    /// Times of an iteration of the sample, which has this number of pixels, in the rest of a trial
    /// of `seconds` that has begun. Two blocks differ in their light paths.
    fn measure_times(
        &self,
        renderer: &mut Renderer,
        mut light_paths: u32,
        pixels: f64,
        begun: Instant,
        seconds: f64,
    ) -> Result<TimeModel> {
        let elapsed = || begun.elapsed().as_secs_f64();
        let threads = rayon::current_num_threads();
        let mut recorder = Recorder::new(threads);
        let share = 0.5 * (1.0 - TRIAL_MEASURING) * seconds;
        let mut per_light_path = 0.0;
        for _ in 0..2 {
            renderer.begin_block(Counts::uniform(light_paths, TIMED_CAMERA_PATHS))?;
            let block_begun = elapsed();
            let mut timed = 0;
            while timed < 1
                || elapsed() < block_begun + share
                || timed < TRIAL_TIMED && elapsed() < TRIAL_PATIENCE * seconds
            {
                let times = renderer.iterate(Measure::Off).times;
                recorder.add(light_paths.into(), TIMED_CAMERA_PATHS.into(), &times);
                renderer.check_interrupt()?;
                timed += 1;
            }
            // As many more as fit in the time, within the ratios that separate the times.
            let light = renderer.block().clock.times.light.as_secs_f64();
            let light = light / (timed as f64 * threads as f64);
            per_light_path = light / f64::from(light_paths);
            let fits = share / light;
            let ratio = (fits as u32).clamp(TIMED_RATIOS[0], TIMED_RATIOS[1]);
            light_paths = light_paths.saturating_mul(ratio).min(self.max_light_paths);
        }
        let model = fit(&recorder.samples(), pixels)?.model;
        // Two counts determine the fixed time badly: it is at most half of the measured time.
        let light_path = model.light_path.max(0.5 * per_light_path);
        Ok(TimeModel { light_path, ..model })
    }
}

/// Measures the noise in the first part of a trial of `seconds` that has begun, and the cells that
/// it needs. Returns the mean number of photons of an iteration.
fn measure_noise(
    renderer: &mut Renderer,
    begun: Instant,
    seconds: f64,
    growth: &mut CellGrowth,
) -> Result<f64> {
    let settings = renderer.settings();
    let camera_paths = settings.pixels() as f64 * f64::from(settings.camera_paths);
    let has_photons = settings.has_photons();
    let elapsed = || begun.elapsed().as_secs_f64();
    let (mut iterations, mut photons) = (0, 0);
    let measuring = TRIAL_MEASURING * seconds;
    while elapsed() < measuring
        || iterations < TRIAL_ITERATIONS && elapsed() < TRIAL_PATIENCE * measuring
        || iterations < 2
    {
        let work_before = renderer.area_work();
        photons += renderer.iterate(Measure::Pairs).photons;
        if has_photons {
            growth.add(iterations as usize, camera_paths, renderer.area_work().since(work_before));
        }
        renderer.check_interrupt()?;
        iterations += 1;
    }
    Ok(photons as f64 / iterations as f64)
}

impl<'a> TrialRunner<'a> {
    /// The largest luminance that a camera path is likely to find, W/(m^2 sr).
    pub fn brightest(&self) -> f64 {
        brightest_path(self.scene)
    }

    /// A renderer of one pixel of each square of `stride` by `stride` pixels, and the index of its
    /// areas. Those of equal lookup radius share areas, because they see mostly the same surfaces.
    pub(super) fn sample(
        &mut self,
        settings: Settings,
        stride: u32,
        config: RenderConfig,
    ) -> Result<(Renderer, usize)> {
        let same = |(own, _): &(Renderer, _)| own.settings().reach() == settings.reach();
        let known = self.areas.iter().position(same).unwrap_or(self.areas.len());
        if known == self.areas.len() {
            let renderer = self.areas[0].0.sample(settings.clone(), self.stride)?;
            self.areas.push((renderer, CellGrowth::default()));
        }
        let config = RenderConfig { independent_paths: true, hides_lights: true, ..config };
        let renderer = self.areas[known].0.sample(settings, stride)?.guided(self.guide.clone());
        Ok((renderer.configure(config)?, known))
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

/// Side of the squares of which one pixel each makes a sample of about so many pixels.
pub fn stride(settings: &Settings, sample: f64) -> u32 {
    let stride = (settings.pixels() as f64 / sample).sqrt() as u32;
    stride.clamp(1, settings.width.min(settings.height))
}

/// Wall-clock time of a path of either kind, seconds, in trials of one pixel out of `stride`
/// squared.
fn seconds_per_path(renderer: &Renderer, stride: u32) -> Result<f64> {
    let light_paths = (TRIAL_PATHS.start as u32).min(renderer.most_light_paths());
    let camera_paths = TRIAL_CAMERA_PATHS;
    let settings = renderer.settings().clone();
    let settings = Settings { light_paths, camera_paths, guide: 0, sobol_set: 1, ..settings };
    let mut probe = renderer.sample(settings, stride)?;
    let paths = probe.settings().pixels() as f64 * f64::from(camera_paths) + f64::from(light_paths);
    // The first iteration meets cold caches.
    probe.iterate(Measure::Pairs);
    let start = Instant::now();
    probe.iterate(Measure::Pairs);
    probe.check_interrupt()?;
    Ok(start.elapsed().as_secs_f64() / paths)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::adaptive::technique::trial::BIAS_TOLERANCE;
    use crate::test_scene::TestScene;
    use bdpm_core::settings::{Direct, Kernel, Strategy};

    #[test]
    fn equal_radii_measure_the_bias_of_each_class_separately() {
        let scene = TestScene::new("cornell-box-classic", [16, 16]);
        let own = scene.settings.clone();
        // Photons straight from the lamp are then of the class that merges at every vertex.
        let (direct, radius) = (Direct::PhotonMap, 8.0 * own.radius);
        let own = Settings { direct, radius, caustic_radius: radius, light_paths: 4000, ..own };
        let renderer = scene.renderer(&own);
        let mut runner = TrialRunner::new(&renderer, 0.0).unwrap();
        // Without time a trial takes two iterations, with equal samples each time.
        let mut nested = |class| -> Vec<f64> {
            let trial = runner.trial(&own, Some(class), 0.0).unwrap();
            trial.noise.pixels.iter().map(|pixel| pixel.noise.nested[1]).collect()
        };
        let [every, last] = PhotonClass::ALL.map(&mut nested);
        let square = |values: &[f64]| values.iter().map(|d| d * d).sum::<f64>();
        let between: Vec<f64> = every.iter().zip(&last).map(|(a, b)| a - b).collect();
        assert!(square(&every) > 0.0 && square(&last) > 0.0);
        assert!(square(&between) > 0.1 * square(&every), "both classes have the same bias");
    }

    #[test]
    fn trial_that_is_darker_than_others_expects_more_noise() {
        let scene = TestScene::new("cornell-box-classic", [16, 16]);
        let own = Settings { light_paths: 4000, ..scene.settings.clone() };
        let renderer = scene.renderer(&own);
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

    /// Areas are computed for merges alone. Later trials at the same radii find them computed, and
    /// still know what an image would need.
    #[test]
    fn trials_know_the_start_up_of_areas() {
        let scene = TestScene::new("cornell-box-classic", [64, 64]);
        for kernel in [Kernel::Area, Kernel::Disc] {
            let own = scene.settings.clone();
            let own = Settings { kernel, merge_vertex: 2, light_paths: 4000, ..own };
            let renderer = scene.renderer(&own);
            let mut runner = TrialRunner::new(&renderer, 0.0).unwrap();
            let mut start_up = |strategy| {
                let trial = runner.trial(&Settings { strategy, ..own.clone() }, None, 0.0).unwrap();
                trial.start_up
            };
            assert_eq!(start_up(Strategy::Path), None);
            let both = [Strategy::CutMis, Strategy::Mis].map(&mut start_up);
            assert!(both.iter().all(|known| known.is_some() == (kernel == Kernel::Area)));
            let [Some(first), Some(second)] = both else { continue };
            for own in [first, second] {
                let [few, many] = [1e4, 1e7].map(|camera_paths| own.seconds(camera_paths));
                assert!(few > 0.0 && few <= many && many < 1e3 * few, "{own:?}");
            }
            let [first, second] = [first, second].map(|own| own.seconds(1e5));
            assert!(second > 0.5 * first, "{first} {second}");
        }
    }
}
