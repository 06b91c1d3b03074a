//! glTF: hidden nodes, compressed and quantized meshes.

use crate::common::gltf::*;
use serde_json::json;

/// The square compressed by the encoder `meshoptimizer` 1.3.0, in a second buffer.
const POSITIONS: &str =
    "oAAAAAEzAAAA//8AAAABDAAAAP8AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAIC/AACAvwAAAAA=";
const INDICES: &str = "4fAAAHaHVmd4qYZliWiYAWkAAA==";

/// The square, whose two views are compressed by this extension.
fn compressed(extension: &str) -> Model {
    use base64::Engine;
    use base64::prelude::BASE64_STANDARD;
    let [positions, indices] =
        [POSITIONS, INDICES].map(|text| BASE64_STANDARD.decode(text).unwrap());
    let mut model = square();
    let data = BASE64_STANDARD.encode([&positions[..], &indices].concat());
    let (first, second) = (positions.len(), indices.len());
    let uri = format!("data:;base64,{data}");
    model.json["buffers"] = json!([
        { "byteLength": first + second, "uri": uri },
        { "byteLength": 60, "extensions": { (extension): { "fallback": true } } },
    ]);
    model.json["extensionsRequired"] = json!([extension]);
    let view = |stream: serde_json::Value, [offset, length]: [usize; 2]| {
        let extensions = json!({ (extension): stream });
        json!({ "buffer": 1, "byteOffset": offset, "byteLength": length, "extensions": extensions })
    };
    let of = |offset: usize, length: usize, stride: usize, count: usize, mode: &str| {
        json!({
            "buffer": 0, "byteOffset": offset, "byteLength": length, "byteStride": stride,
            "count": count, "mode": mode,
        })
    };
    model.json["bufferViews"] = json!([
        view(of(0, first, 12, 4, "ATTRIBUTES"), [0, 48]),
        view(of(first, second, 2, 6, "TRIANGLES"), [48, 12]),
    ]);
    model.bin.clear();
    model
}

#[test]
fn compressed_meshes_are_those_of_plain_files() {
    let plain = square().load().scene.fingerprint();
    for extension in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        let loaded = compressed(extension).load();
        assert_eq!(loaded.scene.fingerprint(), plain, "{extension}");
        let mut unmarked = compressed(extension);
        unmarked.json["buffers"][1].as_object_mut().unwrap().remove("extensions");
        assert_eq!(unmarked.load().scene.fingerprint(), plain, "{extension}");
    }
}

#[test]
fn damaged_compressed_views_are_refused() {
    let refused = |change: fn(&mut serde_json::Value), part: &str| {
        let mut model = compressed("EXT_meshopt_compression");
        change(&mut model.json["bufferViews"][0]);
        model.files().refused(&["bufferViews[0].extensions.EXT_meshopt_compression: ", part]);
    };
    const NAME: &str = "EXT_meshopt_compression";
    refused(|view| view["extensions"][NAME]["byteLength"] = json!(20), "cut off");
    refused(|view| view["extensions"][NAME]["byteLength"] = json!(9999), "it exceeds the");
    refused(|view| view["extensions"][NAME]["count"] = json!(5), "times count is not");
    refused(|view| view["extensions"][NAME]["mode"] = json!("LINES"), "its mode is none of");
    refused(|view| view["extensions"][NAME]["filter"] = json!("SHARP"), "its filter is unknown");
    refused(|view| view["extensions"][NAME]["buffer"] = json!(7), "buffers[7]");
    refused(
        |view| {
            view["byteLength"] = json!(1_u64 << 50);
            view["extensions"][NAME]["count"] = json!((1_u64 << 50) / 12);
        },
        "take",
    );
}

/// `KHR_mesh_quantization`: positions as normalized and as plain integers.
#[test]
fn quantized_positions_are_the_square() {
    let positions = |code: u64, is_normalized: bool, bytes: &[u8]| {
        let mut model = square();
        let accessor = model.accessor(bytes, code, "VEC3", 4);
        let size = bytes.len() / 4;
        model.json["accessors"][accessor]["normalized"] = json!(is_normalized);
        let view = model.json["accessors"][accessor]["bufferView"].as_u64().unwrap() as usize;
        model.json["bufferViews"][view]["byteStride"] = json!(size);
        model.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = json!(accessor);
        model.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
        model.load().scene.meshes()[0].positions.clone()
    };
    let expected = SQUARE.map(glam::Vec3::from);
    let pad = |corner: [f32; 3]| corner.map(|x| x as i8);
    let bytes = |scale: i8| -> Vec<u8> {
        let corner = |corner: [f32; 3]| {
            let [x, y, z] = pad(corner).map(|x| (x * scale) as u8);
            [x, y, z, 0]
        };
        SQUARE.into_iter().flat_map(corner).collect()
    };
    assert_eq!(positions(5120, true, &bytes(127)), expected);
    assert_eq!(positions(5120, false, &bytes(1)), expected);
    let words: Vec<u8> = SQUARE
        .into_iter()
        .flat_map(|[x, y, z]| [x, y, z, 0.0])
        .flat_map(|x| ((32_767.0 * x) as i16).to_le_bytes())
        .collect();
    assert_eq!(positions(5122, true, &words), expected);
}

/// A square in front of that of [`square`], and a light, below a node.
fn with_hidden(visible: serde_json::Value) -> Model {
    let mut model = square();
    let near = model.node(json!({ "mesh": 0, "translation": [0, 0, 1] }));
    let light = json!({ "KHR_lights_punctual": { "light": 0 } });
    let light = model.node(json!({ "extensions": light, "translation": [0, 0, 2] }));
    let parent = model.node(json!({
        "children": [near, light], "extensions": { "KHR_node_visibility": visible },
    }));
    model.json["extensions"] =
        json!({ "KHR_lights_punctual": { "lights": [{ "type": "point", "intensity": 683 }] } });
    model.json["scenes"] = json!([{ "nodes": [0, parent] }]);
    model.json["extensionsRequired"] = json!(["KHR_node_visibility"]);
    model
}

#[test]
fn hidden_nodes_have_neither_meshes_nor_lights() {
    for (visible, count, lights) in
        [(json!({ "visible": false }), 1, 0), (json!({ "visible": true }), 2, 1), (json!({}), 2, 1)]
    {
        let loaded = with_hidden(visible.clone()).load();
        let scene = &loaded.scene;
        assert_eq!(scene.placements().len(), count, "{visible}");
        assert_eq!(scene.lights().emitters().len(), lights, "{visible}");
        assert!(!loaded.warnings_text().contains("KHR_node_visibility"));
    }
    // A visible node below a hidden one is hidden as well.
    let mut model = with_hidden(json!({ "visible": false }));
    model.json["nodes"][1]["extensions"] = json!({ "KHR_node_visibility": { "visible": true } });
    assert_eq!(model.load().scene.placements().len(), 1);
}
