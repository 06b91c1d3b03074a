//! Camera paths from Sobol points: less noise, and an error that the image knows.

use crate::common::*;
use bdpm::film::aov::AovSelection;
use bdpm::film::radiance::luminance;
use bdpm::noise::Measure;
use bdpm::render::RenderConfig;
use bdpm::render::block::CombinedImage;
use bdpm::settings::{Settings, Strategy};
use bdpm::{Renderer, Scene};
use std::sync::Arc;

const SIDE: u32 = 48;
const ITERATIONS: u64 = 64;
const SEEDS: u64 = 16;

/// An image of path tracing, with the halves that tell its variance.
fn rendered(scene: &Arc<Scene>, side: u32, seed: u64, iterations: u64) -> Renderer {
    let strategy = Strategy::Path;
    let own = Settings { strategy, camera_paths: 1, seed, ..settings(side, side) };
    let aovs = AovSelection { halves: true, ..AovSelection::default() };
    let config = RenderConfig { aovs, ..RenderConfig::default() };
    let mut renderer = Renderer::new(scene, &accel(scene), own).unwrap().configure(config).unwrap();
    for _ in 0..iterations {
        renderer.iterate(Measure::Off);
    }
    renderer
}

/// Images of several seeds are independent: their spread is the true variance, which is less than
/// that of independent iterations.
#[test]
fn reported_variance_is_that_between_images() {
    let scene = &furnished_box();
    let (mut reported, mut independent) = (Vec::new(), Vec::new());
    let mut pixels = vec![Vec::new(); (SIDE * SIDE) as usize];
    for seed in 1..=SEEDS {
        let renderer = rendered(scene, SIDE, seed, ITERATIONS);
        let image = CombinedImage::new(renderer.blocks(), vec![1.0]);
        for (pixel, value) in pixels.iter_mut().zip(image.mean()) {
            pixel.push(luminance(value.as_dvec3()));
        }
        let pooled = image.pooled_variance().unwrap().0;
        reported.push(pooled);
        independent.push(pooled / image.set_factor());
    }
    let between = |own: &Vec<f64>| Estimate::from_samples(own).error.powi(2) * SEEDS as f64;
    let count = pixels.len() as f64;
    let truth = pixels.iter().map(between).sum::<f64>() / count;
    // Pixels are independent. The variance of a sample variance of `n` normal values is
    // `2 V^2/(n - 1)`.
    let squares = pixels.iter().map(|own| between(own).powi(2)).sum::<f64>() / count;
    let error = (2.0 / (SEEDS as f64 - 1.0) * squares / count).sqrt();
    let [reported, independent] = [reported, independent].map(|own| Estimate::from_samples(&own));
    println!("variance {truth:.3e} +- {error:.1e}, reported {reported:?}, else {independent:?}");
    let off = (reported.mean - truth) / reported.error.hypot(error);
    assert!(off.abs() < 4.0, "{off} standard errors");
    // Direct light of the box through the first vertex gains more than a tenth.
    assert!(independent.mean > 1.1 * truth, "{} {truth}", independent.mean);
}

/// Few pixels or iterations say nothing: the variance of independent iterations is an upper bound.
#[test]
fn small_images_report_the_variance_of_independent_iterations() {
    let factor = |side, iterations| {
        let renderer = rendered(&furnished_box(), side, 1, iterations);
        CombinedImage::new(renderer.blocks(), vec![1.0]).set_factor()
    };
    assert_eq!(factor(44, 64), 1.0);
    assert_eq!(factor(SIDE, 15), 1.0);
    assert!(factor(SIDE, 64) < 0.95);
}
