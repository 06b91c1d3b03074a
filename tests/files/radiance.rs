//! Scenes of Radiance: surfaces, materials and light of known values, and errors.

use bdpm::base::photometry::LUMENS_PER_WATT;
use bdpm::import::WarningKind;
use bdpm::load::{Loaded, load};
use bdpm::scene::Emitter;
use bdpm::scene::bsdf::Bsdf;
use glam::Vec3;
use std::path::Path;

const SQUARE: &str = "12  0 0 0  1 0 0  1 1 0  0 1 0\n";

fn try_load(text: &str) -> bdpm::base::error::Result<Loaded> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rad");
    std::fs::write(&path, text).unwrap();
    load(&path)
}

fn read(text: &str) -> Loaded {
    try_load(text).unwrap_or_else(|e| panic!("{e}"))
}

/// A square of a material below a lamp.
fn with(material: &str) -> Loaded {
    read(&format!(
        "void light bright 0 0 3 1 1 1\nbright polygon lamp 0 0 12 0 0 2 0 1 2 1 1 2 1 0 2\n\
         {material}\nit polygon square 0 0 {SQUARE}"
    ))
}

fn bsdf(material: &str) -> Bsdf {
    let loaded = with(material);
    loaded.scene.materials().iter().find(|own| own.name == "it").expect("the material").bsdf
}

#[test]
fn example_of_all_elements_is_read() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/radiance/room.rad");
    let loaded = load(data).unwrap_or_else(|e| panic!("{e}"));
    let scene = &loaded.scene;
    assert!((scene.camera.position() - Vec3::new(0.0, -2.3, 1.6)).length() < 1e-6);
    let skipped: Vec<_> =
        loaded.warnings.iter().filter(|one| one.kind == WarningKind::Skipped).collect();
    assert!(skipped.is_empty(), "{skipped:?}");
    let lamp = scene.lights().power();
    let expected =
        0.48 * std::f32::consts::PI * Vec3::new(30.0, 28.0, 25.0) * 179.0 / LUMENS_PER_WATT;
    assert!((lamp / expected - 1.0).abs().max_element() < 1e-4, "{lamp} {expected}");
    // Inside of the box, three columns of 2 m.
    let bounds = scene.bounds();
    assert!((bounds.min - Vec3::new(-2.0, -2.5, 0.0)).length() < 1e-5, "{bounds:?}");
    assert!((bounds.max - Vec3::new(2.0, 2.5, 3.0)).length() < 1e-5, "{bounds:?}");
}

#[test]
fn materials_have_the_shares_of_the_file() {
    let Bsdf::Lambertian { albedo, .. } = bsdf("void plastic it 0 0 5 .2 .3 .4 0 0") else {
        panic!("no specular share is diffuse")
    };
    assert_eq!(albedo, Vec3::new(0.2, 0.3, 0.4));
    let Bsdf::Glossy(plastic) = bsdf("void plastic it 0 0 5 .2 .3 .4 .05 .1") else { panic!() };
    assert!((plastic.normal_reflectance() - 0.05).abs() < 1e-6);
    assert!((plastic.alpha() - 0.1).abs() < 1e-6);
    let Bsdf::Glossy(metal) = bsdf("void metal it 0 0 5 .7 .6 .5 .9 .2") else { panic!() };
    assert!((metal.metallic() - 0.9).abs() < 1e-6);
    let Bsdf::ThinDielectric(sheet) = bsdf("void glass it 0 0 3 .9 .8 .7") else { panic!() };
    assert_eq!((sheet.eta, sheet.internal), (1.52, Vec3::new(0.9, 0.8, 0.7)));
    let Bsdf::DiffuseTransmission(cloth) = bsdf("void trans it 0 0 7 .8 .8 .8 0 0 .25 0") else {
        panic!()
    };
    let [reflected, transmitted] = cloth.shares();
    assert!((reflected.x - 0.6).abs() < 1e-5 && (transmitted.x - 0.2).abs() < 1e-5);
}

/// Rays that a `trans` surface lets pass straight on do not meet it, and the rest adds up.
#[test]
fn straight_transmission_is_an_opening() {
    let loaded = with("void trans it 0 0 7 1 1 1 0 0 .5 .5");
    let own = loaded.scene.materials().iter().find(|own| own.name == "it").unwrap();
    let opacity = own.opacity.unwrap();
    assert!((opacity - 0.75).abs() < 1e-5, "{opacity}");
    let Bsdf::DiffuseTransmission(cloth) = own.bsdf else { panic!() };
    let [reflected, transmitted] = cloth.shares();
    assert!((opacity * reflected.x - 0.5).abs() < 1e-5, "{reflected}");
    assert!((opacity * transmitted.x - 0.25).abs() < 1e-5, "{transmitted}");
}

#[test]
fn suns_and_skies_light_the_scene() {
    let loaded = read(&format!(
        "void light solar 0 0 3 1e6 1e6 1e6\nsolar source sun 0 0 4 0 0 1 .5\n\
         void brightfunc skyfunc 2 skybright skybright.cal 0 3 2 10 2\n\
         skyfunc glow sky_glow 0 0 4 1 1 1 0\nsky_glow source sky 0 0 4 0 0 1 180\n\
         void plastic it 0 0 5 .5 .5 .5 0 0\nit polygon square 0 0 {SQUARE}"
    ));
    let scene = &loaded.scene;
    let factor = 179.0 / LUMENS_PER_WATT;
    let emitters = scene.lights().emitters();
    let [Emitter::Directional(sun)] = emitters else { panic!("{emitters:?}") };
    let expected = factor * 1e6 * std::f32::consts::PI * 0.25f32.to_radians().sin().powi(2);
    assert!((sun.irradiance.x / expected - 1.0).abs() < 1e-4 && sun.direction == -Vec3::Z);
    let sky = scene.lights().environment().unwrap();
    assert!((sky.radiance(Vec3::Z).x / (10.0 * factor) - 1.0).abs() < 0.01);
}

#[test]
fn later_materials_replace_earlier_ones_for_what_follows() {
    let loaded = read(&format!(
        "void light bright 0 0 3 1 1 1\nbright sphere lamp 0 0 4 0 0 3 .1\n\
         void plastic it 0 0 5 .1 .1 .1 0 0\nit polygon one 0 0 {SQUARE}\
         void plastic it 0 0 5 .9 .9 .9 0 0\nit polygon other 0 0 {SQUARE}"
    ));
    let albedo = |own: &bdpm::scene::Material| match own.bsdf {
        Bsdf::Lambertian { albedo, .. } if own.name == "it" => Some(albedo.x),
        _ => None,
    };
    let all: Vec<f32> = loaded.scene.materials().iter().filter_map(albedo).collect();
    assert_eq!(all, [0.1, 0.9]);
}

#[test]
fn errors_name_the_line_and_what_to_do() {
    let cases = [
        ("void plastic it 0 0 5 .5 .5 .5 0\n", "ends before", 1),
        ("void plastic it 0 0 x\n", "number of arguments", 1),
        ("void plastic it 0 0 5 .5 .5 .5 0 zero\n", "`zero` is not a number", 1),
        ("\nit polygon square 0 0 9 0 0 0 1 0 0 1 1 0\n", "`it` is not defined", 2),
        ("void plastic it 0 0 5 1 1 1 0 0\nit polygon s 0 0 6 0 0 0 1 1 1\n", "6 numbers", 2),
        ("void plastic it 0 0 5 1 1 1 0 0\nit torus s 0 0 0\n", "no known type", 2),
        ("!gensurf a b\n", "`gensurf` is not run", 1),
        ("!rm -rf x\n", "`rm` is not run", 1),
        ("\n\n!xform -t 1 nothing.rad\n", "is not a number", 3),
        ("!xform -t 1 0 0 nothing.rad\n", "no file `nothing.rad`", 1),
        ("!xform -a 1e9 -t 1 0 0 a.rad\n", "number of copies", 1),
        ("!xform a.rad\n", "include each other", 1),
        ("!genbox it box 1 2\n", "incomplete", 1),
        ("!xform -a 1000000 -t 1 0 0 -s 1 a.rad\n", "include each other", 1),
        ("void glass it 0 0 4 1 1 1 0\nit polygon s 0 0 9 0 0 0 1 0 0 1 1 0\n", "index 0", 2),
    ];
    for (text, problem, line) in cases {
        let Err(error) = try_load(text) else { panic!("{text} is read") };
        assert!(error.to_string().contains(problem), "{text}: {error}");
        assert_eq!(error.line_number(), Some(line), "{text}: {error}");
    }
}

/// An `illum` with an alternate is no light, but what stands behind it is.
#[test]
fn views_and_illums_are_those_of_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.rad");
    let scene = format!(
        "void light bright 0 0 3 1 1 1\nbright sphere lamp 0 0 4 5 5 5 .5\n\
         void illum it 1 void 0 3 9 9 9\nit polygon square 0 0 {SQUARE}"
    );
    std::fs::write(&path, scene).unwrap();
    let view = path.with_extension("vf");
    std::fs::write(&view, "rvu -vtv -vp 1 2 3 -vd 0 2 0 -vu 0 0 1 -vv 40 -vs .25 -vl -.5\n")
        .unwrap();
    let loaded = load(&path).unwrap();
    let camera = &loaded.scene.camera;
    assert_eq!((camera.position(), camera.direction()), (Vec3::new(1.0, 2.0, 3.0), Vec3::Y));
    assert_eq!(camera.shift(), [0.25, -0.5]);
    let it = loaded.scene.materials().iter().find(|own| own.name == "it").unwrap();
    assert_eq!((it.opacity, it.emission), (Some(0.0), Vec3::ZERO));
    for (text, line) in
        [("nothing\n", None), ("\nrvu -vp 1 2 x\n", Some(2)), ("rvu -vta -vp 0 0 0", Some(1))]
    {
        std::fs::write(&view, text).unwrap();
        let Err(error) = load(&path) else { panic!("{text} is read") };
        assert_eq!(error.line_number(), line, "{error}");
    }
}

#[test]
fn what_is_left_out_is_reported() {
    let pattern = "void colorpict wood 7 red green blue a.hdr . u v 0 0\n";
    let loaded = with(&format!("{pattern}wood plastic it 0 0 5 .5 .5 .5 0 0"));
    let texts: Vec<_> = loaded.warnings.iter().map(|own| own.text.clone()).collect();
    assert!(texts.iter().any(|own| own.contains("patterns") && own.contains("wood")), "{texts:?}");
}

/// A sheet by a BSDF file: the direction that is up is turned with the file that names it, and
/// diffuse shares of the numbers are added.
#[test]
fn sheets_scatter_by_bsdf_files() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    let transmission = super::klems::block("Transmission Front", |_, _| 0.1);
    put("blind.xml", &super::klems::xml("Columns", "Visible", &[transmission]));
    put("tree.xml", &super::klems::xml("TensorTree4", "Visible", &[]));
    let lamp =
        "void light bright 0 0 3 1 1 1\nbright polygon lamp 0 0 12 0 0 2 0 1 2 1 1 2 1 0 2\n";
    let loaded = |material: &str| {
        put("part.rad", &format!("{material}\nit polygon square 0 0 {SQUARE}"));
        put("a.rad", &format!("{lamp}!xform -rx 90 part.rad\n"));
        load(folder.path().join("a.rad"))
    };
    let sheet = |material: &str| {
        let loaded = loaded(material).unwrap_or_else(|error| panic!("{error}"));
        let own = loaded.scene.materials().iter().find(|own| own.name == "it").unwrap().bsdf;
        let skipped = loaded.warnings.iter().filter(|one| one.kind == WarningKind::Skipped);
        (own, skipped.map(|one| one.text.clone()).collect::<Vec<_>>().join("\n"))
    };
    let (own, notes) = sheet("void BSDF it 6 0 blind.xml 0 1 0 . 0 9 .3 .3 .3 0 0 0 .1 .1 .1");
    let Bsdf::Klems(klems) = own else { panic!("{own:?}") };
    assert!((klems.up() - Vec3::Z).length() < 1e-6 && notes.is_empty(), "{notes}");
    let shares = [true, false].map(|front| klems.diffuse_shares(front));
    let transmitted = 0.1 * std::f32::consts::PI + 0.1;
    for (found, expected) in shares.iter().flatten().zip([0.3, transmitted, 0.0, transmitted]) {
        assert!((found - expected).abs() < 1e-4, "{shares:?}");
    }
    let (_, notes) = sheet("void BSDF it 6 .1 blind.xml 0 1 0 . 0 0");
    assert!(notes.contains("without thickness"), "{notes}");
    let (_, notes) = sheet("void aBSDF it 5 blind.xml 0 1 0 . 0 0");
    assert!(notes.contains("spread over a patch"), "{notes}");
    let (own, notes) = sheet("void BSDF it 6 0 tree.xml 0 1 0 . 0 0");
    assert!(matches!(own, Bsdf::Lambertian { .. }) && notes.contains("TensorTree4"), "{notes}");
    for (wrong, problem) in [
        ("void BSDF it 6 0 absent.xml 0 1 0 . 0 0", "there is no BSDF file `absent.xml`"),
        ("void BSDF it 3 0 blind.xml up 0 0", "has no file with a direction"),
    ] {
        let refused = loaded(wrong).unwrap_err().to_string();
        assert!(refused.contains(problem) && refused.contains("part.rad:"), "{refused}");
    }
}
