//! A quick estimate of the time of iterations, from a sample of the pixels, before any iteration is
//! rendered.

use crate::timing::TimeModel;
use crate::timing::fit::fit;
use crate::timing::measure::{Phase, Recorder, TimeSample};
use bdpm_core::accel::Intersect;
use bdpm_core::base::error::Result;
use bdpm_core::film::counts::Counts;
use bdpm_core::noise::Measure;
use bdpm_core::render::Renderer;
use bdpm_core::scene::Scene;
use bdpm_core::settings::{Kernel, Settings, Strategy};
use std::sync::Arc;

/// Approximate side of the sample, pixels.
const SAMPLE_SIDE: u32 = 32;

/// The same where only camera paths are timed, whose waves are then full.
const PATH_SAMPLE_SIDE: u32 = 64;

/// Maximum number of light paths.
const MAX_LIGHT_PATHS: u32 = 16_384;

/// Ratio between the two numbers of light paths and of camera paths that are timed.
const COUNT_RATIO: u32 = 4;

/// Timed iterations at each pair of counts. One more before them warms up the memory.
const ITERATIONS: usize = 3;

/// Approximate lower bound of the times of iterations with `settings` on the threads of the current
/// rayon pool. It includes the phases, but neither waiting between threads nor the areas around
/// gather points.
///
/// # Errors
/// As [`Renderer::new`].
pub fn min_times(
    scene: &Arc<Scene>,
    accel: &Arc<dyn Intersect>,
    settings: &Settings,
) -> Result<TimeModel> {
    let many = settings.light_paths.clamp(COUNT_RATIO, MAX_LIGHT_PATHS);
    let few = many / COUNT_RATIO;
    let few_paths = Settings { light_paths: few, kernel: Kernel::Disc, ..settings.clone() };
    let mut renderer =
        sample(&Renderer::new(scene, accel, few_paths.clone())?, &few_paths, SAMPLE_SIDE)?;
    renderer.iterate(Measure::Off);
    let mut recorder = Recorder::new(rayon::current_num_threads());
    for (light_paths, camera_paths) in [(few, 1), (many, 1), (few, COUNT_RATIO)] {
        renderer.begin_block(Counts::uniform(light_paths, camera_paths))?;
        for _ in 0..ITERATIONS {
            let times = renderer.iterate(Measure::Off).times;
            recorder.add(light_paths.into(), camera_paths.into(), &times);
        }
    }
    let mut samples = recorder.samples();
    samples.retain(|TimeSample { phase, .. }| *phase != Phase::Rest);
    let Settings { width, height, .. } = renderer.settings();
    let sampled = f64::from(*width) * f64::from(*height);
    let model = fit(&samples, sampled)?.model;
    Ok(TimeModel { pixels: settings.pixels() as f64, ..model })
}

/// Approximate lower bound of the time of an iteration of path tracing with one path per pixel of
/// the image of a renderer, seconds.
///
/// # Errors
/// As [`Renderer::new`].
pub fn path_time(renderer: &Renderer) -> Result<f64> {
    let pixels = renderer.settings().pixels() as f64;
    let paths = Settings { strategy: Strategy::Path, ..renderer.settings().clone() };
    let mut renderer = sample(renderer, &paths, PATH_SAMPLE_SIDE)?;
    let times = [(); 3].map(|()| renderer.iterate(Measure::Off).times.wall.as_secs_f64());
    let fastest = times.into_iter().fold(f64::INFINITY, f64::min);
    Ok(fastest * pixels / renderer.settings().pixels() as f64)
}

/// A renderer of one camera path in some pixels, about `side` by `side` of a square image.
fn sample(renderer: &Renderer, settings: &Settings, side: u32) -> Result<Renderer> {
    let stride = (settings.width.min(settings.height) / side).max(1);
    let settings = Settings { camera_paths: 1, sobol_set: 1, ..settings.clone() };
    renderer.sample(settings, stride)
}
