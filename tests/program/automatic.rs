//! `bdpm render` that chooses its own counts: goals, promises, plans, checkpoints.

use bdpm::image_io::{Value, read_exr, write_exr};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box-classic");

fn render(output: &Path, more: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.args(["render", SCENE, "--accel", "bvh", "--json", "--quiet", "--output"]);
    command.arg(output).args(more).stdin(Stdio::null());
    command
}

fn run(mut command: Command) -> Output {
    command.output().unwrap()
}

fn report(command: Command) -> serde_json::Value {
    let output = run(command);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn fail(command: Command, code: i32) -> String {
    let output = run(command);
    let shown = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(code), "{shown}");
    shown
}

fn folder() -> (tempfile::TempDir, impl Fn(&str) -> PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().to_owned();
    (folder, move |name| path.join(name))
}

/// All values of an image, as bits.
fn bits(path: &Path) -> Vec<u32> {
    let image = read_exr(path).unwrap();
    let channels = image.layers.iter().flat_map(|layer| &layer.channels);
    channels.flat_map(|(_, values)| values.iter().map(|v| v.to_bits())).collect()
}

fn iterations(report: &serde_json::Value) -> u64 {
    report["iterations"].as_u64().unwrap()
}

#[test]
fn target_is_reached_with_chosen_counts_and_the_plan_replays() {
    let (_folder, at) = folder();
    let (first, again) = (at("a.exr"), at("b.exr"));
    let wishes = ["--resolution", "40x30", "--target-rms", "4%"];
    let found = report(render(&first, &wishes));
    assert_eq!((&found["automatic"], &found["stopped_by"]), (&true.into(), &"target".into()));
    assert!(found["relative_rms"].as_f64().unwrap() < 0.04, "{found}");
    assert!(iterations(&found) >= 32);
    let blocks = found["blocks"].as_array().unwrap();
    let chosen = &found["technique"]["candidates"][0];
    for name in ["strategy", "merge_vertex", "direct", "camera_paths"] {
        assert_eq!(found["settings"][name], chosen[name], "{name}");
    }
    assert_eq!(blocks[0]["light_paths"], found["settings"]["light_paths"]);
    // Rounded to whole sets
    let [rounded, light_paths, set] =
        [&blocks[0]["light_paths"], &chosen["light_paths"], &found["settings"]["sobol_set"]]
            .map(|number| number.as_u64().unwrap());
    assert!(rounded.is_multiple_of(set) && rounded.abs_diff(light_paths) <= set / 2, "{found}");
    let sum: u64 = blocks.iter().map(|block| block["iterations"].as_u64().unwrap()).sum();
    assert_eq!(sum, iterations(&found));

    let plan = first.to_string_lossy().into_owned();
    let replayed = report(render(&again, &["--plan", &plan, "--threads", "1"]));
    assert_eq!(iterations(&replayed), iterations(&found));
    assert_eq!((&replayed["automatic"], &replayed["blocks"]), (&false.into(), &found["blocks"]));
    assert_eq!(bits(&first), bits(&again));

    // The settings that the plan was made for must agree.
    let shown = fail(render(&again, &["--plan", &plan, "--seed", "5"]), 1);
    assert!(shown.contains("seed is 1, not 5") && shown.contains("a.exr"), "{shown}");

    // A replay that was interrupted goes on by itself.
    let checkpoint = at("c.ckpt").to_string_lossy().into_owned();
    let begin = ["--plan", &plan, "--iterations", "5", "--checkpoint", &checkpoint];
    assert_eq!(iterations(&report(render(&again, &begin))), 5);
    let rest = report(render(&again, &["--resume", &checkpoint]));
    assert_eq!(iterations(&rest), iterations(&found));
    assert_eq!(bits(&first), bits(&again));
}

#[test]
fn a_time_is_kept_and_an_interrupted_choice_goes_on() {
    let (_folder, at) = folder();
    let checkpoint = at("c.ckpt").to_string_lossy().into_owned();
    let wishes = ["--resolution", "24x24", "--time", "3s", "--checkpoint", &checkpoint];
    let first = report(render(&at("a.exr"), &wishes));
    assert_eq!(first["stopped_by"], "time");
    let more = ["--resume", &checkpoint, "--time", "1s"];
    let second = report(render(&at("b.exr"), &more));
    assert!(second["automatic"].as_bool().unwrap() && iterations(&second) > iterations(&first));
    // The promise stays, and neither the choice nor its first iterations are repeated.
    assert!(first["technique"].is_object() && second["technique"].is_null());
    assert!(first["promise"].is_object(), "no promise was made");
    assert_eq!(second["promise"], first["promise"]);
    assert_eq!(second["settings"], first["settings"]);
    let blocks = |report: &serde_json::Value| report["blocks"].as_array().unwrap().clone();
    if blocks(&first).len() > 1 {
        assert_eq!(blocks(&second)[0]["iterations"], blocks(&first)[0]["iterations"]);
    }
    assert!(second["rms"].as_f64().unwrap() < first["rms"].as_f64().unwrap());
}

#[test]
fn explicit_choices_are_kept() {
    let (_folder, at) = folder();
    let own = ["--resolution", "24x24", "--time", "300ms", "--radius", "3", "--strategy", "mis"];
    let found = report(render(&at("a.exr"), &own));
    let settings = &found["settings"];
    assert_eq!((&settings["radius"], &settings["strategy"]), (&3.0.into(), &"mis".into()));
    let candidates = found["technique"]["candidates"].as_array().unwrap();
    assert!(candidates.iter().all(|it| it["radius"] == 3.0 && it["strategy"] == "mis"), "{found}");
    let all = [
        "--merge-vertex=1",
        "--direct=connect",
        "--caustic-radius=1",
        "--kernel=area",
        "--guide=0",
        "--sobol-set=1",
        "--splitting=1",
    ];
    // To an error, not for a time: on a busy machine a short time may not tell any noise.
    let own = ["--resolution", "24x24", "--target-error", "10%", "--radius", "3"];
    let found = report(render(&at("a.exr"), &[&own[..], &all[..]].concat()));
    let (technique, candidates) = (&found["technique"], &found["technique"]["candidates"]);
    let open = technique["open"].as_object().unwrap();
    assert!(open.values().all(|open| open == false), "nothing is left to choose: {technique}");
    assert_eq!(candidates.as_array().unwrap().len(), 1);
    // Its bias is part of the error all the same.
    assert!(candidates[0]["bias"].as_f64().unwrap() > 0.0);
    assert_eq!(found["error"]["bias"], candidates[0]["bias"]);
}

#[test]
fn target_error_is_reached() {
    let (_folder, at) = folder();
    let found = report(render(&at("a.exr"), &["--resolution", "32x32", "--target-error", "5%"]));
    assert_eq!(found["stopped_by"], "target");
    let [total, noise, bias] =
        ["total", "noise", "bias"].map(|part| found["error"][part].as_f64().unwrap());
    assert!(total <= 0.05 && (noise.hypot(bias) / total - 1.0).abs() < 1e-9, "{found}");
    // At given counts as well
    let given = ["--strategy", "path", "--light-paths", "2", "--camera-paths", "2"];
    let target = ["--resolution", "32x32", "--target-error", "10%"];
    let found = report(render(&at("c.exr"), &[&given[..], &target].concat()));
    let total = found["error"]["total"].as_f64().unwrap_or_else(|| panic!("{found}"));
    assert!(found["stopped_by"] == "target" && (0.05..=0.1).contains(&total), "{found}");
    let shown = fail(render(&at("b.exr"), &["--target-error", "0.05"]), 2);
    assert!(shown.contains("positive share such as 2%"), "{shown}");
}

#[test]
fn first_limit_reached_ends_the_render() {
    let (_folder, at) = folder();
    let fixed = ["--resolution", "16x12", "--light-paths", "500", "--camera-paths", "2"];
    let stop = |more: &[&str]| {
        let found = report(render(&at("a.exr"), &[&fixed[..], more].concat()));
        assert!(!found["automatic"].as_bool().unwrap() && found["promise"].is_null());
        (found["stopped_by"].as_str().unwrap().to_owned(), iterations(&found))
    };
    assert_eq!(stop(&["--iterations", "5", "--time", "1h"]), ("iterations".into(), 5));
    let (reason, count) = stop(&["--iterations", "100000", "--target-rms", "30%"]);
    assert_eq!(reason, "target");
    assert!((32..100_000).contains(&count));
    assert_eq!(stop(&["--target-rms", "1e-9", "--time", "200ms"]).0, "time");
}

#[test]
fn image_file_contains_its_plan() {
    let (_folder, at) = folder();
    report(render(&at("a.exr"), &["--resolution", "16x12", "--iterations", "3"]));
    let image = read_exr(&at("a.exr")).unwrap();
    let expected = r#"[{"light_paths":200000,"camera_paths":4,"iterations":3,"weight":1.0}]"#;
    assert_eq!(image.metadata["plan"], Value::Text(expected.into()));

    let mut forged = image;
    forged.metadata.insert("width".into(), Value::Number(17.0));
    write_exr(&at("forged.exr"), &forged).unwrap();
    let plan = at("forged.exr").to_string_lossy().into_owned();
    let shown = fail(render(&at("b.exr"), &["--plan", &plan]), 1);
    assert!(shown.contains("16x12 pixels, but its settings have 17x12"), "{shown}");
}

#[test]
fn invalid_options_are_refused() {
    let (_folder, at) = folder();
    for bad in ["0", "-1", "0%", "x", "nan"] {
        let shown = fail(render(&at("a.exr"), &["--target-rms", bad]), 2);
        assert!(shown.contains("positive luminance"), "{bad}: {shown}");
    }
    let picture = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/materials/worn.png");
    let shown = fail(render(&at("a.exr"), &["--plan", picture]), 1);
    assert!(shown.contains("help: "), "{shown}");
    fail(render(&at("a.exr"), &["--plan", "b.exr", "--camera-paths", "3"]), 2);
    let missing = fail(render(&at("a.exr"), &["--timings", "none.json"]), 1);
    assert!(missing.contains("none.json"), "{missing}");
}
