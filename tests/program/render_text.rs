//! The text of `bdpm render` for its user: what happens in order, and the result.

use super::render::{SCENE, bdpm, folder, json, succeed, text};
use std::path::Path;
use std::process::{Command, Output};

/// A short render in which settings are chosen.
fn automatic(folder: &Path, more: &[&str]) -> Command {
    let mut command = bdpm(&["render", SCENE, "--accel", "bvh", "--resolution", "16x12"]);
    command.current_dir(folder).args(more);
    command
}

fn stdout(output: &Output) -> &str {
    text(&output.stdout)
}

#[test]
fn path_tracing_reports_neither_radii_nor_guide_nor_light_paths() {
    let (folder, _) = folder();
    let options = ["--target-error", "20%", "--strategy", "path"];
    let output = succeed(automatic(folder.path(), &[&options[..], &["--verbose"]].concat()));
    let shown = stdout(&output);
    assert!(shown.contains(": path tracing without photons"), "{shown}");
    assert!(shown.contains(" camera paths per pixel in each iteration"), "{shown}");
    // Its error is known: there is no merge bias.
    assert!(shown.contains("relative error ") && shown.contains(", all of it noise"), "{shown}");
    for part in ["radius", "guide", "light path", "merge bias", "pooled RMS"] {
        assert!(!shown.contains(part), "{part}: {shown}");
    }
    let report = json(&succeed(automatic(folder.path(), &[&options[..], &["--json"]].concat())));
    let error = &report["error"];
    assert_eq!((&error["bias"], &error["total"]), (&0.0.into(), &error["noise"]));
}

#[test]
fn merging_reports_radii_light_paths_and_one_measure_of_the_error() {
    let (folder, _) = folder();
    let options = ["--target-error", "20%", "--strategy", "single", "--verbose"];
    let output = succeed(automatic(folder.path(), &options));
    let shown = stdout(&output);
    for part in
        ["merging at vertex", ", radius ", " light paths, ", "relative error ", "merge bias"]
    {
        assert!(shown.contains(part), "{part}: {shown}");
    }
    assert!(!shown.contains("pooled RMS") && !shown.contains("one light path"), "{shown}");
    // Fixed path counts have no relative error, but noise.
    let fixed = ["--light-paths", "300", "--camera-paths", "2", "--iterations", "40"];
    let output = succeed(automatic(folder.path(), &fixed));
    let shown = stdout(&output);
    assert!(shown.contains("noise: pooled RMS ") && !shown.contains("relative"), "{shown}");
}

#[test]
fn result_has_one_time_and_json_has_its_parts() {
    let (folder, _) = folder();
    let report = json(&succeed(automatic(folder.path(), &["--time", "1s", "--json"])));
    let seconds = |part: &str| report["seconds"][part].as_f64().unwrap();
    let parts = seconds("pilot") + seconds("render");
    assert!(seconds("pilot") > 0.0 && seconds("render") > 0.0, "{report}");
    assert!(parts <= seconds("total"), "{report}");
    let options = ["--time", "1s", "--objective", "pooled", "--verbose", "--no-denoise"];
    let output = succeed(automatic(folder.path(), &options));
    let shown = stdout(&output);
    let total = shown.split(" iterations in ").nth(1).unwrap().lines().next().unwrap();
    if let Some((_, promised)) = shown.split_once("promised after ") {
        let line = promised.lines().next().unwrap();
        assert!(line.ends_with(&format!(" in {total}")), "{total}: {shown}");
    }
}

#[test]
fn messages_appear_in_the_order_of_events() {
    let (folder, _) = folder();
    let output = succeed(automatic(folder.path(), &["--time", "500ms"]));
    let shown = text(&output.stderr);
    let events = ["read ", "trying techniques and merge radii", "rendering cornell-box: "];
    let places =
        events.map(|event| shown.find(event).unwrap_or_else(|| panic!("{event}: {shown}")));
    assert!(places.is_sorted(), "{shown}");
}

/// Without `--verbose` the result is what was rendered, its error, and what would help.
#[test]
fn result_has_three_lines() {
    let (folder, _) = folder();
    let output = succeed(automatic(folder.path(), &["--time", "2s", "--no-denoise"]));
    let lines: Vec<&str> = stdout(&output).lines().collect();
    let [rendered, error, outlook] = lines[..] else { panic!("{lines:?}") };
    assert!(rendered.contains(".exr and ") && rendered.contains(" iterations in "), "{rendered}");
    assert!(error.starts_with("relative error "), "{error}");
    assert!(outlook.starts_with("an error of ") && outlook.contains(" would take "), "{outlook}");
}
