//! `bdpm render --time` where the time is too short for all pixels.

use crate::common::program_output::{assert_refused, json};
use bdpm::base::math::luminance;
use bdpm::image_io::{Value, read_exr};
use std::path::Path;
use std::process::{Command, Output, Stdio};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box-classic");

/// Times that are over before the first iteration.
const SHORT: [&str; 4] = ["--resolution", "100x60", "--time", "20ms"];

fn render(output: &Path, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.args(["render", SCENE, "--accel", "bvh", "--json", "--output"]).arg(output);
    command.args(more).stdin(Stdio::null()).output().unwrap()
}

#[test]
fn fewer_pixels_are_rendered_and_enlarged() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.exr");
    let output = render(&file, &SHORT);
    let report = json(&output);
    assert_eq!(report["enlarged_from"], serde_json::json!([13, 8]));
    let shown = String::from_utf8_lossy(&output.stderr);
    assert!(shown.contains("100x60 pixels: 13x8 are rendered"), "{shown}");
    let image = read_exr(&file).unwrap();
    assert_eq!((image.width, image.height), (100, 60));
    assert_eq!(image.metadata["enlarged from"], Value::Text("13x8".into()));
    let [layer] = &image.layers[..] else { panic!("{} layers", image.layers.len()) };
    assert_eq!(layer.name, "");
    // It shows what was rendered. Where lamps are, cubics of logarithms differ from means.
    let pixels = layer.to_rgb().unwrap();
    let mean = pixels.iter().map(|pixel| luminance(*pixel)).sum::<f32>() / pixels.len() as f32;
    let rendered = report["mean_luminance"].as_f64().unwrap() as f32;
    assert!((mean / rendered - 1.0).abs() < 0.25, "{mean} {rendered}");
    let png = image::open(file.with_extension("png")).unwrap();
    assert_eq!((png.width(), png.height()), (100, 60));

    let path = file.to_str().unwrap();
    let again = render(&folder.path().join("b.exr"), &["--plan", path]);
    assert_refused(&again, "enlarged from 13x8 pixels, and has no plan", "more time");
}

#[test]
fn who_asks_for_more_than_a_picture_gets_every_pixel() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (checkpoint, noise) = (at("a.ckpt"), at("noise.exr"));
    for more in [
        &["--layers", "albedo"][..],
        &["--photometric"],
        &["--checkpoint", &checkpoint],
        &["--noise", &noise],
        &["--strategy", "mis"],
        &["--target-error", "1%"],
        &["--light-paths", "100"],
    ] {
        let file = folder.path().join("a.exr");
        let report = json(&render(&file, &[&SHORT[..], more].concat()));
        assert!(report["enlarged_from"].is_null(), "{more:?}");
        let image = read_exr(&file).unwrap();
        assert_eq!((image.width, image.height), (100, 60), "{more:?}");
        assert!(image.metadata.contains_key("plan"), "{more:?}");
    }
}
