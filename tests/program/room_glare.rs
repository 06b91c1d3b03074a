//! `bdpm glare` of scenes: the rating straight from luminaires and room.

use crate::common::program_output::{assert_refused, json, succeed};
use bdpm::light::glare::position_index;
use glam::DVec3;
use std::fs::write;
use std::path::Path;
use std::process::{Command, Output, Stdio};

const LUMENS_PER_WATT: f64 = 683.0;

fn glare(folder: &Path, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    let own = ["glare", "room.toml", "--accel", "bvh"];
    command.current_dir(folder).args(own).args(more).stdin(Stdio::null()).output().unwrap()
}

/// A wall that fills the view, lit by a sun from behind the eye, and a black panel of 0.2 by 0.2 m
/// before it, which emits toward the eye. The eye is at the origin and looks along -z.
fn write_room(folder: &Path, center: DVec3) {
    let DVec3 { x, y, z } = center;
    let wall = "v -900 -900 -4\nv 900 -900 -4\nv 900 900 -4\nv -900 900 -4\nf 1 2 3 4\n";
    let corner = |a: f64, b: f64| format!("v {} {} {z}\n", x + 0.1 * a, y + 0.1 * b);
    let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
    write(folder.join("wall.obj"), wall).unwrap();
    write(folder.join("panel.obj"), corners.concat() + "f 1 2 3 4\n").unwrap();
    let text = "[camera]\nposition = [0, 0, 0]\ndirection = [0, 0, -1]\nfov_x_deg = 60\n\
                [[mesh]]\nfile = 'wall.obj'\nmaterial = 'wall'\n\
                [[mesh]]\nfile = 'panel.obj'\nmaterial = 'panel'\n\
                [materials.wall]\nalbedo = 0.5\n[materials.panel]\nalbedo = 0\nemission = 10\n\
                [[light]]\ntype = 'sun'\ndirection = [0.2, 0, -1]\nirradiance = 0.3\n";
    write(folder.join("room.toml"), text).unwrap();
}

/// Solid angle of the panel, and the integral of the inverse square of its position index over it.
fn panel(center: DVec3) -> [f64; 2] {
    let n = 64;
    let (mut solid, mut weighted) = (0.0, 0.0);
    for i in 0..n * n {
        let [a, b] = [i % n, i / n].map(|k| 0.2 * ((f64::from(k) + 0.5) / f64::from(n) - 0.5));
        let at = center + DVec3::new(a, b, 0.0);
        let distance2 = at.length_squared();
        let own = (0.2 / f64::from(n)).powi(2) * -at.z / distance2.powf(1.5);
        // To the right, up, along the view direction
        let index = position_index(DVec3::new(at.x, at.y, -at.z) / distance2.sqrt());
        solid += own;
        weighted += own / (index * index);
    }
    [solid, weighted]
}

#[test]
fn panel_before_an_even_wall_has_the_rating_of_the_formula() {
    for center in [DVec3::new(0.3, 0.5, -2.0), DVec3::new(-0.4, -0.3, -1.5)] {
        let folder = tempfile::tempdir().unwrap();
        write_room(folder.path(), center);
        let report = json(&glare(folder.path(), &["--target-error", "1%", "--json", "--quiet"]));
        let [solid, weighted] = panel(center);
        let luminance = 10.0 * LUMENS_PER_WATT;
        // The wall has the radiance albedo E / pi everywhere, except behind the panel and in its
        // shadow.
        let irradiance = 0.3 / (1.0f64 + 0.04).sqrt();
        let background = LUMENS_PER_WATT * 0.5 * irradiance / std::f64::consts::PI;
        let number = |value: &serde_json::Value| value.as_f64().unwrap();
        let own = &report["luminaires"][0];
        assert_eq!(own["name"], "panel");
        assert!((number(&own["luminance"]) / luminance - 1.0).abs() < 1e-3, "{own}");
        assert!((number(&own["solid_angle"]) / solid - 1.0).abs() < 0.02, "{own} {solid}");
        let measured = &report["background_luminance"];
        let (value, expanded) = (number(&measured["value"]), number(&measured["expanded"]));
        assert!((value - background).abs() < 1.5 * expanded + 0.01 * background, "{measured}");
        let expected = 8.0 * (0.25 / background * luminance * luminance * weighted).log10();
        let (ugr, expanded) = (number(&report["ugr"]["value"]), number(&report["ugr"]["expanded"]));
        assert!((ugr - expected).abs() < 1.5 * expanded + 0.05, "{ugr} +- {expanded}, {expected}");
        assert!(expanded < 0.2, "{expanded}");
    }
}

#[test]
fn options_of_scenes_are_refused_for_images() {
    let folder = tempfile::tempdir().unwrap();
    write_room(folder.path(), DVec3::new(0.0, 0.5, -2.0));
    let output = glare(folder.path(), &["--target-error", "20%"]);
    let shown = succeed(&output);
    assert!(shown.contains("UGR  ") && shown.contains("panel: 6830 cd/m2"), "{shown}");
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    let refused = command.args(["glare", "absent.exr", "--time", "1s"]).output().unwrap();
    assert_refused(&refused, "--time is an option for scenes", "leave it out");
}

/// Eyes that are meters: one sees the panel, one looks away from it.
#[test]
fn meters_that_require_a_rating_are_eyes() {
    let folder = tempfile::tempdir().unwrap();
    let center = DVec3::new(0.3, 0.5, -2.0);
    write_room(folder.path(), center);
    let scene = folder.path().join("room.toml");
    let eye = |normal: &str, most: f64| {
        format!(
            "[[meter]]\nposition = [0, 0, 0]\nnormal = {normal}\nrequired_ugr = {most}\n\
             required_minimum = 1\n"
        )
    };
    let text = std::fs::read_to_string(&scene).unwrap();
    let eyes = [eye("[0, 0, -1]", 30.0), eye("[0, 0, -1]", 10.0), eye("[0, 0, 1]", 19.0)];
    write(&scene, text + &eyes.concat()).unwrap();
    let measure = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
        let own = ["measure", "room.toml", "--accel", "bvh", "--target-error", "1%", "--quiet"];
        command.current_dir(folder.path()).args(own).args(more).stdin(Stdio::null());
        command.output().unwrap()
    };
    let report = json(&measure(&["--json"]));
    let rated = json(&glare(folder.path(), &["--target-error", "1%", "--json", "--quiet"]));
    let number = |value: &serde_json::Value, key: &str| value[key].as_f64().unwrap();
    let verdict = |index: usize| {
        let rating = &report["meters"][index]["requirements"][1];
        assert_eq!((&rating["what"], &rating["limit"]), (&"largest UGR".into(), &"most".into()));
        rating["verdict"].as_str().unwrap().to_owned()
    };
    assert_eq!([0, 1, 2].map(verdict), ["met", "not-met", "met"]);
    let own = &report["meters"][0]["ugr"][0];
    let off = number(own, "value") - number(&rated["ugr"], "value");
    let expanded = number(own, "expanded").hypot(number(&rated["ugr"], "expanded"));
    assert!(off.abs() < 1.5 * expanded + 0.02 && expanded < 0.3, "{own} {rated}");
    assert!(report["meters"][2]["ugr"][0].is_null(), "no luminaire is in view");
    let text = succeed(&measure(&[])).to_owned();
    assert!(text.contains("largest UGR") && text.contains("at most 10: not met"), "{text}");
    // What looks at one point along a ray is no eye.
    let text = std::fs::read_to_string(&scene).unwrap().replace("normal", "direction");
    write(&scene, text).unwrap();
    assert_refused(&measure(&[]), "a meter of luminance has no glare rating", "`normal`");
}
