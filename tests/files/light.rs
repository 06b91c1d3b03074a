//! Default light of scenes without a usable light source, and environments of all kinds.

use crate::common::gltf::*;
use crate::common::program_output::{json as output, succeed};
use bdpm::image_io::{Image, Layer, write_exr};
use bdpm::import::{EnvironmentSource, WarningKind};
use bdpm::load::{LoadOptions, load, load_with};
use bdpm::scene::Emitter;
use glam::Vec3;
use serde_json::{Value, json};
use std::f32::consts::TAU;
use std::process::Command;

/// A closed cube from -1 to 1 with a camera in its middle, of this material.
fn room(material: Value) -> Model {
    let mut model = Model::new();
    let corner = |i: usize| [0, 1, 2].map(|axis| if i >> axis & 1 == 0 { -1.0 } else { 1.0 });
    let positions = model.points(&std::array::from_fn::<_, 8, _>(corner));
    let sides: [[u16; 4]; 6] =
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]];
    let triangles: Vec<u16> =
        sides.iter().flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d]).collect();
    let indices = model.indices(&triangles);
    model.push("materials", material);
    let part =
        json!({ "attributes": { "POSITION": positions }, "indices": indices, "material": 0 });
    model.push("meshes", json!({ "primitives": [part] }));
    model.node(json!({ "mesh": 0 }));
    model.push(
        "cameras",
        json!({ "type": "perspective", "perspective": { "yfov": 1, "znear": 0.1 } }),
    );
    model.node(json!({ "camera": 0, "translation": [0.1, 0.2, 0.3] }));
    model
}

/// A small lamp of this radiance, facing this way along z, at this height of z.
fn with_lamp(mut model: Model, radiance: f32, z: f32, up: bool) -> Model {
    let (lamp, size) = (json!({ "emissiveFactor": [radiance, radiance, radiance] }), 0.05);
    let material = model.push("materials", lamp);
    let mut corners = [[-size, -size, z], [size, -size, z], [0.0, size, z]];
    if !up {
        corners.swap(0, 1);
    }
    let positions = model.points(&corners);
    let part = json!({ "attributes": { "POSITION": positions }, "material": material });
    let mesh = model.push("meshes", json!({ "primitives": [part] }));
    model.node(json!({ "mesh": mesh }));
    model
}

#[test]
fn lamps_that_light_nothing_get_a_default_environment() {
    // Behind a wall that the camera sees the other side of, or in front of it with its back to all.
    for (z, up) in [(-0.5, false), (0.5, true)] {
        let loaded = with_lamp(square(), 1.0, z, up).load();
        let warnings = loaded.warnings_text();
        let environment = loaded.scene.lights().environment().is_some();
        assert!(
            environment
                && warnings.contains("of the visible surfaces black; added soft gray light"),
            "{warnings}"
        );
        assert_eq!(loaded.scene.lights().emitters().len(), 1, "its own light stays");
    }
    // One that shines at the wall is light, however weak.
    for radiance in [1.0, 1e-6] {
        let loaded = with_lamp(square(), radiance, 0.5, false).load();
        assert!(loaded.scene.lights().environment().is_none(), "{}", loaded.warnings_text());
    }
}

#[test]
fn dark_rooms_get_a_lamp_and_lit_rooms_keep_their_light() {
    let loaded = room(grey()).load();
    let warnings = loaded.warnings_text();
    assert!(
        warnings.contains("nothing emits light") && warnings.contains("a point light of"),
        "{warnings}"
    );
    let [Emitter::Point { position, .. }] = loaded.scene.lights().emitters() else {
        panic!("{warnings}")
    };
    assert!(position.x == 0.1 && position.y > 0.2 && position.y < 1.0, "{position}");
    let lit = with_lamp(room(grey()), 1.0, 0.9, false).load();
    assert!(lit.scene.lights().environment().is_none(), "{}", lit.warnings_text());
    assert_eq!(lit.scene.lights().emitters().len(), 1);
    // A lamp beyond its walls does not light it.
    let unlit = with_lamp(room(grey()), 1.0, 1.5, true).load();
    assert!(matches!(
        unlit.scene.lights().emitters(),
        [Emitter::Point { .. }, Emitter::Triangle { .. }]
    ));
    let again = with_lamp(room(grey()), 1.0, 1.5, true).load();
    assert_eq!(unlit.scene.fingerprint(), again.scene.fingerprint());
}

#[test]
fn placed_lights_suffice_if_they_light_a_fifth() {
    let spot = |outer: f32| {
        let mut model = square();
        let cones = json!({ "innerConeAngle": 0.9 * outer, "outerConeAngle": outer });
        let light = json!({ "type": "spot", "intensity": 1, "spot": cones });
        model.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [light] } });
        let light = json!({ "KHR_lights_punctual": { "light": 0 } });
        model.node(json!({ "translation": [0, 0, 1], "extensions": light }));
        model.load()
    };
    let wide = spot(0.8);
    assert!(wide.scene.lights().environment().is_none(), "{}", wide.warnings_text());
    // It lights 0.03 of an area of 4, with a radiance of 0.5/pi/683 in the middle.
    let narrow = spot(0.1);
    let above = narrow.scene.lights().environment_radiance(Vec3::Y).x;
    let typical = 0.5 / std::f32::consts::PI / 683.0;
    assert!(above > 0.1 * typical && above < 3.0 * typical, "{above} {}", narrow.warnings_text());
}

#[test]
fn metals_without_surroundings_get_an_environment() {
    let metal = json!({ "pbrMetallicRoughness": { "roughnessFactor": 0.0 } });
    let mut model = square();
    model.json["materials"][0] = metal;
    let (scene, warnings) = {
        let loaded = model.load();
        (loaded.scene.clone(), loaded.warnings_text())
    };
    assert!(
        warnings.contains("nothing emits light; added soft gray light around it"),
        "{warnings}"
    );
    let [below, above] =
        [-1.0, 1.0].map(|y| scene.lights().environment_radiance(Vec3::new(0.0, y, 0.0)).x);
    assert!(below < 0.01 && above > 1.19, "{below} {above}");
}

#[test]
fn requested_environments_apply_to_every_format() {
    let bare = square().files();
    let obj = files(&[("a.obj", SQUARE_OBJ.as_bytes())]);
    let toml = "camera = { position = [0, 0, 5], target = [0, 0, 0], fov_x_deg = 40 }\n\
                environment = { radiance = 3 }\n[[mesh]]\nfile = 'a.obj'\n";
    let toml = files(&[("a.obj", SQUARE_OBJ.as_bytes()), ("a.toml", toml.as_bytes())]);
    let source: EnvironmentSource = "0.5,1,2".parse().unwrap();
    let given = LoadOptions { environment: Some(&source), ..LoadOptions::default() };
    let none = LoadOptions { no_fallback_light: true, ..LoadOptions::default() };
    for files in [&bare, &obj, &toml] {
        let own = load(&files.1).unwrap().scene;
        let loaded = load_with(&files.1, &given).unwrap();
        assert_eq!(loaded.scene.lights().environment_radiance(Vec3::X), Vec3::new(0.5, 1.0, 2.0));
        assert_ne!(loaded.scene.fingerprint(), own.fingerprint());
        assert!(!loaded.warnings_text().contains("nothing emits"));
    }
    let warnings = load_with(&toml.1, &given).unwrap().warnings_text();
    assert!(warnings.contains("the given environment replaces that of the file"), "{warnings}");
    for files in [&bare, &obj] {
        let error = load_with(&files.1, &none).err().unwrap().to_string();
        assert!(
            error.contains("the scene has no light") && error.contains("give an environment"),
            "{error}"
        );
    }
    let lamp = with_lamp(square(), 1.0, -0.5, false).files();
    let dark = load_with(&lamp.1, &none).unwrap();
    assert!(dark.scene.lights().environment().is_none());
}

#[test]
fn invalid_environment_pixels_become_black() {
    let folder = tempfile::TempDir::new().unwrap();
    let path = folder.path().join("sky.exr");
    let bad = [Vec3::NAN, Vec3::new(1.0, -1.0, 1.0), Vec3::new(0.0, f32::INFINITY, 0.0)];
    let pixels: Vec<Vec3> = [Vec3::ONE; 5].into_iter().chain(bad).collect();
    let layers = vec![Layer::rgb("", &pixels)];
    let image = Image { width: 4, height: 2, layers, metadata: Default::default() };
    write_exr(&path, &image).unwrap();
    let source = EnvironmentSource::File(path.clone());
    let given = LoadOptions { environment: Some(&source), ..LoadOptions::default() };
    let loaded = load_with(&square().files().1, &given).unwrap();
    let warning = loaded.warnings.iter().find(|warning| warning.text.contains("sky.exr")).unwrap();
    assert_eq!(warning.kind, WarningKind::Skipped);
    assert!(
        warning.text.contains("3 pixels are negative or not finite, the first at (1, 1)"),
        "{warning}"
    );
    // In the middle of each pixel of 4 longitudes and 2 latitudes.
    for (index, expected) in [[1.0; 5].to_vec(), vec![0.0; 3]].concat().into_iter().enumerate() {
        let longitude = TAU * ((index % 4) as f32 + 0.5 - 2.0) / 4.0;
        let (sin, cos) = longitude.sin_cos();
        let y = if index < 4 { 1.0 } else { -1.0 };
        let found = loaded.scene.lights().environment_radiance(Vec3::new(sin, y, -cos).normalize());
        assert_eq!(found, Vec3::splat(expected), "{index}");
    }
}

#[test]
fn render_command_adds_light_or_reports_black_images() {
    let folder = tempfile::TempDir::new().unwrap();
    let out = folder.path().join("out.exr");
    let lamp = with_lamp(square(), 1.0, -0.5, false).files();
    let run = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
        command.arg(arguments[0]).arg(&lamp.1).args(&arguments[1..]).output().unwrap()
    };
    let small = ["--resolution", "16x16", "--light-paths", "100", "--camera-paths", "1"];
    let render = |more: &[&str]| {
        let mut arguments = vec!["render", "--iterations", "1", "-o", out.to_str().unwrap()];
        arguments.extend(small.iter().chain(more));
        let done = run(&arguments);
        succeed(&done);
        String::from_utf8(done.stderr).unwrap()
    };
    let told = render(&["--no-fallback-light"]);
    assert!(told.contains("is black\nhelp: add an environment by --environment"), "{told}");
    let told = render(&[]);
    assert!(told.contains("added soft gray light") && !told.contains("warning"), "{told}");
    let advice = "\nhelp: give another environment, or disable the default light\n\
                  options: --environment, --no-fallback-light\n";
    assert!(told.contains(advice), "{told}");
    let fingerprint = |more: &[&str]| {
        let arguments: Vec<&str> = ["info", "--json"].iter().chain(more).copied().collect();
        output(&run(&arguments))["fingerprint"].clone()
    };
    let all = [&[][..], &["--environment", "2"], &["--no-fallback-light"]].map(fingerprint);
    assert!(all[0] != all[1] && all[1] != all[2] && all[0] != all[2]);
    // The copy has the light as its own.
    let copy = folder.path().join("copy");
    let converted = output(&run(&["convert", copy.to_str().unwrap(), "--json"]));
    assert_eq!(converted["fingerprints"][0], converted["fingerprints"][1]);
    assert_eq!(converted["fingerprints"][0], all[0]);
}

/// A map of 8 by 4 pixels with two lit ones at (5, 1), of which a file holds a part, or more.
#[test]
fn environment_maps_are_display_windows() {
    use exr::prelude::*;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let bright = |x: i64, y: i64| if (5..7).contains(&x) && y == 1 { 1.0 } else { 0.0 };
    for (position, size) in [([0, 0], [8, 4]), ([4, 1], [3, 2]), ([-2, -1], [12, 6])] {
        let pixel = |at: Vec2<usize>| {
            let [x, y] = [at.0 as i64 + position[0], at.1 as i64 + position[1]];
            // Outside of the display window.
            let hidden = if (0..8).contains(&x) && (0..4).contains(&y) { 0.0 } else { 9.0 };
            let value = bright(x, y) as f32 + hidden;
            (value, value, value)
        };
        let attributes = LayerAttributes {
            layer_position: Vec2(position[0] as i32, position[1] as i32),
            ..LayerAttributes::default()
        };
        let layer = Layer::new(
            (size[0], size[1]),
            attributes,
            Encoding::UNCOMPRESSED,
            SpecificChannels::rgb(pixel),
        );
        let mut image = Image::from_layer(layer);
        image.attributes.display_window = IntegerBounds::from_dimensions((8, 4));
        image.write().to_file(&path).unwrap();
        let image = bdpm::import::read_radiance(&path).unwrap();
        let ((width, height), pixels) = (image.size, image.pixels);
        assert_eq!((width, height), (8, 4));
        let lit: Vec<usize> = (0..32).filter(|i| pixels[*i] != glam::Vec3::ZERO).collect();
        assert_eq!(lit, [13, 14], "{position:?}");
    }
}

/// A Radiance file of one pixel, without run lengths.
fn hdr(header: &str, pixel: [u8; 4]) -> Vec<u8> {
    let head = format!("#?RADIANCE\n{header}FORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 1\n");
    [head.as_bytes(), &pixel].concat()
}

#[test]
fn exposure_and_primaries_of_hdr_files_count() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hdr");
    let pixel = [128, 64, 32, 129];
    let read = |header: &str| {
        std::fs::write(&path, hdr(header, pixel)).unwrap();
        bdpm::import::read_radiance(&path).unwrap().pixels[0]
    };
    let plain = read("");
    assert!((plain.x / plain.y - 2.0).abs() < 1e-2, "{plain}");
    assert!((read("EXPOSURE=2\nEXPOSURE= 2.0\n") - plain / 4.0).length() < 1e-6);
    let corrected = read("COLORCORR=1 2 4\n");
    assert!((corrected - plain / glam::Vec3::new(1.0, 2.0, 4.0)).length() < 1e-6, "{corrected}");
    assert_eq!(read("EXPOSURE=nan\nEXPOSURE=0\nPRIMARIES=1\n"), plain);
    let usual = "PRIMARIES=0.6400 0.3300 0.2900 0.6000 0.1500 0.0600 0.3333 0.3333\n";
    assert_eq!(read(usual), plain);
    // Red and green are exchanged.
    let swapped = "PRIMARIES=0.3000 0.6000 0.6400 0.3300 0.1500 0.0600 0.3127 0.3290\n";
    let found = read(swapped);
    assert!((found.x - plain.y).abs() + (found.y - plain.x).abs() < 1e-4, "{found}");
}

#[test]
fn primaries_of_exr_files_are_converted() {
    use exr::prelude::*;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.exr");
    let mut image =
        Image::from_channels((2, 1), SpecificChannels::rgb(|_| (1.0_f32, 0.5_f32, 0.25_f32)));
    let pair = |x: f32, y: f32| Vec2(x, y);
    image.attributes.chromaticities = Some(exr::meta::attribute::Chromaticities {
        red: pair(0.3, 0.6),
        green: pair(0.64, 0.33),
        blue: pair(0.15, 0.06),
        white: pair(0.3127, 0.3290),
    });
    image.write().to_file(&path).unwrap();
    let pixels = bdpm::import::read_radiance(&path).unwrap().pixels;
    assert!((pixels[1] - glam::Vec3::new(0.5, 1.0, 0.25)).length() < 1e-5, "{}", pixels[1]);
}
