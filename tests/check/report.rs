//! `bdpm reproduce`: the quick experiment from beginning to end, and its report, which
//! `make check-report` opens in a browser then.

use crate::common::program_output::{assert_refused, json, text};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::Value;
use std::fs;
use std::io::{Cursor, ErrorKind};
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn reproduce(output: &Path, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.current_dir(env!("CARGO_MANIFEST_DIR")).args(["reproduce", "--output"]).arg(output);
    command.args(more).stdin(Stdio::null()).output().unwrap()
}

/// Calls `visit` with every number, by name.
fn numbers(name: &str, value: &Value, visit: &mut impl FnMut(&str, f64)) {
    match value {
        Value::Object(fields) => fields.iter().for_each(|(key, v)| numbers(key, v, visit)),
        Value::Array(items) => items.iter().for_each(|item| numbers(name, item, visit)),
        Value::Number(number) => visit(name, number.as_f64().unwrap()),
        // Values that are not finite are written as null.
        Value::Null => {
            assert!(["error", "implied", "processor"].contains(&name), "{name} is null");
        }
        Value::Bool(_) | Value::String(_) => {}
    }
}

#[test]
fn the_quick_experiment_ends_in_a_report_that_is_complete() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("out/report-quick");
    match fs::remove_dir_all(&folder) {
        Err(error) if error.kind() != ErrorKind::NotFound => panic!("{error}"),
        _ => {}
    }
    let found = json(&reproduce(&folder, &["--quick", "--quiet", "--json"]));
    assert_eq!(found["complete"], true);
    let results = fs::read_to_string(folder.join("results.json")).unwrap();
    let results: Value = serde_json::from_str(&results).unwrap();
    let mut count = 0;
    numbers("", &results, &mut |_, _| count += 1);
    assert!(count > 500, "{count}");
    assert_eq!(found["findings"], results["findings"]);
    assert_eq!(results["cells"].as_array().unwrap().len(), 25);
    assert_eq!(results["experiment"]["done"].as_array().unwrap().len(), 28);
    let ratio = &results["terms"][0]["ratio"];
    let (value, error) = (ratio["value"].as_f64().unwrap(), ratio["error"].as_f64().unwrap());
    assert!((value - 1.0).abs() < 6.0 * error, "formula over sample: {value} +- {error}");

    let html = fs::read_to_string(folder.join("report.html")).unwrap();
    let mut pictures = 0;
    // Any three letters may turn up in a picture's data.
    let mut shown = html.split("</style>").nth(1).unwrap().to_owned();
    for part in html.split("src=\"").skip(1) {
        let source = part.split('"').next().unwrap();
        shown = shown.replace(source, "");
        let data = source.strip_prefix("data:image/png;base64,");
        let png = STANDARD.decode(data.expect("pictures are part of the file")).unwrap();
        let mut reader = png::Decoder::new(Cursor::new(png)).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut bytes).unwrap();
        assert_eq!((info.width, info.height), (64, 64));
        let (least, most) = (bytes.iter().min().unwrap(), bytes.iter().max().unwrap());
        assert!(most - least > 100, "picture {pictures} shows something: {least} to {most}");
        pictures += 1;
    }
    assert_eq!(pictures, 9);
    assert_eq!(html.matches("<figure").count(), 11);
    assert_eq!(html.matches("<figcaption").count(), 11);
    // The name of the language of the plots is no address that a browser opens.
    let shown = shown.replace("http://www.w3.org/2000/svg", "");
    for word in ["NaN", ">inf", "-inf", "http:", "https:"] {
        assert!(!shown.contains(word), "{word}");
    }

    // The experiment is complete: again only writes the report, the same.
    let again = reproduce(&folder, &["--quick"]);
    assert!(text(&again.stderr).contains("all parts are complete"), "{}", text(&again.stderr));
    assert!(text(&again.stdout).contains("the same as printed"));
    assert_eq!(fs::read_to_string(folder.join("report.html")).unwrap(), html);
    let other = reproduce(&folder, &["--quick", "--seed", "7"]);
    assert_refused(&other, "its seed is 1, not 7", "another folder");
}
