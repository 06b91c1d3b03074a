//! Small glTF files, made piece by piece.

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use bdpm::Renderer;
use bdpm::load::{Loaded, load};
use bdpm::noise::Measure;
use bdpm::scene::Scene;
use bdpm::scene::backend::{Backend, build};
use bdpm::settings::{PartialSettings, Settings};
use glam::Vec3;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::Arc;
use tempfile::TempDir;

pub const U8: u64 = 5121;
pub const U16: u64 = 5123;
pub const U32: u64 = 5125;
pub const F32: u64 = 5126;

/// A document with one buffer.
#[derive(Clone)]
pub struct Model {
    pub json: Value,
    pub bin: Vec<u8>,
}

pub fn bytes(numbers: &[f32]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

impl Model {
    pub fn new() -> Self {
        let empty = json!([]);
        let json = json!({
            "asset": { "version": "2.0" },
            "accessors": empty, "bufferViews": empty, "meshes": empty, "nodes": empty,
            "materials": empty, "cameras": empty, "textures": empty, "images": empty,
        });
        Self { json, bin: Vec::new() }
    }

    /// Adds an element to a list and returns its index.
    pub fn push(&mut self, list: &str, element: Value) -> usize {
        let list = self.json[list].as_array_mut().unwrap();
        list.push(element);
        list.len() - 1
    }

    pub fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let offset = self.bin.len();
        self.bin.extend_from_slice(bytes);
        let view = json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() });
        self.push("bufferViews", view)
    }

    pub fn accessor(&mut self, bytes: &[u8], code: u64, kind: &str, count: usize) -> usize {
        let view = self.view(bytes);
        let (code, kind) = (json!(code), json!(kind));
        let own =
            json!({ "bufferView": view, "componentType": code, "type": kind, "count": count });
        self.push("accessors", own)
    }

    pub fn points(&mut self, points: &[[f32; 3]]) -> usize {
        self.accessor(&bytes(points.as_flattened()), F32, "VEC3", points.len())
    }

    pub fn uvs(&mut self, uvs: &[[f32; 2]]) -> usize {
        self.accessor(&bytes(uvs.as_flattened()), F32, "VEC2", uvs.len())
    }

    pub fn indices(&mut self, indices: &[u16]) -> usize {
        let bytes: Vec<u8> = indices.iter().flat_map(|index| index.to_le_bytes()).collect();
        self.accessor(&bytes, U16, "SCALAR", indices.len())
    }

    pub fn node(&mut self, node: Value) -> usize {
        self.push("nodes", node)
    }

    /// The document with its buffer as a data URI, and without empty lists.
    pub fn text(&self) -> String {
        let data = BASE64_STANDARD.encode(&self.bin);
        self.text_with(json!(format!("data:application/octet-stream;base64,{data}")))
    }

    /// The JSON text with another URI of the buffer, or none.
    pub fn text_with(&self, uri: Value) -> String {
        let mut json = self.json.clone();
        if json["buffers"].is_null() && !self.bin.is_empty() {
            json["buffers"] = json!([{ "byteLength": self.bin.len() }]);
            if !uri.is_null() {
                json["buffers"][0]["uri"] = uri;
            }
        }
        json.as_object_mut().unwrap().retain(|_, value| *value != json!([]));
        json.to_string()
    }

    pub fn glb(&self) -> Vec<u8> {
        let mut text = self.text_with(Value::Null).into_bytes();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let word = |number: usize| u32::try_from(number).unwrap().to_le_bytes();
        let length = word(12 + 8 + text.len() + 8 + bin.len());
        let head = [*b"glTF", word(2), length, word(text.len()), *b"JSON"].concat();
        [&head[..], &text, &word(bin.len()), b"BIN\0", &bin].concat()
    }

    pub fn files(&self) -> Files {
        files(&[("a.gltf", self.text().as_bytes())])
    }

    #[track_caller]
    pub fn load(&self) -> Loaded {
        self.files().load()
    }
}

/// A folder of files; the last one is loaded.
pub struct Files(pub TempDir, pub PathBuf);

pub fn files(list: &[(&str, &[u8])]) -> Files {
    let folder = TempDir::new().unwrap();
    let mut last = PathBuf::new();
    for (name, content) in list {
        last = folder.path().join(name);
        std::fs::write(&last, content).unwrap();
    }
    Files(folder, last)
}

impl Files {
    #[track_caller]
    pub fn load(&self) -> Loaded {
        load(&self.1).unwrap_or_else(|e| panic!("{e}"))
    }

    /// The error must hold all parts, the file's name, and an advice.
    #[track_caller]
    pub fn refused(&self, parts: &[&str]) {
        let error = load(&self.1).expect_err("loaded").to_string();
        for part in parts.iter().chain(&["\nhelp: "]) {
            assert!(error.contains(part), "no {part:?} in:\n{error}");
        }
        assert!(error.contains(&*self.0.path().to_string_lossy()), "no path in:\n{error}");
    }
}

/// A grey diffuse material like that of an OBJ file without one.
pub fn grey() -> Value {
    let pbr = json!({ "baseColorFactor": [0.5, 0.5, 0.5, 1], "metallicFactor": 0 });
    json!({ "pbrMetallicRoughness": pbr, "doubleSided": true, "extensions": diffuse() })
}

/// Extensions that leave a material without highlights.
pub fn diffuse() -> Value {
    json!({ "KHR_materials_ior": { "ior": 1 } })
}

/// Corners of a square, and its two triangles.
pub const SQUARE: [[f32; 3]; 4] =
    [[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]];
pub const TWO: [u16; 6] = [0, 1, 2, 0, 2, 3];

/// One node with a grey square, and the same as an OBJ file.
pub fn square() -> Model {
    let mut model = Model::new();
    let (positions, indices) = (model.points(&SQUARE), model.indices(&TWO));
    let material = model.push("materials", grey());
    let part = json!({
        "attributes": { "POSITION": positions }, "indices": indices, "material": material,
    });
    model.push("meshes", json!({ "primitives": [part] }));
    model.node(json!({ "mesh": 0 }));
    model
}

pub const SQUARE_OBJ: &str = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3 4\n";

/// The image of two iterations on 16 by 12 pixels.
fn image(scene: &Arc<Scene>, backend: Backend) -> Vec<Vec3> {
    let asked = PartialSettings {
        resolution: Some([16, 12]),
        light_paths: Some(2000),
        ..PartialSettings::default()
    };
    let settings = Settings::resolve(&asked, &PartialSettings::default(), scene.size()).unwrap();
    let accel = build(backend, scene).unwrap();
    let mut renderer = Renderer::new(scene, &accel, settings).unwrap();
    renderer.iterate(Measure::Off);
    renderer.iterate(Measure::Off);
    renderer.film().mean()
}

/// Both scenes are the same bit for bit, and so are their images on all backends.
#[track_caller]
pub fn assert_same(a: &Arc<Scene>, b: &Arc<Scene>) {
    assert_eq!(a.triangles(), b.triangles());
    assert_eq!(a.fingerprint(), b.fingerprint());
    for backend in Backend::ALL.into_iter().filter(|backend| build(*backend, a).is_ok()) {
        let image = image(a, backend);
        assert!(image.iter().any(|value| value.x > 0.0), "the image is black");
        assert_eq!(image, self::image(b, backend), "{backend}");
    }
}
