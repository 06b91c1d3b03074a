//! No glTF file makes the loader panic or hold more than its size warrants: a good one with values
//! of its JSON replaced, with pieces of its text or bytes deleted, doubled or replaced.
//! `PROPTEST_CASES=100000` tries far more.

use crate::common::gltf::*;
use crate::common::mutate::{apply, change, fuzz_config, load_and_check};
use proptest::collection::vec;
use proptest::prelude::*;
use serde_json::{Value, json};
use std::sync::LazyLock;

/// A file of nearly everything that is read.
fn rich() -> Model {
    let mut model = square();
    let uvs = model.uvs(&[[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]);
    let normals = model.points(&[[0.0, 0.0, 1.0]; 4]);
    let (replaced, values) = (model.view(&[1, 3]), model.view(&bytes(&[0.5; 6])));
    model.json["accessors"][0]["sparse"] = json!({
        "count": 2,
        "indices": { "bufferView": replaced, "componentType": U8 },
        "values": { "bufferView": values, "byteOffset": 0 },
    });
    let attributes = &mut model.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["TEXCOORD_0"] = json!(uvs);
    attributes["NORMAL"] = json!(normals);
    attributes["COLOR_0"] = json!(normals);
    let corners = model.points(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]);
    let joints = model.accessor(&[0, 1, 0, 0].repeat(4), U8, "VEC4", 4);
    let weights = model.accessor(&bytes(&[0.5, 0.5, 0.0, 0.0].repeat(4)), F32, "VEC4", 4);
    let bound = [glam::Mat4::IDENTITY; 2].map(|matrix| matrix.to_cols_array());
    let bound = model.accessor(&bytes(bound.as_flattened()), F32, "MAT4", 2);
    model.json["skins"] = json!([{ "joints": [4, 5], "inverseBindMatrices": bound }]);
    let strip = json!({
        "attributes": { "POSITION": corners, "JOINTS_0": joints, "WEIGHTS_0": weights },
        "mode": 5, "material": 1,
        "targets": [{ "POSITION": corners }, { "POSITION": normals, "NORMAL": normals }],
    });
    let fan = json!({ "attributes": { "POSITION": corners }, "mode": 6, "material": 2 });
    model.push(
        "meshes",
        json!({ "name": "more", "weights": [0.5, 0], "primitives": [strip, fan, { "attributes": {} , "mode": 0 }] }),
    );

    let mut png = Vec::new();
    let mut encoder = png::Encoder::new(&mut png, 2, 1);
    encoder.set_color(png::ColorType::Rgba);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&[255, 0, 0, 255, 0, 255, 0, 100]).unwrap();
    writer.finish().unwrap();
    let view = model.view(&png);
    model.push("images", json!({ "bufferView": view, "mimeType": "image/png" }));
    model.json["samplers"] = json!([{ "wrapS": 33071, "wrapT": 10497 }]);
    model.push("textures", json!({ "source": 0, "sampler": 0 }));
    let transform =
        json!({ "offset": [0.1, 0.2], "rotation": 0.5, "scale": [2, 2], "texCoord": 0 });
    model.json["materials"][0] = json!({
        "name": "cut",
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.8, 0.5, 0.2, 1],
            "baseColorTexture": {
                "index": 0, "texCoord": 0, "extensions": { "KHR_texture_transform": transform },
            },
            "metallicFactor": 0.2,
            "roughnessFactor": 0.9,
            "metallicRoughnessTexture": { "index": 0 },
        },
        "alphaMode": "MASK", "alphaCutoff": 0.6, "doubleSided": true,
        "extensions": { "KHR_materials_clearcoat": { "clearcoatFactor": 0.7 } },
    });
    model.push(
        "materials",
        json!({
            "emissiveFactor": [1, 0.5, 0.25], "emissiveTexture": { "index": 0 },
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 5 } },
        }),
    );
    model.push(
        "materials",
        json!({
            "extensions": {
                "KHR_materials_transmission": { "transmissionFactor": 1 },
                "KHR_materials_volume": {
                    "thicknessFactor": 1, "attenuationColor": [1, 0.5, 1], "attenuationDistance": 2,
                },
                "KHR_materials_specular": { "specularFactor": 0.5, "specularColorFactor": [1, 2, 0] },
                "KHR_materials_ior": { "ior": 1.3 },
            },
        }),
    );
    let lamp = |kind: &str| json!({ "type": kind, "intensity": 100, "color": [1, 1, 0.5] });
    let mut spot = lamp("spot");
    spot["spot"] = json!({ "innerConeAngle": 0.2, "outerConeAngle": 0.5 });
    let lights = json!({ "lights": [lamp("point"), spot, lamp("directional")] });
    model.json["extensions"] = json!({ "KHR_lights_punctual": lights });
    model.json["extensionsUsed"] = json!(["KHR_lights_punctual", "KHR_materials_ior"]);
    model.json["extensionsRequired"] = json!(["KHR_lights_punctual"]);
    let light = |index: usize| json!({ "KHR_lights_punctual": { "light": index } });
    model.push(
        "cameras",
        json!({
            "type": "perspective", "perspective": { "yfov": 0.7, "aspectRatio": 1.5, "znear": 0.1 },
        }),
    );
    let sizes = model.points(&[[1.0, 2.0, 0.5]; 4]);
    let instances = json!({
        "EXT_mesh_gpu_instancing": {
            "attributes": { "TRANSLATION": normals, "ROTATION": weights, "SCALE": sizes },
        },
    });
    let matrix = [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, -2, 0, 1, 2, 3, 1];
    model.json["nodes"] = json!([
        { "mesh": 0, "children": [1, 2], "translation": [0, 0, -3] },
        { "mesh": 1, "rotation": [0, 0.6, 0, 0.8], "scale": [1, -2, 1], "weights": [0.1, 0.2], "skin": 0 },
        { "mesh": 0, "matrix": matrix, "children": [3], "extensions": instances },
        { "camera": 0, "name": "eye", "extensions": light(1) },
        { "extensions": light(0), "translation": [0, 5, 0] },
        { "extensions": light(2) },
    ]);
    model.json["scenes"] = json!([{ "nodes": [0, 4, 5] }]);
    model.json["scene"] = json!(0);
    model.json["buffers"] = json!([{ "byteLength": model.bin.len() }]);
    model
}

static RICH: LazyLock<Model> = LazyLock::new(rich);

/// With its buffer in the text.
fn rich_text() -> Vec<u8> {
    let mut model = RICH.clone();
    model.json.as_object_mut().unwrap().remove("buffers");
    model.text().into_bytes()
}

/// Places of all values of the JSON.
static PLACES: LazyLock<Vec<String>> = LazyLock::new(|| {
    fn walk(value: &Value, place: &str, all: &mut Vec<String>) {
        all.push(place.to_owned());
        match value {
            Value::Object(map) => {
                map.iter().for_each(|(k, v)| walk(v, &format!("{place}/{k}"), all))
            }
            Value::Array(list) => {
                list.iter().enumerate().for_each(|(i, v)| walk(v, &format!("{place}/{i}"), all));
            }
            _ => {}
        }
    }
    let mut all = Vec::new();
    walk(&RICH.json, "", &mut all);
    all
});

/// Values that are likely to matter where they do not belong.
fn values() -> Vec<Value> {
    let numbers = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 63, 64, 65, 5120, 5121, 5122, 5123, 5125, 5126];
    let mut all: Vec<Value> = numbers.map(Value::from).to_vec();
    all.extend([u64::MAX, u64::MAX - 1, 1 << 63, 1 << 32, (1 << 32) - 1, 1 << 31].map(Value::from));
    all.extend([-1_i64, i64::MIN].map(Value::from));
    all.extend([0.5, -0.5, 1e-45, 1e-300, 1e12, 3e38, 1e39, 1e300, 1.6, -0.0].map(Value::from));
    all.extend(
        ["", "VEC2", "VEC3", "SCALAR", "MASK", "BLEND", "spot", "data:;base64,AAAA", "."]
            .map(Value::from),
    );
    all.extend([json!(null), json!(true), json!([]), json!({}), json!([0]), json!([0, 1, 2])]);
    all
}

/// A change of the JSON as such.
#[derive(Clone, Debug)]
enum Edit {
    Replace { place: usize, value: usize },
    Copy { from: usize, to: usize },
    Remove { place: usize },
}

fn edit() -> impl Strategy<Value = Edit> {
    let place = 0..PLACES.len();
    prop_oneof![
        4 => (place.clone(), 0..values().len()).prop_map(|(place, value)| Edit::Replace { place, value }),
        2 => (place.clone(), place.clone()).prop_map(|(from, to)| Edit::Copy { from, to }),
        1 => place.prop_map(|place| Edit::Remove { place }),
    ]
}

fn edited(edits: &[Edit]) -> Model {
    let mut model = RICH.clone();
    for edit in edits {
        let set = |json: &mut Value, place: usize, value: Value| {
            if let Some(old) = json.pointer_mut(&PLACES[place]) {
                *old = value;
            }
        };
        match *edit {
            Edit::Replace { place, value } => set(&mut model.json, place, values()[value].clone()),
            Edit::Copy { from, to } => {
                let value = model.json.pointer(&PLACES[from]).cloned();
                set(&mut model.json, to, value.unwrap_or_default());
            }
            Edit::Remove { place } => {
                let (parent, key) = PLACES[place].rsplit_once('/').unwrap_or_default();
                match model.json.pointer_mut(parent) {
                    Some(Value::Object(map)) => drop(map.remove(key)),
                    Some(Value::Array(list)) => drop(list.pop()),
                    _ => {}
                }
            }
        }
    }
    model
}

/// The document as it is, in a GLB file.
fn as_glb(model: &Model) -> Vec<u8> {
    let mut glb = RICH.glb();
    let text = model.json.to_string().into_bytes();
    let json_end = 20 + u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    glb.splice(20..json_end, text.iter().copied());
    glb[12..16].copy_from_slice(&(text.len() as u32).to_le_bytes());
    let length = glb.len() as u32;
    glb[8..12].copy_from_slice(&length.to_le_bytes());
    glb
}

fn check(content: &[u8], name: &str) {
    let files = files(&[(name, content)]);
    load_and_check(&files.1);
}

proptest! {
    #![proptest_config(fuzz_config(1500))]

    #[test]
    fn changed_values_load_or_are_refused(edits in vec(edit(), 1..5)) {
        check(&as_glb(&edited(&edits)), "a.glb");
    }

    #[test]
    fn changed_text_loads_or_is_refused(changes in vec(change(), 1..6)) {
        let mut text = rich_text();
        changes.iter().for_each(|change| apply(&mut text, change));
        check(&text, "a.gltf");
    }

    #[test]
    fn changed_containers_load_or_are_refused(changes in vec(change(), 1..6)) {
        let mut glb = RICH.glb();
        changes.iter().for_each(|change| apply(&mut glb, change));
        check(&glb, "a.glb");
    }

    #[test]
    fn changed_bytes_load_or_are_refused(edits in vec((0.0..1.0, any::<u8>()), 1..40)) {
        let mut model = RICH.clone();
        for (at, byte) in edits {
            let at = (at * model.bin.len() as f64) as usize;
            model.bin[at] = byte;
        }
        check(&model.glb(), "a.glb");
    }

    #[test]
    fn files_of_random_bytes_load_or_are_refused(bytes in vec(any::<u8>(), 0..300)) {
        check(&bytes, "a.gltf");
        check(&[b"glTF\x02\0\0\0", &bytes[..]].concat(), "a.glb");
    }
}

/// The mutations above start from files that load; otherwise they would test nothing but refusal.
#[test]
fn unmodified_files_load() {
    for (name, content) in
        [("a.gltf", rich_text()), ("a.glb", RICH.glb()), ("b.glb", as_glb(&RICH))]
    {
        let loaded = files(&[(name, &content)]).load();
        assert_eq!(loaded.scene.meshes().len(), 7, "{}", loaded.warnings_text());
        assert_eq!(loaded.scene.materials().len(), 3);
        assert_eq!(loaded.scene.lights().emitters().len(), 3 + 2);
    }
}
