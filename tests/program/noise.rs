//! `bdpm analyze` and `bdpm predict` as their users meet them.

use crate::common::program_output::{assert_refused, json, succeed, text};
use bdpm::base::math::Rgb;
use bdpm::image_io::{Image, Layer, Metadata, write_exr};
use std::fs::{self, File};
use std::io::BufReader;
use std::path::Path;
use std::process::{Command, Output, Stdio};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");

fn bdpm(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.args(arguments).stdin(Stdio::null()).output().unwrap()
}

/// Measures a tiny image with the BVH, which every build has; later options win.
fn analyze(output: &Path, more: &[&str]) -> Output {
    let output = output.to_str().unwrap();
    let mut arguments = vec!["analyze", SCENE, "--accel", "bvh", "--output", output];
    arguments.extend(["--resolution", "16x12", "--radius", "40"]);
    arguments.extend(more);
    bdpm(&arguments)
}

const QUICK: [&str; 6] = ["--light-paths", "200", "--camera-paths", "4", "--iterations", "40"];

fn png_size(path: &Path) -> (u32, u32) {
    let mut reader =
        png::Decoder::new(BufReader::new(File::open(path).unwrap())).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert!(bytes.iter().any(|&byte| byte != bytes[0]), "a picture of something");
    (info.width, info.height)
}

#[test]
fn analyze_measures_and_predict_needs_its_file_only() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("noise.exr");
    let result = analyze(&path, &[&QUICK[..], &["--json", "--region", "side-walls"]].concat());
    let result = json(&result);
    assert_eq!((&result["iterations"], &result["noise"]["pixels"]), (&40.into(), &16.into()));
    assert_eq!((&result["region"], &result["estimator"]), (&"side-walls".into(), &"pairs".into()));
    for picture in ["noise.terms.png", "noise.rms.png"] {
        let (width, height) = png_size(&folder.path().join(picture));
        assert!(width >= 512 && height >= 384, "{picture}: {width}x{height}");
    }
    let ratio = result["noise"]["pooled_rms"]["ratio"]["value"].as_f64().unwrap();
    assert!((ratio - 1.0).abs() < 0.2, "{ratio}");

    let file = path.to_str().unwrap();
    let counts = ["--light-paths", "200,5000", "--camera-paths", "1,4"];
    let predict = |more: &[&str]| bdpm(&[&["predict", file][..], &counts, more].concat());
    let found = json(&predict(&["--region", "side-walls", "--json"]));
    let predictions = found["predictions"].as_array().unwrap();
    assert_eq!(predictions.len(), 4);
    // At the measured counts, the prediction is what analyze said.
    let (here, said) = (&predictions[1]["pooled_rms"], &result["noise"]["pooled_rms"]["predicted"]);
    for key in ["value", "error"] {
        let (a, b) = (here[key].as_f64().unwrap(), said[key].as_f64().unwrap());
        assert!((a / b - 1.0).abs() < 1e-4, "{key}: {a} {b}");
    }
    let rows = text(&predict(&[]).stdout).lines().count();
    assert_eq!(rows, 2 + 4);

    assert_refused(&predict(&["--region", "ceiling"]), "no region `ceiling`", "use side-walls, or");
    assert_refused(&predict(&["--region", "0,0,2,1"]), "not in the image", "fractions");
    assert_refused(&predict(&["--region", "0,0,.01,.01"]), "no pixel center", "larger region");
}

#[test]
fn the_table_has_every_row_and_quiet_has_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("noise.exr");
    let table = analyze(&path, &[&QUICK[..], &["--estimator", "halves"]].concat());
    let table = succeed(&table).to_owned();
    for row in [
        "whole image, 192 pixels",
        "C, interaction",
        "B, camera paths",
        "F, light paths",
        "RMS by formula",
        "RMS sampled",
        "formula / sampled",
        "merge bias",
        "5 % after",
    ] {
        assert!(table.contains(row), "{row} in {table}");
    }
    let quiet = analyze(&path, &[&QUICK[..], &["--quiet"]].concat());
    assert_eq!((succeed(&quiet), text(&quiet.stderr)), ("", ""));
}

#[test]
fn impossible_measurements_are_refused_before_rendering() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("noise.exr");
    for (arguments, problem, advice) in [
        (&["--light-paths", "1"][..], "with 1 light path", "use at least 2 light paths"),
        (&["--camera-paths", "1"], "with 1 camera path", "use at least 2 camera paths"),
        (&["--iterations", "1"], "1 measured iterations", "at least 2 iterations"),
        (&["--iterations", "0"], "0 measured iterations", "at least 2 iterations"),
        (&["--region", "ceiling"], "no region `ceiling`", "use side-walls, or a rectangle"),
        (&["--region", "0,0,1"], "`0,0,1` is not a rectangle", "four numbers"),
        (&["--region", "1,0,0,1"], "not in the image", "x0 < x1"),
        (&["--resolution", "60000x60000"], "GiB", "a lower resolution"),
    ] {
        // clap takes an option once: leave the default resolution out where another is given.
        let output = path.to_str().unwrap();
        let mut all = vec!["analyze", SCENE, "--accel", "bvh", "--output", output, "--quiet"];
        all.extend(arguments);
        assert_refused(&bdpm(&all), problem, advice);
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is written");
}

#[test]
fn predict_refuses_what_it_cannot_use() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let layers = vec![Layer::rgb("", &[Rgb::ONE; 6])];
    let image = Image { width: 3, height: 2, layers, metadata: Metadata::new() };
    write_exr(at("plain.exr").as_ref(), &image).unwrap();
    let counts = ["--light-paths", "1000", "--camera-paths", "25"];
    let predict = |more: &[&str]| bdpm(&[&["predict"][..], &counts, more].concat());
    assert_refused(&predict(&[&at("plain.exr")]), "no measured noise", "`bdpm analyze` wrote");
    assert_refused(&predict(&[&at("none.exr")]), "none.exr", "check the path");
    for bad in ["1,2", "1,2,x", "1,-2,3", "1,2,NaN"] {
        let refused = predict(&["--coefficients", bad]);
        assert_refused(&refused, "is not a list of coefficients", "three numbers a,b,f");
    }
    let good = r#"{"fixed":0,"light_path":5.67e-7,"camera_path":0.24,"look_up":0.008,
                   "merge_pair":2.012e-6,"pixels":1}"#;
    let timed = |timings: &str| {
        fs::write(at("t.json"), timings).unwrap();
        let file = at("t.json");
        predict(&[
            "--coefficients",
            "3595,37.18,0.3788",
            "--json",
            "--timings",
            &file,
            "--time",
            "1000s",
        ])
    };
    for (from, to, problem, advice) in [
        ("\"look_up\":0.008", "\"look_up\":-1", "look_up is -1", "look_up as a number of seconds"),
        ("\"fixed\":0", "\"fixd\":0", "unknown field `fixd`", "keys fixed, light_path"),
        ("\"fixed\":0,", "", "missing field `fixed`", "keys fixed, light_path"),
        ("\"pixels\":1", "\"pixels\":0", "0 pixels", "number of pixels"),
        ("}", "", "not timings", "JSON object"),
    ] {
        assert_refused(&timed(&good.replace(from, to)), problem, advice);
    }
    let found = json(&timed(good));
    let best = &found["best_light_paths"][0];
    assert!((best["light_paths"]["value"].as_f64().unwrap() - 3440.0).abs() < 5.0, "{best}");
    let row = &found["predictions"][0]["timed"];
    assert!((row["tau"].as_f64().unwrap() - 6.25).abs() < 0.005, "{row}");
    assert!((row["pooled_rms"]["value"].as_f64().unwrap() - 0.101).abs() < 5e-5, "{row}");
    assert!(row["pooled_rms"]["error"].is_null(), "no uncertainty is claimed");
    // Times and timings go together.
    let alone = predict(&["--coefficients", "1,2,3", "--time", "1s"]);
    assert_eq!(alone.status.code(), Some(2));
}
