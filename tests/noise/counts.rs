//! Counts per pixel, blocks of different counts, and the image that they make together, whose mean
//! `tests/check/counts.rs` holds against that of fixed counts.

use crate::common::Estimate;
use crate::common::automatic::*;
use bdpm::Stop;
use bdpm::adaptive::count_policy::CountPolicy;
use bdpm::adaptive::plan::Plan;
use bdpm::film::counts::{CameraCounts, Counts};
use bdpm::noise::Measure;
use bdpm::render::block;
use bdpm::render::block::CombinedImage;
use bdpm::scene::backend::{Backend, build};
use bdpm::{Renderer, Settings};

/// From 1 to 7 camera paths, in no pattern that tiles or rows have.
fn map() -> CameraCounts {
    CameraCounts::PerPixel((0..WIDTH * HEIGHT).map(|i| 1 + (i * 37 + i / 11) % 7).collect())
}

#[test]
fn a_map_of_equal_counts_gives_the_uniform_image_bit_for_bit() {
    let (scene, settings) = scene();
    let accel = build(Backend::Bvh, &scene).unwrap();
    let image = |camera_paths| {
        let mut renderer = Renderer::new(&scene, &accel, settings.clone()).unwrap();
        renderer.begin_block(Counts { light_paths: 2000, camera_paths }).unwrap();
        renderer.iterate(Measure::Off);
        renderer.iterate(Measure::Pairs);
        (renderer.film().clone(), renderer.block().statistics.noise.clone())
    };
    let equal = CameraCounts::PerPixel(vec![3; (WIDTH * HEIGHT) as usize]);
    assert_eq!(image(CameraCounts::Uniform(3)), image(equal));
}

#[test]
fn image_with_a_map_ignores_threads_and_measuring() {
    let (scene, settings) = scene();
    let accel = build(Backend::Bvh, &scene).unwrap();
    let image = |threads, measure| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut renderer = Renderer::new(&scene, &accel, settings.clone()).unwrap();
        let counts = Counts { light_paths: 2000, camera_paths: map() };
        renderer.begin_block(counts).unwrap();
        pool.install(|| (0..3).for_each(|_| drop(renderer.iterate(measure))));
        renderer.film().clone()
    };
    let production = image(1, Measure::Off);
    assert_eq!(production, image(3, Measure::Off));
    assert_eq!(production, image(2, Measure::Pairs), "extra paths stay out of the image");
}

#[test]
fn a_map_changes_the_noise_and_not_the_image() {
    let (scene, settings) = scene();
    let accel = build(Backend::Bvh, &scene).unwrap();
    let mut uniform = Renderer::new(&scene, &accel, settings.clone()).unwrap();
    let expected = Estimate::from_samples(&image_means(&mut uniform, 600, Measure::Pairs));
    let settings = Settings { seed: 2, ..settings };
    let mut mapped = Renderer::new(&scene, &accel, settings).unwrap();
    let counts = Counts { light_paths: 2000, camera_paths: map() };
    mapped.begin_block(counts.clone()).unwrap();
    let found = Estimate::from_samples(&image_means(&mut mapped, 600, Measure::Pairs));
    let error = expected.error.hypot(found.error);
    Estimate { error, ..found }.assert_is(expected.mean, 0.0);

    // Formula (1) with the other run's coefficients foretells the variance at the map.
    let coefficients = block::coefficients(uniform.blocks()).unwrap();
    let predicted = block::pooled_variance(&coefficients, &counts);
    let (sampled, error) = mapped.film().pooled_variance().unwrap();
    // Prediction and measurement have about the same error.
    let error = error * 2.0f64.sqrt();
    assert!((sampled - predicted).abs() < 4.0 * error, "{sampled} {predicted} +- {error}");
    // And measuring at the map finds the same coefficients.
    let measured = block::coefficients(mapped.blocks()).unwrap();
    let again = block::pooled_variance(&measured, &counts);
    assert!((again - predicted).abs() < 4.0 * error, "{again} {predicted} +- {error}");
    // One camera path everywhere would have another variance by far.
    let other = block::pooled_variance(&coefficients, &Counts::uniform(2000, 1));
    assert!(error < 0.06 * predicted && other > 1.5 * predicted, "{error} {other} {predicted}");
}

#[test]
fn a_plan_replays_the_combined_image_bit_for_bit() {
    let (scene, settings) = scene();
    let accel = build(Backend::Bvh, &scene).unwrap();
    let renderer = automatic(&scene, &accel, settings.clone(), 30);
    let weights = block::weights(renderer.blocks(), &[1.0; (WIDTH * HEIGHT) as usize]);
    let combined = CombinedImage::new(renderer.blocks(), weights.clone());
    let plan = Plan::of_blocks(renderer.blocks(), &weights);

    let mut again = Renderer::new(&scene, &accel, settings).unwrap();
    let mut replay = CountPolicy::Plan(plan.clone());
    for _ in 0..plan.iterations().unwrap() {
        replay.prepare(&mut again, &Stop::default(), 0.0).unwrap();
        again.iterate(Measure::Off);
    }
    let replayed = CombinedImage::new(again.blocks(), replay.weights(again.blocks(), &[]));
    assert_eq!(replayed.mean(), combined.mean());
    assert_eq!(replayed.variance_of_mean(), combined.variance_of_mean());
}

#[test]
fn a_single_iteration_of_a_block_counts_with_the_variance_of_its_weight() {
    let (scene, settings) = scene();
    let accel = build(Backend::Bvh, &scene).unwrap();
    let mut renderer = Renderer::new(&scene, &accel, settings).unwrap();
    image_means(&mut renderer, 10, Measure::Pairs);
    let (alone, _) = CombinedImage::new(renderer.blocks(), vec![1.0]).pooled_variance().unwrap();
    renderer.begin_block(Counts::uniform(2000, 6)).unwrap();
    renderer.iterate(Measure::Off);
    // An iteration of half the variance and twice the weight is worth two: 10 become 12.
    let both = CombinedImage::new(renderer.blocks(), vec![0.5, 1.0]);
    let (variance, _) = both.pooled_variance().unwrap();
    assert!((variance / alone - 10.0 / 12.0).abs() < 1e-12, "{variance} {alone}");
    let mean = both.variance_of_mean().unwrap().iter().sum::<f64>() / f64::from(WIDTH * HEIGHT);
    assert!((mean / variance - 1.0).abs() < 1e-9, "{mean} {variance}");
}
