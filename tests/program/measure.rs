//! `bdpm measure` and its library call.

use crate::common::program_output::{assert_refused, json, succeed};
use crate::common::{camera, gray, scene, square};
use bdpm::load::Loaded;
use bdpm::scene::backend::Backend;
use bdpm::scene::{Meter, MeterKind, MeterSet};
use bdpm::{MeasureJob, Measurement};
use glam::Vec3;
use serde_json::Value;
use std::f64::consts::PI;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::{Command, Output, Stdio};

const OFFICE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/office");

fn measure(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.arg("measure").args(arguments).args(["--quiet", "--accel", "bvh"]).stdin(Stdio::null());
    command.output().unwrap()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// A grid, a point and a cone in the office, in a file of their own.
fn meters(folder: &Path) -> String {
    let path = folder.join("meters.toml");
    let text = "[[meter]]\nname = \"plane\"\ncorner = [1, 0.75, 1]\nedges = [[4, 0, 0], [0, 0, 2]]\n\
                normal = [0, 1, 0]\ncolumns = 4\nrows = 2\n\
                [[meter]]\nposition = [3, 1.2, 2]\ntarget = [3, 1.2, 0]\nopening_deg = 20\n";
    std::fs::write(&path, text).unwrap();
    path.to_string_lossy().into_owned()
}

#[test]
fn measurement_reaches_its_target_and_states_units() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (meters, csv, page, maps) = (meters(folder.path()), at("a.csv"), at("a.html"), at("maps"));
    let more = ["--csv", &csv, "--report", &page, "--maps", &maps, "--json"];
    let target = ["--meters", &meters, "--target-error", "20%"];
    let output = measure(&[&[OFFICE][..], &target, &more].concat());
    let report = json(&output);
    assert_eq!(report["reached"], true, "{report}");
    let [plane, cone] = [0, 1].map(|index| &report["meters"][index]);
    assert_eq!((&plane["name"], &plane["unit"]), (&"plane".into(), &"lx".into()));
    assert_eq!((&cone["name"], &cone["unit"]), (&"meter 2".into(), &"cd/m2".into()));
    let readings = plane["readings"].as_array().unwrap();
    assert_eq!(readings.len(), 8);
    assert_eq!(plane["positions"][1], serde_json::json!([2.5, 0.75, 1.5]));
    assert_eq!(cone["normals"], serde_json::json!([[0.0, 0.0, -1.0]]));
    for reading in readings {
        let [value, expanded, noise, bias, direct, indirect] =
            ["value", "expanded", "noise", "bias", "direct", "indirect"]
                .map(|key| number(&reading[key]));
        assert!(expanded <= 0.2 * value && expanded >= 1.9 * noise + bias, "{reading}");
        assert!((direct + indirect - value).abs() < 1e-3 * value && direct > 0.0 && indirect > 0.0);
    }
    let mean = number(&plane["mean"]["value"]);
    let of_meters = readings.iter().map(|reading| number(&reading["value"])).sum::<f64>() / 8.0;
    assert!((mean - of_meters).abs() < 1e-6 * mean, "{mean} {of_meters}");
    // Three panels of 3600 lm over 24 m^2.
    assert!((150.0..600.0).contains(&mean), "{mean}");
    let [uniformity, expanded] =
        ["uniformity", "uniformity_expanded"].map(|key| number(&plane[key]));
    assert!(uniformity < 1.0 && expanded > 0.0 && uniformity + expanded > 0.3, "{plane}");
    let least = number(&plane["minimum"]);
    assert!((least / mean - uniformity).abs() < 1e-6 && number(&plane["diversity"]) <= uniformity);
    let table = std::fs::read_to_string(csv).unwrap();
    assert_eq!(table.lines().count(), 1 + 8 + 1, "{table}");
    assert!(table.lines().nth(1).unwrap().starts_with("plane,0,0,all,lx,"), "{table}");
    let page = std::fs::read_to_string(page).unwrap();
    crate::common::html::assert_whole(&page);
    assert!(page.contains("default-src 'none'"), "{page}");
    let map = bdpm::image_io::read_exr(&Path::new(&maps).join("plane.exr")).unwrap();
    let values = map.layer("").unwrap().channel("Y").unwrap();
    for (value, reading) in values.iter().zip(readings) {
        assert!((f64::from(*value) / number(&reading["value"]) - 1.0).abs() < 1e-6, "{reading}");
    }
    assert!(
        ["png", "svg"].iter().all(|end| Path::new(&maps).join(format!("plane.{end}")).exists())
    );
}

#[test]
fn lights_that_are_measured_apart_add_up_to_all() {
    let folder = tempfile::tempdir().unwrap();
    let meters = meters(folder.path());
    let both = ["--meters", &meters, "--mean", "--target-error", "10%", "--json"];
    let all = json(&measure(&[&[OFFICE][..], &both].concat()));
    let apart = json(&measure(&[&[OFFICE, "--by-light"][..], &both].concat()));
    let groups = apart["meters"][0]["groups"].as_array().unwrap();
    let names: Vec<&str> = groups.iter().map(|group| group["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["panel-left", "panel-middle", "panel-right"]);
    let sum: f64 = groups.iter().map(|group| number(&group["mean"]["value"])).sum();
    let [all, apart] = [all, apart].map(|report| report["meters"][0]["mean"].clone());
    assert!((number(&apart["value"]) - sum).abs() < 1e-6 * sum);
    let difference = (number(&all["value"]) - number(&apart["value"])).abs();
    let allowed = number(&all["expanded"]) + number(&apart["expanded"]);
    assert!(difference < 1.5 * allowed, "{all} {apart}");
}

#[test]
fn unmeasured_merge_bias_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let meters = meters(folder.path());
    let notes = |strategy: &str| {
        let counts = ["--light-paths", "1000", "--camera-paths", "2", "--time", "200ms", "--json"];
        let own = [OFFICE, "--meters", &meters, "--strategy", strategy];
        json(&measure(&[&own[..], &counts].concat()))["notes"].to_string()
    };
    let (merges, traces) = (notes("single"), notes("path"));
    assert_eq!(merges.matches("merge bias is not measured").count(), 1, "{merges}");
    assert!(!traces.contains("merge bias"), "{traces}");
}

#[test]
fn bad_meters_are_refused_with_their_line() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_string_lossy().into_owned()
    };
    let refused = |path: &str, problem: &str, advice: &str| {
        assert_refused(&measure(&[OFFICE, "--meters", path]), problem, advice);
    };
    let toml = |keys: &str| at("a.toml", &format!("[[meter]]\n{keys}"));
    refused(&toml("position = [0, 0, 0]\n"), "a.toml:1: the meter measures neither", "`normal`");
    refused(&toml("name = \"a\"\n"), "neither a point nor a grid", "`position`");
    refused(&toml("corner = [0, 0, 0]\n"), "the grid of meters is not complete", "`edges");
    refused(&toml("position = [0, 0, 0]\nnormal = [0, 0, 0]\n"), "faces", "not zero");
    refused(&at("a.csv", "name,x\n"), "the columns are", "name,x,y,z");
    refused(&at("a.txt", ""), "neither a .csv nor a .toml", ".csv");
    let box_scene = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");
    assert_refused(&measure(&[box_scene]), "the scene has no meters", "--meters");
    assert_refused(&measure(&[OFFICE, "--resolution", "4x4"]), "no resolution", "--resolution");
}

#[test]
fn text_has_a_row_for_each_meter() {
    let folder = tempfile::tempdir().unwrap();
    let meters = meters(folder.path());
    let output = measure(&[OFFICE, "--meters", &meters, "--time", "1s"]);
    let text = succeed(&output);
    for part in
        ["plane: mean", "plane: minimum", "4 by 2 meters, uniformity U0", "meter 2", "cd/m2"]
    {
        assert!(text.contains(part), "{part} in {text}");
    }
}

/// A closed box of albedo 0.5 whose walls all emit 1 W/(m^2 sr).
fn furnace() -> Loaded {
    let mut meshes = Vec::new();
    for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
        meshes.push(square(axis, -axis, 1.0, 0));
        meshes.push(square(-axis, axis, 1.0, 0));
    }
    let camera = camera(Vec3::ZERO, Vec3::X, 60.0);
    let scene = scene(meshes, vec![gray(0.5, 1.0)], vec![], camera);
    let cornell_box = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box");
    Loaded { scene, defaults: Default::default(), ..bdpm::load(Path::new(cornell_box)).unwrap() }
}

#[test]
fn intervals_hold_the_closed_form_as_often_as_they_say() {
    let loaded = furnace();
    let meter = |x: f32| Meter::irradiance(Vec3::new(x, 0.1, -0.2), Vec3::Z).unwrap();
    let sets = vec![
        MeterSet::single("one", MeterKind::Irradiance, meter(0.0)),
        MeterSet::single("other", MeterKind::Irradiance, meter(0.5)),
    ];
    // Radiance 1/(1 - 0.5) everywhere.
    let expected = 683.0 * PI / 0.5;
    let runs = 60;
    let (mut held, mut expanded, mut squares) = (0, 0.0, 0.0);
    for seed in 0..runs {
        let settings = bdpm::settings::PartialSettings { seed: Some(seed), ..Default::default() };
        let job = MeasureJob::new(&loaded).meters(sets.clone()).settings(settings);
        let job = job.backend(Backend::Bvh).target(0.03);
        let Measurement { sets, reached, .. } = job.run(|_| ControlFlow::Continue(())).unwrap();
        assert!(reached);
        for reading in sets.iter().map(|set| set.readings[0]) {
            let error = reading.value - expected;
            held += usize::from(error.abs() <= reading.expanded);
            (expanded, squares) = (expanded + reading.expanded, squares + error * error);
        }
    }
    let count = 2.0 * runs as f64;
    // 95 % of 120 are 114 with a standard deviation of 2.4.
    assert!(held >= 105, "{held} of {count}");
    let ratio = expanded / count / (1.96 * (squares / count).sqrt());
    println!("{held} of {count} held, stated over true spread {ratio:.2}");
    assert!((0.8..1.6).contains(&ratio), "{ratio}");
}

#[test]
fn too_many_meters_of_a_quantity_are_refused_with_their_number() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("meters.toml");
    let text = "[[meter]]\ncorner = [1, 0.75, 1]\nedges = [[4, 0, 0], [0, 0, 2]]\n\
                normal = [0, 1, 0]\ncolumns = 300\nrows = 300\n";
    std::fs::write(&path, text).unwrap();
    let output = measure(&[OFFICE, "--meters", path.to_str().unwrap(), "--time", "1s"]);
    assert_refused(&output, "90000 meters measure illuminance", "at most 65536 meters");
}

/// A meter in a closed box without a lamp never reaches a target: without a time, it ends with a
/// warning.
#[test]
fn dark_meters_end_the_measurement() {
    let lamp = square(Vec3::new(0.0, 3.0, 0.0), Vec3::Y, 0.5, 1);
    let cover = square(Vec3::new(0.0, 2.0, 0.0), Vec3::NEG_Y, 50.0, 0);
    let eye = camera(Vec3::ZERO, Vec3::X, 60.0);
    let scene = scene(vec![lamp, cover], vec![gray(0.5, 0.0), gray(0.0, 1.0)], vec![], eye);
    let meter = Meter::irradiance(Vec3::ZERO, Vec3::Y).unwrap();
    let set = MeterSet::single("dark", MeterKind::Irradiance, meter);
    let measurement = MeasureJob::new(&Loaded { scene, ..furnace() })
        .meters(vec![set])
        .run(|_| ControlFlow::Continue(()))
        .unwrap();
    assert!(!measurement.reached);
    let warning = "no light reached a meter";
    assert!(measurement.warnings.iter().any(|text| text.contains(warning)));
    // Unknown, or 0 with the interval of many paths.
    let reading = measurement.sets[0].readings[0];
    assert!(!reading.is_known() || reading.value == 0.0 && reading.expanded > 0.0, "{reading:?}");
}
