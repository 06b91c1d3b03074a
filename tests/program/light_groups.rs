//! `--lights`, `render --light-groups` and `mix`: images of single light sources and mixtures of
//! them.

// Not a module of `common`, which an example includes as well: it starts the program.
#[path = "../common/light_mixtures.rs"]
mod light_mixtures;

use crate::common::program_output::{assert_refused, json};
use bdpm::base::math::Rgb;
use bdpm::image_io::{Image, Layer, Value, read_exr};
use light_mixtures::{assert_mixtures_state_their_error, bdpm, render, scene};
use std::path::PathBuf;

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

#[test]
fn random_mixtures_have_the_error_that_they_state() {
    assert_mixtures_state_their_error("office", &[], 3);
}
