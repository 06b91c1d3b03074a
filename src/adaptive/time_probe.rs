//! How long iterations will take, before any is rendered: by a moment's look at a sample of the image.

use crate::accel::Intersect;
use crate::base::error::Result;
use crate::film::counts::Counts;
use crate::noise::Measure;
use crate::render::Renderer;
use crate::scene::Scene;
use crate::settings::{Kernel, Settings};
use crate::timing::TimeModel;
use crate::timing::fit::fit;
use crate::timing::measure::{Phase, Recorder, TimeSample};
use std::sync::Arc;

/// Pixels of the sample along a side, about.
const SIDE: u32 = 32;

/// Light paths at the most.
const MOST_LIGHT_PATHS: u32 = 16_384;

/// Light paths over the least number, and camera paths over one.
const RATIO: u32 = 4;

/// Iterations at each pair of counts, after one at the first that meets cold memory.
const ITERATIONS: usize = 3;

/// The times of iterations of the image of `settings` on the threads of the current rayon pool: of its
/// phases, without what threads wait for each other and without the areas around gather points. What
/// takes long takes at least about this long.
///
/// # Errors
/// As [`Renderer::new`].
pub fn least_times(
    scene: &Arc<Scene>,
    accel: &Arc<dyn Intersect>,
    settings: &Settings,
) -> Result<TimeModel> {
    let stride = (settings.width.min(settings.height) / SIDE).max(1);
    let many = settings.light_paths.clamp(RATIO, MOST_LIGHT_PATHS);
    let few = many / RATIO;
    let own =
        Settings { light_paths: few, camera_paths: 1, kernel: Kernel::Disc, ..settings.clone() };
    let mut renderer = Renderer::new(scene, accel, own.clone())?.sample(own, stride)?;
    renderer.iterate(Measure::Off);
    let mut recorder = Recorder::new(rayon::current_num_threads());
    for (light_paths, camera_paths) in [(few, 1), (many, 1), (few, RATIO)] {
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
