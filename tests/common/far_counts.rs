//! Coefficients measured at some counts against the sampled variance at others.

use crate::common::*;
use bdpm::accel::Intersect;
use bdpm::noise::Measure;
use bdpm::noise::image::{NoiseImage, Statistic};
use bdpm::render::RenderConfig;
use bdpm::settings::{Direct, Kernel, MAX_LIGHT_PATHS, MisScales};
use bdpm::{Renderer, Scene, Settings};
use std::sync::Arc;

/// Measures every iteration.
pub fn measure(
    scene: &Arc<Scene>,
    accel: &Arc<dyn Intersect>,
    settings: Settings,
    iterations: usize,
    measure: Measure,
) -> NoiseImage {
    let renderer = Renderer::new(scene, accel, settings).unwrap();
    let mut renderer = renderer.configure(RenderConfig::with_pixel_batches()).unwrap();
    for _ in 0..iterations {
        renderer.iterate(measure);
    }
    renderer.block().noise_image().unwrap()
}

pub fn all(image: &NoiseImage) -> Vec<usize> {
    (0..image.pixels.len()).collect()
}

/// Asserts that two independent statistics agree within `relative` or two standard errors,
/// whichever is larger, the latter being less than `most`.
#[track_caller]
fn assert_agree(
    what: &str,
    predicted: Statistic,
    sampled: Statistic,
    (relative, most): (f64, f64),
) {
    let error = predicted.error.hypot(sampled.error) / sampled.value;
    let off = predicted.value / sampled.value - 1.0;
    println!("{what}: {:.5} / {:.5}, {off:+.4} +- {error:.4}", predicted.value, sampled.value);
    assert!(2.0 * error < most, "{what}: two standard errors are {:.4}", 2.0 * error);
    assert!(off.abs() < relative.max(2.0 * error), "{what}: off by {off:+.4} +- {error:.4}");
}

/// A scene whose noise is measured at some counts and predicted for others.
pub struct Subject<'a> {
    pub name: String,
    pub scene: &'a Arc<Scene>,
    /// All but counts and seeds.
    pub settings: Settings,
    /// Light paths of the measurement.
    pub few: u32,
    /// Iterations of the measurement.
    pub iterations: usize,
    /// Share of the pixels that count: those with the least noise in a run of their own. Rare light
    /// in the others would take too long to be sampled.
    pub quiet: f64,
    /// Two standard errors are less than this, so that the test says something.
    pub most: f64,
}

impl Subject<'_> {
    /// Asserts that coefficients measured at few paths of both kinds tell the noise at far counts:
    /// light and camera paths, and iterations that sample it.
    pub fn assert_far_counts(&self, far: &[(u32, u32, usize)]) {
        let Self { name, scene, settings, few, iterations, quiet, most } = self;
        let accel = accel(scene);
        let at = |light_paths, camera_paths, seed| Settings {
            light_paths: settings.allowed_light_paths(MAX_LIGHT_PATHS).nearest(light_paths),
            camera_paths,
            seed,
            ..settings.clone()
        };
        let pilot = measure(scene, &accel, at(1000, 4, 3), 200, Measure::Pairs);
        let mut region = all(&pilot);
        let noise = |pixel: &usize| pilot.pixels[*pixel].noise.sampled;
        region.sort_by(|one, other| noise(one).total_cmp(&noise(other)));
        region.truncate((quiet * region.len() as f64) as usize);
        let poor = measure(scene, &accel, at(*few, 4, 1), *iterations, Measure::Pairs);
        for &(light_paths, camera_paths, iterations) in far {
            let settings = at(light_paths, camera_paths, 2);
            let light_paths = settings.light_paths;
            let far = measure(scene, &accel, settings, iterations, Measure::Pairs);
            let what = format!("{name} {light_paths} {camera_paths}");
            let (n, m) = (f64::from(light_paths), f64::from(camera_paths));
            let sampled = far.sampled_pooled_rms(&region);
            assert_agree(&what, poor.pooled_rms(&region, n, m), sampled, (0.02, *most));
        }
    }
}

/// Asserts predictions in a furnished box, merged on discs or by areas, with another radius for
/// caustics.
pub fn assert_far_counts(direct: Direct, merge_vertex: u32, kernel: Kernel) {
    let radius = 0.2;
    let caustic_radius = if kernel == Kernel::Area { 0.6 * radius } else { radius };
    let asked =
        Settings { direct, merge_vertex, kernel, radius, caustic_radius, ..settings(12, 12) };
    // The weights are made for other counts than any of these.
    let mis_scales = Some(MisScales { light_paths: 1000, scales: [0.4; 2] });
    let settings = Settings { mis_scales, ..by_way(asked) };
    let name = format!("{direct:?} {kernel:?} k={merge_vertex}");
    Subject {
        name,
        scene: &furnished_box(),
        settings,
        few: 300,
        iterations: 2500,
        quiet: 1.0,
        most: 0.03,
    }
    .assert_far_counts(&[(30_000, 4, 130), (300, 100, 500), (3000, 25, 250)]);
}
