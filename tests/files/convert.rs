//! Scenes written as folders and read again are the same.

use crate::common::gltf::*;
use crate::common::program_output::{assert_refused, json, text};
use bdpm::image_io::{Image, Layer, Metadata, write_exr};
use bdpm::load::{Loaded, export, load};
use bdpm::scene::{FieldOfView, Material, Optics};
use glam::Vec3;
use serde_json::json;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;

fn convert(arguments: &[&Path], more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bdpm"));
    command.arg("convert").args(arguments).args(more).stdin(Stdio::null()).output().unwrap()
}

fn bits(normals: &[Vec3]) -> Vec<u32> {
    normals.iter().flat_map(|normal| normal.to_array().map(f32::to_bits)).collect()
}

/// The scene written and read again: the same but for its name.
#[track_caller]
fn assert_kept(loaded: &Loaded) -> TempDir {
    let folder = TempDir::new().unwrap();
    let exported = export(loaded, "a b", folder.path(), false).unwrap_or_else(|e| panic!("{e}"));
    assert!(exported.warnings.is_empty(), "{:?}", exported.warnings);
    let text = fs::read_to_string(folder.path().join("scene.toml")).unwrap();
    let again = load(folder.path()).unwrap_or_else(|e| panic!("{e}\n{text}"));
    assert_eq!(again.warnings_text(), "", "{text}");
    let (a, b) = (&loaded.scene, &again.scene);
    assert_eq!(a.camera, b.camera, "{text}");
    // Copies of a mesh that was held once have other rounding errors.
    if a.meshes().len() == a.placements().len() {
        assert_eq!(a.triangles(), b.triangles(), "{text}");
        assert_eq!(a.lights().emitters(), b.lights().emitters(), "{text}");
    }
    assert_eq!((&a.regions, &loaded.defaults), (&b.regions, &again.defaults), "{text}");
    assert_eq!(loaded.meters, again.meters, "{text}");
    for (a, b) in a.copies().iter().zip(b.copies()) {
        assert_eq!((&a.normals, &a.uvs), (&b.normals, &b.uvs), "{}", a.name);
        assert_eq!(bits(&a.normals), bits(&b.normals), "{}", a.name);
        assert_eq!((&a.triangles, &a.positions), (&b.triangles, &b.positions), "{}", a.name);
    }
    for (a, b) in a.materials().iter().zip(b.materials()) {
        assert_eq!(&Material { name: b.name.clone(), ..a.clone() }, b, "{text}");
    }
    assert_eq!(a.fingerprint(), b.fingerprint(), "{text}");
    assert!(text.starts_with("# Converted from `a b` by bdpm"), "{text}");
    folder
}

#[track_caller]
fn assert_files_kept(list: &[(&str, &[u8])]) -> TempDir {
    assert_kept(&files(list).load())
}

#[test]
fn committed_scenes_are_exported_without_loss() {
    let mut count = 0;
    for entry in fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/scenes")).unwrap() {
        let folder = entry.unwrap().path();
        // Others are made by a program.
        if folder.join("scene.toml").is_file() {
            assert_kept(&load(&folder).unwrap_or_else(|e| panic!("{e}")));
            count += 1;
        }
    }
    assert!(count >= 4);
}

fn picture(seed: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 3, 2);
    encoder.set_color(png::ColorType::Rgba);
    let mut writer = encoder.write_header().unwrap();
    let texels: Vec<u8> = (0..24_u8).map(|i| i.wrapping_mul(37) ^ seed).collect();
    writer.write_image_data(&texels).unwrap();
    writer.finish().unwrap();
    bytes
}

/// Two squares of one name, with materials of one name, all kinds of textures, lights and a camera.
fn textured() -> Model {
    let mut model = square();
    let uvs = model.uvs(&[[0.0, 1.0], [1.3, 1.0], [1.0, -0.1], [0.0, 0.0]]);
    let normals =
        model.points(&[[0.1, 0.2, 0.9], [-0.3, 0.1, 0.8], [0.0, 0.3, 0.7], [0.2, 0.2, 1.0]]);
    let attributes = &mut model.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["TEXCOORD_0"] = json!(uvs);
    attributes["NORMAL"] = json!(normals);
    for seed in [0, 100] {
        let view = model.view(&picture(seed));
        model.push("images", json!({ "bufferView": view }));
    }
    model.json["samplers"] = json!([{ "wrapS": 33071, "wrapT": 33648 }, { "magFilter": 9728 }]);
    for (source, sampler) in [(0, 0), (1, 1), (1, 0)] {
        model.push("textures", json!({ "source": source, "sampler": sampler }));
    }
    model.json["materials"] = json!([
        {
            "name": "../\"worn\"\n paint",
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.8, 0.4, 0.2, 1], "metallicFactor": 0.7, "roughnessFactor": 0.3,
                "baseColorTexture": { "index": 0 }, "metallicRoughnessTexture": { "index": 1 },
            },
            "normalTexture": { "index": 2, "scale": 0.3 },
            "alphaMode": "MASK", "alphaCutoff": 0.3,
            "extensions": { "KHR_materials_ior": { "ior": 1.33 } },
        },
        {
            "name": "../\"worn\"\n paint",
            "emissiveFactor": [1, 0.7, 0.1], "emissiveTexture": { "index": 0 },
        },
    ]);
    let mut lamp = model.json["meshes"][0].clone();
    lamp["primitives"][0]["material"] = json!(1);
    model.push("meshes", lamp);
    let turn = Vec3::new(0.3, -0.2, 0.1);
    let turned = json!([turn.x, turn.y, turn.z, (1.0 - turn.length_squared()).sqrt()]);
    model.json["nodes"][0]["name"] = json!("it");
    model.json["nodes"][0]["rotation"] = turned.clone();
    model.node(json!({ "name": "it", "mesh": 1, "translation": [0.1, 0.2, 3.7] }));
    model.push(
        "cameras",
        json!({ "type": "perspective", "perspective": { "yfov": 0.7, "znear": 1 } }),
    );
    model.node(
        json!({ "camera": 0, "translation": [0.3, 0.1, 9.3], "rotation": [0.02, 0.01, 0.005, 1] }),
    );
    model.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [
        { "type": "point", "intensity": 123 }, { "type": "directional", "color": [1, 0.3, 0.1] },
        { "type": "spot", "intensity": 77, "spot": { "innerConeAngle": 0.1, "outerConeAngle": 0.3 } },
    ] } });
    for light in 0..3 {
        let own = json!({ "KHR_lights_punctual": { "light": light } });
        model
            .node(json!({ "extensions": own, "rotation": turned, "translation": [0.7, 3.3, 0.1] }));
    }
    model
}

#[test]
fn gltf_scenes_with_repeated_names_are_exported_without_loss() {
    let model = textured();
    let loaded = model.load();
    let folder = assert_kept(&loaded);
    assert_same(&loaded.scene, &load(folder.path()).unwrap().scene);
    let names = |part: &str| {
        let entries = fs::read_dir(folder.path().join(part)).unwrap();
        let mut names: Vec<_> =
            entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    };
    assert_eq!(names("meshes"), ["it-2.obj", "it.obj"]);
    assert_eq!(names("textures").len(), 3, "with the opacity of its own: {:?}", names("textures"));
}

#[test]
fn obj_models_are_exported_without_loss() {
    let mtl = "newmtl shiny\nKd .3 .2 .1\nKs .5\nillum 2\nNs 37\nNi 1.4\nnewmtl steel\nKd 0\nKs .7\n\
               Ns 12\nillum 3\nnewmtl glass\nillum 7\nNi 1.5\nNs 900\nnewmtl lamp\nKd 0\nKe 3 2 1\n";
    let mut obj = "mtllib a.mtl\nvn 0.1 0.2 0.7\nvn 0 0.5 1\nvn 0.3 0.3 0.3\n".to_owned();
    for (i, name) in ["shiny", "steel", "glass", "lamp", "nowhere"].into_iter().enumerate() {
        obj += &format!("v {i} 0 0.1\nv {i}.7 0 1e-7\nv {i} 1 -3e5\nusemtl {name}\ng part {i}\n");
        obj += "f -3//1 -2//2 -1//3\n";
    }
    assert_files_kept(&[("a.mtl", mtl.as_bytes()), ("a.obj", obj.as_bytes())]);
}

#[test]
fn scene_files_with_all_tables_are_exported_without_loss() {
    let folder = TempDir::new().unwrap();
    let radiance: Vec<Vec3> = (0..8).map(|i| Vec3::new(0.1, 1.7, 1e-3) * i as f32).collect();
    let layers = vec![Layer::rgb("", &radiance)];
    let image = Image { width: 4, height: 2, layers, metadata: Metadata::new() };
    write_exr(&folder.path().join("sky.exr"), &image).unwrap();
    let sky = fs::read(folder.path().join("sky.exr")).unwrap();
    let scene =
        "mesh = [{ file = 'a.obj', material = 'b c', rotate_deg = [10, 20, 30], scale = 0.1 }]
        [camera]
        type = 'thin-lens'
        position = [1, 2, 30]
        target = [0.1, 0.2, 0.3]
        up = [0.1, 1, 0.2]
        fov_x_deg = 33.3
        aperture_radius = 0.1
        shift = [0.25, -0.1]
        [materials.'b c']
        type = 'dielectric'
        ior = 1.33
        outside_ior = 1.5
        roughness = 0.37
        hidden = true
        [[light]]
        type = 'spot'
        position = [3, 4, 5]
        target = [0, 0.1, 0]
        inner_deg = 12.3
        outer_deg = 45.6
        lumen = [100, 90, 80]
        [[light]]
        type = 'sun'
        direction = [1, -2, 0.3]
        lux = 1000
        [environment]
        file = 'sky.exr'
        turn_deg = 123.4
        [regions]
        left = [[0, 0, 0.5, 1]]
        'the rest' = [[0.5, 0, 0.75, 1], [0.75, 0.1, 1, 0.9]]
        [render]
        resolution = [64, 48]
        radius = '0.7%'
        light_paths = 1234
        camera_paths = 3
        merge_vertex = 3
        direct = 'photon-map'
        seed = 7";
    let list: [(&str, &[u8]); 3] =
        [("sky.exr", &sky), ("a.obj", SQUARE_OBJ.as_bytes()), ("a.toml", scene.as_bytes())];
    assert_files_kept(&list);
    // Media and their dispersion.
    for index in [
        "'SF11'",
        "1.5\noutside_ior = { d = 1.33, abbe = 55.5 }",
        "{ cauchy = [1.5, 0.004, 1e-5] }\noutside_ior = 'water'",
        "{ sellmeier = [[1, 0.01], [0.5, 100]] }",
        "{ nanometers = [400, 550.5, 700], values = [1.6, 1.53, 1.5] }",
    ] {
        let text = scene.replace("1.33\n        outside_ior = 1.5", index);
        assert_ne!(text, scene);
        let list: [(&str, &[u8]); 3] =
            [("sky.exr", &sky), ("a.obj", SQUARE_OBJ.as_bytes()), ("a.toml", text.as_bytes())];
        assert_files_kept(&list);
    }
    let sensor = "camera = { type = 'sensor', position = [0, 0, 9], direction = [0, 0.1, -1], \
                  sensor_width = 0.1, disc_distance = 1, disc_radius = 0.2, exposure = 0.01 }
        environment = { radiance = [1, 0.3, 0.1] }
        [[mesh]]
        file = 'a.obj'";
    let own = "type = 'sensor', position = [0, 0, 9], direction = [0, 0.1, -1], \
               sensor_width = 0.1, disc_distance = 1, disc_radius = 0.2, exposure = 0.01";
    for camera in [
        own,
        "type = 'orthographic', position = [0, 0, 9], direction = [0, 0.1, -1], width = 3.7",
        "type = 'orthographic', position = [0, 0, 9], target = [0, 0, 0], height = 3, shift = [1, 0.1]",
        "type = 'panorama', position = [0, 0, 9], target = [0, 0.3, 0]",
        "type = 'fisheye', position = [0, 0, 9], target = [0, 0, 0], fov_deg = 170",
        "type = 'fisheye', position = [0, 0, 9], target = [0, 0, 0], projection = 'equisolid'",
    ] {
        let text = sensor.replace(own, camera);
        let list: [(&str, &[u8]); 2] =
            [("a.obj", SQUARE_OBJ.as_bytes()), ("a.toml", text.as_bytes())];
        // The grey of faces without material is a choice of the original.
        let folder = TempDir::new().unwrap();
        let loaded = files(&list).load();
        export(&loaded, "a", folder.path(), false).unwrap();
        let read = load(folder.path()).unwrap().scene.fingerprint();
        assert_eq!(read, loaded.scene.fingerprint(), "{camera}");
    }
}

/// A fan of so many triangles, with normals that are not of length 1.
fn fan(triangles: usize) -> Model {
    let mut model = Model::new();
    let corner = |i: usize| {
        let (sin, cos) = (i as f32 * 0.01).sin_cos();
        [cos, sin, 0.1 * sin]
    };
    let corners: Vec<_> = (0..triangles + 2).map(corner).collect();
    let normals: Vec<_> = corners.iter().map(|[x, y, _]| [0.3 * x, 0.2 * y, 0.93]).collect();
    let attributes =
        json!({ "POSITION": model.points(&corners), "NORMAL": model.points(&normals) });
    model.push("materials", grey());
    model.push(
        "meshes",
        json!({ "primitives": [{ "attributes": attributes, "mode": 6, "material": 0 }] }),
    );
    model
}

#[test]
fn mirrored_and_partly_dropped_meshes_are_exported_without_loss() {
    let mut model = fan(5);
    model.node(json!({ "mesh": 0, "scale": [-1, 2, 1], "rotation": [0, 0.6, 0, 0.8] }));
    assert_kept(&model.load());
    // One of the four corners is only used by a triangle without area.
    let mut model = Model::new();
    let corners = [[5.0, 0.0, 0.0], [0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let part = json!({
        "attributes": { "POSITION": model.points(&corners) },
        "indices": model.indices(&[0, 1, 2, 3, 1, 2]), "material": 0,
    });
    model.push("materials", grey());
    model.push("meshes", json!({ "primitives": [part] }));
    model.node(json!({ "mesh": 0 }));
    let loaded = model.load();
    assert_eq!(loaded.scene.meshes()[0].positions.len(), 3);
    assert_kept(&loaded);
}

#[test]
fn instanced_meshes_keep_their_normals_when_exported() {
    // One group becomes instances. The other has parts that are too small alone, but not together.
    let mut model = fan(150);
    let part = model.json["meshes"][0]["primitives"][0].clone();
    model.json["meshes"][0]["primitives"] = json!([part, part]);
    for i in 0..40 {
        let (sin, cos) = (i as f32 * 0.07).sin_cos();
        let scale = if i % 3 == 0 { [1.0, -1.3, 1.0] } else { [1.1, 1.0, 0.9] };
        model.node(json!({
            "mesh": 0, "rotation": [0, sin, 0, cos], "scale": scale, "translation": [i, 0, 0],
        }));
    }
    let loaded = model.load();
    assert!(loaded.scene.meshes().len() < loaded.scene.placements().len());
    assert_kept(&loaded);
}

#[test]
fn lost_tangents_are_warnings() {
    let mut model = textured();
    let tangents = bytes([[0.0, 2.0, 0.0, 1.0]; 4].as_flattened());
    let accessor = model.accessor(&tangents, F32, "VEC4", 4);
    model.json["meshes"][0]["primitives"][0]["attributes"]["TANGENT"] = json!(accessor);
    let folder = TempDir::new().unwrap();
    let exported = export(&model.load(), "a", folder.path(), false).unwrap();
    assert!(exported.warnings[0].text.contains("no tangents"), "{:?}", exported.warnings);
}

#[test]
fn conversion_without_force_replaces_no_file() {
    let files = textured().files();
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("new/folder");
    let report = json(&convert(&[&files.1, &out], &["--json"]));
    assert_eq!(report["fingerprints"][0], report["fingerprints"][1]);
    assert_eq!(report["files"], 6);
    let before = fs::read(out.join("scene.toml")).unwrap();
    assert_refused(
        &convert(&[&files.1, &out], &[]),
        "already holds `scene.toml`",
        "allow its files",
    );
    assert_eq!(fs::read(out.join("scene.toml")).unwrap(), before);
    let again = convert(&[&files.1, &out], &["--force"]);
    let shown = text(&again.stdout);
    assert!(again.status.success() && shown.contains("6 files, fingerprint "), "{shown}");
}

#[test]
fn converted_scenes_have_the_camera_that_the_options_request() {
    let folder = TempDir::new().unwrap();
    let (scene, out) = (Path::new("tests/data/mitsuba/shapes.xml"), folder.path().join("out"));
    let done = convert(&[scene, &out], &["--look-at", "1,2,30,1,2,0", "--fov", "12.5"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
    let camera = &load(&out).unwrap().scene.camera;
    assert_eq!((camera.position(), camera.direction()), (Vec3::new(1.0, 2.0, 30.0), -Vec3::Z));
    let optics = camera.optics();
    assert!(matches!(optics, Optics::Pinhole(FieldOfView::X(12.5))), "{optics:?}");
}
