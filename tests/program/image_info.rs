//! `bdpm info` of an image.

use crate::common::program_output::{assert_refused, json, succeed};
use bdpm::base::math::Rgb;
use bdpm::image_io::{Image, Layer, Metadata, write_exr};
use std::path::Path;
use std::process::{Command, Output, Stdio};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");

fn bdpm(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.args(arguments).current_dir(folder).stdin(Stdio::null()).output().unwrap()
}

/// Renders a tiny image and returns the report of the render.
fn rendered(folder: &Path, name: &str, more: &[&str]) -> serde_json::Value {
    let own = ["render", SCENE, "--accel", "bvh", "--output", name, "--json", "--quiet"];
    json(&bdpm(folder, &[&own[..], more].concat()))
}

#[test]
fn automatic_image_states_its_error_audit_and_plan() {
    let folder = tempfile::tempdir().unwrap();
    let report = rendered(folder.path(), "a.exr", &["--time", "2s", "--resolution", "24x24"]);
    let info = json(&bdpm(folder.path(), &["info", "a.exr", "--json"]));
    let own = &info["bdpm"];
    assert_eq!(info["size"], serde_json::json!([24, 24]));
    for key in ["scene", "fingerprint", "version"] {
        assert_eq!(own[key], report[key], "{key}: {info}");
    }
    assert_eq!(own["iterations"], report["iterations"].as_f64().unwrap());
    assert_eq!(own["error"], report["error"], "{info}");
    assert!(own["error"]["interval"]["high"].as_f64().unwrap() > 0.0, "{info}");
    let rms = own["rms"].as_f64().unwrap() / report["rms"].as_f64().unwrap();
    // It is recorded in single precision.
    assert!((rms - 1.0).abs() < 1e-6, "{info}");
    assert_eq!(own["audit"].is_null(), report["audit"].is_null(), "{info}");
    if !own["audit"].is_null() {
        assert_eq!(own["audit"]["verdict"], report["audit"]["verdict"]);
    }
    for key in ["strategy", "radius", "kernel", "seed", "light_paths"] {
        let text = |value: &serde_json::Value| value.to_string().replace('"', "");
        assert_eq!(text(&own["settings"][key]), text(&report["settings"][key]), "{key}");
    }
    let steps = own["plan"].as_array().unwrap();
    let iterations = steps.iter().map(|step| step["iterations"].as_u64().unwrap());
    assert_eq!(iterations.sum::<u64>(), report["iterations"].as_u64().unwrap());
    assert!(info["layers"].as_array().unwrap().iter().any(|layer| layer["name"] == "rms"));

    let shown = bdpm(folder.path(), &["info", "a.exr"]);
    let shown = succeed(&shown);
    for part in ["24x24 pixels", "cornell-box (fingerprint", "counts", "(90 %: ", "strategy"] {
        assert!(shown.contains(part), "{part}: {shown}");
    }
}

#[test]
fn fixed_counts_state_noise_and_windows_their_place() {
    let folder = tempfile::tempdir().unwrap();
    let counts = ["--iterations", "2", "--light-paths", "300", "--camera-paths", "2"];
    let crop = ["--resolution", "24x18", "--crop", "5,4,10,8"];
    rendered(folder.path(), "a.exr", &[&counts[..], &crop].concat());
    let shown = bdpm(folder.path(), &["info", "a.exr"]);
    let shown = succeed(&shown);
    for part in [
        "10x8 pixels, at 5,4 of 24x18",
        "relative error    not stated",
        "pooled RMS",
        "300 light paths, 2 camera paths per pixel, in 2 iterations",
    ] {
        assert!(shown.contains(part), "{part}: {shown}");
    }
}

#[test]
fn images_of_other_programs_have_resolution_and_channels() {
    let folder = tempfile::tempdir().unwrap();
    let layers = vec![Layer::rgb("", &[Rgb::ONE; 6])];
    let image = Image { width: 3, height: 2, layers, metadata: Metadata::new() };
    write_exr(&folder.path().join("a.exr"), &image).unwrap();
    let info = json(&bdpm(folder.path(), &["info", "a.exr", "--json"]));
    assert!(info["bdpm"].is_null(), "{info}");
    assert_eq!(info["layers"][0]["channels"], serde_json::json!(["B", "G", "R"]));
    let shown = bdpm(folder.path(), &["info", "a.exr"]);
    let shown = succeed(&shown);
    assert!(shown.contains("3x2 pixels") && shown.contains("neither settings nor"), "{shown}");
}

#[test]
fn options_of_scenes_and_broken_files_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("a.exr"), "text").unwrap();
    for more in
        [&["--radius", "1"][..], &["--look-at", "0,0,0,1,0,0"], &["--strict"], &["--fov", "9"]]
    {
        let refused = bdpm(folder.path(), &[&["info", "a.exr"], more].concat());
        assert_refused(&refused, "a.exr: this is an image", "leave out the other options");
    }
    assert_refused(&bdpm(folder.path(), &["info", "a.exr"]), "a.exr: this is no EXR image", ".exr");
    assert_refused(&bdpm(folder.path(), &["info", "none.exr"]), "none.exr", "check the path");
}

#[test]
fn image_of_a_dispersive_scene_says_that_negative_values_are_meant() {
    let folder = tempfile::tempdir().unwrap();
    let floor = "v -9 0 -9\nv 9 0 -9\nv 9 0 9\nv -9 0 9\nf 4 3 2 1\n";
    std::fs::write(folder.path().join("floor.obj"), floor).unwrap();
    let scene = |material: &str| {
        format!(
            "[camera]\nposition = [0, 5, 5]\ntarget = [0, 0, 0]\nfov_x_deg = 40\n\
             [[mesh]]\nfile = 'floor.obj'\nmaterial = 'm'\n[materials.m]\n{material}\n\
             [environment]\nradiance = 1\n"
        )
    };
    let states = |name: &str, material: &str| {
        std::fs::write(folder.path().join(name), scene(material)).unwrap();
        let own = ["render", name, "--accel", "bvh", "--output", "a.exr", "--quiet"];
        let more = ["--resolution", "8x8", "--iterations", "1", "--light-paths", "100"];
        succeed(&bdpm(folder.path(), &[&own[..], &more, &["--camera-paths", "1"]].concat()));
        let image = bdpm::image_io::read_exr(&folder.path().join("a.exr")).unwrap();
        image.metadata.contains_key("negative values")
    };
    assert!(states("glass.toml", "type = 'dielectric'\nior = 'N-BK7'"));
    assert!(!states("plain.toml", "albedo = 0.5"));
}
