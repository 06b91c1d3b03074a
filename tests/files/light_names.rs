//! Names of lights, and errors of their tables.

use bdpm::load::{Loaded, export, load};
use std::fs::write;
use std::path::Path;
use tempfile::TempDir;

/// A scene with these tables of lights, the first of which begins in line 11.
fn scene(folder: &Path, lights: &str) -> bdpm::Result<Loaded> {
    let text = "[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\nfov_x_deg = 40\n\
                [[mesh]]\nfile = 'a.obj'\nmaterial = 'm'\n[materials.m]\nalbedo = 0.5\n\n";
    write(folder.join("a.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    write(folder.join("scene.toml"), format!("{text}{lights}")).unwrap();
    load(folder)
}

const LAMP: &str = "[[light]]\ntype = 'point'\nposition = [0, 1, 2]\nlumen = 800\n";

fn names(loaded: &Loaded) -> Vec<String> {
    loaded.scene.light_sources().into_iter().map(|(_, name)| name).collect()
}

#[test]
fn names_of_lights_are_those_of_the_file_and_stay_in_conversions() {
    let folder = TempDir::new().unwrap();
    // The second lamp is dark: it has neither a name nor a number.
    let dark = LAMP.replace("800", "0").replace("'point'", "'point'\nname = 'dark'");
    let sun = "[[light]]\ntype = 'sun'\nname = 'sun \"1\"'\ndirection = [0, 0, -1]\nlux = 1\n";
    let desk = LAMP.replace("'point'", "'point'\nname = 'desk'");
    let loaded = scene(folder.path(), &[LAMP, &dark, sun, &desk].concat()).unwrap();
    assert_eq!(names(&loaded), ["light 1", "sun \"1\"", "desk"]);
    let sources = loaded.scene.light_sources();
    let only = loaded.scene.with_only(&[sources[2].0.clone()]).unwrap();
    assert_eq!(only.light_sources()[0].1, "desk");
    let out = TempDir::new().unwrap();
    export(&loaded, "scene.toml", out.path(), true).unwrap();
    assert_eq!(names(&load(out.path()).unwrap()), names(&loaded));
}

#[test]
fn unknown_and_wrong_keys_of_lights_are_reported_at_their_own_lines() {
    let folder = TempDir::new().unwrap();
    let refused = |second: &str, place: &str, parts: &[&str]| {
        let text = format!("{LAMP}[[light]]\n{second}");
        let shown = scene(folder.path(), &text).unwrap_err().to_string();
        assert!(shown.contains(&format!("scene.toml:{place}: ")), "{shown}");
        assert!(parts.iter().all(|part| shown.contains(part)), "{shown}");
    };
    let point = "type = 'point'\nposition = [0, 1, 2]\n";
    refused(&format!("{point}lumens = 9\n"), "18", &["unknown key `lumens`", "`lumen`"]);
    refused(&format!("{point}lumen = -9\n"), "18", &["light is negative"]);
    refused(&format!("{point}power = true\n"), "18", &["a number or a list of 3 numbers"]);
    refused("type = 'bulb'\n", "16", &["unknown value `bulb`", "`luminaire`"]);
    refused("position = [0, 1, 2]\n", "15", &["the key `type` is missing"]);
    refused("type = 'point'\nlumen = 1\n", "15", &["`position`", "is missing"]);
    let luminaire = "type = 'luminaire'\nposition = [0, 1, 2]\n";
    refused(luminaire, "15", &["the key `file`", "is missing"]);
    refused(&format!("{luminaire}target = [0, 0, 0]\n"), "15", &["unknown key `target`"]);
}

#[test]
fn names_that_control_what_shows_them_are_replaced() {
    let folder = TempDir::new().unwrap();
    let hostile = r"a\u202Eb\u001Bc\nd\u2066";
    let shown = "a\u{fffd}b\u{fffd}c\u{fffd}d\u{fffd}";
    let text = format!(
        "[camera]\nposition = [0, 0, 5]\ntarget = [0, 0, 0]\nfov_x_deg = 40\n\
         [[mesh]]\nfile = 'a.obj'\nmaterial = \"{hostile}\"\n\
         [materials.\"{hostile}\"]\nalbedo = 0.5\n\
         [[light]]\ntype = 'point'\nname = \"{hostile}\"\nposition = [0, 1, 2]\nlumen = 800\n\
         [[meter]]\nname = \"{hostile}\"\nposition = [0, 0, 1]\nnormal = [0, 0, -1]\n"
    );
    write(folder.path().join("a.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    write(folder.path().join("scene.toml"), text).unwrap();
    let loaded = load(folder.path()).unwrap();
    assert_eq!(names(&loaded), [shown]);
    assert_eq!(loaded.meters[0].name, shown);
    assert!(loaded.scene.materials().iter().any(|material| material.name == shown));
}
