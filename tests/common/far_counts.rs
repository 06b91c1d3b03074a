//! Coefficients measured at some counts against the sampled variance at others.
#![allow(dead_code)] // each program uses its own part

use crate::common::*;
use bdpm::accel::Intersect;
use bdpm::noise::Measure;
use bdpm::noise::film::BatchGrain;
use bdpm::noise::image::{NoiseImage, Statistic};
use bdpm::settings::Direct;
use bdpm::{Renderer, Scene, Settings};

/// Measures every iteration.
pub fn measure(
    scene: &Scene,
    accel: &dyn Intersect,
    settings: Settings,
    iterations: usize,
    measure: Measure,
) -> NoiseImage {
    let renderer = Renderer::new(scene, accel, settings).unwrap();
    let mut renderer = renderer.with_batches(BatchGrain::Pixel);
    for _ in 0..iterations {
        renderer.iterate(measure);
    }
    renderer.noise_image().unwrap()
}

pub fn all(image: &NoiseImage) -> Vec<usize> {
    (0..image.pixels.len()).collect()
}

/// Asserts that two independent statistics agree within `relative` or two standard errors,
/// whichever is larger, the latter being at most 3 %.
#[track_caller]
fn assert_agree(what: &str, predicted: Statistic, sampled: Statistic, relative: f64) {
    let error = predicted.error.hypot(sampled.error) / sampled.value;
    let off = predicted.value / sampled.value - 1.0;
    println!("{what}: {:.5} / {:.5}, {off:+.4} +- {error:.4}", predicted.value, sampled.value);
    assert!(2.0 * error < 0.03, "{what}: two standard errors are {:.4}", 2.0 * error);
    assert!(off.abs() < relative.max(2.0 * error), "{what}: off by {off:+.4} +- {error:.4}");
}

/// Asserts that coefficients measured at few paths of both kinds tell the noise at far counts.
pub fn assert_far_counts(direct: Direct, merge_vertex: u32) {
    let scene = furnished_box();
    let accel = accel(&scene);
    // Weights for other counts than any of these.
    let at = |light_paths, camera_paths, seed| {
        let asked = Settings {
            direct,
            merge_vertex,
            light_paths,
            camera_paths,
            seed,
            radius: 0.2,
            caustic_radius: 0.2,
            ..settings(12, 12)
        };
        Settings { mis_light_paths: 1000, ..by_way(asked) }
    };
    let poor = measure(&scene, &*accel, at(300, 4, 1), 2500, Measure::Pairs);
    for (light_paths, camera_paths, iterations) in
        [(30_000, 4, 130), (300, 100, 500), (3000, 25, 250)]
    {
        let settings = at(light_paths, camera_paths, 2);
        let far = measure(&scene, &*accel, settings, iterations, Measure::Pairs);
        let region = all(&poor);
        let what = format!("{direct:?} k={merge_vertex} {light_paths} {camera_paths}");
        let (n, m) = (f64::from(light_paths), f64::from(camera_paths));
        let sampled = far.sampled_pooled_rms(&region);
        assert_agree(&what, poor.pooled_rms(&region, n, m), sampled, 0.02);
    }
}
