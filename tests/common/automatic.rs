//! A small box rendered with automatic counts, the same on every machine.

use bdpm::adaptive::autopilot::{Autopilot, AutopilotState, CountOptions};
use bdpm::adaptive::optimize::Objective;
use bdpm::adaptive::stopping::Stop;
use bdpm::load::load;
use bdpm::noise::Measure;
use bdpm::timing::TimeModel;
use bdpm::{Renderer, Scene, Settings};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

pub const WIDTH: u32 = 24;
pub const HEIGHT: u32 = 20;

pub fn scene() -> (Arc<Scene>, Settings) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box-classic");
    let loaded = load(&folder).unwrap();
    let settings =
        Settings::resolve(&Default::default(), &loaded.defaults, loaded.scene.size()).unwrap();
    let settings = Settings {
        width: WIDTH,
        height: HEIGHT,
        light_paths: 2000,
        camera_paths: 3,
        radius: 4.0 * settings.radius,
        caustic_radius: 4.0 * settings.radius,
        ..settings
    };
    (loaded.scene, settings)
}

/// Mean luminance of each iteration's image.
pub fn image_means(renderer: &mut Renderer, iterations: usize, measure: Measure) -> Vec<f64> {
    let mut before = renderer.film().mean_luminance() * renderer.film().iterations as f64;
    let samples = (0..iterations).map(|_| {
        renderer.iterate(measure);
        let sum = renderer.film().mean_luminance() * renderer.film().iterations as f64;
        let sample = sum - before;
        before = sum;
        sample
    });
    samples.collect()
}

/// Renders with automatic counts as if an iteration took a second for each 10 camera paths per
/// pixel, so that the choice is the same on every machine.
pub fn automatic(
    scene: &Arc<Scene>,
    accel: &Arc<dyn bdpm::accel::Intersect>,
    settings: Settings,
    seconds: u64,
) -> Renderer {
    let times = TimeModel {
        fixed: 0.05,
        light_path: 1e-5,
        camera_path: 0.1 / f64::from(WIDTH * HEIGHT),
        look_up: 0.0,
        merge_pair: 1e-8,
        pixels: f64::from(WIDTH * HEIGHT),
    };
    let time = Some(Duration::from_secs(seconds));
    let goal = Stop { time, objective: Objective::Pooled, ..Stop::default() };
    let options = CountOptions { per_pixel: true, denoises: false, times: Some(times) };
    let mut pilot = Autopilot::new(AutopilotState::new(times, 0.0), options);
    let mut renderer = Renderer::new(scene, accel, settings).unwrap();
    let mut elapsed = 0.0;
    while elapsed < seconds as f64 {
        let measure = pilot.prepare(&mut renderer, &goal, elapsed);
        renderer.iterate(measure);
        elapsed += times.at(&renderer.block().counts);
    }
    renderer
}
