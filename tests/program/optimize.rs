//! `bdpm optimize` as its users meet it.

use crate::common::program_output::{assert_refused, json, succeed};
use bdpm::adaptive::plan::Plan;
use bdpm::image_io::{read_exr, write_exr};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");
const SMALL: [&str; 6] = ["--accel", "bvh", "--resolution", "16x12", "--radius", "40"];

/// The paper's coefficients and times.
const PAPER: &str = "3595,37.18,0.3788";
const PAPER_TIMES: &str = r#"{"fixed":0,"light_path":5.67e-7,"camera_path":0.24,"look_up":0.008,
                              "merge_pair":2.012e-6,"pixels":1}"#;
/// Times of the small image.
const SMALL_TIMES: &str = r#"{"fixed":1e-5,"light_path":1e-7,"camera_path":1e-7,"look_up":2e-8,
                              "merge_pair":1e-11,"pixels":192}"#;

fn bdpm(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.args(arguments).stdin(Stdio::null()).output().unwrap()
}

/// Measures the noise of a tiny image with the BVH, which every build has.
fn analyze(output: &str) {
    let counts = ["--light-paths", "200", "--camera-paths", "4", "--iterations", "64"];
    let output = ["analyze", SCENE, "--output", output, "--quiet"];
    succeed(&bdpm(&[&output[..], &SMALL, &counts].concat()));
}

/// The row of this name.
#[track_caller]
fn row<'a>(report: &'a Value, name: &str) -> &'a Value {
    let rows = report["rows"].as_array().unwrap();
    rows.iter().find(|row| row["name"] == name).unwrap_or_else(|| panic!("{name} in {report}"))
}

#[track_caller]
fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

fn write(folder: &Path, name: &str, content: &str) -> String {
    let path = folder.join(name);
    fs::write(&path, content).unwrap();
    path.to_str().unwrap().to_owned()
}

#[test]
fn optimum_of_the_paper_is_found_and_plotted() {
    let folder = tempfile::tempdir().unwrap();
    let times = write(folder.path(), "times.json", PAPER_TIMES);
    let plot = folder.path().join("plot.svg").to_str().unwrap().to_owned();
    let optimize = |more: &[&str]| {
        bdpm(&[&["optimize", "--coefficients", PAPER, "--timings", &times], more].concat())
    };
    let found = json(&optimize(&["--time", "1000s", "--plot", &plot, "--json"]));
    let best = row(&found, "best-uniform");
    assert!((3000.0..3500.0).contains(&number(&best["light_paths"])), "{best}");
    assert!((0.098..0.1).contains(&number(&best["rms_after"]["value"])), "{best}");
    assert!(best["rms_after"]["error"].is_null(), "no uncertainty is claimed");
    // At least 16 iterations fit in the time.
    assert!(number(&best["iteration_time"]) <= 1000.0 / 16.0, "{best}");
    let flat = &found["flat_range"];
    assert!(number(&flat[0]) < 2500.0 && number(&flat[1]) > 4500.0, "{flat}");
    let shortest = row(&found, "uniform");
    assert!(number(&shortest["iteration_time"]) < number(&best["iteration_time"]));
    assert_eq!(shortest["relative_time"]["value"], 1.0);
    assert!((0.99..=1.0).contains(&number(&best["relative_time"]["value"])), "{best}");
    let one_each = row(&found, "one-each");
    assert_eq!((&one_each["light_paths"], &one_each["camera_paths"]), (&1.into(), &1.0.into()));
    assert!(number(&one_each["relative_time"]["value"]) > 90.0, "{one_each}");
    let one = row(&found, "one-camera-path");
    assert!((0.99..=1.0).contains(&number(&one["relative_time"]["value"])), "{one}");

    let plot = fs::read_to_string(plot).unwrap();
    for part in
        ["<svg", "light paths per iteration, N_F", "W/(m² sr)", "N_B = 25", "minimum 0.0987"]
    {
        assert!(plot.contains(part), "{part} in {plot}");
    }

    // The RMS after a time and the time to an RMS are inverse to each other.
    let rms = number(&best["rms_after"]["value"]).to_string();
    let found = json(&optimize(&["--target-rms", &rms, "--json"]));
    let seconds = number(&row(&found, "best-uniform")["time_to_target"]["value"]);
    assert!((seconds / 1000.0 - 1.0).abs() < 0.01, "{seconds}");
    let table = optimize(&[]);
    for part in
        ["best everywhere alike", "N_B = 1 with its best N_F", "relative time", "merge_pair"]
    {
        assert!(succeed(&table).contains(part), "{part} in {}", succeed(&table));
    }
}

#[test]
fn plans_of_all_objectives_are_written_and_rendered() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (noise, plan, image) = (at("noise.exr"), at("plan.exr"), at("image.exr"));
    let times = write(folder.path(), "times.json", SMALL_TIMES);
    analyze(&noise);
    let optimize = |more: &[&str]| {
        let needed = ["optimize", &noise, "--timings", &times, "--output", &plan, "--json"];
        bdpm(&[&needed[..], more].concat())
    };
    let render = || {
        let done = bdpm(&[
            "render",
            SCENE,
            "--plan",
            &plan,
            "--output",
            &image,
            "--accel",
            "bvh",
            "--iterations",
            "3",
            "--quiet",
            "--json",
        ]);
        json(&done)["blocks"][0].clone()
    };
    for objective in ["pooled", "relative", "mean-rms", "max-rms"] {
        let found = json(&optimize(&["--time", "1s", "--per-pixel", "--objective", objective]));
        let [each, best] = ["per-pixel", "best-uniform"].map(|name| row(&found, name));
        // Means over 5 by 5 of so few pixels blur what the weights tell apart.
        let gain = number(&best["relative_time"]["value"]);
        assert!(gain > if objective == "relative" { 0.0 } else { 1.0 }, "{objective}: {best}");
        assert!(number(&each["rms_after"]["error"]) > 0.0, "{objective}: {each}");
        assert!(number(&each["iteration_time"]) <= 1.0 / 16.0, "{objective}: {each}");
        let block = render();
        for key in ["light_paths", "camera_paths", "least_camera_paths", "most_camera_paths"] {
            assert_eq!(block[key], each[key], "{objective}: {key}");
        }
        assert_eq!(block["iterations"], 3);
    }
    // Outside the region, one path is enough.
    json(&optimize(&["--per-pixel", "--region", "side-walls"]));
    let steps = Plan::read_from(&read_exr(plan.as_ref()).unwrap()).unwrap().steps;
    let camera_paths = &steps[0].counts.camera_paths;
    assert!((0..192).filter(|&pixel| camera_paths.at(pixel) == 1).count() >= 192 - 16);
    assert!(camera_paths.most() > 1);

    let found = json(&optimize(&["--target-rms", "1%"]));
    let uniform = row(&found, "uniform");
    assert!(number(&uniform["time_to_target"]["error"]) > 0.0, "{uniform}");
    assert_eq!(render()["light_paths"], uniform["light_paths"]);
    // Memory bounds the light paths.
    let found = json(&optimize(&["--max-memory", "200KiB"]));
    let most = number(&found["most_light_paths"]);
    assert!(most < number(&uniform["light_paths"]) || most < 5000.0, "{most}");
    assert!(number(&row(&found, "best-uniform")["light_paths"]) <= most);
}

#[test]
fn wrong_inputs_of_optimize_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let noise = at("noise.exr");
    analyze(&noise);
    let times = write(folder.path(), "times.json", SMALL_TIMES);
    let foreign = write(folder.path(), "foreign.json", PAPER_TIMES);
    let optimize = |more: &[&str]| bdpm(&[&["optimize"][..], more].concat());
    let measured = |more: &[&str]| optimize(&[&[&noise[..], "--timings", &times], more].concat());
    let given = |more: &[&str]| {
        optimize(&[&["--coefficients", PAPER, "--timings", &foreign][..], more].concat())
    };
    assert_refused(&optimize(&[&noise]), "how long an iteration takes", "bdpm calibrate SCENE");
    let refused = optimize(&[&noise, "--timings", &foreign]);
    assert_refused(&refused, "foreign.json: these times are for 1 pixels, not 192", "calibrate");
    assert_refused(
        &optimize(&[&at("none.exr"), "--timings", &times]),
        "none.exr",
        "check the path",
    );
    for (option, value) in [
        ("--per-pixel", None),
        ("--output", Some(at("p.exr"))),
        ("--max-memory", Some("1GB".into())),
    ] {
        let arguments: Vec<_> = [option].into_iter().chain(value.as_deref()).collect();
        let problem = format!("{option} needs more than coefficients");
        assert_refused(&given(&arguments), &problem, "`bdpm analyze` wrote");
    }
    assert_refused(&given(&["--target-rms", "1%"]), "the mean luminance is unknown", "without %");
    assert_refused(&measured(&["--region", "ceiling"]), "no region `ceiling`", "use side-walls");
    assert_refused(&measured(&["--max-memory", "1KiB"]), "1024 bytes", "allow more memory");
    assert_refused(&measured(&["--output", &at("p.png")]), "does not end in .exr", "p.exr");
    assert_refused(&measured(&["--plot", &at("p.png")]), "does not end in .svg", "p.svg");
    let refused =
        optimize(&["--coefficients", "0,0,0", "--timings", &foreign, "--plot", &at("p.svg")]);
    assert_refused(&refused, "no noise to plot", "leave out the plot");
    for wrong in [
        ["--time", "0s"],
        ["--time", "0"],
        ["--time", "soon"],
        ["--target-rms", "-1"],
        ["--max-memory", "much"],
        ["--objective", "best"],
    ] {
        assert_eq!(measured(&wrong).status.code(), Some(2), "{wrong:?}");
    }
    let both = measured(&["--time", "1s", "--target-rms", "1%"]);
    assert_eq!(both.status.code(), Some(2));

    // A file from before photons were counted, and a black image.
    let mut old = read_exr(noise.as_ref()).unwrap();
    old.metadata.remove("photons_per_light_path").unwrap();
    let luminance = old.layers.iter_mut().find(|layer| layer.name == "L").unwrap();
    luminance.channels[0].1.fill(0.0);
    write_exr(at("old.exr").as_ref(), &old).unwrap();
    let old = |more: &[&str]| {
        let path = at("old.exr");
        optimize(&[&[&path[..], "--timings", &times], more].concat())
    };
    assert_refused(&old(&["--max-memory", "1GiB"]), "how many photons", "bdpm analyze");
    assert_refused(&old(&["--target-rms", "1%"]), "the region is black", "without %");
    assert_eq!(
        row(&json(&old(&["--objective", "relative", "--json"])), "uniform")["relative_time"]["value"],
        1.0
    );
    assert!(!Path::new(&at("p.exr")).exists() && !Path::new(&at("p.svg")).exists());
}
