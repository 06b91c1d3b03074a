//! `bdpm goniometer`.

use crate::common::program_output::{assert_refused, json, succeed};
use bdpm::light::photometry::LuminaireFile;
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// A panel of 0.2 by 0.2 m that faces down with the radiance 5, in a scene with +y up.
fn write_scene(folder: &Path, more: &str) {
    fs::write(
        folder.join("panel.obj"),
        "v -0.1 0 -0.1\nv 0.1 0 -0.1\nv 0.1 0 0.1\nv -0.1 0 0.1\nf 1 2 3 4\n",
    )
    .unwrap();
    let text = format!(
        "[camera]\nposition = [0, -1, 1]\ntarget = [0, 0, 0]\nfov_x_deg = 40\n[[mesh]]\nfile = \
         \"panel.obj\"\nmaterial = \"lamp\"\n[materials.lamp]\ntype = \"lambertian\"\nalbedo = \
         0\nemission = 5\n{more}"
    );
    fs::write(folder.join("lamp.toml"), text).unwrap();
}

fn bdpm(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.current_dir(folder).args(["goniometer", "lamp.toml"]).args(arguments).output().unwrap()
}

#[test]
fn measurement_writes_files_and_reports_units_and_angles() {
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path(), "");
    let options = ["--iterations", "20", "--watts", "30", "--c-step", "90"];
    let files = ["--eulumdat", "lamp.ldt", "--plot", "lamp.svg", "--gamma-step", "5", "--json"];
    let report = json(&bdpm(folder.path(), &[&options[..], &files].concat()));
    let number = |key: &str, part: &str| report[key][part].as_f64().unwrap();
    let flux = std::f64::consts::PI * 683.0 * 5.0 * 0.04;
    let error = number("flux", "standard_error");
    // All paths leave with equal flux.
    assert!((number("flux", "value") - flux).abs() < 4.0 * error + 1e-5 * flux, "{report}");
    assert_eq!(report["flux"]["unit"], "lm");
    assert!((number("light_output_ratio", "value") - 1.0).abs() < 1e-5);
    for (key, share, expected) in [("beam_angle", 0.5, 120.0), ("field_angle", 0.1, 168.5)] {
        assert_eq!(report[key]["share"], share);
        for plane in ["c0_c180", "c90_c270"] {
            let angle = number(key, plane);
            // Intensities of nodes are means over two steps.
            assert!((angle - expected).abs() < 3.0, "{key}: {angle}");
        }
    }
    for name in ["lamp.ies", "lamp.ldt"] {
        let file = LuminaireFile::read(&folder.path().join(name)).unwrap();
        assert_eq!((&file.name[..], file.watts), ("lamp", 30.0));
        let ratio = file.distribution.flux() / number("flux", "value");
        assert!((ratio - 1.0).abs() < 1e-6, "{name}: {ratio}");
    }
    let plot = fs::read_to_string(folder.path().join("lamp.svg")).unwrap();
    assert!(plot.contains("<polyline") && plot.ends_with("</svg>\n"));
    let rows = report["distribution"]["intensity"].as_array().unwrap();
    assert_eq!((rows.len(), rows[0].as_array().unwrap().len()), (37, 4));
}

#[test]
fn text_report_has_values_with_standard_errors() {
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path(), "");
    let output = bdpm(folder.path(), &["--iterations", "8", "-o", "out.ies", "--quiet"]);
    assert_eq!(succeed(&output), "");
    let options = ["--iterations", "8", "--gamma-step", "30", "--down", "0,1,0", "-o", "up.ies"];
    let output = bdpm(folder.path(), &options);
    let shown = succeed(&output);
    assert!(shown.contains("light output ratio") && shown.contains("lm\n"), "{shown}");
    assert!(shown.contains("gamma 180") && shown.contains("±"), "{shown}");
    let up = LuminaireFile::read(&folder.path().join("up.ies")).unwrap();
    assert!(up.distribution.values()[0] == 0.0, "it shines to the zenith of this frame");
}

/// A spot with a beam of 16 degrees, at steps of 5 and of 1 degree.
#[test]
fn steps_that_are_too_coarse_for_the_beam_are_noted() {
    let folder = tempfile::tempdir().unwrap();
    let spot = "[[light]]\ntype = \"spot\"\nposition = [0, -1, 0]\ndirection = [0, -1, 0]\ncandela = \
                1e5\ninner_deg = 1\nouter_deg = 20\n";
    write_scene(folder.path(), spot);
    let notes = |step: &str| {
        let options = ["--iterations", "8", "--gamma-step", step, "-o", "out.ies", "--json"];
        json(&bdpm(folder.path(), &options))["notes"].as_array().unwrap().clone()
    };
    let coarse = notes("5");
    assert_eq!(coarse.len(), 1, "{coarse:?}");
    let note = coarse[0].as_str().unwrap();
    assert!(note.contains("steps of 5 degrees") && note.contains("give --gamma-step"), "{note}");
    assert!(notes("1").is_empty());
}

#[test]
fn impossible_measurements_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path(), "");
    let refused = |options: &[&str], problem: &str, advice: &str| {
        assert_refused(&bdpm(folder.path(), options), problem, advice);
    };
    refused(&["--gamma-step", "7"], "the steps of the angles are 7", "divides 180");
    refused(&["-o", "lamp.exr"], "lamp.exr", ".ies");
    refused(&["--c0", "0,1,0"], "`c0` has no length", "vector");
    refused(&["--lamp-lumen", "0"], "flux of the lamps", "above 0");
    write_scene(folder.path(), "[environment]\nradiance = 1\n");
    refused(&["--iterations", "4"], "an environment", "only the lamps");
}
