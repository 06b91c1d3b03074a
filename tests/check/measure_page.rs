//! `bdpm measure --by-light --report`: pages with sliders, and what follows for some mixtures from
//! the JSON of the same measurements, which `make check-report` compares in a browser then.

use bdpm::measurement::{Judged, Reading, SetReadings};
use bdpm::scene::{MeterKind, Requirement};
use serde_json::{Value, json};
use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::process::{Command, Stdio};

/// Meters of the office: a grid with requirements, a point, a grid with more points than the page
/// lists, eyes and luminance. The name is one that pages quote.
const METERS: &str = r#"
[[meter]]
name = "the <desks> & more"
corner = [1, 0.75, 1]
edges = [[4, 0, 0], [0, 0, 2]]
normal = [0, 1, 0]
columns = 8
rows = 5
required_mean = 300
required_minimum = 250
required_uniformity = 0.7
required_diversity = 0.6
maintenance_factor = 0.8
[[meter]]
name = "left desk"
position = [1.6, 0.72, 1.2]
normal = [0, 1, 0]
required_minimum = 200
[[meter]]
name = "wall"
corner = [0.1, 0.5, 3]
edges = [[0, 0, -2], [0, 2, 0]]
normal = [1, 0, 0]
columns = 24
rows = 16
required_minimum = 200
[[meter]]
name = "eyes"
corner = [1, 1.2, 1.5]
edges = [[4, 0, 0], [0, 0, 2]]
normal = [0, 0, -1]
columns = 3
rows = 2
required_ugr = 19
[[meter]]
name = "wall behind the desks"
position = [4.6, 1.2, 1.8]
target = [4.6, 1.2, 0]
opening_deg = 10
"#;

/// A lamp over a cover, and one under it. Few paths say nothing of the light of the upper lamp
/// below the cover.
const COVER: &str = r#"
[camera]
position = [0, 5, 5]
target = [0, 0, 0]
fov_y_deg = 40
[[mesh]]
file = "lamp.obj"
material = "upper"
[[mesh]]
file = "cover.obj"
material = "gray"
[materials.upper]
albedo = 0
emission = 10
[materials.gray]
albedo = 0.5
[[light]]
name = "lower"
type = "point"
position = [0, 1, 0]
candela = 100
[[meter]]
name = "below"
corner = [-1, 0, -1]
edges = [[2, 0, 0], [0, 0, 2]]
normal = [0, 1, 0]
columns = 4
rows = 3
required_mean = 10
[[meter]]
name = "above"
position = [0, 2.5, 0]
normal = [0, 1, 0]
"#;

/// Measures, and writes a page. Returns the JSON.
fn measure(folder: &Path, arguments: &[&str], page: &str, status: i32) -> Value {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.current_dir(folder).arg("measure").args(arguments).stdin(Stdio::null());
    command.args(["--by-light", "--json", "--quiet", "--accel", "bvh", "--report", page]);
    let output = command.output().unwrap();
    let shown = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(status), "{shown}");
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Writes a page without its script, which then shows what the program wrote.
fn write_plain(folder: &Path, page: &str) {
    let html = fs::read_to_string(folder.join(page)).unwrap();
    let (before, script) = html.split_once("<script>").expect("a script");
    let (_, after) = script.split_once("</script>").expect("its end");
    fs::write(folder.join(format!("plain-{page}")), format!("{before}{after}")).unwrap();
}

/// A number, which is null if it is not finite.
fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(f64::NAN)
}

/// The sum of independent readings, each times the factor of its light:
/// docs/explanation/measurement.md.
fn mixed(readings: &[&Value], factors: &[f64]) -> Reading {
    let on = || readings.iter().zip(factors).filter(|(_, factor)| **factor > 0.0);
    let sum = |of: &dyn Fn(&Value) -> f64| -> f64 { on().map(|(own, d)| d * of(own)).sum() };
    let root = |of: &dyn Fn(&Value) -> f64| -> f64 {
        on().map(|(own, d)| (d * of(own)).powi(2)).sum::<f64>().sqrt()
    };
    let key = |name: &'static str| move |own: &Value| number(&own[name]);
    let bias = sum(&key("bias"));
    Reading {
        value: sum(&key("value")),
        noise: root(&key("noise")),
        bias,
        expanded: root(&|own| number(&own["expanded"]) - number(&own["bias"])) + bias,
        direct: sum(&key("direct")),
    }
}

/// The keys of a set that require something.
fn requirement(set: &Value) -> Requirement {
    let required = |what: &str| {
        let all = set["requirements"].as_array().unwrap();
        all.iter().find(|own| own["what"] == what).map(|own| number(&own["required"]))
    };
    Requirement {
        mean: required("maintained mean"),
        minimum: required("maintained minimum"),
        uniformity: required("uniformity U0"),
        diversity: required("diversity Ud"),
        maintenance: number(&set["maintenance_factor"]),
        ..Requirement::default()
    }
}

/// Number of lights that are on and under which intervals of a set are open above, by the notes.
fn open(report: &Value, set: &Value, factors: &[f64]) -> usize {
    let notes = report["notes"].as_array().unwrap();
    let name = format!("`{}`", set["name"].as_str().unwrap());
    let is_open = |(group, factor): &(&Value, &f64)| {
        let start = format!("{}: not enough light seen", group["name"].as_str().unwrap());
        let mut notes = notes.iter().map(|note| note.as_str().unwrap());
        **factor > 0.0 && notes.any(|note| note.starts_with(&start) && note.contains(&name))
    };
    set["groups"].as_array().unwrap().iter().zip(factors).filter(is_open).count()
}

/// Readings of a set, and what follows from them, if the lights have these factors.
fn dimmed(report: &Value, set: &Value, factors: &[f64]) -> Value {
    let groups = set["groups"].as_array().unwrap();
    let means: Vec<&Value> = groups.iter().map(|group| &group["mean"]).collect();
    let count = set["readings"].as_array().unwrap().len();
    let point = |index: usize| -> Reading {
        let own: Vec<&Value> = groups.iter().map(|group| &group["readings"][index]).collect();
        mixed(&own, factors)
    };
    let readings: Vec<Reading> = (0..count).map(point).collect();
    let size = ["columns", "rows"].map(|key| number(&set[key]) as u32);
    let single = SetReadings::single("", MeterKind::Irradiance, mixed(&means, factors));
    let (open, requirement) = (open(report, set, factors), requirement(set));
    let own = SetReadings { readings, grid: size, requirement, open, ..single };
    let alone =
        (0..groups.len()).map(|light| mixed(&means[light..=light], &factors[light..=light]));
    let of_requirement = |own: &Judged| {
        json!({ "what": own.what, "value": own.found.value, "expanded": own.found.expanded,
                "verdict": own.verdict.describe() })
    };
    json!({
        "columns": set["columns"],
        "mean": own.mean,
        "alone": alone.collect::<Vec<Reading>>(),
        "extremes": [own.extremes()[0], own.extremes()[1], own.uniformity(), own.diversity()],
        "requirements": own.judged().iter().map(of_requirement).collect::<Vec<Value>>(),
        "readings": own.readings,
    })
}

/// A page with what the meters read under some mixtures of its lights.
fn mixtures(page: &str, report: &Value, all: &[&[f64]]) -> Value {
    let sets = report["meters"].as_array().unwrap();
    let groups = sets[0]["groups"].as_array().unwrap();
    let of_factors = |factors: &&[f64]| {
        let sets: Vec<Value> = sets.iter().map(|set| dimmed(report, set, factors)).collect();
        json!({ "factors": factors, "sets": sets })
    };
    json!({
        "page": page,
        "lights": groups.iter().map(|group| &group["name"]).collect::<Vec<&Value>>(),
        "mixtures": all.iter().map(of_factors).collect::<Vec<Value>>(),
    })
}

#[test]
fn pages_of_dimmed_lights() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("out/measure");
    match fs::remove_dir_all(&folder) {
        Err(error) if error.kind() != ErrorKind::NotFound => panic!("{error}"),
        _ => fs::create_dir_all(&folder).unwrap(),
    }
    let square = |height: u32, half: f32| {
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];
        let lines = corners.map(|[x, z]| format!("v {} {height} {}\n", x * half, z * half));
        lines.concat() + "f 1 2 3 4\n"
    };
    for (name, text) in [
        ("meters.toml", METERS.to_owned()),
        ("cover.toml", COVER.to_owned()),
        ("lamp.obj", square(3, 0.5)),
        ("cover.obj", square(2, 50.0)),
    ] {
        fs::write(folder.join(name), text).unwrap();
    }
    let office = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/office");
    let own = [office, "--meters", "meters.toml", "--target-error", "10%"];
    let office = measure(&folder, &own, "office.html", 0);
    let few = ["--time", "1ms", "--strategy", "path", "--light-paths", "1000"];
    let own = [&["cover.toml"][..], &few, &["--camera-paths", "16"]].concat();
    let cover = measure(&folder, &own, "unknown.html", 3);
    ["office.html", "unknown.html"].iter().for_each(|page| write_plain(&folder, page));
    let lights = cover["meters"][0]["groups"].as_array().unwrap();
    let off = lights.iter().map(|own| if own["name"] == "lower" { 0.7 } else { 0.0 });
    let off: Vec<f64> = off.collect();
    let pages = [
        mixtures(
            "office.html",
            &office,
            &[
                &[1.0; 3],
                &[0.3, 1.0, 1.0],
                &[0.0, 1.7, 0.05],
                &[2.0; 3],
                &[0.0; 3],
                &[0.5, 0.0, 0.0],
            ],
        ),
        mixtures("unknown.html", &cover, &[&[1.0; 2], &off, &[0.0; 2]]),
    ];
    let script = format!("const PAGES = {};\n", Value::Array(pages.into()));
    fs::write(folder.join("mixtures.js"), script).unwrap();
}
