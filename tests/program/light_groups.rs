//! `--lights`, `render --light-groups` and `mix`: images of single light sources and mixtures of
//! them.

use crate::common::program_output::{assert_refused, json};
use bdpm::base::math::{Rgb, luminance};
use bdpm::base::rng::{Stream, StreamKey};
use bdpm::film::radiance::luminance_weights;
use bdpm::image_io::{Image, Layer, Value, read_exr};
use bdpm::output::light_mix::LightImages;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

fn scene(name: &str) -> String {
    format!("{}/scenes/{name}", env!("CARGO_MANIFEST_DIR"))
}

fn bdpm(args: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.args(args).stdin(Stdio::null()).output().unwrap()
}

/// Renders at fixed counts.
fn render(scene: &str, output: &Path, more: &[&str]) -> Output {
    let fixed = ["--accel", "bvh", "--light-paths", "1500"];
    let output = output.to_str().unwrap();
    let args = [&["render", scene, "--json", "--no-denoise", "--output", output], &fixed[..], more];
    bdpm(&args.concat())
}

fn pixels(image: &Image, layer: &str) -> Vec<Rgb> {
    image.layer(layer).and_then(Layer::to_rgb).unwrap()
}

fn at(folder: &tempfile::TempDir, name: &str) -> PathBuf {
    folder.path().join(name)
}

#[test]
fn layers_of_light_groups_add_up_and_can_be_mixed_again() {
    let folder = tempfile::tempdir().unwrap();
    let (file, dimmed) = (at(&folder, "a.exr"), at(&folder, "b.exr"));
    let iterations = ["--iterations", "6", "--camera-paths", "2", "--resolution", "48x36"];
    let groups = "--light-groups=window=*left,rest=panel-middle+*right";
    let office = scene("office");
    let report = json(&render(&office, &file, &[&[groups][..], &iterations].concat()));
    assert_eq!(report["lights"][0]["name"], "window");
    assert!(report["error"]["total"].as_f64().unwrap() > 0.0, "{report}");
    let image = read_exr(&file).unwrap();
    assert_eq!(image.metadata["lights"], Value::Text("window, rest".into()));
    let [whole, window, rest] =
        ["", "light.window", "light.rest"].map(|layer| pixels(&image, layer));
    for ((whole, window), rest) in whole.iter().zip(&window).zip(&rest) {
        assert!((*whole - (*window + *rest)).abs().max_element() <= 1e-6 * whole.max_element());
    }
    assert!(image.layer("albedo").is_some(), "layers that do not depend on lights are kept");
    // The group is the image of its light sources alone.
    let alone = at(&folder, "c.exr");
    let lights = ["--lights", "panel-middle,panel-right", "--seed", "2"];
    json(&render(&office, &alone, &[&lights[..], &iterations].concat()));
    let alone = read_exr(&alone).unwrap();
    assert_eq!(pixels(&alone, ""), rest);
    assert_eq!(alone.metadata["lights"], Value::Text("panel-middle, panel-right".into()));

    let [from, to] = [&file, &dimmed].map(|path| path.to_str().unwrap());
    json(&bdpm(&["mix", from, "--set", "win*=0.25", "--json", "--output", to]));
    let mixed = read_exr(&dimmed).unwrap();
    let expected = window.iter().zip(&rest).map(|(window, rest)| 0.25 * *window + *rest);
    for (own, expected) in pixels(&mixed, "").iter().zip(expected) {
        assert!((*own - expected).abs().max_element() <= 1e-6 * expected.max_element());
    }
    assert!(dimmed.with_extension("png").exists());
    let unknown = bdpm(&["mix", from, "--set", "lamp=1", "--output", to]);
    assert_refused(&unknown, "no image has the light `lamp`", "rest, window");
}

#[test]
fn lights_that_are_not_there_or_in_no_group_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let (file, office) = (at(&folder, "a.exr"), scene("office"));
    let unknown = render(&office, &file, &["--lights", "lamp", "--iterations", "1"]);
    assert_refused(&unknown, "no light source `lamp`", "panel-left, panel-middle, panel-right");
    let groups = |groups: &str| {
        render(&office, &file, &[&format!("--light-groups={groups}"), "--iterations", "1"])
    };
    assert_refused(&groups("a=panel-left"), "`panel-middle` is in no group", "rest=*");
    assert_refused(&groups("a=*,b=*left"), "`panel-left` is in several groups", "one group");
    assert_refused(&groups("a=*,b=sun"), "group `b` has no light source", "bdpm info");
    assert!(!file.exists());
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

/// True squared errors of 50 random mixtures agree with those stated. Mixtures of the same images
/// have errors in common, so that the mean ratio of each seed is one sample.
#[test]
fn random_mixtures_have_the_error_that_they_state() {
    const MIXTURES: u32 = 50;
    const SEEDS: u64 = 4;
    for (name, more, lights) in [
        ("office", &[][..], 3),
        ("cornell-box-classic", &["--environment", "0.1"], 2),
        ("materials", &["--environment", "0.3"], 4),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let scene = scene(name);
        let rendered = |seed: u64, iterations: &str| {
            let file = at(&folder, "a.exr");
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
        // neighborhoods, which may have a lamp in them: images of 32x24 pixels state up to .16
        // less. Errors that add up in place of their squares would state twice as much.
        assert!((mean - 1.04).abs() < 2.0 * error + 0.16, "{name}: {mean} +- {error}");
    }
}
