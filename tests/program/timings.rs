//! `bdpm calibrate` and `predict --timings` as their users meet them.

use crate::common::program_output::{assert_refused, json, succeed, text};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");
const OTHER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box-classic");
const SMALL: [&str; 6] = ["--accel", "bvh", "--resolution", "16x12", "--radius", "40"];

fn bdpm(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.args(arguments).stdin(Stdio::null()).output().unwrap()
}

/// Measures the times of a tiny image with the BVH, which every build has.
fn calibrate(scene: &str, output: &Path, more: &[&str]) -> Output {
    let output = output.to_str().unwrap();
    let few = ["--output", output, "--time", "1ms"];
    bdpm(&[&["calibrate", scene], &SMALL[..], &few, more].concat())
}

/// Measures the noise of the same image.
fn analyze(output: &Path) {
    let output = output.to_str().unwrap();
    let counts = ["--light-paths", "100", "--camera-paths", "2", "--iterations", "32"];
    let done =
        bdpm(&[&["analyze", SCENE, "--output", output, "--quiet"], &SMALL[..], &counts].concat());
    succeed(&done);
}

#[test]
fn calibrate_measures_and_predict_takes_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let result = json(&calibrate(SCENE, &at("t.json"), &["--json", "--quiet", "--threads", "1"]));
    let file: Value = serde_json::from_str(&fs::read_to_string(at("t.json")).unwrap()).unwrap();
    for key in ["model", "errors", "points", "setup", "notes"] {
        assert_eq!(file[key], result[key], "{key}");
    }
    assert_eq!(result["rounds"], 2);
    // Five sizes of four phases.
    assert_eq!(file["points"].as_array().unwrap().len(), 20);
    assert_eq!((&file["setup"]["threads"], &file["model"]["pixels"]), (&1.into(), &192.0.into()));
    assert_eq!(file["notes"].as_array().unwrap().len(), 0);

    analyze(&at("noise.exr"));
    let (noise, times) = (at("noise.exr"), at("t.json"));
    let (noise, times) = (noise.to_str().unwrap(), times.to_str().unwrap());
    let predict = |times: &str, more: &[&str]| {
        let counts = ["--light-paths", "1000", "--camera-paths", "2"];
        let times = ["--timings", times, "--time", "60s"];
        bdpm(&[&["predict", noise][..], &counts, &times, more].concat())
    };
    let found = json(&predict(times, &["--json"]));
    assert_eq!(found["times"]["from"], times);
    for key in ["model", "errors", "setup"] {
        assert_eq!(found["times"][key], file[key], "{key}");
    }
    let model = |key: &str| file["model"][key].as_f64().unwrap();
    let camera_paths = 2.0 * 192.0;
    let tau = model("fixed")
        + 1000.0 * model("light_path")
        + camera_paths * (model("camera_path") + model("look_up"))
        + 1000.0 * camera_paths * model("merge_pair");
    let predicted = found["predictions"][0]["timed"]["tau"].as_f64().unwrap();
    assert!((predicted / tau - 1.0).abs() < 1e-9, "{predicted} {tau}");
    let table = predict(times, &[]);
    let table = succeed(&table);
    for part in ["t.json, for cornell-box, 16x12 pixels, 1 thread", "bvh", "merge_pair", "+-"] {
        assert!(table.contains(part), "{part} in {table}");
    }

    // Times of another scene with other settings, and of another number of pixels.
    let foreign = ["--merge-vertex", "1", "--quiet"];
    succeed(&calibrate(OTHER, &at("other.json"), &foreign));
    let other = at("other.json");
    let refused = predict(other.to_str().unwrap(), &[]);
    assert_refused(&refused, "scene is `cornell-box-classic`, not `cornell-box`", "bdpm calibrate");
    assert_refused(&refused, "; their merge-vertex is 1, not 2", "bdpm calibrate");
    assert!(!text(&refused.stderr).contains("radius"), "what agrees is not named");
    let mut bare = file["model"].clone();
    fs::write(at("bare.json"), bare.to_string()).unwrap();
    let path = at("bare.json");
    let table = predict(path.to_str().unwrap(), &[]);
    assert!(succeed(&table).contains("without uncertainty"), "{}", succeed(&table));
    bare["pixels"] = 191.into();
    fs::write(&path, bare.to_string()).unwrap();
    let refused = predict(path.to_str().unwrap(), &[]);
    assert_refused(&refused, "for 191 pixels, not 192", "bdpm calibrate");
    // A folder is Criterion's.
    let refused = predict(folder.path().to_str().unwrap(), &[]);
    assert_refused(&refused, "there are no times in this folder", "cargo bench --bench tau");
}

#[test]
fn calibrate_shows_a_table_and_refuses_what_it_ignores() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.json");
    let table = calibrate(SCENE, &path, &[]);
    assert!(text(&table.stderr).contains("measuring the times of 5 sizes: cornell-box, 16x12"));
    let table = succeed(&table);
    for part in ["phase", "light ", "camera ", "merge ", "rest ", "light_path", "Table 2", "t.json"]
    {
        assert!(table.contains(part), "{part} in {table}");
    }
    fs::remove_file(&path).unwrap();
    let quiet = calibrate(SCENE, &path, &["--quiet"]);
    assert_eq!((succeed(&quiet), text(&quiet.stderr)), ("", ""));
    fs::remove_file(&path).unwrap();

    for (more, problem, advice) in [
        (["--light-paths", "5"], "chooses the numbers of paths itself", "leave out --light-paths"),
        (["--camera-paths", "5"], "chooses the numbers of paths itself", "--camera-paths"),
        (["--merge-vertex", "0"], "merge vertex 0", "1 to 255"),
    ] {
        assert_refused(&calibrate(SCENE, &path, &more), problem, advice);
    }
    let bad = folder.path().join("t.exr");
    assert_refused(&calibrate(SCENE, &bad, &[]), "does not end in .json", "t.json");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is written");
}

#[test]
fn times_of_a_file_are_those_of_their_settings() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    succeed(&calibrate(SCENE, Path::new(&at("t.json")), &["--quiet", "--threads", "1"]));
    let more = ["--timings", &at("t.json"), "--time", "200ms", "--threads", "1"];
    let to = ["--output", &at("a.exr"), "--json", "--quiet"];
    let found = json(&bdpm(&[&["render", SCENE][..], &SMALL, &to, &more].concat()));
    assert_eq!(found["automatic"], true);
    // Nothing but counts is chosen.
    let open = found["technique"]["open"].as_object().unwrap();
    assert!(open.values().all(|open| open == false), "{found}");
}
