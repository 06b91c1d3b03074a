//! Mitsuba's scenes: conversion of elements, and errors with their position.

use bdpm::import::WarningKind;
use bdpm::load::{Loaded, export, load};
use bdpm::scene::bsdf::{Bsdf, DiffuseTransmission, FacetModel, Principled, PrincipledParameters};
use bdpm::scene::{Emitter, RefractiveIndex};
use glam::Vec3;
use std::path::{Path, PathBuf};
use tempfile::TempDir;

/// The files that are also rendered by Mitsuba itself (`scripts/mitsuba-check.sh --elements`).
fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/mitsuba")
}

pub(super) const CAMERA: &str = "<sensor type='perspective'><float name='fov' value='40'/><transform name='to_world'>\
    <lookat origin='0, 0, 5' target='0, 0, 0' up='0, 1, 0'/></transform></sensor>\n";
pub(super) const LIGHT: &str = "<emitter type='constant'/>\n";
pub(super) const SQUARE: &str = "<shape type='rectangle'/>\n";

pub(super) fn scene(inside: &str) -> String {
    format!("<scene version='3.0.0'>\n{inside}</scene>\n")
}

/// A folder with this text as `a.xml`.
pub(super) fn folder(text: &str) -> TempDir {
    let folder = TempDir::new().unwrap();
    std::fs::write(folder.path().join("a.xml"), text).unwrap();
    folder
}

#[track_caller]
pub(super) fn read(text: &str) -> Loaded {
    load(folder(text).path().join("a.xml")).unwrap_or_else(|e| panic!("{e}"))
}

/// A scene of camera, light and what is inside.
#[track_caller]
pub(super) fn with(inside: &str) -> Loaded {
    read(&scene(&[CAMERA, LIGHT, inside].concat()))
}

/// The square of this BSDF.
#[track_caller]
fn look(bsdf: &str) -> Bsdf {
    with(&format!("<shape type='rectangle'>{bsdf}</shape>")).scene.materials()[0].bsdf
}

/// The text must be refused with all parts in the message.
#[track_caller]
pub(super) fn refused(text: &str, parts: &[&str]) {
    let error = load(folder(text).path().join("a.xml")).expect_err("it is wrong").to_string();
    for part in parts {
        assert!(error.contains(part), "{part} is not in\n{error}");
    }
    assert!(error.contains("\nhelp: ") && error.len() < 5000, "{error}");
}

#[test]
fn committed_mitsuba_files_load_and_export() {
    let mut count = 0;
    for entry in std::fs::read_dir(data()).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if !name.ends_with(".xml") || ["base.xml", "ground.xml"].contains(&&name[..]) {
            continue;
        }
        count += 1;
        let loaded = load(&path).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(loaded.defaults.resolution.unwrap()[0], 64, "{name}");
        let folder = TempDir::new().unwrap();
        export(&loaded, &name, folder.path(), false).unwrap_or_else(|e| panic!("{name}: {e}"));
        let again = load(folder.path()).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_eq!(loaded.scene.materials().len(), again.scene.materials().len(), "{name}");
        for (a, b) in loaded.scene.materials().iter().zip(again.scene.materials()) {
            assert_eq!((a.bsdf, a.emission), (b.bsdf, b.emission), "{name}: {}", a.name);
        }
        assert_eq!(loaded.scene.camera, again.scene.camera, "{name}");
        assert_eq!(loaded.scene.triangle_count(), again.scene.triangle_count(), "{name}");
    }
    assert!(count >= 26, "{count}");
}

#[test]
fn parameters_aliases_references_and_includes_are_resolved() {
    let folder = folder(&scene(
        "<default name='grey' value='0.25'/><default name='greyer' value='0.125'/>\n\
         <include filename='b.xml'/>\n<alias id='look' as='other'/>\n\
         <shape type='rectangle'><ref id='other'/></shape>\n",
    ));
    let inner = [
        CAMERA,
        LIGHT,
        "<default name='grey' value='0.9'/><bsdf type='diffuse' id='look'>\
         <rgb name='reflectance' value='$grey, $greyer, 0'/></bsdf>",
    ];
    std::fs::write(folder.path().join("b.xml"), scene(&inner.concat())).unwrap();
    let loaded = load(folder.path().join("a.xml")).unwrap();
    let material = &loaded.scene.materials()[0];
    assert_eq!(material.name, "look");
    let albedo = Vec3::new(0.25, 0.125, 0.0);
    assert_eq!(material.bsdf, Bsdf::Lambertian { albedo, two_sided: false });
}

#[test]
fn transforms_are_applied_in_their_order() {
    let placed = |steps: &str| {
        let shape = format!(
            "<shape type='rectangle'><transform name='to_world'>{steps}</transform></shape>"
        );
        let bounds = *with(&shape).scene.bounds();
        (bounds.center(), bounds.max - bounds.min)
    };
    for (steps, center, size) in [
        ("<translate x='1'/><scale value='2'/>", [2.0, 0.0, 0.0], [4.0, 4.0, 0.0]),
        ("<scale x='2'/><translate value='1, 2, 3'/>", [1.0, 2.0, 3.0], [4.0, 2.0, 0.0]),
        ("<rotate y='1' angle='90'/>", [0.0; 3], [0.0, 2.0, 2.0]),
        ("<matrix value='0 0 1 5 0 1 0 6 -1 0 0 7 0 0 0 1'/>", [5.0, 6.0, 7.0], [0.0, 2.0, 2.0]),
        ("<matrix value='3 0 0 0 1 0 0 0 1'/>", [0.0; 3], [6.0, 2.0, 0.0]),
        (
            "<lookat origin='1, 0, 0' target='2, 0, 0' up='0, 0, 1'/>",
            [1.0, 0.0, 0.0],
            [0.0, 2.0, 2.0],
        ),
    ] {
        let (own_center, own_size) = placed(steps);
        assert!((own_center - Vec3::from_array(center)).length() < 1e-5, "{steps}: {own_center}");
        assert!((own_size - Vec3::from_array(size)).length() < 1e-5, "{steps}: {own_size}");
    }
}

#[test]
fn mirrored_meshes_face_as_in_mitsuba() {
    // As `si.n` of mitsuba 3.9.1 says, where its normals do not say the other: the front is that of
    // the corners.
    let up = |kind: &str, file: &str, more: &str| {
        let text = format!(
            "<shape type='{kind}'>{file}{more}<transform name='to_world'><scale x='-1'/></transform></shape>"
        );
        let folder = folder(&scene(&[CAMERA, LIGHT, &text].concat()));
        let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nf 1 2 3\n";
        std::fs::write(folder.path().join("a.obj"), obj).unwrap();
        std::fs::write(folder.path().join("b.obj"), obj.replace("f 1 2 3", "f 1//1 2//1 3//1"))
            .unwrap();
        let loaded = load(folder.path().join("a.xml")).unwrap_or_else(|e| panic!("{e}"));
        loaded.scene.triangles()[0].normal.z > 0.0
    };
    let [a, b] = ["a", "b"].map(|name| format!("<string name='filename' value='{name}.obj'/>"));
    let flip = "<boolean name='flip_normals' value='true'/>";
    let flat = "<boolean name='face_normals' value='true'/>";
    assert!(!up("obj", &a, "") && up("obj", &a, flip));
    assert!(up("obj", &b, "") && !up("obj", &b, flip) && !up("obj", &b, flat));
    assert!(up("rectangle", "", "") && !up("rectangle", "", flip));
}

#[test]
fn mitsuba_materials_are_converted() {
    let Bsdf::Conductor(metal) = look(
        "<bsdf type='twosided'><bsdf type='roughconductor'><string name='material' value='Cu'/>\
         <float name='alpha' value='0.2'/><rgb name='specular_reflectance' value='0.5'/></bsdf></bsdf>",
    ) else {
        panic!()
    };
    assert_eq!(
        (metal.alpha(), metal.single()),
        (0.2, Some((FacetModel::Beckmann, Vec3::splat(0.5))))
    );
    assert_eq!(look("<bsdf type='conductor'/>"), Bsdf::Mirror { reflectance: Vec3::ONE });
    let Bsdf::RoughDielectric(glass) = look(
        "<bsdf type='roughdielectric'><string name='distribution' value='ggx'/>\
         <string name='int_ior' value='diamond'/><float name='ext_ior' value='1'/></bsdf>",
    ) else {
        panic!()
    };
    assert_eq!((glass.model(), glass.alpha(), glass.eta()), (FacetModel::Ggx, 0.1, 2.419));
    let Bsdf::Dielectric(glass) = look("<bsdf type='dielectric'/>") else { panic!() };
    assert!((glass.eta - 1.504_183).abs() < 1e-6, "as mitsuba 3.9.1 says: {}", glass.eta);
    assert!(matches!(look("<bsdf type='thindielectric'/>"), Bsdf::ThinDielectric(_)));
    for spectrum in [
        "<spectrum name='int_ior' value='400:1.6, 700:1.5'/>",
        "<spectrum type='irregular' name='int_ior'><string name='wavelengths' value='400, 700'/>\
         <string name='values' value='1.6, 1.5'/></spectrum>",
        "<spectrum type='regular' name='int_ior'><float name='wavelength_min' value='400'/>\
         <float name='wavelength_max' value='700'/><string name='values' value='1.6, 1.5'/></spectrum>",
    ] {
        let bsdf =
            format!("<bsdf type='dielectric'>{spectrum}<float name='ext_ior' value='1'/></bsdf>");
        let loaded = with(&format!("<shape type='rectangle'>{bsdf}</shape>"));
        assert_eq!(loaded.warnings_text(), "", "{spectrum}");
        let dispersion = loaded.scene.materials()[0].dispersion.clone().expect(spectrum);
        let table = RefractiveIndex::Table(vec![[400.0, 1.6], [700.0, 1.5]]);
        assert_eq!(dispersion.inside(), &table, "{spectrum}");
    }
    for is_nonlinear in [true, false] {
        let Bsdf::Plastic(plastic) = look(&format!(
            "<bsdf type='plastic'><boolean name='nonlinear' value='{is_nonlinear}'/>\
             <rgb name='diffuse_reflectance' value='1, 0.5, 0'/>\
             <rgb name='specular_reflectance' value='1, 0.5, 0.2'/></bsdf>"
        )) else {
            panic!()
        };
        assert_eq!(plastic.is_nonlinear(), is_nonlinear);
        assert_eq!(plastic.albedo(), Vec3::new(1.0, 0.5, 0.0));
        assert_eq!(plastic.tint(), Vec3::new(1.0, 0.5, 0.2));
        assert_eq!(plastic.facets().alpha, 0.0);
        assert!((plastic.eta() - 1.49 / 1.000_277).abs() < 1e-6);
    }
    let Bsdf::Plastic(rough) = look("<bsdf type='roughplastic'/>") else { panic!() };
    assert_eq!((rough.facets().model, rough.facets().alpha), (FacetModel::Beckmann, 0.1));
    assert_eq!(
        look(
            "<bsdf type='blendbsdf'><float name='weight' value='0.25'/><bsdf type='diffuse'>\
             <rgb name='reflectance' value='0.8, 0, 0'/></bsdf><bsdf type='diffuse'>\
             <rgb name='reflectance' value='0, 0.4, 0'/></bsdf></bsdf>"
        ),
        Bsdf::Lambertian { albedo: Vec3::new(0.6, 0.1, 0.0), two_sided: false }
    );
    let sheet = |reflectance, transmittance| {
        Bsdf::DiffuseTransmission(DiffuseTransmission::new(reflectance, transmittance))
    };
    assert_eq!(look("<bsdf type='difftrans'/>"), sheet(Vec3::ZERO, Vec3::splat(0.5)));
    assert_eq!(
        look(
            "<bsdf type='blendbsdf'><float name='weight' value='0.25'/><bsdf type='diffuse'>\
             <rgb name='reflectance' value='0.8, 0, 0'/></bsdf><bsdf type='difftrans'>\
             <rgb name='transmittance' value='0, 0.4, 0'/></bsdf></bsdf>"
        ),
        sheet(Vec3::new(0.6, 0.0, 0.0), Vec3::new(0.0, 0.1, 0.0))
    );
    assert_eq!(
        look(
            "<bsdf type='principledthin'><rgb name='base_color' value='0.8, 0.4, 0'/>\
             <float name='diff_trans' value='0.5'/></bsdf>"
        ),
        sheet(Vec3::new(0.6, 0.3, 0.0), Vec3::new(0.2, 0.1, 0.0))
    );
    let default = PrincipledParameters { two_sided: false, ..PrincipledParameters::default() };
    assert_eq!(look("<bsdf type='principled'/>"), Bsdf::Principled(Principled::new(default)));
    let Bsdf::Principled(surface) = look(
        "<bsdf type='twosided'><bsdf type='principled'><float name='specular' value='0.8'/>\
         <float name='sheen' value='0.3'/><float name='clearcoat_gloss' value='0.7'/></bsdf></bsdf>",
    ) else {
        panic!()
    };
    let parameters = surface.parameters();
    assert_eq!((parameters.sheen, parameters.clearcoat_gloss), (0.3, 0.7));
    assert!(parameters.two_sided);
    // 2/(1 - sqrt(.08 specular)) - 1
    assert!((parameters.eta - 1.677_31).abs() < 1e-4, "{}", parameters.eta);
}

#[test]
fn mitsuba_lights_are_converted() {
    let loaded = read(&scene(&[
        CAMERA,
        SQUARE,
        "<emitter type='point'><point name='position' x='1' y='2' z='3'/><rgb name='intensity' value='5'/></emitter>\
         <emitter type='directional'><vector name='direction' x='0' y='0' z='-2'/></emitter>\
         <emitter type='spot'><float name='cutoff_angle' value='30'/></emitter>\
         <shape type='sphere'><float name='radius' value='2'/><emitter type='area'>\
         <rgb name='radiance' value='3'/></emitter></shape>",
    ].concat()));
    let emitters = loaded.scene.lights().emitters();
    let is_point = |e: &&Emitter| {
        matches!(e, Emitter::Point { position, intensity }
            if *position == Vec3::new(1.0, 2.0, 3.0) && *intensity == Vec3::splat(5.0))
    };
    assert_eq!(emitters.iter().filter(is_point).count(), 1);
    assert!(
        emitters.iter().any(|e| matches!(e, Emitter::Directional(d) if d.direction == Vec3::NEG_Z))
    );
    assert!(emitters.iter().any(|e| matches!(e, Emitter::Spot(_))));
    // Without a BSDF lamps are black, and other shapes half grey.
    let albedos: Vec<f32> = loaded.scene.materials().iter().map(|m| m.bsdf.albedo().x).collect();
    assert_eq!(albedos, [0.5, 0.0]);
    // A sphere's power is pi L 4 pi r^2.
    let area = |e: &Emitter| match e {
        Emitter::Triangle { shape, .. } => shape.area(),
        _ => 0.0,
    };
    let sum: f32 = emitters.iter().map(area).sum();
    assert!((sum / (16.0 * std::f32::consts::PI) - 1.0).abs() < 1e-4, "{sum}");
}

#[test]
fn approximations_and_omissions_are_warnings() {
    for (inside, kind, warning) in [
        ("<bsdf type='roughplastic'/>", WarningKind::Skipped, "shows both sides"),
        (
            "<bsdf type='principledthin'><float name='diff_trans' value='1'/></bsdf>",
            WarningKind::Skipped,
            "left out sheen and retroreflection",
        ),
        (
            "<bsdf type='principledthin'><float name='spec_trans' value='0.3'/></bsdf>",
            WarningKind::Skipped,
            "left out the clear transmission",
        ),
        ("<bsdf type='plastic'/>", WarningKind::Skipped, "shows both sides"),
        ("<bsdf type='velvet'/>", WarningKind::Skipped, "`velvet`"),
        (
            "<bsdf type='diffuse'><float name='shine' value='1'/></bsdf>",
            WarningKind::Skipped,
            "ignored `shine`",
        ),
        (
            "<bsdf type='diffuse'><spectrum name='reflectance' value='400:0.1, 700:0.9'/></bsdf>",
            WarningKind::Chosen,
            "linear sRGB the spectra",
        ),
    ] {
        let loaded = with(&format!("<shape type='rectangle'>{inside}</shape>"));
        let found = loaded.warnings.iter().any(|n| n.kind == kind && n.text.contains(warning));
        assert!(found, "{inside}: {}", loaded.warnings_text());
    }
    for (inside, warning) in [
        ("<shape type='hair'/>", "left out shapes of type `hair`"),
        ("<emitter type='sunsky'/>", "left out further environments"),
        ("<emitter type='projector'/>", "used a round spot of the same power"),
        (
            "<shape type='disk'><bsdf type='normalmap'><texture name='normalmap' type='rawconstant'>\
             <vector name='value' value='0.5, 0.5, 1'/></texture><bsdf type='diffuse'/></bsdf></shape>",
            "left out the normals or bumps",
        ),
        (
            "<integrator type='path'><integer name='max_depth' value='7'/></integrator>",
            "limit of 7 segments",
        ),
    ] {
        let loaded = with(&[SQUARE, inside].concat());
        assert!(loaded.warnings_text().contains(warning), "{}", loaded.warnings_text());
    }
    let meter = read(&scene(&format!("<sensor type='radiancemeter'/>{LIGHT}{SQUARE}")));
    assert!(meter.warnings_text().contains("whole scene for the `radiancemeter`"));
    // A plain scene has no other warnings.
    assert_eq!(with(SQUARE).warnings_text(), "");
}

#[test]
fn numbers_that_mitsuba_renders_are_read_with_a_warning_at_most() {
    let metal = |eta: &str, k: &str| {
        let both = format!("<rgb name='eta' value='{eta}'/><rgb name='k' value='{k}'/>");
        look(&format!("<bsdf type='roughconductor'>{both}</bsdf>"))
    };
    // Only the squares of indices matter.
    assert_eq!(metal("0.2, -0.01, 1", "3, -2, 1"), metal("0.2, 0.01, 1", "3, 2, 1"));
    for (inside, warning) in [
        ("<bsdf type='dielectric'><float name='int_ior' value='20'/></bsdf>", "refractive index"),
        ("<bsdf type='conductor'><float name='specular_reflectance' value='2'/></bsdf>", "to 1"),
        ("<bsdf type='roughconductor'><float name='alpha' value='1.5'/></bsdf>", "to 1"),
        ("<bsdf type='roughconductor'><integer name='alpha' value='2'/></bsdf>", "to 1"),
    ] {
        let loaded = with(&format!("<shape type='rectangle'>{inside}</shape>"));
        assert!(loaded.warnings_text().contains(warning), "{}", loaded.warnings_text());
    }
    for (inside, warning) in [
        ("<emitter type='point'><rgb name='intensity' value='1, -0.1, 1'/></emitter>", "used 0"),
        ("<emitter type='spot'><float name='cutoff_angle' value='120'/></emitter>", "cutoff"),
        ("<emitter type='spot'><float name='beam_width' value='30'/></emitter>", "beam"),
    ] {
        let loaded = with(&[SQUARE, inside].concat());
        assert!(loaded.warnings_text().contains(warning), "{}", loaded.warnings_text());
    }
}

#[test]
fn differences_in_the_use_of_normals_are_warnings() {
    let file =
        |name: &str| format!("<string name='filename' value='{}'/>", data().join(name).display());
    let bent = |said: &str| {
        let raw = file("normals.png") + "<boolean name='raw' value='true'/>";
        let map = format!("<texture type='bitmap' name='normalmap'>{raw}</texture>");
        let bsdf = format!("<bsdf type='normalmap'>{said}{map}<bsdf type='diffuse'/></bsdf>");
        with(&format!("<shape type='rectangle'>{bsdf}</shape>"))
    };
    let lamp = |said: &str| {
        let mesh = file("pyramid.obj");
        with(&format!("<shape type='obj'>{mesh}{said}<emitter type='area'/></shape>"))
    };
    let shadowing = "<boolean name='use_shadowing_function' value='false'/>";
    let flat = "<boolean name='face_normals' value='true'/>";
    for (warned, silent, phrase) in [
        (bent(""), bent(shadowing), "shadowing by bumps"),
        (lamp(""), lamp(flat), "fronts and cosines"),
    ] {
        assert!(warned.warnings_text().contains(phrase), "{}", warned.warnings_text());
        assert_eq!(silent.warnings_text(), "");
    }
}

/// Public scenes, where they are at hand.
#[test]
fn public_mitsuba_scenes_load() {
    let shared = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/scenes");
    for (name, triangles) in [("cornell-box", 36), ("veach-mis", 100), ("veach-bidir", 1000)] {
        let path = shared.join(name).join("scene.xml");
        if path.exists() {
            let loaded = load(&path).unwrap_or_else(|e| panic!("{e}"));
            assert!(loaded.scene.triangle_count() >= triangles, "{name}");
            let complete =
                loaded.warnings.iter().all(|warning| warning.kind == WarningKind::Chosen);
            assert!(complete, "{name}: {}", loaded.warnings_text());
        }
    }
}

/// The medium of a sensor fills the scene unless a shape bounds it, also where opaque shapes and
/// glass name it as their exterior.
#[test]
fn medium_around_the_sensor_fills_the_scene() {
    let fog = "<medium type='homogeneous' id='fog'><float name='sigma_t' value='1'/></medium>";
    let sensor = CAMERA.replace("</sensor>", "<ref id='fog'/></sensor>");
    let lamp = "<emitter type='point'><rgb name='intensity' value='1'/></emitter>";
    let shape = |bsdf: &str, side: &str| {
        format!("<shape type='sphere'><bsdf type='{bsdf}'/><ref name='{side}' id='fog'/></shape>\n")
    };
    for (shapes, fills) in [
        (shape("diffuse", "exterior"), true),
        (shape("dielectric", "exterior"), true),
        (shape("null", "interior"), false),
        (shape("null", "exterior"), false),
        (shape("dielectric", "interior"), false),
    ] {
        let loaded = read(&scene(&[fog, &sensor, lamp, &shapes].concat()));
        assert_eq!(loaded.scene.filling_medium().is_some(), fills, "{shapes}");
    }
}

/// Coefficients have the color of no light: a constant spectrum is gray, as one number is.
#[test]
fn constant_spectra_of_media_are_gray() {
    for sigma in [
        "<float name='sigma_t' value='1.5'/>",
        "<spectrum name='sigma_t' value='1.5'/>",
        "<spectrum name='sigma_t' value='400:1.5, 700:1.5'/>",
        "<volume type='constvolume' name='sigma_t'>\
         <spectrum name='value' value='300:1.5, 900:1.5'/></volume>",
    ] {
        let medium = format!(
            "<medium type='homogeneous' id='ink'>{sigma}<rgb name='albedo' value='0'/></medium>\
             <shape type='sphere'><bsdf type='null'/><ref name='interior' id='ink'/></shape>"
        );
        let loaded = read(&scene(&format!("{LIGHT}{medium}")));
        let boundary = loaded.scene.materials().iter().find_map(|own| own.boundary.clone());
        let absorption = boundary.unwrap().interior.unwrap().absorption;
        // Both ends of the visible range are missing from the third one.
        assert!((absorption - 1.5).abs().max_element() < 0.01, "{sigma}: {absorption}");
    }
}
