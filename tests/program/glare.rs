//! `bdpm glare`.

use crate::common::program_output::{assert_refused, json, succeed, text};
use bdpm::base::math::Rgb;
use bdpm::image_io::{Image, Layer, Metadata, read_exr, write_exr};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");

fn bdpm(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.args(arguments).stdin(Stdio::null()).output().unwrap()
}

fn glare(image: &Path, more: &[&str]) -> Output {
    bdpm(&[&["glare", image.to_str().unwrap(), "--json"], more].concat())
}

/// Renders a small image with the camera of a scene file that holds nothing else.
fn rendered(folder: &Path, name: &str, camera: &str, more: &[&str]) -> PathBuf {
    let (path, from) = (folder.join(name), folder.join("camera.toml"));
    let position = "position = [278, 273, 100]\ntarget = [278, 273, 400]\n";
    std::fs::write(&from, format!("[camera]\n{camera}\n{position}")).unwrap();
    let (path_text, from) = (path.to_str().unwrap(), from.to_str().unwrap());
    let few = ["--iterations", "2", "--light-paths", "1000", "--camera-paths", "1", "--quiet"];
    let own = ["render", SCENE, "--accel", "bvh", "--resolution", "32x32"];
    let files = ["--camera-from", from, "--output", path_text];
    succeed(&bdpm(&[&own[..], &few, &files, more].concat()));
    path
}

#[test]
fn pixels_that_are_not_finite_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let write = |bad: &[(usize, f32)]| {
        let mut pixels = vec![Rgb::ONE; 64];
        bad.iter().for_each(|(index, value)| pixels[*index].y = *value);
        let layers = vec![Layer::rgb("", &pixels)];
        let image = Image { width: 8, height: 8, layers, metadata: Metadata::new() };
        write_exr(&path, &image).unwrap();
    };
    write(&[]);
    succeed(&glare(&path, &[]));
    write(&[(19, f32::NAN)]);
    assert_refused(&glare(&path, &[]), "a.exr: the pixel (3, 2) is not finite", "render");
    write(&[(19, f32::INFINITY), (45, f32::NAN)]);
    let problem = "a.exr: 2 pixels are not finite; the first is (3, 2)";
    assert_refused(&glare(&path, &[]), problem, "render");
}

#[test]
fn pictures_of_sources_are_of_images_and_replace_no_input() {
    let folder = tempfile::tempdir().unwrap();
    let camera = "type = \"fisheye\"\nprojection = \"equisolid\"\nfov_deg = 150";
    let path = rendered(folder.path(), "fisheye.exr", camera, &[]);
    let picture = folder.path().join("sources.png");
    let out = picture.to_str().unwrap();
    let with = json(&glare(&path, &["--picture", out]));
    assert_eq!(with, json(&glare(&path, &[])), "the rating is the same");
    let (width, height) = image::image_dimensions(&picture).unwrap();
    assert!(width >= 32 && height > 32, "the image, and lines below it");
    let refused = bdpm(&["glare", SCENE, "--picture", out]);
    assert_refused(&refused, "a scene is rated without an image", "fisheye");
    assert_refused(&glare(&path, &["--picture", "a.jpg"]), "a.jpg", ".png");
}

#[test]
fn lens_is_that_of_the_file_and_contradictions_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let camera = "type = \"fisheye\"\nprojection = \"equisolid\"\nfov_deg = 150";
    let path = rendered(folder.path(), "fisheye.exr", camera, &[]);
    let own = json(&glare(&path, &[]));
    let given = ["--projection", "equisolid", "--fov", "150"];
    let same = json(&glare(&path, &given));
    assert_eq!(own, same);
    let refused = glare(&path, &["--projection", "equidistant"]);
    assert_refused(&refused, "the projection equisolid, not equidistant", "--projection");
    let refused = glare(&path, &["--fov", "180"]);
    assert_refused(&refused, "spans 150 degrees, not 180", "--fov");

    // Files of other programs do not state their camera.
    let mut image = read_exr(&path).unwrap();
    image.metadata = Metadata::new();
    write_exr(&path, &image).unwrap();
    assert_eq!(json(&glare(&path, &given))["dgp"], own["dgp"]);
    let other = json(&glare(&path, &[]));
    assert_ne!(other["vertical_illuminance"], own["vertical_illuminance"]);
}

/// Standard errors of pixels that share neither photons nor a cache give uncertainties of the
/// ratings.
#[test]
fn path_traced_images_have_uncertainties_and_others_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let camera = "type = \"fisheye\"\nfov_deg = 180";
    let photons = json(&glare(&rendered(folder.path(), "a.exr", camera, &[]), &[]));
    assert!(photons["expanded"].is_null(), "{photons}");
    assert!(photons["without_uncertainty"].as_str().unwrap().contains("photons"), "{photons}");
    let cached = rendered(folder.path(), "c.exr", camera, &["--strategy", "gather"]);
    let cached = json(&glare(&cached, &[]));
    assert!(cached["expanded"].is_null(), "{cached}");
    assert!(cached["without_uncertainty"].as_str().unwrap().contains("cache"), "{cached}");
    let path = rendered(folder.path(), "b.exr", camera, &["--strategy", "path"]);
    let traced = json(&glare(&path, &[]));
    assert!(traced["without_uncertainty"].is_null(), "{traced}");
    let expanded = traced["expanded"]["vertical_illuminance"].as_f64().unwrap();
    let illuminance = traced["vertical_illuminance"].as_f64().unwrap();
    assert!(expanded > 0.0 && expanded < illuminance, "{expanded} {illuminance}");
    let output = bdpm(&["glare", path.to_str().unwrap()]);
    let shown = succeed(&output);
    assert!(shown.contains("+-") && !shown.contains("without"), "{shown}");
}

/// Images of one view with different seeds have uncertainties although their pixels share photons.
#[test]
fn repeated_images_have_the_uncertainty_of_their_spread() {
    let folder = tempfile::tempdir().unwrap();
    let camera = "type = \"fisheye\"\nfov_deg = 180";
    let seeded =
        |seed: &str| rendered(folder.path(), &format!("{seed}.exr"), camera, &["--seed", seed]);
    let images = ["1", "2", "3"].map(seeded);
    let [first, second, third] = images.each_ref().map(|path| path.to_str().unwrap());
    let own = json(&glare(&images[0], &[second, third]));
    assert!(own["without_uncertainty"].is_null(), "{own}");
    assert_eq!(own["images"], serde_json::json!([first, second, third]));
    assert!(own["notes"][0].as_str().unwrap().contains("merge bias"), "{own}");
    let number = |own: &serde_json::Value| own["vertical_illuminance"].as_f64().unwrap();
    // The mean of the three, with Student's quantile of 95 % for two degrees of freedom
    let alone = images.each_ref().map(|path| number(&json(&glare(path, &[]))));
    let mean = alone.iter().sum::<f64>() / 3.0;
    let squares: f64 = alone.iter().map(|own| (own - mean).powi(2)).sum();
    let expanded = 4.303 * (squares / 6.0).sqrt();
    assert!((number(&own) / mean - 1.0).abs() < 1e-5, "{own} {mean}");
    assert!((number(&own["expanded"]) / expanded - 1.0).abs() < 1e-3, "{own} {expanded}");

    let refused = |others: &[&str], problem: &str, advice: &str| {
        assert_refused(&glare(&images[0], others), problem, advice);
    };
    refused(&[second, second], "2.exr: this image has the seed", "--seed");
    refused(&[first], "1.exr: this image has the seed", "--seed");
    let other = "type = \"fisheye\"\nfov_deg = 150";
    let other = rendered(folder.path(), "other.exr", other, &["--seed", "9"]);
    refused(&[other.to_str().unwrap()], "another size or lens", "one view");
    let scene = glare(Path::new(SCENE), &[first]);
    assert_refused(&scene, "one scene is rated at a time", "images of one view");
}

#[test]
fn images_of_other_cameras_and_windows_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = rendered(folder.path(), "a.exr", "type = \"pinhole\"\nfov_y_deg = 60", &[]);
    let refused = glare(&path, &[]);
    assert_refused(&refused, "no fisheye image: its camera is of type \"pinhole\"", "fisheye");
    assert!(text(&refused.stderr).contains("a.exr"), "{}", text(&refused.stderr));
    let camera = "type = \"fisheye\"\nprojection = \"equidistant\"\nfov_deg = 180";
    let path = rendered(folder.path(), "b.exr", camera, &["--crop", "0,0,16,16"]);
    assert_refused(&glare(&path, &[]), "only a window of a fisheye image", "--crop");
}
