//! pbrt: parameters that `Attribute` replaces, coefficients by spectra, portals, and the lights of
//! objects.

use bdpm::import::WarningKind;
use bdpm::load::{LoadOptions, Loaded, load, load_with};
use bdpm::scene::Emitter;
use bdpm::scene::bsdf::{Bsdf, Reflectance};
use glam::Vec3;

const LIGHT: &str = "LightSource \"infinite\" \"rgb L\" [ 1 1 1 ]\n";
const BALL: &str = "Shape \"sphere\"\n";

fn read(text: &str) -> Loaded {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.pbrt");
    std::fs::write(&path, format!("WorldBegin\n{text}")).unwrap();
    load(&path).unwrap_or_else(|e| panic!("{e}"))
}

fn albedo(text: &str) -> Vec3 {
    let loaded = read(&[LIGHT, text, BALL].concat());
    loaded.scene.materials()[0].bsdf.albedo()
}

/// In pbrt the last of several parameters of one name counts, and parameters of the directive
/// precede those of `Attribute` (`ParameterDictionary`).
#[test]
fn last_attribute_of_a_name_counts() {
    let gray = "Attribute \"material\" \"rgb reflectance\" [.9 .9 .9]\n";
    let red = "Attribute \"material\" \"rgb reflectance\" [.8 .2 .1]\n";
    let own = "Material \"diffuse\" \"rgb reflectance\" [.1 .2 .3]\n";
    let twice =
        "Material \"diffuse\" \"rgb reflectance\" [.3 .3 .3] \"rgb reflectance\" [.4 .5 .6]\n";
    let plain = "Material \"diffuse\"\n";
    let [red_color, gray_color] = [Vec3::new(0.8, 0.2, 0.1), Vec3::splat(0.9)];
    for (text, expected) in [
        ([gray, red, plain].concat(), red_color),
        ([red, gray, plain].concat(), gray_color),
        ([red, gray, own].concat(), Vec3::new(0.1, 0.2, 0.3)),
        ([gray, twice].concat(), Vec3::new(0.4, 0.5, 0.6)),
        (["AttributeBegin\n", red, "AttributeEnd\n", gray, plain].concat(), gray_color),
    ] {
        let albedo = albedo(&text);
        assert!((albedo - expected).abs().max_element() < 1e-5, "{text}{albedo}");
    }
}

/// The absorption of the medium that this parameter describes, 1/scene unit.
fn absorption(sigma: &str) -> Vec3 {
    let medium = format!(
        "MakeNamedMedium \"ink\" \"string type\" \"homogeneous\" {sigma} \"rgb sigma_s\" [0 0 0]\n\
         MediumInterface \"ink\" \"\"\nMaterial \"interface\"\n"
    );
    let loaded = read(&[LIGHT, &medium, BALL].concat());
    let boundary = loaded.scene.materials().iter().find_map(|own| own.boundary.clone()).unwrap();
    boundary.interior.unwrap().absorption
}

/// Coefficients and refractive indices have the color of no light.
#[test]
fn constant_spectra_of_coefficients_and_indices_are_gray() {
    for (sigma, expected) in [
        ("\"spectrum sigma_a\" [200 1.5 900 1.5]", Vec3::splat(1.5)),
        ("\"rgb sigma_a\" [1.5 1.5 1.5]", Vec3::splat(1.5)),
        ("\"spectrum sigma_a\" [200 1.5 900 1.5] \"float scale\" 2", Vec3::splat(3.0)),
    ] {
        let absorption = absorption(sigma);
        assert!((absorption - expected).abs().max_element() < 1e-3, "{sigma}: {absorption}");
    }
    let metal = |eta: &str| {
        let text = format!("Material \"conductor\" {eta}\n");
        let loaded = read(&[LIGHT, &text, BALL].concat());
        let Bsdf::Conductor(metal) = loaded.scene.materials()[0].bsdf else { panic!() };
        let Reflectance::Measured { eta, k } = metal.reflectance() else { panic!() };
        [eta, k]
    };
    let [eta, k] = metal("\"spectrum eta\" [300 2 900 2] \"spectrum k\" [300 3 900 3]");
    assert!((eta - 2.0).abs().max_element() < 2e-3, "{eta}");
    assert!((k - 3.0).abs().max_element() < 3e-3, "{k}");
    // Cesium iodide has nearly the same index at all wavelengths.
    let [eta, _] = metal("\"spectrum eta\" \"metal-CsI-eta\" \"spectrum k\" \"metal-CsI-k\"");
    assert!((eta - 1.8).abs().max_element() < 0.05, "{eta}");
}

/// What the image lacks is an error for `--strict`.
#[test]
fn ignored_portals_are_reported_as_left_out() {
    let portal = "\"point3 portal\" [0 0 0 1 0 0 1 1 0 0 1 0]";
    let loaded = read(&format!("LightSource \"infinite\" \"rgb L\" [1 1 1] {portal}\n{BALL}"));
    let skipped = loaded.warnings.iter().find(|own| own.kind == WarningKind::Skipped);
    assert!(skipped.is_some_and(|own| own.text.contains("portal")), "{}", loaded.warnings_text());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.pbrt");
    let text = format!("WorldBegin\nLightSource \"infinite\" {portal}\n{BALL}");
    std::fs::write(&path, text).unwrap();
    let loaded = load_with(&path, &LoadOptions::default()).unwrap();
    assert!(loaded.warnings.iter().any(|own| own.kind == WarningKind::Skipped));
}

/// As in pbrt: area lights of objects do not shine, and other lights are where they are defined.
#[test]
fn lights_of_objects_are_reported_with_the_name_of_the_object() {
    let object = |light: &str| {
        let text = format!(
            "{LIGHT}ObjectBegin \"streetlamp\"\n{light}\n{BALL}ObjectEnd\n\
             Translate 3 0 0\nObjectInstance \"streetlamp\"\n"
        );
        read(&text)
    };
    let area = object("AreaLightSource \"diffuse\" \"rgb L\" [1 1 1]");
    let text = area.warnings_text();
    assert!(area.scene.lights().emitters().is_empty());
    assert!(text.contains("the emission of shapes of objects: `streetlamp`"), "{text}");
    let point = object("LightSource \"point\" \"point3 from\" [0 2 0]");
    let [Emitter::Point { position, .. }] = point.scene.lights().emitters() else { panic!() };
    assert_eq!(*position, Vec3::new(0.0, 2.0, 0.0));
    let text = point.warnings_text();
    assert!(text.contains("the lights of objects: `streetlamp`"), "{text}");
}
