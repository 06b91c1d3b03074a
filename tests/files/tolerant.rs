//! Files with small errors that other programs open load here as well, with a warning.

use crate::common::gltf::*;
use bdpm::import::WarningKind;
use bdpm::load::Loaded;
use bdpm::scene::Material;
use glam::{Vec2, Vec3};
use serde_json::json;
use std::io::Cursor;

const TRIANGLE: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";

/// Loads the last file, which must tell this.
#[track_caller]
fn loaded_with_warning(list: &[(&str, &[u8])], kind: WarningKind, part: &str) -> Loaded {
    let loaded = files(list).load();
    let warning = loaded.warnings.iter().find(|warning| warning.text.contains(part));
    assert_eq!(warning.map(|warning| warning.kind), Some(kind), "{}", loaded.warnings_text());
    loaded
}

#[test]
fn repeatedly_listed_nodes_are_shown_once() {
    let mut model = square();
    model.json["nodes"] = json!([
        { "children": [1], "translation": [0, 0, 1] },
        { "children": [2], "translation": [0, 0, 2] },
        { "mesh": 0 },
        { "children": [4], "translation": [0, 0, 9] },
        { "mesh": 0 },
    ]);
    // Below another, twice, and below one that is not listed: then it is a root.
    for (listed, heights) in [
        (json!([2, 1, 0]), vec![3.0]),
        (json!([0, 0, 2]), vec![3.0]),
        (json!([0, 4, 4]), vec![3.0, 0.0]),
    ] {
        model.json["scenes"] = json!([{ "nodes": listed }]);
        let files = [("a.gltf", model.text())];
        let loaded = loaded_with_warning(
            &[("a.gltf", files[0].1.as_bytes())],
            WarningKind::Chosen,
            "each is shown once",
        );
        let meshes = loaded.scene.meshes().iter();
        let found: Vec<f32> = meshes.map(|mesh| mesh.positions[0].z).collect();
        assert_eq!(found, heights, "{listed}");
    }
    model.json["scenes"] = json!([{ "nodes": [0, 3] }]);
    assert!(!model.load().warnings_text().contains("shown once"));
}

#[test]
fn invalid_references_are_ignored() {
    for (rest, uvs, normals) in [
        ("vt 0 0\nf 1/1 2/2 3/1", false, false),
        ("vn 0 0 1\nf 1//1 2//-2 3//1", false, false),
        ("vt 0 0\nvn 0 0 1\nf 1/9/1 2/1/1 3/1/1", false, true),
        ("vt 0 0\nvn 0 0 1\nf 1/1/0 2/1/1 3/1/1", true, false),
    ] {
        let text = format!("{TRIANGLE}{rest}\n");
        let loaded = loaded_with_warning(
            &[("a.obj", text.as_bytes())],
            WarningKind::Skipped,
            "ignored 1 references to texture",
        );
        let mesh = &loaded.scene.meshes()[0];
        assert_eq!((!mesh.uvs.is_empty(), !mesh.normals.is_empty()), (uvs, normals), "{rest}");
    }
    let text = format!("{TRIANGLE}vt nan -nan(ind)\nvn 0 0 inf\nf 1/1/1 2/1/1 3/1/1\n");
    let loaded = loaded_with_warning(
        &[("a.obj", text.as_bytes())],
        WarningKind::Skipped,
        "ignored 3 coordinates of textures",
    );
    assert_eq!(loaded.scene.meshes()[0].uvs, [Vec2::ZERO; 3]);
}

#[test]
fn unnamed_and_redefined_materials_are_warnings() {
    let mtl = "newmtl a\nKd 1 0 0\nnewmtl b\nKd 0 1 0\nnewmtl a\nKd 0 0 1\n";
    let text = format!("mtllib a.mtl\n{TRIANGLE}usemtl a\nf 1 2 3\nusemtl\nf 1 3 2\n");
    let list = [("a.mtl", mtl.as_bytes()), ("a.obj", text.as_bytes())];
    let loaded =
        loaded_with_warning(&list, WarningKind::Skipped, "all but the last definition of `a`");
    let colors: Vec<Vec3> = loaded.scene.materials().iter().map(|m| m.bsdf.albedo()).collect();
    assert_eq!(colors, [Vec3::Z, Vec3::splat(0.5)]);
    loaded_with_warning(&list, WarningKind::Chosen, "faces without material");
    let text = format!("mtllib\n{TRIANGLE}f 1 2 3\n");
    loaded_with_warning(
        &[("a.obj", text.as_bytes())],
        WarningKind::Skipped,
        "`mtllib without a name (line 1)`",
    );
}

/// Two texels, black and white.
fn picture(format: image::ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let picture = image::RgbImage::from_raw(2, 1, vec![0, 0, 0, 255, 255, 255]).unwrap();
    picture.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

#[test]
fn pictures_of_all_supported_formats_load() {
    use image::ImageFormat::{Bmp, Tga, Tiff, WebP};
    for (name, format) in [("p.TGA", Tga), ("p.bmp", Bmp), ("p.tif", Tiff), ("p.png", WebP)] {
        let mtl = format!("newmtl m\nmap_Kd {name}\n");
        let text = format!("mtllib a.mtl\nusemtl m\n{TRIANGLE}vt 0 0\nf 1/1 2/1 3/1\n");
        let list =
            [(name, &picture(format)[..]), ("a.mtl", mtl.as_bytes()), ("a.obj", text.as_bytes())];
        let loaded = files(&list).load();
        let Material { albedo_texture, .. } = &loaded.scene.materials()[0];
        let texture =
            albedo_texture.as_ref().unwrap_or_else(|| panic!("{}", loaded.warnings_text()));
        let at = [0.25, 0.75].map(|u| texture.color(Vec2::new(u, 0.5)));
        assert_eq!(at, [Vec3::ZERO, Vec3::ONE], "{name}");
    }
    let webp = picture(WebP);
    let mut model = square();
    let view = model.view(&webp);
    model.push("images", json!({ "bufferView": view }));
    model.push("textures", json!({ "extensions": { "EXT_texture_webp": { "source": 0 } } }));
    model.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
    model.json["extensionsRequired"] = json!(["EXT_texture_webp"]);
    assert!(model.load().scene.materials()[0].albedo_texture.is_some());
}

#[test]
fn unreadable_gltf_pictures_are_ignored() {
    for (image, part) in [
        (json!({ "uri": "no.png" }), "images[0].uri: there is no file `no.png`"),
        (json!({ "bufferView": 0 }), "images[0]: the texture cannot be read"),
    ] {
        let mut model = square();
        model.push("images", image);
        model.push("textures", json!({ "source": 0 }));
        model.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] =
            json!({ "index": 0 });
        let text = model.text();
        let loaded =
            loaded_with_warning(&[("a.gltf", text.as_bytes())], WarningKind::Skipped, part);
        assert!(loaded.scene.materials()[0].albedo_texture.is_none());
    }
    let mut model = square();
    model.push("textures", json!({ "extensions": { "KHR_texture_basisu": { "source": 0 } } }));
    model.json["materials"][0]["normalTexture"] = json!({ "index": 0 });
    let text = model.text();
    loaded_with_warning(
        &[("a.gltf", text.as_bytes())],
        WarningKind::Skipped,
        "textures[0] of an unknown format",
    );
}

#[cfg(unix)]
#[test]
fn names_that_are_not_utf8_are_found() {
    use std::ffi::OsStr;
    use std::os::unix::ffi::OsStrExt;
    let folder = tempfile::TempDir::new().unwrap();
    let at = |name: &[u8]| folder.path().join(OsStr::from_bytes(name));
    // Two names that differ in a byte alone which is no UTF-8, and a picture with such a name.
    let mtl = b"newmtl m\xe9\nKd 1 0 0\nmap_Kd p\xe9.png\nnewmtl m\xe8\nKd 0 1 0\n";
    let obj = [
        b"mtllib a\xe9.mtl\n",
        TRIANGLE.as_bytes(),
        b"usemtl m\xe9\nf 1 2 3\nusemtl m\xe8\nf 1 3 2\n",
    ];
    std::fs::write(at(b"a\xe9.mtl"), mtl).unwrap();
    std::fs::write(at(b"p\xe9.png"), picture(image::ImageFormat::Png)).unwrap();
    std::fs::write(at(b"a.obj"), obj.concat()).unwrap();
    let loaded = bdpm::load::load(at(b"a.obj")).unwrap();
    let materials = loaded.scene.materials();
    let names: Vec<&str> = materials.iter().map(|material| &material.name[..]).collect();
    assert_eq!(names, ["m\u{e9}", "m\u{e8}"], "{}", loaded.warnings_text());
    assert_eq!([0, 1].map(|i| materials[i].bsdf.albedo()), [Vec3::X, Vec3::Y]);
    assert!(materials[0].albedo_texture.is_some(), "{}", loaded.warnings_text());
}

#[test]
fn compressed_meshes_are_refused_with_the_command_to_decompress() {
    let command = "npx @gltf-transform/cli cp OLD NEW.glb";
    let mut model = square();
    model.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    model.files().refused(&["KHR_draco_mesh_compression", command]);
    // Used, and not said to be required.
    let mut draco = square();
    draco.json["meshes"][0]["primitives"][0]["extensions"] =
        json!({ "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": {} } });
    draco.load();
    draco.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    draco.files().refused(&["meshes[0].primitives[0]: it is compressed by KHR_draco", command]);
}

#[test]
fn files_in_another_case_are_found_by_every_format_with_a_note() {
    let picture = picture(image::ImageFormat::Png);
    let mut model = square();
    model.push("images", json!({ "uri": "P.PNG" }));
    model.push("textures", json!({ "source": 0 }));
    model.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
    let model = model.text();
    let mesh = format!("{TRIANGLE}f 1 2 3\n");
    let mitsuba = "<scene version='3.0.0'><emitter type='constant'/><shape type='obj'>\
                   <string name='filename' value='C:\\models\\Mesh.OBJ'/></shape></scene>";
    let pbrt =
        "Camera \"perspective\"\nWorldBegin\nLightSource \"infinite\"\nInclude \"Part.PBRT\"\n";
    let part = "Shape \"sphere\"\n";
    for (name, scene, shown) in [
        ("a.gltf", &model[..], "`P.PNG`"),
        ("a.xml", mitsuba, "`C:\\models\\Mesh.OBJ`"),
        ("a.pbrt", pbrt, "`Part.PBRT`"),
    ] {
        let list = [
            ("p.png", &picture[..]),
            ("mesh.obj", mesh.as_bytes()),
            ("part.pbrt", part.as_bytes()),
            (name, scene.as_bytes()),
        ];
        let note = format!("found under other names the files {shown}");
        loaded_with_warning(&list, WarningKind::Chosen, &note);
    }
}

#[test]
fn scene_far_from_the_origin_is_moved_with_a_note() {
    let far =
        |offset: f32| format!("v {offset} 0 0\nv {} 0 0\nv {offset} 1 0\nf 1 2 3\n", offset + 1.0);
    let text = far(1e4);
    loaded_with_warning(&[("a.obj", text.as_bytes())], WarningKind::Chosen, "far from the origin");
    let near = far(5.0);
    let loaded = files(&[("a.obj", near.as_bytes())]).load();
    assert!(!loaded.warnings_text().contains("origin"), "{}", loaded.warnings_text());
}
