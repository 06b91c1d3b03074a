//! Whatever is wrong with a glTF file, the error names the file, the element and what to do.

use crate::common::gltf::*;
use serde_json::{Value, json};

/// The square after a change must be refused with all parts in the message.
#[track_caller]
fn refused(change: impl FnOnce(&mut Model), parts: &[&str]) {
    let mut model = square();
    change(&mut model);
    let name_and_parts: Vec<&str> = [&["a.gltf:"], parts].concat();
    model.files().refused(&name_and_parts);
}

/// Checks a model with one replaced value of its JSON.
#[track_caller]
fn with(pointer: &str, value: Value, parts: &[&str]) {
    refused(
        |model| match model.json.pointer_mut(pointer) {
            Some(place) => *place = value,
            None => {
                let (parent, key) = pointer.rsplit_once('/').unwrap();
                model.json.pointer_mut(parent).unwrap()[key] = value;
            }
        },
        parts,
    );
}

#[test]
fn text_that_is_not_gltf_is_refused() {
    for (text, parts) in [
        ("", &["a.gltf:1: this is not valid glTF: EOF"][..]),
        ("hello", &["a.gltf:1: this is not valid glTF: expected value"]),
        ("{}", &["asset.version is missing"]),
        (
            "{\"asset\":\n{\"version\":2}}",
            &["a.gltf:2: this is not valid glTF: invalid type", "2 | {\"ver"],
        ),
        ("{\"asset\":{\"version\":\"1.0\"}}", &["asset.version: the file is glTF 1.0", "glTF 2.0"]),
        (
            "{\"asset\":{\"version\":\"1.0\"},\"nodes\":{}}",
            &["the file is glTF 1.0", "gltf-pipeline"],
        ),
        ("{\"meshes\":{\"a\":{}}}", &["the file is glTF 1.0, but only 2.0 is supported"]),
        ("{\"asset\":{\"version\":\"2.0\",\"minVersion\":\"3.0\"}}", &["the file is glTF 3.0"]),
        ("{\"asset\":{\"version\":\"2.0\"}}", &["the scene has no triangle"]),
        ("{\"asset\":{\"version\":\"2.0\"},\"nodes\":[{\"mesh\":-1}]}", &["not valid glTF", "-1"]),
        ("{\"asset\":{\"version\":\"2.0\"},\"nodes\":[{\"mesh\":1e400}]}", &["not valid glTF"]),
        ("{\"asset\":{\"version\":\"2.0\"}}x", &["trailing characters"]),
    ] {
        files(&[("a.gltf", text.as_bytes())]).refused(parts);
    }
    let deep = format!("{{\"asset\":{}1{}}}", "[".repeat(100_000), "]".repeat(100_000));
    files(&[("a.gltf", deep.as_bytes())]).refused(&["a.gltf:1: this is not valid glTF"]);
    let many = format!("{{\"nodes\":[{}]}}", "{},".repeat(2_000_001));
    files(&[("a.gltf", many.as_bytes())]).refused(&["more than 2000000 JSON objects"]);
}

#[test]
fn truncated_glb_files_are_refused() {
    let good = square().glb();
    // Without its last bytes the file has fewer than its header says.
    for length in (4..good.len()).filter(|length| *length < 40 || length % 7 == 0) {
        files(&[("a.glb", &good[..length])]).refused(&["a.glb: the GLB file is cut off"]);
    }
    let changed = |at: usize, bytes: &[u8]| {
        let mut glb = good.clone();
        glb[at..at + bytes.len()].copy_from_slice(bytes);
        files(&[("a.glb", &glb)])
    };
    changed(4, &[1]).refused(&["GLB version 1, but only 2 is supported"]);
    changed(8, &[0xff; 4]).refused(&["cut off"]);
    changed(12, &[0xff; 4]).refused(&["cut off"]);
    changed(16, b"JSOM").refused(&["does not begin with JSON"]);
    changed(20, b"x").refused(&["a.glb:1: this is not valid glTF"]);
    let end = 20 + u32::from_le_bytes(good[12..16].try_into().unwrap()) as usize;
    changed(end + 4, b"BIM\0").refused(&["buffers[0]: it has no uri"]);
    changed(end, &[0xff; 4]).refused(&["cut off"]);
}

#[test]
fn indices_out_of_range_are_refused() {
    with("/nodes/0/mesh", json!(7), &["nodes[0].mesh: there is no meshes[7]; the file has 1"]);
    with("/nodes/0/camera", json!(0), &["nodes[0].camera: there is no cameras[0]"]);
    with("/nodes/0/children", json!([4]), &["nodes[0].children: there is no nodes[4]"]);
    with("/scene", json!(3), &["scene: there is no scenes[3]"]);
    with("/scenes", json!([{ "nodes": [9] }]), &["scenes[0].nodes: there is no nodes[9]"]);
    let light = json!({ "KHR_lights_punctual": { "light": 2 } });
    with("/nodes/0/extensions", light, &["KHR_lights_punctual.light: there is no lights[2]"]);
    let part = "/meshes/0/primitives/0";
    let at = |key: &str| format!("{part}/{key}");
    with(
        &at("material"),
        json!(5),
        &["meshes[0].primitives[0].material: there is no materials[5]"],
    );
    with(&at("indices"), json!(5), &["meshes[0].primitives[0]: there is no accessors[5]"]);
    with(&at("attributes/POSITION"), json!(5), &["attributes.POSITION: there is no accessors[5]"]);
    with(&at("attributes/NORMAL"), json!(5), &["attributes.NORMAL: there is no accessors[5]"]);
    with(
        "/accessors/0/bufferView",
        json!(9),
        &["accessors[0].bufferView: there is no bufferViews[9]"],
    );
    with("/bufferViews/0/buffer", json!(3), &["bufferViews[0].buffer: there is no buffers[3]"]);
    let textured = |model: &mut Model| {
        model.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] =
            json!({ "index": 0 });
    };
    refused(
        textured,
        &["materials[0].pbrMetallicRoughness.baseColorTexture: there is no textures[0]"],
    );
    let source = |source: Value| {
        move |model: &mut Model| {
            textured(model);
            model.push("textures", source);
        }
    };
    refused(source(json!({ "source": 1 })), &["textures[0].source: there is no images[1]"]);
    let image = |image: Value| {
        move |model: &mut Model| {
            source(json!({ "source": 0 }))(model);
            model.push("images", image);
        }
    };
    refused(
        image(json!({ "bufferView": 8 })),
        &["images[0].bufferView: there is no bufferViews[8]"],
    );
    refused(image(json!({})), &["images[0]: it has neither uri nor bufferView"]);
}

#[test]
fn accessors_beyond_their_buffers_are_refused() {
    with(
        "/accessors/0/count",
        json!(5),
        &["accessors[0]: 5 elements of 12 bytes", "48 bytes of the view"],
    );
    with("/accessors/0/byteOffset", json!(4), &["accessors[0]: 4 elements", "from byte 4 on"]);
    for huge in [u64::MAX, u64::MAX / 12, 1 << 60] {
        with("/accessors/1/count", json!(huge), &["the scene has more than 4294967295 triangles"]);
        with("/accessors/0/count", json!(huge), &["accessors[0]"]);
        with("/accessors/0/byteOffset", json!(huge), &["accessors[0]: 4 elements of 12 bytes"]);
        with("/bufferViews/0/byteOffset", json!(huge), &["bufferViews[0]: byteOffset"]);
        with("/bufferViews/0/byteLength", json!(huge), &["bufferViews[0]: byteOffset 0 and"]);
        with("/bufferViews/0/byteStride", json!(huge), &["accessors[0]: 4 elements of 12 bytes"]);
    }
    // Less than can be numbered, and more than memory holds.
    with("/accessors/1/count", json!(12_000_000_000_u64), &["GiB of memory, but"]);
    with("/bufferViews/0/byteStride", json!(8), &["accessors[0]: byteStride is 8, less than"]);
    with(
        "/accessors/0/type",
        json!("VEC2"),
        &["attributes.POSITION: accessors[0] holds VEC2, not VEC3"],
    );
    with("/accessors/0/componentType", json!(5124), &["accessors[0]: unknown componentType 5124"]);
    with("/accessors/1/componentType", json!(5122), &["indices must be unsigned integers"]);
    with("/meshes/0/primitives/0/mode", json!(7), &["meshes[0].primitives[0]: unknown mode 7"]);
    with("/meshes/0/primitives/0/attributes", json!({}), &["attributes.POSITION is missing"]);
    refused(
        |model| model.bin[48 + 4..][..2].copy_from_slice(&[4, 0]),
        &["meshes[0].primitives[0].indices: index 4 at place 2, but there are 4 vertices"],
    );
    for bits in [f32::NAN, f32::INFINITY, -2e12] {
        refused(
            |model| model.bin[16..20].copy_from_slice(&bits.to_le_bytes()),
            &["attributes.POSITION: element 1 is not finite or beyond 1e12"],
        );
    }
    refused(
        |model| {
            let normals = model.points(&SQUARE[..3]);
            let attributes = &mut model.json["meshes"][0]["primitives"][0]["attributes"];
            attributes["NORMAL"] = json!(normals);
        },
        &["attributes.NORMAL: 3 elements for 4 vertices"],
    );
}

#[test]
fn invalid_sparse_accessors_are_refused() {
    let sparse = |indices: &[u8], count: u64, parts: &[&str]| {
        refused(
            |model| {
                let (indices, values) = (model.view(indices), model.view(&[0; 24]));
                model.json["accessors"][0]["sparse"] = json!({
                    "count": count,
                    "indices": { "bufferView": indices, "componentType": U8 },
                    "values": { "bufferView": values },
                });
            },
            parts,
        );
    };
    let ascend = "accessors[0].sparse.indices: indices must ascend and be less than 4";
    sparse(&[1, 1], 2, &[ascend]);
    sparse(&[2, 1], 2, &[ascend]);
    sparse(&[1, 4], 2, &[ascend]);
    sparse(&[1], 2, &["accessors[0].sparse.indices: 2 elements of 1 bytes"]);
    sparse(&[0, 1, 2], 3, &["accessors[0].sparse.values: 3 elements of 12 bytes"]);
    sparse(&[0], 5, &["accessors[0].sparse: count is 5, more than the 4 elements"]);
    sparse(&[0], u64::MAX, &["meshes[0]: sparse accessors replace more elements"]);
}

#[test]
fn missing_buffers_are_refused() {
    let uri = |uri: &str, parts: &[&str]| {
        let text = square().text_with(json!(uri));
        files(&[("short.bin", &[0; 59]), ("a.gltf", text.as_bytes())]).refused(parts);
    };
    uri(
        "none.bin",
        &["buffers[0].uri: there is no file `none.bin`", "put the file into the folder"],
    );
    uri("short.bin", &["buffers[0]: byteLength is 60, but it has 59 bytes"]);
    uri(
        "https://example.org/a.bin",
        &["buffers[0].uri: `https://example.org/a.bin` is not a file"],
    );
    uri("data:text/plain,hello", &["buffers[0].uri: the data URI is not in base64"]);
    uri("data:;base64,A=B", &["buffers[0].uri: the data URI is not valid base64"]);
    uri(".", &["this is a folder"]);
    let none = square().text_with(Value::Null);
    files(&[("a.gltf", none.as_bytes())]).refused(&["buffers[0]: it has no uri"]);
}

#[test]
fn nodes_that_are_not_a_tree_are_refused() {
    let nodes = |nodes: Value, parts: &[&str]| with("/nodes", nodes, parts);
    nodes(
        json!([{ "mesh": 0, "children": [0] }]),
        &["nodes[0].children: the node is below itself"],
    );
    nodes(
        json!([{ "children": [1] }, { "children": [2] }, { "children": [1] }]),
        &["nodes[2].children: nodes[1] is already a child of nodes[0]"],
    );
    nodes(json!([{ "children": [1] }, { "children": [0] }, { "mesh": 0 }]), &["is below itself"]);
    nodes(json!([{ "children": [1, 1] }, {}]), &["nodes[0].children: nodes[1] is already a child"]);
}

#[test]
fn impossible_node_transforms_are_refused() {
    with(
        "/nodes/0/rotation",
        json!([0, 0, 0, 0]),
        &["nodes[0].rotation: the quaternion has no length"],
    );
    let projective = json!([1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
    with("/nodes/0/matrix", projective, &["nodes[0].matrix: its last row is not 0, 0, 0, 1"]);
    with("/nodes/0/matrix", json!([1, 2, 3]), &["not valid glTF: invalid length 3"]);
    with("/nodes/0/translation", json!([1e30, 0, 0]), &["nodes[0]: its transform moves it out"]);
    with("/nodes/0/scale", json!([1e308, 1, 1]), &["nodes[0]: its transform moves it out"]);
    refused(
        |model| {
            model.json["nodes"] = json!([
                { "scale": [1e300, 1, 1], "children": [1] }, { "scale": [1e300, 1, 1], "mesh": 0 }
            ]);
        },
        &["nodes[1]: its transform is not finite"],
    );
}

#[test]
fn materials_lights_and_cameras_out_of_range_are_refused() {
    let material = "/materials/0";
    let at = |key: &str| format!("{material}/{key}");
    with(
        &at("pbrMetallicRoughness/roughnessFactor"),
        json!(1.5),
        &["materials[0].pbrMetallicRoughness.roughnessFactor: 1.5 is not between 0 and 1"],
    );
    with(&at("pbrMetallicRoughness/baseColorFactor"), json!([1, -1, 1, 1]), &["-1 is not between"]);
    with(&at("alphaMode"), json!("HALF"), &["materials[0].alphaMode: it is none of OPAQUE"]);
    with(&at("emissiveFactor"), json!([-1, 0, 0]), &["materials[0].emissiveFactor: the emission"]);
    with(&at("emissiveFactor"), json!([1e39, 0, 0]), &["not valid glTF: number out of range"]);
    refused(
        |model| {
            let strong = json!({ "emissiveStrength": 1e38 });
            let material = &mut model.json["materials"][0];
            material["emissiveFactor"] = json!([1e38, 0, 0]);
            material["extensions"] = json!({ "KHR_materials_emissive_strength": strong });
        },
        &["emissiveFactor: the emission is negative or not finite"],
    );
    let ior = json!({ "KHR_materials_ior": { "ior": 0.01 } });
    with(&at("extensions"), ior, &["KHR_materials_ior.ior: it is 0.01, not from 0.1 to 10"]);
    let light = |light: Value, node: Value, parts: &[&str]| {
        refused(
            |model| {
                let lights = json!({ "lights": [light] });
                model.json["extensions"] = json!({ "KHR_lights_punctual": lights });
                let mut node = node;
                node["extensions"] = json!({ "KHR_lights_punctual": { "light": 0 } });
                model.node(node);
            },
            parts,
        );
    };
    let place = "extensions.KHR_lights_punctual.lights[0]";
    light(json!({ "type": "laser" }), json!({}), &[place, "none of point, spot and directional"]);
    light(
        json!({ "type": "point", "intensity": -1 }),
        json!({}),
        &[place, "negative or not finite"],
    );
    for (inner, outer) in [(0.5, 0.4), (-0.1, 0.4), (0.0, 0.0), (0.0, 2.0)] {
        let cones = json!({ "innerConeAngle": inner, "outerConeAngle": outer });
        light(json!({ "type": "spot", "spot": cones }), json!({}), &[place, "innerConeAngle is"]);
    }
    let flat = json!({ "scale": [1, 1, 0] });
    light(json!({ "type": "directional" }), flat.clone(), &["leaves the light no direction"]);
    let far = json!({ "translation": [1e20, 0, 0] });
    light(json!({ "type": "point" }), far, &["nodes[1]", "position is beyond 1e12"]);
    let camera = |camera: Value, node: Value, parts: &[&str]| {
        refused(
            |model| {
                model.push("cameras", camera);
                let mut node = node;
                node["camera"] = json!(0);
                model.node(node);
            },
            parts,
        );
    };
    let lens = |yfov: f32| json!({ "type": "perspective", "perspective": { "yfov": yfov } });
    camera(lens(0.0), json!({}), &["nodes[1].camera: yfov is 0, not between 0 and pi"]);
    camera(lens(4.0), json!({}), &["nodes[1].camera: yfov is 4"]);
    camera(
        lens(1.0),
        flat,
        &["nodes[1].camera: the camera's direction and up vector are parallel"],
    );
    camera(json!({ "type": "perspective" }), json!({}), &["cameras[0]: perspective is missing"]);
    camera(json!({ "type": "fisheye" }), json!({}), &["cameras[0]: its type is neither"]);
    let wide = json!({ "yfov": 1, "aspectRatio": 0 });
    let wide = json!({ "type": "perspective", "perspective": wide });
    camera(wide, json!({}), &["nodes[1].camera: aspectRatio is not a positive number"]);
}

#[test]
fn unsupported_required_extensions_are_refused() {
    let required = |name: &str, parts: &[&str]| with("/extensionsRequired", json!([name]), parts);
    let draco = "KHR_draco_mesh_compression";
    required(draco, &["extensionsRequired: the file needs `KHR_draco", "without compression"]);
    let older = "KHR_materials_pbrSpecularGlossiness";
    required(
        older,
        &["the file needs `KHR_materials_pbrSpecular", "is not supported", "metalrough OLD"],
    );
    required("KHR_texture_basisu", &["the file needs `KHR_texture_basisu`", "without these"]);
}

/// Few bytes that would take much memory or time.
#[test]
fn files_with_exploding_triangle_counts_are_refused() {
    let doubled = |model: &mut Model| {
        // An accessor without a view: zeros that take no bytes of the file.
        let zeros = json!({ "componentType": F32, "type": "VEC3", "count": 3_000_000_000_u64 });
        let accessor = model.push("accessors", zeros);
        let part = json!({ "attributes": { "POSITION": accessor } });
        model.json["meshes"][0]["primitives"] = json!([part]);
    };
    refused(doubled, &["triangles", "leave out or simplify"]);
    refused(
        |model| {
            let part = model.json["meshes"][0]["primitives"][0].clone();
            model.json["meshes"][0]["primitives"] = json!(vec![part; 10_000]);
            model.json["nodes"] = json!(vec![json!({ "mesh": 0 }); 500_000]);
        },
        &["the scene has more than 4294967295 triangles"],
    );
}
