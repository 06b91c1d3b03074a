//! `bdpm measure` in the dark, and with hardly any time.

use crate::common::program_output::{json, succeed};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

const OFFICE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/office");

/// Counts that a measurement of one millisecond has, whatever the machine.
fn counts(camera_paths: &str) -> [&str; 8] {
    let fixed = ["--time", "1ms", "--strategy", "path", "--light-paths", "1000"];
    let [a, b, c, d, e, f] = fixed;
    [a, b, c, d, e, f, "--camera-paths", camera_paths]
}

fn measure(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.current_dir(folder).arg("measure").args(arguments);
    command.args(["--quiet", "--accel", "bvh"]).stdin(Stdio::null()).output().unwrap()
}

fn square(height: f32, half: f32) -> String {
    let corner = |x: f32, z: f32| format!("v {} {height} {}\n", x * half, z * half);
    let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    corners.concat() + "f 1 2 3 4\n"
}

const CAMERA: &str = "[camera]\nposition = [0, 5, 5]\ntarget = [0, 0, 0]\nfov_y_deg = 40\n";

/// A black ground under a spot, and a grid of which the corners are outside of its cone.
fn write_spot(folder: &Path) {
    fs::write(folder.join("ground.obj"), square(0.0, 300.0)).unwrap();
    let text = format!(
        "{CAMERA}[[mesh]]\nfile = \"ground.obj\"\nmaterial = \"k\"\n[materials.k]\nalbedo = \
         0\n[[light]]\ntype = \"spot\"\nposition = [0, 2, 0]\ndirection = [0, -1, 0]\ncandela = \
         1000\nouter_deg = 30\n[[meter]]\nname = \"grid\"\ncorner = [-2, 0, -2]\nedges = [[4, 0, \
         0], [0, 0, 4]]\nnormal = [0, 1, 0]\ncolumns = 8\nrows = 8\n"
    );
    fs::write(folder.join("spot.toml"), text).unwrap();
}

/// A lamp over a gray cover: a meter between them is lit, and one below the cover is dark, which
/// only many paths show.
fn write_cover(folder: &Path) {
    fs::write(folder.join("lamp.obj"), square(3.0, 0.5)).unwrap();
    fs::write(folder.join("cover.obj"), square(2.0, 50.0)).unwrap();
    let text = format!(
        "{CAMERA}[[mesh]]\nfile = \"lamp.obj\"\nmaterial = \"lamp\"\n[[mesh]]\nfile = \
         \"cover.obj\"\nmaterial = \"gray\"\n[materials.lamp]\nalbedo = 0\nemission = \
         10\n[materials.gray]\nalbedo = 0.5\n[[meter]]\nname = \"dark\"\nposition = [0, 0, \
         0]\nnormal = [0, 1, 0]\n[[meter]]\nname = \"lit\"\nposition = [0, 2.5, 0]\nnormal = [0, \
         1, 0]\n"
    );
    fs::write(folder.join("cover.toml"), text).unwrap();
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

/// No light can come there: 0, with a minimum, a maximum and a uniformity, and the status 0.
#[test]
fn meters_outside_of_a_cone_are_certainly_dark() {
    let folder = tempfile::tempdir().unwrap();
    write_spot(folder.path());
    let files = ["--csv", "a.csv", "--report", "a.html", "--maps", "maps", "--json"];
    let time = ["spot.toml", "--time", "300ms"];
    let report = json(&measure(folder.path(), &[&time[..], &files].concat()));
    let grid = &report["meters"][0];
    let dark = |reading: &&Value| reading["value"] == 0.0 && reading["expanded"] == 0.0;
    let readings = grid["readings"].as_array().unwrap();
    // Four by four meters are within the cone, whose radius is 1.15 m.
    assert_eq!(readings.iter().filter(dark).count(), 48);
    for key in ["minimum", "minimum_expanded", "uniformity", "uniformity_expanded", "diversity"] {
        assert_eq!(number(&grid[key]), 0.0, "{key}: {grid}");
    }
    assert!(number(&grid["maximum"]) > 100.0 && number(&grid["mean"]["value"]) > 10.0, "{grid}");
    assert_eq!((&report["reached"], &report["notes"]), (&true.into(), &serde_json::json!([])));
    let table = fs::read_to_string(folder.path().join("a.csv")).unwrap();
    assert!(table.contains("grid,0,0,all,lx,0,0,0,0,0,0,"), "{table}");
    let page = fs::read_to_string(folder.path().join("a.html")).unwrap();
    assert!(!page.contains("unknown") && !page.contains("NaN"), "{page}");
    let text = succeed(&measure(folder.path(), &time)).to_owned();
    assert!(text.contains("uniformity U0 0.000 +- 0.000") && !text.contains("unknown"), "{text}");
}

/// Below the floor of the office, no surface is above the meter's plane.
#[test]
fn meters_below_everything_are_certainly_dark() {
    let folder = tempfile::tempdir().unwrap();
    let meters = "name,x,y,z,nx,ny,nz\ndark,3,-1,2,0,-1,0\n";
    fs::write(folder.path().join("m.csv"), meters).unwrap();
    let own = [OFFICE, "--meters", "m.csv", "--target-error", "1%", "--json"];
    let report = json(&measure(folder.path(), &own));
    let reading = &report["meters"][0]["readings"][0];
    assert_eq!((&reading["value"], &reading["expanded"]), (&0.0.into(), &0.0.into()), "{report}");
    assert_eq!((&report["reached"], &report["notes"]), (&true.into(), &serde_json::json!([])));
}

/// Few paths without light tell nothing: the status is 3, and an error with `--strict`.
#[test]
fn readings_without_light_are_empty_and_have_a_status_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    write_cover(folder.path());
    let own = [&["cover.toml"][..], &counts("16")].concat();
    let files = ["--csv", "a.csv", "--report", "a.html", "--json"];
    let output = measure(folder.path(), &[&own[..], &files].concat());
    assert_eq!(output.status.code(), Some(3), "{output:?}");
    let error = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(error.contains("readings are unknown: `dark`\nhelp: "), "{error}");
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let reading = |index: usize| report["meters"][index]["readings"][0].clone();
    assert!(reading(0)["value"].is_null() && reading(0)["expanded"].is_null(), "{report}");
    assert!(number(&reading(1)["value"]) > 100.0);
    assert_eq!(report["reached"], false);
    let table = fs::read_to_string(folder.path().join("a.csv")).unwrap();
    assert!(table.lines().any(|row| row == "dark,0,0,all,lx,,,,,,,0,0,0"), "{table}");
    assert!(fs::read_to_string(folder.path().join("a.html")).unwrap().contains("unknown"));
    let text = measure(folder.path(), &own);
    assert!(String::from_utf8_lossy(&text.stdout).contains("unknown"), "{text:?}");
    let strict = measure(folder.path(), &[&own[..], &["--strict", "--csv", "b.csv"]].concat());
    assert_eq!(strict.status.code(), Some(1));
    assert!(strict.stdout.is_empty() && !folder.path().join("b.csv").exists(), "{strict:?}");
}

/// Many paths without light bound it by the rule of three: `3 pi L/n` for a lamp of the radiance
/// `L`, or a few times this bound.
#[test]
fn enclosed_meters_are_0_with_an_interval() {
    let folder = tempfile::tempdir().unwrap();
    write_cover(folder.path());
    let own = [&["cover.toml", "--json"][..], &counts("20000")].concat();
    let report = json(&measure(folder.path(), &own));
    let reading = &report["meters"][0]["readings"][0];
    let (value, expanded) = (number(&reading["value"]), number(&reading["expanded"]));
    // At least three iterations.
    let bound = 3.0 * std::f64::consts::PI * 10.0 * 683.0 / 60_000.0;
    assert!(value == 0.0 && expanded > 0.0 && expanded < 10.0 * bound, "{reading} {bound}");
}

/// One iteration has no uncertainty, so that a measurement has more, however little time there is.
#[test]
fn shortest_measurement_states_an_uncertainty() {
    let folder = tempfile::tempdir().unwrap();
    let report = json(&measure(folder.path(), &[&[OFFICE, "--json"][..], &counts("64")].concat()));
    for set in report["meters"].as_array().unwrap() {
        for reading in set["readings"].as_array().unwrap() {
            assert!(number(&reading["expanded"]) > 0.0, "{reading}");
        }
    }
}
