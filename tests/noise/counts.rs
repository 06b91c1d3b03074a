//! Counts per pixel, blocks of different counts, and the image that they make together.

use crate::common::Estimate;
use bdpm::image::counts::{CameraCounts, Counts};
use bdpm::image::film::luminance;
use bdpm::import::load;
use bdpm::noise::Measure;
use bdpm::render::block;
use bdpm::render::block::Combined;
use bdpm::scene::backend::{Backend, build};
use bdpm::steer::autopilot::Autopilot;
use bdpm::steer::goal::Goal;
use bdpm::steer::plan::Plan;
use bdpm::steer::{Replay, Steer};
use bdpm::timing::TimeModel;
use bdpm::{Renderer, Scene, Settings};
use std::path::Path;
use std::time::Duration;

const WIDTH: u32 = 24;
const HEIGHT: u32 = 20;

fn scene() -> (Scene, Settings) {
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

/// From 1 to 7 camera paths, in no pattern that tiles or rows have.
fn map() -> CameraCounts {
    CameraCounts::PerPixel((0..WIDTH * HEIGHT).map(|i| 1 + (i * 37 + i / 11) % 7).collect())
}

/// Mean luminance of each iteration's image.
fn image_means(renderer: &mut Renderer, iterations: usize, measure: Measure) -> Vec<f64> {
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

#[test]
fn a_map_of_equal_counts_gives_the_uniform_image_bit_for_bit() {
    let (scene, settings) = scene();
    let accel = build(Backend::Bvh, &scene).unwrap();
    let image = |camera_paths| {
        let mut renderer = Renderer::new(&scene, &*accel, settings.clone()).unwrap();
        renderer.begin_block(Counts { light_paths: 2000, camera_paths }).unwrap();
        renderer.iterate(Measure::Off);
        renderer.iterate(Measure::Pairs);
        (renderer.film().clone(), renderer.noise().cloned())
    };
    let equal = CameraCounts::PerPixel(vec![3; (WIDTH * HEIGHT) as usize]);
    assert_eq!(image(CameraCounts::Uniform(3)), image(equal));
}

#[test]
fn threads_and_measuring_do_not_change_an_image_with_a_map() {
    let (scene, settings) = scene();
    let accel = build(Backend::Bvh, &scene).unwrap();
    let image = |threads, measure| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut renderer = Renderer::new(&scene, &*accel, settings.clone()).unwrap();
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
    let mut uniform = Renderer::new(&scene, &*accel, settings.clone()).unwrap();
    let expected = Estimate::from_samples(&image_means(&mut uniform, 600, Measure::Pairs));
    let settings = Settings { seed: 2, ..settings };
    let mut mapped = Renderer::new(&scene, &*accel, settings).unwrap();
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

/// Renders with automatic counts as if an iteration took a second for each 10 camera paths per
/// pixel, so that the choice is the same on every machine.
fn automatic<'a>(
    scene: &'a Scene,
    accel: &'a dyn bdpm::accel::Intersect,
    settings: Settings,
    seconds: u64,
) -> Renderer<'a> {
    let times = TimeModel {
        fixed: 0.05,
        light_path: 1e-5,
        camera_path: 0.1 / f64::from(WIDTH * HEIGHT),
        look_up: 0.0,
        merge_pair: 1e-8,
        pixels: f64::from(WIDTH * HEIGHT),
    };
    let time = Some(Duration::from_secs(seconds));
    let goal = Goal { time, ..Goal::default() };
    let mut pilot = Autopilot::new(goal, 1, None).with_times(times);
    let mut renderer = Renderer::new(scene, accel, settings).unwrap();
    let mut elapsed = 0.0;
    while elapsed < seconds as f64 {
        let measure = pilot.steer(&mut renderer, elapsed).unwrap();
        renderer.iterate(measure);
        let counts = &renderer.block().counts;
        elapsed += times.iteration(f64::from(counts.light_paths), counts.camera_paths.mean());
    }
    renderer
}

#[test]
fn the_combined_image_of_automatic_counts_is_unbiased() {
    let (scene, settings) = scene();
    let accel = build(Backend::Bvh, &scene).unwrap();
    let mut fixed = Renderer::new(&scene, &*accel, settings.clone()).unwrap();
    let reference = Estimate::from_samples(&image_means(&mut fixed, 3000, Measure::Off));
    let reference_pixels = fixed.film().mean();
    let reference_variance = fixed.film().variance_of_mean().unwrap();

    let (mut means, mut predicted) = (Vec::new(), Vec::new());
    let mut pixels: Vec<Vec<f64>> = vec![Vec::new(); (WIDTH * HEIGHT) as usize];
    for seed in 100..148 {
        let settings = Settings { seed, ..settings.clone() };
        let renderer = automatic(&scene, &*accel, settings, 60);
        let blocks = renderer.blocks();
        assert!(blocks.len() >= 3, "a pilot of two blocks, and what was chosen");
        let combined = Combined::new(blocks, block::weights(blocks));
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
    // independent pixel, of which there are at least some 10.
    assert!((scatter / predicted.mean - 1.0).abs() < 0.25, "{scatter} {predicted:?}");
}

#[test]
fn a_plan_replays_the_combined_image_bit_for_bit() {
    let (scene, settings) = scene();
    let accel = build(Backend::Bvh, &scene).unwrap();
    let renderer = automatic(&scene, &*accel, settings.clone(), 30);
    let weights = block::weights(renderer.blocks());
    let combined = Combined::new(renderer.blocks(), weights.clone());
    let plan = Plan::of_blocks(renderer.blocks(), &weights);

    let mut again = Renderer::new(&scene, &*accel, settings).unwrap();
    let mut replay = Replay::new(plan.clone());
    for _ in 0..plan.iterations().unwrap() {
        replay.steer(&mut again, 0.0).unwrap();
        again.iterate(Measure::Off);
    }
    let replayed = Combined::new(again.blocks(), replay.weights(again.blocks()));
    assert_eq!(replayed.mean(), combined.mean());
    assert_eq!(replayed.variance_of_mean(), combined.variance_of_mean());
}

#[test]
fn a_single_iteration_of_a_block_counts_with_the_variance_of_its_weight() {
    let (scene, settings) = scene();
    let accel = build(Backend::Bvh, &scene).unwrap();
    let mut renderer = Renderer::new(&scene, &*accel, settings).unwrap();
    image_means(&mut renderer, 10, Measure::Pairs);
    let (alone, _) = Combined::new(renderer.blocks(), vec![1.0]).pooled_variance().unwrap();
    renderer.begin_block(Counts::uniform(2000, 6)).unwrap();
    renderer.iterate(Measure::Off);
    // An iteration of half the variance and twice the weight is worth two: 10 become 12.
    let both = Combined::new(renderer.blocks(), vec![0.5, 1.0]);
    let (variance, _) = both.pooled_variance().unwrap();
    assert!((variance / alone - 10.0 / 12.0).abs() < 1e-12, "{variance} {alone}");
    let mean = both.variance_of_mean().unwrap().iter().sum::<f64>() / f64::from(WIDTH * HEIGHT);
    assert!((mean / variance - 1.0).abs() < 1e-9, "{mean} {variance}");
}
