//! IES and EULUMDAT files: their intensities, their errors, and luminaires of scene files.

use crate::common::gltf::{files, square};
use bdpm::base::math::luminance;
use bdpm::light::photometry::{
    LuminaireDescription, LuminaireFile, OpeningShape, write_eulumdat, write_lm63,
};
use bdpm::load::load;
use bdpm::scene::{Emitter, IntensityDistribution, Photometry};
use glam::{DVec3, Vec3};
use serde_json::{Value, json};
use std::f64::consts::PI;
use std::path::{Path, PathBuf};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

fn read(name: &str) -> LuminaireFile {
    LuminaireFile::read(&data(&format!("photometry/{name}"))).unwrap()
}

/// Direction of a polar angle and an azimuth of type C, degrees.
fn c(azimuth: f64, gamma: f64) -> DVec3 {
    let ((sin, cos), (y, x)) = (gamma.to_radians().sin_cos(), azimuth.to_radians().sin_cos());
    DVec3::new(sin * x, sin * y, -cos)
}

#[track_caller]
fn assert_near(found: f64, expected: f64) {
    assert!((found - expected).abs() < 1e-6 * expected.abs().max(1.0), "{found} {expected}");
}

#[test]
fn quadrants_are_mirrored_and_factors_apply() {
    let file = read("quarter.ies");
    assert_eq!((&file.name[..], file.watts, file.lamp_lumens), ("Two tubes", 40.0, Some(2000.0)));
    assert_eq!(file.opening, OpeningShape::Box([1.2, 0.2, 0.05]));
    assert!(file.notes.is_empty() && file.tilt.is_empty(), "{file:?}");
    let factor = 2.5 * 0.9;
    for (azimuth, gamma, value) in
        [(0.0, 60.0, 35.0), (30.0, 75.0, 20.0), (60.0, 45.0, 78.0), (90.0, 60.0, 62.0)]
    {
        for image in [azimuth, 180.0 - azimuth, 180.0 + azimuth, 360.0 - azimuth] {
            assert_near(file.distribution.intensity(c(image, gamma)), factor * value);
        }
    }
    // Bilinear in both angles, and nothing above
    assert_near(
        file.distribution.intensity(c(15.0, 67.5)),
        factor * (35.0 + 12.0 + 45.0 + 20.0) / 4.0,
    );
    assert_near(file.distribution.intensity(c(15.0, 90.1)), 0.0);
}

#[test]
fn tilt_and_dimensions_in_feet_are_read() {
    let file = read("tilted.ies");
    assert_eq!(file.tilt, [[0.0, 1.0], [45.0, 0.9], [90.0, 0.8]]);
    assert_near(file.tilt_factor(60.0), 0.9 - 0.1 / 3.0);
    assert_eq!([file.tilt_factor(-5.0), file.tilt_factor(120.0)], [1.0, 0.8]);
    let diameter = 0.5 * 0.3048;
    assert_eq!(file.opening, OpeningShape::Cylinder([diameter, diameter, 0.0]));
    // In 1995 the second factor is for future use. Absolute photometry has no lumens.
    assert_eq!(file.lamp_lumens, None);
    assert_near(file.distribution.intensity(c(90.0, 30.0)), 380.0);
    assert_near(file.distribution.intensity(c(270.0, 180.0 - 1e-9)), 2.0);
}

#[test]
fn types_a_and_b_have_their_axes() {
    let flood = read("flood.ies").distribution;
    assert_eq!(flood.photometry(), Photometry::B);
    let b = |v: f64, h: f64| {
        let ((sin, cos), (y, x)) = (h.to_radians().sin_cos(), v.to_radians().sin_cos());
        DVec3::new(cos * y, -sin, -cos * x)
    };
    for side in [-1.0, 1.0] {
        assert_near(flood.intensity(b(0.0, side * 20.0)), 4500.0);
        assert_near(flood.intensity(b(-30.0, side * 50.0)), 500.0);
    }
    assert_near(flood.intensity(b(20.0, 0.0)), 0.5 * (5000.0 + 1500.0));
    assert_near(flood.intensity(b(135.0, 0.0)), 0.0);

    let lamp = read("headlamp.ies").distribution;
    assert_eq!(lamp.photometry(), Photometry::A);
    let a = |v: f64, h: f64| {
        let ((sin, cos), (y, x)) = (v.to_radians().sin_cos(), h.to_radians().sin_cos());
        DVec3::new(sin, -cos * y, -cos * x)
    };
    assert_near(lamp.intensity(a(5.0, -10.0)), 1500.0);
    assert_near(lamp.intensity(a(-5.0, 40.0 - 1e-9)), 10.0);
    assert_near(lamp.intensity(a(31.0, 0.0)), 0.0);
    assert_near(lamp.intensity(a(0.0, -41.0)), 0.0);
}

#[test]
fn all_symmetries_of_eulumdat_are_completed() {
    let klm = 3.3;
    for (name, formula) in [
        ("none", (|c, _| 1.0 + 0.3 * f64::sin(c + 0.5)) as fn(f64, f64) -> f64),
        ("round", |_, _| 1.0),
        ("c0-c180", |c, _| 1.0 + 0.3 * c.cos()),
        ("c90-c270", |c, _| 1.0 + 0.3 * c.sin()),
        ("quadrants", |c, _| 1.0 + 0.3 * (2.0 * c).cos()),
    ] {
        let file = read(&format!("{name}.ldt"));
        assert_eq!((&file.name[..], file.lamp_lumens), (name, Some(3300.0)));
        assert_eq!(file.opening, OpeningShape::Box([0.18, 1.2, 0.0]));
        assert!(file.notes.is_empty(), "{:?}", file.notes);
        for gamma in [15.0, 45.0, 75.0] {
            for azimuth in [0.0, 60.0, 90.0, 120.0, 210.0, 300.0, 330.0f64] {
                let sine = f64::to_radians(gamma).sin();
                let varying = 1.0 + (formula(azimuth.to_radians(), gamma) - 1.0) * sine;
                let expected = klm * 300.0 * f64::to_radians(gamma).cos() * varying;
                let found = file.distribution.intensity(c(azimuth, gamma));
                // The files have three decimals.
                assert!(
                    (found - expected).abs() < 2e-3 * klm,
                    "{name} {azimuth}: {found} {expected}"
                );
            }
        }
    }
}

/// A file with these further sets of lamps after its own of 3300 lm and 62 W.
fn with_lamp_sets(others: &[&str]) -> tempfile::TempDir {
    let text = std::fs::read_to_string(data("photometry/round.ldt")).unwrap();
    let mut lines: Vec<&str> = text.lines().collect();
    let count = (1 + others.len()).to_string();
    lines[25] = &count;
    let further: Vec<&str> = others.iter().flat_map(|set| set.split(';')).collect();
    lines.splice(32..32, further);
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("sets.ldt"), lines.join("\r\n")).unwrap();
    folder
}

#[test]
fn sets_of_lamps_are_chosen_by_their_number() {
    let folder = with_lamp_sets(&["1;LED 830;6600;830;1A;40", "-1;LED 840;3960;840;1A;31,5"]);
    let path = folder.path().join("sets.ldt");
    let own = read("round.ldt");
    for (set, factor, lumens, watts) in [
        (None, 1.0, Some(3300.0), 62.0),
        (Some(2), 2.0, Some(6600.0), 40.0),
        (Some(3), 1.2, None, 31.5),
    ] {
        let file = LuminaireFile::read_with(&path, set).unwrap();
        assert_near(file.distribution.peak(), factor * own.distribution.peak());
        assert_eq!((file.lamp_lumens, file.watts), (lumens, watts));
        let note = file.notes.first().map_or("", |note| &note[..]);
        assert_eq!(set.is_none(), note.contains("2 (1 x LED 830, 6600 lm, 40 W)"), "{note}");
        assert_eq!(set.is_none(), note.contains("`lamp_set`"), "{note}");
    }
    let absent = LuminaireFile::read_with(&path, Some(4)).unwrap_err();
    assert_eq!(absent.line_number(), Some(26), "{absent}");
    assert!(absent.to_string().contains("the file has 3"), "{absent}");
    let single = LuminaireFile::read_with(&data("photometry/round.ldt"), Some(2)).unwrap_err();
    assert!(single.to_string().contains("the file has one"), "{single}");
    let ies = LuminaireFile::read_with(&data("photometry/quarter.ies"), Some(1)).unwrap_err();
    assert!(ies.to_string().contains("one set"), "{ies}");
}

#[test]
fn written_files_read_back_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let about = LuminaireDescription {
        name: "a lamp".into(),
        origin: "bdpm".into(),
        opening: OpeningShape::Cylinder([0.3, 0.2, 0.1]),
        lamp_lumens: Some(1234.5),
        watts: 12.5,
    };
    let names = ["quarter.ies", "tilted.ies", "flood.ies", "headlamp.ies", "none.ldt", "round.ldt"];
    for name in names {
        let distribution = read(name).distribution;
        let path = folder.path().join("written.ies");
        std::fs::write(&path, write_lm63(&distribution, &about)).unwrap();
        let again = LuminaireFile::read(&path).unwrap();
        assert_eq!(again.distribution, distribution, "{name}");
        assert_eq!((again.opening, again.lamp_lumens), (about.opening, about.lamp_lumens));
        assert!(again.notes.is_empty() && again.name == "a lamp" && again.watts == 12.5);

        let text = write_eulumdat(&distribution, &about);
        if distribution.photometry() != Photometry::C {
            assert!(text.unwrap_err().problem().contains("C planes"));
            continue;
        }
        let path = folder.path().join("written.ldt");
        std::fs::write(&path, text.unwrap()).unwrap();
        let again = LuminaireFile::read(&path).unwrap().distribution;
        assert_near(again.flux(), distribution.flux());
        for (azimuth, gamma) in [(10.0, 20.0), (100.0, 50.0), (250.0, 80.0), (359.0, 88.0)] {
            let of = |own: &IntensityDistribution| own.intensity(c(azimuth, gamma));
            assert_near(of(&again), of(&distribution));
        }
    }
}

#[track_caller]
fn refused(name: &str, change: impl Fn(&str) -> String, problem: &str) {
    let text = std::fs::read_to_string(data(&format!("photometry/{name}"))).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, change(&text)).unwrap();
    let shown = LuminaireFile::read(&path).unwrap_err().to_string();
    assert!(shown.contains(problem), "{shown}");
}

#[test]
fn errors_name_file_and_line() {
    let replace = |from: &'static str, to: &'static str| {
        move |text: &str| {
            assert!(text.contains(from), "{from}");
            text.replacen(from, to, 1)
        }
    };
    let ies = "quarter.ies";
    refused(ies, replace("TILT=NONE", ""), "quarter.ies: there is no line TILT=");
    refused(
        ies,
        replace("99 92", "99 bright"),
        "quarter.ies:15: `bright` stands for a candela value",
    );
    refused(ies, replace("0 15 30", "0 30 15"), "quarter.ies:10: a vertical angle is 15 after 30");
    refused(ies, replace("7 4 1 2", "7 4 4 2"), ":8: the photometric type is 4");
    refused(ies, replace("7 4 1 2", "7 4 1 3"), ":8: the type of units is 3");
    refused(ies, replace("7 4 1 2", "1 4 1 2"), ":8: the number of vertical angles is 1");
    refused(
        ies,
        replace("7 4 1 2", "7e9 4 1 2"),
        ":8: the number of vertical angles is 7000000000",
    );
    refused(ies, replace("0 30 60 90\n", "0 30 60 80\n"), "the planes are from 0 to 80 degrees");
    refused(ies, replace(", 36, 11", ""), ":17: the file ends before a candela value");
    refused(ies, replace("0.9 1 40", "0 1 40"), ":9: the multiplier times the ballast factor is 0");
    refused(ies, replace("0.2 1.2 0.05", "0.2 1.2 -0.05"), ":8: only the height");
    refused(ies, replace("TILT=NONE", "TILT=absent.tlt"), ":7: there is no file `absent.tlt`");
    refused("tilted.ies", replace("0 45 90\n", "0 45 190\n"), ":7: a tilt angle is 190");
    let ldt = "quadrants.ldt";
    refused(ldt, replace("\r\n3\r\n4\r\n", "\r\n3\r\n7\r\n"), "quadrants.ldt:3: the symmetry is 7");
    refused(ldt, replace("3300", "none"), "quadrants.ldt:29: `none` stands for the luminous flux");
    refused(ldt, |text| text[..text.len() * 3 / 4].into(), "the file ends before");
    refused(ldt, |text| text.replace("1200", "1e9"), ":21: the luminous opening has a dimension");
    refused(
        "none.ldt",
        replace("\r\n330\r\n", "\r\n10\r\n"),
        "the angle of a plane is 10 after 300",
    );
    let other = LuminaireFile::read(Path::new("lamp.txt")).unwrap_err().to_string();
    assert!(other.contains("lamp.txt: the file is neither an IES file"), "{other}");
}

/// A scene of a floor and this light.
fn scene(light: &str) -> bdpm::Result<bdpm::load::Loaded> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(
        folder.path().join("floor.obj"),
        "v -1 0 -1\nv -1 0 1\nv 1 0 1\nv 1 0 -1\nf 1 2 3 4\n",
    )
    .unwrap();
    for name in ["quarter.ies", "tilted.ies", "round.ldt"] {
        std::fs::copy(data(&format!("photometry/{name}")), folder.path().join(name)).unwrap();
    }
    let text = format!(
        "[camera]\nposition = [0, 2, 3]\ntarget = [0, 0, 0]\nfov_x_deg = 40\n[[mesh]]\n\
         file = \"floor.obj\"\n[[light]]\ntype = \"luminaire\"\n{light}\n"
    );
    std::fs::write(folder.path().join("scene.toml"), text).unwrap();
    load(folder.path())
}

fn power(light: &str) -> f64 {
    f64::from(luminance(scene(light).unwrap().scene.lights().power()))
}

#[test]
fn flux_of_luminaires_in_scenes_is_that_of_the_file_or_the_given_one() {
    let own = read("quarter.ies").distribution.flux() / 683.0;
    let near = |found: f64, expected: f64| assert!((found / expected - 1.0).abs() < 1e-5);
    let at = "file = \"quarter.ies\"\nposition = [0, 1, 0]\n";
    near(power(at), own);
    near(power(&format!("{at}opening = \"point\"")), own);
    near(power(&format!("{at}scale = 0.5\ncolor = [1, 0.5, 0.2]")), 0.5 * own);
    near(power(&format!("{at}lumen = 683")), 1.0);
    let tilted = read("tilted.ies").distribution.flux() / 683.0;
    near(power("file = \"tilted.ies\"\nposition = [0, 1, 0]\ntilt_deg = 45"), 0.9 * tilted);
    let round = read("round.ldt").distribution.flux() / 683.0;
    near(power("file = \"round.ldt\"\nposition = [0, 1, 0]\nlamp_set = 1"), round);
}

#[test]
fn luminaires_in_scenes_face_as_told() {
    let intensity = |keys: &str, direction: Vec3| {
        let text = format!(
            "file = \"quarter.ies\"\nposition = [0, 1, 0]\nopening = \"point\"\nscale = 683\n{keys}"
        );
        let loaded = scene(&text).unwrap();
        let [Emitter::Luminaire(lamp)] = loaded.scene.lights().emitters() else { panic!() };
        f64::from(lamp.aimed.intensity(direction).x)
    };
    // 60 degrees from the axis: 35 in C0 and 62 in C90
    let (half, rest) = (0.5f32, 0.75f32.sqrt());
    let [c0, c90] = [2.25 * 35.0, 2.25 * 62.0];
    let near = |found: f64, expected: f64| {
        assert!((found / expected - 1.0).abs() < 1e-4, "{found} {expected}");
    };
    near(intensity("", Vec3::new(rest, -half, 0.0)), c0);
    near(intensity("", Vec3::new(0.0, -half, rest)), c90);
    near(intensity("turn_deg = 90", Vec3::new(rest, -half, 0.0)), c90);
    near(intensity("c0 = [0, 0, 1]", Vec3::new(0.0, -half, rest)), c0);
    let aside = "direction = [0, 0, 2]\nc0 = [1, 0, 5]";
    near(intensity(aside, Vec3::new(rest, 0.0, half)), c0);
    near(intensity(aside, Vec3::new(0.0, rest, half)), c90);
    near(intensity("direction = [1, 0, 0]", Vec3::new(half, 0.0, -rest)), c0);
}

#[test]
fn openings_become_surfaces_of_the_stated_size() {
    let text = |own: &str| format!("file = \"quarter.ies\"\nposition = [0, 1, 0]\n{own}");
    let [loaded, hidden] = ["", "hidden = true"].map(|own| scene(&text(own)).unwrap());
    let scene = &loaded.scene;
    assert_eq!(scene.triangle_count(), 2 + 12);
    assert!(matches!(scene.lights().emitters(), [Emitter::Opening(_)]));
    let bounds = scene.bounds();
    // Length along C0, here x; the floor is from -1 to 1.
    assert!((bounds.max.y - 1.025).abs() < 1e-6, "{bounds:?}");
    assert!(!loaded.warnings_text().contains(".ies"), "{}", loaded.warnings_text());
    let is_hidden = |scene: &bdpm::Scene| {
        let mut openings = scene.materials().iter().filter(|one| one.luminous_opening.is_some());
        openings.next().unwrap().hidden_from_camera
    };
    assert!(!is_hidden(scene) && is_hidden(&hidden.scene));
}

#[test]
fn errors_about_luminaires_of_scenes_name_the_line() {
    let shown = |light: &str| scene(light).unwrap_err().to_string();
    let absent = shown("file = \"absent.ies\"\nposition = [0, 1, 0]");
    assert!(absent.contains("scene.toml:7") && absent.contains("no file `absent.ies`"), "{absent}");
    let both = shown("file = \"round.ldt\"\nposition = [0, 1, 0]\nscale = 1\nlumen = 5");
    assert!(both.contains("both `scale` and `lumen`"), "{both}");
    let along = shown("file = \"round.ldt\"\nposition = [0, 1, 0]\nc0 = [0, 1, 0]");
    assert!(along.contains("`c0` has no length"), "{along}");
    let dark = shown("file = \"round.ldt\"\nposition = [0, 1, 0]\nscale = -1");
    assert!(dark.contains("the factor of the intensity is -1"), "{dark}");
    let black = shown("file = \"round.ldt\"\nposition = [0, 1, 0]\ncolor = 0");
    assert!(black.contains("color of the luminaire is black"), "{black}");
    let set = shown("file = \"round.ldt\"\nposition = [0, 1, 0]\nlamp_set = 0");
    assert!(set.contains("scene.toml:7") && set.contains("`lamp_set` is 0"), "{set}");
    let set = shown("file = \"quarter.ies\"\nposition = [0, 1, 0]\nlamp_set = 1");
    assert!(set.contains("an IES file describes one set"), "{set}");
    let unknown = shown("file = \"round.ldt\"\nposition = [0, 1, 0]\nopening = \"lens\"");
    assert!(unknown.contains("unknown"), "{unknown}");
}

#[test]
fn flux_of_a_lambertian_file_is_pi_times_its_peak() {
    // The nodes are 15 degrees apart, between which a chord is up to 0.9 % below the cosine.
    let own = read("round.ldt").distribution;
    assert!((own.flux() / (PI * own.peak()) - 1.0).abs() < 0.01, "{}", own.flux());
}

#[test]
fn ies_profiles_of_gltf_files_are_placed_by_their_nodes() {
    let text = std::fs::read(data("photometry/quarter.ies")).unwrap();
    // By a file, and by a buffer view
    for by_view in [false, true] {
        let mut model = square();
        let profile = if by_view {
            let view = model.view(&text);
            json!({ "bufferView": view, "mimeType": "application/x-ies-lm-63" })
        } else {
            json!({ "uri": "quarter.ies" })
        };
        model.json["extensionsUsed"] = json!(["EXT_lights_ies"]);
        model.json["extensionsRequired"] = json!(["EXT_lights_ies"]);
        model.json["extensions"] = json!({ "EXT_lights_ies": { "lights": [profile] } });
        let own = json!({ "light": 0, "multiplier": 683, "color": [1, 0.5, 2] });
        // Half a right angle about y: -z turns toward -x, and x toward -z.
        let half = (PI / 8.0).sin_cos();
        let (position, scale) = ([1, 2, 3], [5, 5, 5]);
        model.node(json!({
            "extensions": { "EXT_lights_ies": own }, "translation": position, "scale": scale,
            "rotation": [0.0, half.0, 0.0, half.1], "name": "lamp",
        }));
        let model = files(&[("quarter.ies", &text), ("a.gltf", model.text().as_bytes())]);
        let loaded = model.load();
        assert_eq!(loaded.summary.light_names, ["lamp"]);
        let lights = loaded.scene.lights().emitters();
        let found = lights.iter().find_map(|light| match light {
            Emitter::Luminaire(lamp) => Some(lamp),
            _ => None,
        });
        let lamp = found.unwrap();
        assert_eq!(lamp.position, Vec3::new(1.0, 2.0, 3.0));
        let root = 0.5f32.sqrt();
        let (nadir, c0) = (Vec3::new(-root, 0.0, -root), Vec3::new(root, 0.0, -root));
        // Gamma 60 in C0 and in C90
        for (aside, value) in [(c0, 35.0), (Vec3::Y, 62.0)] {
            let direction = 0.5 * nadir + 0.75f32.sqrt() * aside;
            let intensity = lamp.aimed.intensity(direction);
            let expected = 2.25 * value * Vec3::new(1.0, 0.5, 1.0);
            assert!((intensity - expected).length() < 0.05, "{intensity} {expected}");
        }
    }
}

#[test]
fn malformed_ies_profiles_of_gltf_files_are_refused() {
    let refused = |lights: Value, own: Value, problem: &str| {
        let mut model = square();
        model.json["extensions"] = json!({ "EXT_lights_ies": { "lights": lights } });
        model.json["nodes"][0]["extensions"] = json!({ "EXT_lights_ies": own });
        files(&[("b.ies", b"TILT=NONE\n1 2 3"), ("a.gltf", model.text().as_bytes())])
            .refused(&[problem]);
    };
    let by = |light: usize| json!({ "light": light });
    refused(json!([{ "uri": "b.ies" }]), by(1), "EXT_lights_ies.light: there is no lights[1]");
    refused(json!([{}]), by(0), "lights[0]: it has neither uri nor bufferView");
    refused(json!([{ "uri": "b.ies" }]), by(0), "b.ies:2: the file ends before");
    refused(json!([{ "bufferView": 99 }]), by(0), "there is no bufferViews[99]");
}

/// Bright toward +y (C90), dark toward -y, and symmetric in x.
const LOPSIDED: &str = "IESNA:LM-63-2002
TILT=NONE
1 1000 1 2 5 1 2 0 0 0
1 1 10
0 90
0 90 180 270 360
1000 1000
1800 1800
1000 1000
200 200
1000 1000
";

#[test]
fn mirrored_nodes_mirror_their_profiles() {
    for (scale, bright) in [
        ([1, 1, 1], Vec3::Y),
        ([-1, 1, 1], Vec3::Y),
        ([1, -1, 1], Vec3::NEG_Y),
        ([-1, -1, 1], Vec3::NEG_Y),
        ([1, 1, -1], Vec3::Y),
        ([-2, -2, -2], Vec3::NEG_Y),
    ] {
        let mut model = square();
        model.json["extensionsUsed"] = json!(["EXT_lights_ies"]);
        model.json["extensions"] = json!({ "EXT_lights_ies": { "lights": [{ "uri": "a.ies" }] } });
        let own = json!({ "light": 0, "multiplier": 683 });
        model.node(json!({ "extensions": { "EXT_lights_ies": own }, "scale": scale }));
        let text = model.text();
        let list = [("a.ies", LOPSIDED.as_bytes()), ("a.gltf", text.as_bytes())];
        let loaded = files(&list).load();
        let lights = loaded.scene.lights().emitters();
        let found = lights.iter().find_map(|light| match light {
            Emitter::Luminaire(lamp) => Some(lamp.aimed.clone()),
            _ => None,
        });
        let lamp = found.unwrap();
        let nadir = Vec3::new(0.0, 0.0, if scale[2] < 0 { 1.0 } else { -1.0 });
        for (aside, value) in [(bright, 1800.0), (-bright, 200.0), (Vec3::X, 1000.0)] {
            let intensity = lamp.intensity((nadir + aside).normalize()).x;
            assert!((intensity / value - 1.0).abs() < 1e-4, "{scale:?} {aside}: {intensity}");
        }
    }
}
