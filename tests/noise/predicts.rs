//! The measured coefficients against the sampled variance of the renderer itself. The other
//! strategies are in `tests/check/predicts.rs`.

use crate::common::far_counts::*;
use crate::common::*;
use bdpm::Settings;
use bdpm::noise::Measure;
use bdpm::noise::image::NoiseImage;
use bdpm::settings::{Direct, Kernel};

#[test]
fn coefficients_measured_anywhere_predict_the_noise_everywhere() {
    for merge_vertex in [1, MIS] {
        assert_far_counts(Direct::Connect, merge_vertex, Kernel::Disc);
    }
}

/// Sets of light paths that split have coefficients of their own, which predict as well.
#[test]
fn noise_of_sobol_sets_that_split_is_predicted_at_far_counts() {
    let settings = Settings {
        direct: Direct::PhotonMap,
        merge_vertex: 1,
        kernel: Kernel::Disc,
        sobol_set: 64,
        splitting: 3,
        radius: 0.2,
        caustic_radius: 0.2,
        ..settings(12, 12)
    };
    let (name, scene) = ("Sobol sets".into(), &furnished_box());
    Subject { name, scene, settings, few: 300, iterations: 2500, quiet: 1.0, most: 0.05 }
        .assert_far_counts(&[(32_768, 4, 130), (512, 100, 500), (3200, 25, 250)]);
}

/// Asserts that settings have the same mean image as with independent light paths that do not
/// split, and at most `share` of their light coefficient.
#[track_caller]
fn assert_less_noise_of_light_paths(settings: Settings, share: f64) {
    const ITERATIONS: usize = 200;
    let scene = furnished_box();
    let accel = accel(&scene);
    let independent = Settings { sobol_set: 1, splitting: 1, seed: 2, ..settings.clone() };
    let [plain, other] = [independent, settings]
        .map(|settings| measure(&scene, &accel, settings, ITERATIONS, Measure::Pairs));
    let region = all(&plain);
    let light = |image: &NoiseImage| {
        image.statistic(&region, |pixels| {
            bdpm::noise::image::mean(pixels, |noise| noise.coefficients.f)
        })
    };
    let (before, after) = (light(&plain), light(&other));
    println!(
        "f {:.4} +- {:.4}, {:.4} +- {:.4}",
        before.value, before.error, after.value, after.error
    );
    assert!(after.value + 3.0 * after.error < share * (before.value - 3.0 * before.error));
    // Equal means, pixel by pixel: squared deviations over their variances.
    let squares = plain.pixels.iter().zip(&other.pixels).map(|(one, other)| {
        let variance = (one.noise.sampled + other.noise.sampled) / ITERATIONS as f64;
        (one.luminance - other.luminance).powi(2) / variance
    });
    let mean = squares.sum::<f64>() / region.len() as f64;
    println!("mean squared deviation {mean:.3}");
    // Pixels share light paths: about 40 of them are independent at this radius.
    assert!((mean - 1.0).abs() < 4.0 * (2.0f64 / 40.0).sqrt(), "{mean}");
}

#[test]
fn sobol_sets_and_splitting_keep_the_mean_and_lower_the_noise_of_light_paths() {
    let own = Settings {
        merge_vertex: 1,
        light_paths: 8192,
        camera_paths: 4,
        radius: 0.1,
        caustic_radius: 0.1,
        ..settings(12, 12)
    };
    let sets = Settings { direct: Direct::PhotonMap, sobol_set: 1024, ..own.clone() };
    assert_less_noise_of_light_paths(sets, 0.9);
    assert_less_noise_of_light_paths(Settings { splitting: 6, ..own }, 0.6);
}

#[test]
fn formula_and_samples_of_one_run_agree_pixel_by_pixel_as_the_batches_say() {
    let scene = furnished_box();
    let accel = accel(&scene);
    let settings = Settings {
        merge_vertex: 2,
        camera_paths: 10,
        light_paths: 500,
        radius: 0.2,
        caustic_radius: 0.2,
        ..settings(12, 12)
    };
    for estimator in [Measure::Pairs, Measure::Halves] {
        let image = measure(&scene, &accel, settings.clone(), 1600, estimator);
        let deviations: Vec<f64> = (0..image.pixels.len())
            .map(|pixel| {
                let difference = image.statistic(&[pixel], |noise| {
                    noise[0].coefficients.variance(500.0, 10.0) - noise[0].sampled
                });
                difference.value / difference.error
            })
            .collect();
        let n = deviations.len() as f64;
        let mean = deviations.iter().sum::<f64>() / n;
        let square = deviations.iter().map(|z| z * z).sum::<f64>() / n;
        println!("{estimator:?}: deviations {mean:.3} +- {:.3}", square.sqrt());
        // Student's t with 15 degrees of freedom has the variance 15/13. Pixels are hardly
        // correlated here: a mean of 144 has a standard error of 0.09, a mean square one of 0.15.
        assert!(mean.abs() < 0.4, "{mean}");
        assert!((square - 15.0 / 13.0).abs() < 0.6, "{square}");
    }
}

#[test]
fn coefficients_do_not_depend_on_the_backend_the_counts_or_the_estimator() {
    let scene = furnished_box();
    let at = |light_paths, camera_paths, seed| Settings {
        merge_vertex: 2,
        light_paths,
        camera_paths,
        seed,
        radius: 0.2,
        caustic_radius: 0.2,
        ..settings(8, 8)
    };
    let default = accel(&scene);
    let bvh = bdpm::scene::backend::build(bdpm::scene::backend::Backend::Bvh, &scene).unwrap();
    let runs = [
        measure(&scene, &default, at(300, 20, 1), 1000, Measure::Pairs),
        measure(&scene, &bvh, at(300, 20, 2), 500, Measure::Pairs),
        measure(&scene, &default, at(1000, 7, 3), 800, Measure::Pairs),
        measure(&scene, &default, at(301, 21, 4), 1000, Measure::Halves),
    ];
    let region = all(&runs[0]);
    type Pick = fn(&bdpm::noise::image::NoiseSample) -> f64;
    let picks: [(&str, Pick); 3] =
        [("a", |p| p.coefficients.a), ("b", |p| p.coefficients.b), ("f", |p| p.coefficients.f)];
    for (name, pick) in picks {
        let of = |image: &NoiseImage| {
            image.statistic(&region, |pixels| bdpm::noise::image::mean(pixels, pick))
        };
        let first = of(&runs[0]);
        for (number, run) in runs.iter().enumerate().skip(1) {
            let other = of(run);
            let error = first.error.hypot(other.error);
            println!("{name} {number}: {:.4e} {:.4e} +- {error:.1e}", first.value, other.value);
            assert!(error < 0.2 * first.value, "{name} {number}: {error} says little");
            assert!((first.value - other.value).abs() < 4.0 * error, "{name} {number}");
        }
    }
}
