//! The image that blocks of automatic counts make together. More of counts is in
//! `tests/noise/counts.rs`.

use crate::common::Estimate;
use crate::common::automatic::*;
use bdpm::Renderer;
use bdpm::Settings;
use bdpm::film::radiance::luminance;
use bdpm::noise::Measure;
use bdpm::render::block;
use bdpm::render::block::CombinedImage;
use bdpm::scene::backend::{Backend, build};

#[test]
#[ignore = "takes minutes: make check-long"]
fn the_combined_image_of_automatic_counts_is_unbiased() {
    let (scene, settings) = scene();
    let accel = build(Backend::Bvh, &scene).unwrap();
    let mut fixed = Renderer::new(&scene, &accel, settings.clone()).unwrap();
    let reference = Estimate::from_samples(&image_means(&mut fixed, 3000, Measure::Off));
    let reference_pixels = fixed.film().mean();
    let reference_variance = fixed.film().variance_of_mean().unwrap();

    let (mut means, mut predicted) = (Vec::new(), Vec::new());
    let mut pixels: Vec<Vec<f64>> = vec![Vec::new(); (WIDTH * HEIGHT) as usize];
    for seed in 100..148 {
        let settings = Settings { seed, ..settings.clone() };
        let renderer = automatic(&scene, &accel, settings, 60);
        let blocks = renderer.blocks();
        assert!(blocks.len() >= 2, "the scene's counts, and what was chosen");
        let combined =
            CombinedImage::new(blocks, block::weights(blocks, &[1.0; (WIDTH * HEIGHT) as usize]));
        means.push(combined.mean_luminance());
        predicted.push(combined.pooled_variance().unwrap().0);
        for (samples, value) in pixels.iter_mut().zip(combined.mean()) {
            samples.push(luminance(value.as_dvec3()));
        }
    }
    let found = Estimate::from_samples(&means);
    Estimate { error: found.error.hypot(reference.error), ..found }.assert_is(reference.mean, 0.0);

    // Pixel by pixel: squared deviations over their errors have the mean 47/45 of Student's t.
    let mut squares = Vec::new();
    for (i, samples) in pixels.iter().enumerate() {
        let Estimate { mean, error } = Estimate::from_samples(samples);
        let expected = luminance(reference_pixels[i].as_dvec3());
        squares.push((mean - expected).powi(2) / (error * error + reference_variance[i]));
    }
    let z2 = squares.iter().sum::<f64>() / squares.len() as f64;
    println!("mean {found:?}, reference {reference:?}, z^2 {z2}");
    // Pixels share light paths: about a third of them are independent.
    assert!((0.6..1.5).contains(&z2), "{z2}");

    // The variance that each run predicts for its image is what the seeds scatter by.
    let scatter: Vec<f64> = pixels
        .iter()
        .map(|samples| Estimate::from_samples(samples).error.powi(2) * samples.len() as f64)
        .collect();
    let scatter = scatter.iter().sum::<f64>() / scatter.len() as f64;
    let predicted = Estimate::from_samples(&predicted);
    println!("scatter {scatter}, predicted {predicted:?}");
    // 48 seeds: a sample variance with a relative standard error of about 1/sqrt(24) per
    // independent pixel, and at least some 10 are independent.
    assert!((scatter / predicted.mean - 1.0).abs() < 0.25, "{scatter} {predicted:?}");
}
