//! The measured coefficients against the sampled variance of the renderer itself.

mod common;

use bdpm::accel::Intersect;
use bdpm::noise::Measure;
use bdpm::noise::film::BatchGrain;
use bdpm::noise::image::{NoiseImage, Statistic};
use bdpm::settings::Direct;
use bdpm::{Renderer, Scene, Settings};
use common::*;

/// Measures every iteration.
fn measure(
    scene: &Scene,
    accel: &dyn Intersect,
    settings: Settings,
    iterations: usize,
    measure: Measure,
) -> NoiseImage {
    let counts = (settings.light_paths, settings.camera_paths);
    let renderer = Renderer::new(scene, accel, settings).unwrap();
    let mut renderer = renderer.with_batches(BatchGrain::Pixel);
    for _ in 0..iterations {
        renderer.iterate(measure);
    }
    NoiseImage::new(renderer.film(), renderer.noise().unwrap(), counts)
}

fn all(image: &NoiseImage) -> Vec<usize> {
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

#[test]
fn coefficients_measured_anywhere_predict_the_noise_everywhere() {
    let scene = furnished_box();
    let accel = accel(&scene);
    for direct in [Direct::Connect, Direct::PhotonMap] {
        for merge_vertex in [1, 2] {
            let at = |light_paths, camera_paths, seed| Settings {
                direct,
                merge_vertex,
                light_paths,
                camera_paths,
                seed,
                radius: 0.2,
                ..settings(12, 12)
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
    }
}
