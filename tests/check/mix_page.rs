//! `bdpm mix --report`: pages of all tone curves and what `mix` states for some mixtures, which
//! `make check-report` compares in a browser then.

use serde_json::{Value, json};
use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::process::{Command, Stdio};

/// A name that shells and pages quote.
const NAME: &str = "the <left> panel's";

fn bdpm(folder: &Path, args: &[&str]) -> Vec<u8> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    let output = command.current_dir(folder).args(args).stdin(Stdio::null()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

#[test]
fn pages_of_mixtures() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("out/mix");
    match fs::remove_dir_all(&folder) {
        Err(error) if error.kind() != ErrorKind::NotFound => panic!("{error}"),
        _ => fs::create_dir_all(&folder).unwrap(),
    }
    let scene = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/office");
    let groups = format!("--light-groups={NAME}=panel-left,rest=panel-middle+panel-right");
    let render = ["render", scene.to_str().unwrap(), &groups, "--output", "office.exr", "--quiet"];
    let counts = ["--resolution", "320x200", "--light-paths", "20000", "--camera-paths", "2"];
    let counts = [&counts[..], &["--iterations", "16", "--no-denoise"]].concat();
    bdpm(&folder, &[&render[..], &counts].concat());
    for curve in ["srgb", "agx", "filmic"] {
        let (image, page) = (format!("{curve}.exr"), format!("{curve}.html"));
        let files = ["--output", &image, "--report", &page, "--tonemap", curve, "--quiet"];
        bdpm(&folder, &[&["mix", "office.exr"], &files[..]].concat());
    }
    let mixture = |[left, rest]: [f64; 2]| {
        let words = [(NAME, left), ("rest", rest)].map(|(name, own)| format!("{name}={own}"));
        let set = ["--set", &words[0], "--set", &words[1]];
        let stated =
            bdpm(&folder, &[&["mix", "office.exr", "--json", "-o", "a.exr"], &set[..]].concat());
        let stated: Value = serde_json::from_slice(&stated).unwrap();
        let command = |(name, own): (&str, f64)| match name {
            _ if own == 1.0 => String::new(),
            NAME => format!(r" --set 'the <left> panel'\''s={own}'"),
            _ => format!(" --set {name}={own}"),
        };
        // In the order of the layers of the file.
        let order = stated["lights"].as_array().unwrap().iter().map(|own| own["name"].as_str());
        let set = order.map(|name| match name.unwrap() {
            "rest" => command(("rest", rest)),
            name => command((name, left)),
        });
        json!({
            "factors": { NAME: left, "rest": rest },
            "error": stated["error"],
            "mean": stated["mean_luminance"],
            "command": format!("bdpm mix office.exr{} --output mixture.exr", set.collect::<String>()),
        })
    };
    let mixtures: Vec<Value> =
        [[0.3, 1.0], [0.0, 1.0], [1.5, 0.05], [2.0, 0.0]].map(mixture).into();
    let script = format!("const MIXTURES = {};\n", Value::Array(mixtures));
    fs::write(folder.join("mixtures.js"), script).unwrap();
}
