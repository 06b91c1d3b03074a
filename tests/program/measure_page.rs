//! `measure --report`: a slider for each light that was measured apart, and the numbers from which
//! the script of the page computes dimmed light.

use crate::common::html::assert_whole;
use crate::common::program_output::json;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};

const METERS: &str = "[[meter]]\nname = \"a<b>\"\ncorner = [1, 0.75, 1]\nedges = [[4, 0, 0], \
                      [0, 0, 2]]\nnormal = [0, 1, 0]\ncolumns = 4\nrows = 2\nrequired_mean = 500\n\
                      [[meter]]\nposition = [3, 1.2, 2]\ntarget = [3, 1.2, 0]\nopening_deg = 20\n";

/// Measures the office with fixed counts. Returns the page and the JSON.
fn measure(folder: &Path, more: &[&str]) -> (String, Value) {
    fs::write(folder.join("meters.toml"), METERS).unwrap();
    let office = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/office");
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.current_dir(folder).args([
        "measure",
        office,
        "--meters",
        "meters.toml",
        "--time",
        "1ms",
    ]);
    command.args([
        "--strategy",
        "single",
        "--light-paths",
        "2000",
        "--camera-paths",
        "8",
        "--json",
    ]);
    command.args(["--report", "a.html", "--quiet", "--accel", "bvh"]).args(more);
    let report = json(&command.stdin(Stdio::null()).output().unwrap());
    (fs::read_to_string(folder.join("a.html")).unwrap(), report)
}

/// Value of an attribute of a tag.
fn attribute<'a>(tag: &'a str, name: &str) -> &'a str {
    tag.split(&format!(" {name}=\"")).nth(1).expect(name).split('"').next().unwrap()
}

/// Numbers of an attribute with so many bytes each.
fn numbers<const N: usize>(tag: &str, name: &str, number: fn([u8; N]) -> f64) -> Vec<f64> {
    let text = attribute(tag, name).strip_prefix("base64,").unwrap();
    let bytes = STANDARD.decode(text).unwrap();
    bytes.chunks_exact(N).map(|own| number(own.try_into().unwrap())).collect()
}

fn doubles(tag: &str, name: &str) -> Vec<f64> {
    numbers(tag, name, f64::from_le_bytes)
}

/// Numbers of an attribute of 32-bit floats; zeros if there is none.
fn singles(tag: &str, name: &str, count: usize) -> Vec<f64> {
    match tag.contains(&format!(" {name}=")) {
        true => numbers(tag, name, |bytes| f64::from(f32::from_le_bytes(bytes))),
        false => vec![0.0; count],
    }
}

fn assert_close(own: f64, stated: &Value) {
    let stated = stated.as_f64().unwrap();
    assert!((own - stated).abs() <= 1e-6 * stated.abs(), "{own} {stated}");
}

#[test]
fn page_of_lights_measured_apart_has_sliders_and_all_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let (page, report) = measure(folder.path(), &["--by-light"]);
    assert_whole(&page);
    for light in ["panel-left", "panel-middle", "panel-right"] {
        assert_eq!(page.matches(&format!("data-name=\"{light}\"")).count(), 1, "{light}");
    }
    assert_eq!(page.matches("type=\"range\"").count(), 3);
    assert_eq!(page.matches("max=\"2\" step=\"0.01\" value=\"1\"").count(), 3);
    assert!(page.contains("a&lt;b&gt;: mean") && !page.contains("a<b>"), "names are escaped");
    let sets = report["meters"].as_array().unwrap();
    let parts: Vec<&str> = page.split("<div class=\"measured\"").skip(1).collect();
    assert_eq!(parts.len(), sets.len());
    for (part, set) in parts.iter().zip(sets) {
        let part = part.split("</div>").next().unwrap();
        assert_eq!(attribute(part, "data-unit"), set["unit"].as_str().unwrap());
        let groups = set["groups"].as_array().unwrap();
        let tags: Vec<&str> = part.split("<i ").skip(1).collect();
        assert_eq!(tags.len(), groups.len());
        let all = set["readings"].as_array().unwrap();
        // Values and biases of all lights, and squares of spreads.
        let mut sums = vec![[0.0; 3]; all.len()];
        for (tag, group) in tags.iter().zip(groups) {
            let tag = &format!(" {tag}")[..];
            let [value, noise, bias, spread, direct] = doubles(tag, "data-mean")[..] else {
                panic!("five numbers")
            };
            let mean = &group["mean"];
            for (own, key) in
                [(value, "value"), (noise, "noise"), (bias, "bias"), (direct, "direct")]
            {
                assert_eq!(own, mean[key].as_f64().unwrap(), "{key}");
            }
            assert_close(spread + bias, &mean["expanded"]);
            let values = doubles(tag, "data-value");
            let [noises, spreads, biases] = ["data-noise", "data-spread", "data-bias"]
                .map(|name| singles(tag, name, values.len()));
            let readings = group["readings"].as_array().unwrap();
            assert_eq!(values.len(), readings.len());
            for (point, reading) in readings.iter().enumerate() {
                assert_eq!(values[point], reading["value"].as_f64().unwrap());
                assert_close(noises[point], &reading["noise"]);
                assert_close(spreads[point] + biases[point], &reading["expanded"]);
                let [value, spread, bias] = &mut sums[point];
                *value += values[point];
                *spread += spreads[point].powi(2);
                *bias += biases[point];
            }
        }
        for ([value, spread, bias], reading) in sums.iter().zip(all) {
            assert_close(*value, &reading["value"]);
            assert_close(spread.sqrt() + bias, &reading["expanded"]);
        }
    }
}

#[test]
fn page_of_lights_measured_together_has_no_sliders_and_no_script() {
    let folder = tempfile::tempdir().unwrap();
    let (page, _) = measure(folder.path(), &[]);
    assert_whole(&page);
    for part in
        ["<script", "<input", "<button", "id=\"dimming\"", "class=\"measured\"", "full strength"]
    {
        assert!(!page.contains(part), "{part}");
    }
}
