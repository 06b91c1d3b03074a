//! How far the squared noise of one image lies from its expectation, against many images.

use crate::common::*;
use bdpm::Settings;
use bdpm::adaptive::stopping::{Convergence, Stop, importance};
use bdpm::film::radiance::luminance;
use bdpm::noise::Measure;
use bdpm::render::Renderer;
use bdpm::settings::{Bias, Direct, Kernel};

const IMAGES: usize = 80;
const ITERATIONS: u32 = 16;

#[test]
fn spread_of_the_squared_noise_is_that_of_many_images() {
    let scene = furnished_box();
    let settings = Settings {
        direct: Direct::PhotonMap,
        merge_vertex: 1,
        kernel: Kernel::Disc,
        bias: Bias::Reduce,
        radius: 0.06,
        caustic_radius: 0.06,
        light_paths: 1000,
        camera_paths: 1,
        ..settings(48, 48)
    };
    let accel = accel(&scene);
    let (mut images, mut spreads, mut intervals) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 0..IMAGES as u64 {
        let settings = Settings { seed, ..settings.clone() };
        let mut renderer = Renderer::new(&scene, &accel, settings).unwrap();
        for _ in 0..ITERATIONS {
            renderer.iterate(Measure::Off);
        }
        let stop = Stop::default();
        let importance = importance(renderer.blocks(), stop.objective);
        let convergence = Convergence::new(renderer.blocks(), vec![1.0], &importance);
        spreads.push(convergence.noise_spread);
        intervals.push(convergence.error_interval(&stop, 1.0).unwrap());
        let luminances = renderer.film().mean();
        images.push(luminances.iter().map(|own| luminance(own.as_dvec3())).collect::<Vec<f64>>());
    }
    // Squared distance of each image from the mean of the others, with the weights of the mean of
    // all.
    let count = IMAGES as f64;
    let pixels = images[0].len();
    let mean: Vec<f64> =
        (0..pixels).map(|p| images.iter().map(|image| image[p]).sum::<f64>() / count).collect();
    let floor = 0.01 * (mean.iter().sum::<f64>() / pixels as f64).powi(2);
    let squares: Vec<f64> = images
        .iter()
        .map(|image| {
            let own = image.iter().zip(&mean).map(|(own, mean)| {
                // The mean of the others is further away than that of all.
                (own - mean).powi(2) * (count / (count - 1.0)).powi(2) / (mean * mean + floor)
            });
            own.sum::<f64>() / pixels as f64 / (1.0 + 1.0 / (count - 1.0))
        })
        .collect();
    let average = squares.iter().sum::<f64>() / count;
    let scatter = squares.iter().map(|square| (square - average).powi(2)).sum::<f64>();
    let true_spread = (scatter / (count - 1.0)).sqrt() / average;
    let rms = |values: &[f64]| (values.iter().map(|v| v * v).sum::<f64>() / count).sqrt();
    let spread = rms(&spreads);
    // The standard deviation of 80 values is known to 8 %. Squares of 6 pixels miss some
    // correlation.
    assert!((spread / true_spread - 1.0).abs() < 0.3, "{spread}, not {true_spread}");
    // Independent pixels of equal weight would have the spread sqrt(2/pixels) of a mean of squares.
    // A spread of 80 images is known to 8 %, so that 1.4 times it is five standard errors above.
    assert!(true_spread > 1.4 * (2.0 / pixels as f64).sqrt(), "{true_spread}");
    let covered = intervals
        .iter()
        .zip(&squares)
        .filter(|(range, square)| (range.low..=range.high).contains(&square.sqrt()));
    assert!(covered.count() as f64 > 0.85 * count);
}
