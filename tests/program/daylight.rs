//! Requirements, daylight factors and the daylight of a year, as the program reports them.

use crate::common::program_output::{assert_refused, json, succeed};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn bdpm(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.args(arguments).args(["--quiet", "--accel", "bvh"]).stdin(Stdio::null());
    command.output().unwrap()
}

/// A ground plane below an open sky with one lamp, and a grid of meters with these keys on it.
fn scene(folder: &Path, keys: &str) -> String {
    fs::write(
        folder.join("ground.obj"),
        "v -50 0 -50\nv -50 0 50\nv 50 0 50\nv 50 0 -50\nf 1 2 3 4\n",
    )
    .unwrap();
    let text = format!(
        "[camera]\nposition = [0, 5, 5]\ntarget = [0, 0, 0]\nfov_x_deg = 60\n\
         [[mesh]]\nfile = \"ground.obj\"\nmaterial = \"ground\"\n[materials.ground]\nalbedo = 0.2\n\
         [[light]]\ntype = \"point\"\nposition = [0, 10, 0]\ncandela = 50000\n\
         [[meter]]\nname = \"place\"\ncorner = [-0.5, 0, -0.5]\nedges = [[1, 0, 0], [0, 0, 1]]\n\
         normal = [0, 1, 0]\n{keys}"
    );
    let path = folder.join("scene.toml");
    fs::write(&path, text).unwrap();
    path.to_string_lossy().into_owned()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

/// 500 lx below the lamp: with a maintenance factor of .8, 390 lx are met and 410 lx are not.
#[test]
fn requirements_are_met_or_not() {
    let folder = tempfile::tempdir().unwrap();
    let keys = "required_mean = 390\nrequired_uniformity = 0.9\nmaintenance_factor = 0.8\n";
    let scene_file = scene(folder.path(), keys);
    let page = folder.path().join("page.html").to_string_lossy().into_owned();
    let measure = ["measure", &scene_file, "--target-error", "1%"];
    let report = json(&bdpm(&[&measure[..], &["--json", "--report", &page]].concat()));
    let set = &report["meters"][0];
    // EN 12464-1 wants 5 by 5 points for a side of 1 m.
    assert_eq!((&set["columns"], &set["rows"]), (&5.into(), &5.into()));
    let [mean, uniformity] = [0, 1].map(|index| &set["requirements"][index]);
    assert!((number(&mean["value"]) - 0.8 * number(&set["mean"]["value"])).abs() < 1e-9);
    assert!((395.0..400.0).contains(&number(&mean["value"])), "{mean}");
    assert_eq!((&mean["verdict"], &uniformity["verdict"]), (&"met".into(), &"met".into()));
    let page = fs::read_to_string(page).unwrap();
    for part in ["maintained mean", "factor 0.8", "SHA-256", "ground.obj", "reflectance", "Command"]
    {
        assert!(page.contains(part), "{part}");
    }
    scene(folder.path(), "required_mean = 410\nmaintenance_factor = 0.8\n");
    let output = bdpm(&measure);
    let text = succeed(&output);
    assert!(text.contains("at least 410 lx: not met"), "{text}");
    scene(folder.path(), "required_mean = 0\n");
    assert_refused(&bdpm(&measure), "scene.toml:14: the required mean is 0", "positive");
    scene(folder.path(), "maintenance_factor = 1.5\n");
    assert_refused(&bdpm(&measure), "the maintenance factor is 1.5", "0.8");
}

/// In the open, the daylight factor is 100 %, whatever lamps there are.
#[test]
fn daylight_factor_in_the_open_is_all_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let scene_file = scene(folder.path(), "required_daylight_factor = [90, 110]\n");
    let measure = ["measure", &scene_file, "--daylight-factor", "--target-error", "2%"];
    assert_refused(&bdpm(&measure), "daylight factors of [90.0, 110.0] %", "the minimum");
    scene(folder.path(), "required_daylight_factor = [90, 80]\n");
    let report = json(&bdpm(&[&measure[..], &["--json"]].concat()));
    let set = &report["meters"][0];
    assert_eq!((&set["unit"], &set["quantity"]), (&"%".into(), &"daylight factor".into()));
    let [mean, expanded] = ["value", "expanded"].map(|key| number(&set["mean"][key]));
    assert!((mean - 100.0).abs() < expanded + 0.1, "{mean} +- {expanded}");
    for index in 0..2 {
        assert_eq!(set["requirements"][index]["verdict"], "met");
    }
    let conflict = bdpm(&[&measure[..], &["--by-light"]].concat());
    assert_eq!(conflict.status.code(), Some(2));
}

/// A weather file of one day of June.
fn weather(folder: &Path) -> String {
    let header = "LOCATION,Munich,BY,DEU,made,0,48.1,11.6,1.0,520\n".to_owned();
    let mut text = header + &"HEADER\n".repeat(7);
    for hour in 1..=24 {
        let day = (6..=20).contains(&hour);
        let (direct, diffuse) = if day { (600, 120) } else { (0, 0) };
        text += &format!("2001,6,21,{hour},60,A,20,10,40,95000,0,0,300,0,{direct},{diffuse}\n");
    }
    let path = folder.join("day.epw");
    fs::write(&path, text).unwrap();
    path.to_string_lossy().into_owned()
}

#[test]
fn a_year_of_one_day_is_bright_in_the_open() {
    let folder = tempfile::tempdir().unwrap();
    let (scene_file, weather) = (scene(folder.path(), ""), weather(folder.path()));
    let at = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
    let (csv, page) = (at("year.csv"), at("year.html"));
    let command = ["daylight", &scene_file, "--weather", &weather, "--paths", "2000"];
    let report =
        json(&bdpm(&[&command[..], &["--json", "--csv", &csv, "--report", &page]].concat()));
    assert_eq!(report["occupied_hours"], 10);
    let set = &report["meters"][0];
    assert_eq!(number(&set["spatial_autonomy"]["value"]), 100.0);
    let point = &set["points"][0];
    assert_eq!(number(&point["autonomy"]["value"]), 100.0);
    assert_eq!((number(&point["sun_hours"]), number(&set["sunlight_exposure"])), (10.0, 0.0));
    let useful: f64 = (0..4).map(|index| number(&point["useful"][index]["value"])).sum();
    assert!((useful - 100.0).abs() < 1e-9);
    // By night it is dark.
    assert_eq!(number(&set["by_month"][5][1]), 0.0);
    assert!(number(&set["by_month"][5][12]) > 30_000.0);
    let csv = fs::read_to_string(csv).unwrap();
    assert_eq!(csv.lines().count(), 26);
    assert!(csv.starts_with("name,row,column,autonomy,autonomy_expanded,"), "{csv}");
    let page = fs::read_to_string(page).unwrap();
    assert!(page.contains("Munich, DEU") && page.contains("day.epw"), "{page}");
    let output = bdpm(&command);
    let text = succeed(&output);
    assert!(text.contains("sDA300,50% 100.0 %"), "{text}");
    let output = bdpm(&[&command[..], &["--threads", "1"]].concat());
    let again = succeed(&output);
    let lines = |text: &str| text.lines().take(4).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(lines(text), lines(again), "the same seed gives the same result");
}

#[test]
fn bad_weather_is_refused_with_its_line() {
    let folder = tempfile::tempdir().unwrap();
    let scene_file = scene(folder.path(), "");
    let weather = folder.path().join("bad.epw");
    fs::write(&weather, "date,hour\n1,2\n").unwrap();
    let path = weather.to_string_lossy();
    let refused = bdpm(&["daylight", &scene_file, "--weather", &path]);
    assert_refused(&refused, "bad.epw:1: this is no EPW weather file", "LOCATION");
    let missing = bdpm(&["daylight", &scene_file, "--weather", "/no/such.epw"]);
    assert_refused(&missing, "/no/such.epw", "path");
}
