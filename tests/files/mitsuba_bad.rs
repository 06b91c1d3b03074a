//! Mitsuba's scene files that are refused, and what the errors say.

use super::mitsuba::{CAMERA, LIGHT, SQUARE, folder, read, refused, scene};
use bdpm::load::load;
use bdpm::scene::bsdf::Bsdf;
use glam::Vec3;

#[test]
fn errors_name_file_line_and_element() {
    let shape =
        |inside: &str| scene(&format!("{CAMERA}{LIGHT}<shape type='rectangle'>\n{inside}</shape>"));
    for (text, parts) in [
        ("<scene>", &["a.xml:1: it is not valid XML"][..]),
        ("<bsdf type='diffuse'/>", &["a.xml:1: its root is <bsdf>"]),
        (&shape("<ref id='x'/>"), &["a.xml:5: <ref id=\"x\">: nothing has the id `x`", "5 | <ref"]),
        (
            &shape("<bsdf type='diffuse'>\n<rgb name='reflectance' value='a'/></bsdf>"),
            &["a.xml:6:", "`a` is not"],
        ),
        (
            &shape("<bsdf type='diffuse'><rgb name='reflectance' value='1 2'/></bsdf>"),
            &["neither one nor three"],
        ),
        (
            &shape("<bsdf type='conductor'><string name='material' value='Xx'/></bsdf>"),
            &["unknown material `Xx`", "`Au`"],
        ),
        (
            &shape("<transform name='to_world'><scale value='0'/></transform>"),
            &["<shape type=\"rectangle\">", "flattens"],
        ),
        (
            &shape("<transform name='to_world'><shear/></transform>"),
            &["<shear>", "step of a transform is unknown"],
        ),
        (
            &shape("<transform name='to_world'><matrix value='1 2 3'/></transform>"),
            &["neither 16 nor 9"],
        ),
        (&shape("<bsdf type='mask'/>"), &["<bsdf type=\"mask\">", "no BSDF within"]),
        (
            &scene(&format!(
                "{CAMERA}{LIGHT}<shape type='obj'><string name='filename' value='no.obj'/></shape>"
            )),
            &["no file `no.obj`"],
        ),
        (&scene(&format!("{CAMERA}{LIGHT}<shape type='instance'/>")), &["refers to no shapegroup"]),
        (&scene("<float name='a' value='$b'/>"), &["the parameter `$b` has no value"]),
        (
            &scene("<bsdf type='diffuse' id='a'/><bsdf type='diffuse' id='a'/>"),
            &["the id `a` is given twice"],
        ),
        (&scene("<include filename='b.xml'/>"), &["there is no file `b.xml`"]),
        (&scene(&[CAMERA, LIGHT].concat()), &["the scene has no triangle"]),
    ] {
        refused(text, &[&["a.xml"], parts].concat());
    }
}

#[test]
fn hostile_files_are_refused() {
    // Entities.
    let bomb = "<?xml version='1.0'?><!DOCTYPE scene [<!ENTITY a 'aaaa'><!ENTITY b '&a;&a;'>]><scene>&b;</scene>";
    refused(bomb, &["it has a DTD"]);
    // Deep nesting: of ours, and of what the parser sees.
    for depth in [60, 20_000] {
        let deep = "<bsdf type='twosided'>".repeat(depth) + &"</bsdf>".repeat(depth);
        refused(&scene(&deep), &["a.xml"]);
    }
    // References to themselves.
    let cycle = "<bsdf type='twosided' id='a'><ref id='a'/></bsdf><shape type='rectangle'><ref id='a'/></shape>";
    refused(&scene(&[CAMERA, LIGHT, cycle].concat()), &["refers to itself"]);
    let group = "<shape type='shapegroup' id='g'><shape type='instance'><ref id='g'/></shape></shape>\
                 <shape type='instance'><ref id='g'/></shape>";
    refused(&scene(&[CAMERA, LIGHT, group].concat()), &["no triangle"]);
    let texture = "<texture type='checkerboard' id='t'><ref name='color0' id='t'/></texture>\
                   <shape type='rectangle'><bsdf type='diffuse'><ref name='reflectance' id='t'/></bsdf></shape>";
    assert!(read(&scene(&[CAMERA, LIGHT, texture].concat())).warnings_text().contains("used gray"));
    let spectrum = "<spectrum type='d65' id='t'><ref name='value' id='t'/></spectrum>\
                    <emitter type='point'><ref name='intensity' id='t'/></emitter>";
    refused(&scene(&[CAMERA, SQUARE, spectrum].concat()), &["D65 of D65"]);
    refused(&scene("<include filename='a.xml'/>"), &["`a.xml` includes itself"]);
    // Parameters and references that grow exponentially.
    let mut text = "<default name='a0' value='xxxxxxxx'/>".to_owned();
    for i in 0..40 {
        text += &format!("<default name='b{}' value='$b{i}$b{i}'/>", i + 1).replace("$b0", "$a0");
    }
    refused(&scene(&text), &["more than 65536 bytes"]);
    let mut text = "<bsdf type='diffuse' id='a0'/>".to_owned();
    for i in 0..45 {
        let next = i + 1;
        text +=
            &format!("<bsdf type='blendbsdf' id='a{next}'><ref id='a{i}'/><ref id='a{i}'/></bsdf>");
    }
    text += "<shape type='rectangle'><ref id='a45'/></shape>";
    let albedo = Vec3::splat(0.5);
    let loaded = read(&scene(&[CAMERA, LIGHT, &text].concat()));
    assert_eq!(loaded.scene.materials()[0].bsdf, Bsdf::Lambertian { albedo, two_sided: false });
}

#[test]
fn broken_mesh_files_are_refused() {
    let shape = |kind: &str| {
        scene(&format!(
            "{CAMERA}{LIGHT}<shape type='{kind}'><string name='filename' value='m.{kind}'/></shape>"
        ))
    };
    let header = |vertices: &str, rest: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex {vertices}\nproperty float x\nproperty float y\n\
             property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n{rest}"
        )
    };
    for (text, problem) in [
        ("ply\n".to_owned(), "cannot read it as a PLY file"),
        (header("4000000000", "0 0 0\n"), "the file ends before item 1 of the element `vertex`"),
        (header("3", "0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n"), "a face uses vertex 7 of 3"),
        (header("3", "0 0 0\n1 0 0\n0 1 0\n3 0 1 -1\n"), "face 0 has the vertex index -1"),
        (header("3", "0 0 1e39\n1 0 0\n0 1 0\n3 0 1 2\n"), "vertex 0 of its file is not finite"),
    ] {
        let folder = folder(&shape("ply"));
        std::fs::write(folder.path().join("m.ply"), &text).unwrap();
        let error = load(folder.path().join("a.xml")).unwrap_err().to_string();
        assert!(error.contains(problem), "{problem}: {error}");
    }
    let folder = folder(&shape("serialized"));
    std::fs::write(folder.path().join("m.serialized"), b"PK12345").unwrap();
    let error = load(folder.path().join("a.xml")).unwrap_err().to_string();
    assert!(error.contains("m.serialized") && error.contains("not 0x041c"), "{error}");
}
