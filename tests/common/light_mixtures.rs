//! Random mixtures of images of single light sources, with the errors that they state.

use crate::common::program_output::json;
use bdpm::base::math::{Rgb, luminance};
use bdpm::base::rng::{Stream, StreamKey};
use bdpm::film::radiance::luminance_weights;
use bdpm::image_io::read_exr;
use bdpm::output::light_mix::LightImages;
use std::path::Path;
use std::process::{Command, Output, Stdio};

pub fn scene(name: &str) -> String {
    format!("{}/scenes/{name}", env!("CARGO_MANIFEST_DIR"))
}

pub fn bdpm(args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.args(args).stdin(Stdio::null()).output().unwrap()
}

/// Renders at fixed counts.
pub fn render(scene: &str, output: &Path, more: &[&str]) -> Output {
    let fixed = ["--accel", "bvh", "--light-paths", "1500"];
    let output = output.to_str().unwrap();
    let args = [&["render", scene, "--json", "--no-denoise", "--output", output], &fixed[..], more];
    bdpm(&args.concat())
}

/// Squared error of a mixture of these factors over the one that it states.
fn ratio(image: &LightImages, reference: &LightImages, factors: &[Rgb]) -> f64 {
    let (own, truth) = (image.mixture(factors), reference.mixture(factors));
    let luminances = |all: &[Rgb]| all.iter().map(|own| f64::from(luminance(*own))).collect();
    let [own_light, light]: [Vec<f64>; 2] =
        [luminances(&own.radiance), luminances(&truth.radiance)];
    let weights = luminance_weights(&light);
    let squares = own_light.iter().zip(&light).zip(weights);
    let sum: f64 = squares.map(|((own, truth), weight)| weight * (own - truth).powi(2)).sum();
    sum / own_light.len() as f64 / own.error.unwrap().total.powi(2)
}

/// Asserts that the true squared errors of 50 random mixtures of a scene with this number of light
/// sources agree with those stated. Mixtures of the same images have errors in common, so that the
/// mean ratio of each seed is one sample.
#[track_caller]
pub fn assert_mixtures_state_their_error(name: &str, more: &[&str], lights: usize) {
    const MIXTURES: u32 = 50;
    const SEEDS: u64 = 4;
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(name);
    let rendered = |seed: u64, iterations: &str| {
        let file = folder.path().join("a.exr");
        let seed = (100 * seed).to_string();
        let own = ["--light-groups", "--seed", &seed, "--iterations", iterations];
        let small = ["--resolution", "32x24", "--camera-paths", "2", "--strategy", "mis"];
        let all = [&own[..], &small, more];
        json(&render(&scene, &file, &all.concat()));
        LightImages::new(vec![(name.to_owned(), read_exr(&file).unwrap())]).unwrap()
    };
    let reference = rendered(99, "1600");
    assert_eq!(reference.lights.len(), lights, "{name}");
    let mean_ratio = |seed: u64| {
        let image = rendered(seed, "64");
        let mut rng = StreamKey::new(seed, Stream::Test, 0).rng(0);
        let mut factors = || (0..lights).map(|_| Rgb::splat(rng.next_1d())).collect::<Vec<_>>();
        let ratios = (0..MIXTURES).map(|_| ratio(&image, &reference, &factors()));
        ratios.sum::<f64>() / f64::from(MIXTURES)
    };
    let ratios: Vec<f64> = (1..=SEEDS).map(mean_ratio).collect();
    let mean = ratios.iter().sum::<f64>() / SEEDS as f64;
    let spread = ratios.iter().map(|own| (own - mean).powi(2)).sum::<f64>();
    let error = (spread / (SEEDS * (SEEDS - 1)) as f64).sqrt();
    // The reference has 1/25 of the variance. Where pixels are noisy, weights are those of
    // neighborhoods, which may have a lamp in them: images of 32x24 pixels state up to .16 less.
    // Errors that add up in place of their squares would state twice as much.
    assert!((mean - 1.04).abs() < 2.0 * error + 0.16, "{name}: {mean} +- {error}");
}
