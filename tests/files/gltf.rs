//! glTF: every way to store a shape is the same shape, and nodes put it where they say. What the
//! same scene is as OBJ or TOML, it is bit for bit; materials, lights and cameras are in
//! `gltf_looks.rs`.

use crate::common::gltf::*;
use bdpm::import::WarningKind;
use bdpm::load::{LoadOptions, Loaded, load, load_with};
use bdpm::scene::Scene;
use glam::{Vec2, Vec3};
use serde_json::{Value, json};
use std::sync::Arc;

fn as_obj(content: &str) -> Loaded {
    files(&[("a.obj", content.as_bytes())]).load()
}

#[test]
fn all_forms_of_a_gltf_file_load_like_obj() {
    let model = square();
    let obj = as_obj(SQUARE_OBJ);
    let uri = |uri: &str| model.text_with(json!(uri));
    let beside = uri("a%20b.bin");
    let raw = uri("100%.bin");
    let unpadded = model.text().replace('=', "");
    for list in [
        &[("a.gltf", model.text().as_bytes())][..],
        &[("a.gltf", unpadded.as_bytes())],
        &[("a.gltf", format!("\u{feff}{}", model.text()).as_bytes())],
        &[("a b.bin", &model.bin), ("a.gltf", beside.as_bytes())],
        &[("100%.bin", &model.bin), ("a.gltf", raw.as_bytes())],
        &[("a.glb", &model.glb())],
        &[("binary-all-the-same.gltf", &model.glb())],
        &[("a.glb", &[&model.glb()[..], b"\0\0\0\0more"].concat())],
    ] {
        let loaded = files(list).load();
        assert_same(&loaded.scene, &obj.scene);
        assert_eq!(loaded.warnings.len(), 2, "camera and light: {}", loaded.warnings_text());
        assert!(loaded.warnings.iter().all(|warning| warning.kind == WarningKind::Chosen));
    }
}

/// The square from positions and the primitive's other keys.
fn square_of(make: impl Fn(&mut Model) -> Value) -> Arc<Scene> {
    let mut model = Model::new();
    let mut part = make(&mut model);
    part["material"] = model.push("materials", grey()).into();
    model.push("meshes", json!({ "primitives": [part] }));
    model.node(json!({ "mesh": 0 }));
    model.load().scene
}

#[test]
fn indices_of_all_sizes_and_without_indices_load() {
    let obj = as_obj(SQUARE_OBJ).scene;
    let all = |kind: u64, bytes: &[u8]| {
        square_of(|model| {
            let indices = model.accessor(bytes, kind, "SCALAR", 6);
            json!({ "attributes": { "POSITION": model.points(&SQUARE) }, "indices": indices })
        })
    };
    assert_same(&all(U8, &TWO.map(|i| i as u8)), &obj);
    assert_same(&all(U16, TWO.map(u16::to_le_bytes).as_flattened()), &obj);
    assert_same(&all(U32, TWO.map(|i| u32::from(i).to_le_bytes()).as_flattened()), &obj);
    let none = square_of(|model| {
        let points = model.points(&TWO.map(|index| SQUARE[usize::from(index)]));
        json!({ "attributes": { "POSITION": points } })
    });
    assert_eq!(none.triangles(), obj.triangles());
}

#[test]
fn strips_and_fans_load() {
    let strip = square_of(|model| {
        let points = model.points(&[SQUARE[0], SQUARE[1], SQUARE[3], SQUARE[2]]);
        json!({ "attributes": { "POSITION": points }, "mode": 5 })
    });
    let by_index = square_of(|model| {
        let (points, indices) = (model.points(&SQUARE), model.indices(&[0, 1, 3, 2]));
        json!({ "attributes": { "POSITION": points }, "indices": indices, "mode": 5 })
    });
    let fan = square_of(|model| {
        let points = model.points(&SQUARE);
        json!({ "attributes": { "POSITION": points }, "mode": 6 })
    });
    for scene in [&strip, &by_index, &fan] {
        assert_eq!(scene.triangle_count(), 2);
        let area: f32 = scene.triangles().iter().map(|t| t.area()).sum();
        assert_eq!(area, 4.0);
        assert!(scene.triangles().iter().all(|t| t.normal == Vec3::Z), "fronts are in front");
    }
    assert_eq!(strip.triangles(), by_index.triangles());
}

#[test]
fn interleaved_sparse_quantized_and_strided_accessors_load() {
    let obj = as_obj(SQUARE_OBJ).scene;
    // Positions 20 bytes apart, texture coordinates of two bytes each between them.
    let interleaved = square_of(|model| {
        let vertex = |p: &[f32; 3]| [&bytes(p)[..], &[9; 8]].concat();
        let data: Vec<u8> = SQUARE.iter().flat_map(vertex).collect();
        let points = model.accessor(&data, F32, "VEC3", 4);
        model.json["bufferViews"][0]["byteStride"] = json!(20);
        json!({ "attributes": { "POSITION": points }, "indices": model.indices(&TWO) })
    });
    assert_same(&interleaved, &obj);
    // Two of four positions replaced, over a base and over zeros.
    for with_base in [true, false] {
        let sparse = square_of(|model| {
            let mut base = SQUARE;
            base[1] = [7.0; 3];
            base[3] = [8.0; 3];
            let replaced: &[u8] = if with_base { &[1, 3] } else { &[0, 1, 2, 3] };
            let values: Vec<f32> = replaced.iter().flat_map(|i| SQUARE[usize::from(*i)]).collect();
            let points = model.points(&base);
            let (indices, values) = (model.view(replaced), model.view(&bytes(&values)));
            model.json["accessors"][points]["sparse"] = json!({
                "count": replaced.len(),
                "indices": { "bufferView": indices, "componentType": U8 },
                "values": { "bufferView": values },
            });
            if !with_base {
                let accessor = model.json["accessors"][points].as_object_mut().unwrap();
                accessor.remove("bufferView");
            }
            json!({ "attributes": { "POSITION": points }, "indices": model.indices(&TWO) })
        });
        assert_same(&sparse, &obj);
    }
    // Signed bytes, where 127 stands for 1.
    let quantized = square_of(|model| {
        model.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
        let data = SQUARE.map(|p| p.map(|x| (127.0 * x) as i8 as u8));
        let points = model.accessor(data.as_flattened(), 5120, "VEC3", 4);
        model.json["accessors"][points]["normalized"] = json!(true);
        model.json["bufferViews"][0].as_object_mut().unwrap().remove("byteStride");
        json!({ "attributes": { "POSITION": points }, "indices": model.indices(&TWO) })
    });
    assert_same(&quantized, &obj);
    // A vertex array shared with others.
    let shared = square_of(|model| {
        let mut points = vec![[5.0; 3]; 100];
        points[40..44].copy_from_slice(&SQUARE);
        let points = model.points(&points);
        let indices = model.indices(&TWO.map(|index| index + 40));
        json!({ "attributes": { "POSITION": points }, "indices": indices })
    });
    assert_eq!(shared.meshes()[0].positions.len(), 4);
    assert_same(&shared, &obj);
}

#[test]
fn normals_and_texture_coordinates_of_all_types_load() {
    let picture = || {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, 2, 2);
        encoder.set_color(png::ColorType::Rgb);
        let mut writer = encoder.write_header().unwrap();
        writer.write_image_data(&[255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255]).unwrap();
        writer.finish().unwrap();
        bytes
    };
    let uvs = [[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]];
    let scene = |code: u64, transform: Option<Value>| {
        let mut model = square();
        let uv = match code {
            F32 => model.uvs(&uvs),
            U8 => model.accessor(
                uvs.map(|uv| uv.map(|x| (255.0 * x) as u8)).as_flattened(),
                code,
                "VEC2",
                4,
            ),
            _ => {
                let data = uvs.map(|uv| uv.map(|x| ((65535.0 * x) as u16).to_le_bytes()));
                model.accessor(data.as_flattened().as_flattened(), code, "VEC2", 4)
            }
        };
        model.json["accessors"][uv]["normalized"] = json!(code != F32);
        let normals =
            model.points(&[[0.0, 0.0, 2.0], [0.0, 0.6, 0.8], [0.0, 0.0, 1.0], [f32::NAN; 3]]);
        let attributes = &mut model.json["meshes"][0]["primitives"][0]["attributes"];
        attributes["NORMAL"] = json!(normals);
        attributes["TEXCOORD_1"] = json!(uv);
        let view = model.view(&picture());
        model.push("images", json!({ "bufferView": view, "mimeType": "image/png" }));
        model.push("textures", json!({ "source": 0 }));
        let mut info = json!({ "index": 0, "texCoord": 1 });
        if let Some(transform) = transform {
            info["extensions"] = json!({ "KHR_texture_transform": transform });
        }
        model.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"] = info;
        files(&[("a.glb", &model.glb())]).load()
    };
    let plain = scene(F32, None);
    let mesh = &plain.scene.meshes()[0];
    assert_eq!(mesh.uvs, [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y], "v points up");
    assert_eq!(mesh.normals, [Vec3::Z, Vec3::new(0.0, 0.6, 0.8), Vec3::Z, Vec3::ZERO]);
    assert_eq!((plain.summary.textures, plain.warnings.len()), (1, 2), "{}", plain.warnings_text());
    for code in [U8, U16] {
        assert_same(&scene(code, None).scene, &plain.scene);
    }
    // An equal model as OBJ and MTL.
    let obj = "mtllib a.mtl\nusemtl m\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvn 0 0 2\nvn 0 .6 .8\nvn 0 0 1\n\
               vn 0 0 0\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1/1/1 2/2/2 3/3/3 4/4/4\n";
    let mtl = "newmtl m\nKd .5\nmap_Kd p.png\n";
    let obj = files(&[("p.png", &picture()), ("a.mtl", mtl.as_bytes()), ("a.obj", obj.as_bytes())]);
    assert_same(&plain.scene, &obj.load().scene);
    // Scaled about the upper left corner, turned by a quarter, moved.
    let turn = std::f32::consts::FRAC_PI_2;
    let transform = json!({ "offset": [0.25, 0.5], "rotation": turn, "scale": [2, 1] });
    let moved = scene(F32, Some(transform));
    for (uv, [u, v]) in moved.scene.meshes()[0].uvs.iter().zip(uvs) {
        // Counterclockwise as it is seen: +u goes up, where v is less, and +v to the right.
        let expected = Vec2::new(0.25 + v, 1.0 - (0.5 - 2.0 * u));
        assert!((*uv - expected).length() < 1e-6, "{uv} {expected}");
    }
}

#[test]
fn nodes_place_meshes_as_transforms_of_a_scene_file_do() {
    let toml = |keys: &str| {
        let scene = format!(
            "camera = {{ position = [0, 0, 9], direction = [0, 0, -1], fov_y_deg = {:?} }}\n\
             light = [{{ type = 'point', position = [0, 0, 5], candela = 1000 }}]\n\
             [[mesh]]\nfile = 'a.obj'\n{keys}\n",
            0.5_f32.to_degrees()
        );
        let obj = SQUARE_OBJ.replace("f 1 2 3 4", "f 1 2 3\nf 1 3 4");
        files(&[("a.obj", obj.as_bytes()), ("s.toml", scene.as_bytes())]).load().scene
    };
    let gltf = |nodes: &[Value]| {
        let mut model = square();
        model.json["nodes"] = json!(nodes);
        let camera = model.node(json!({ "camera": 0, "translation": [0, 0, 9] }));
        model.push(
            "cameras",
            json!({
                "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.1 }
            }),
        );
        let light = json!({ "KHR_lights_punctual": { "light": 0 } });
        let light = model.node(json!({ "extensions": light, "translation": [0, 0, 5] }));
        let lights = json!({ "lights": [{ "type": "point", "intensity": 1000 }] });
        model.json["extensions"] = json!({ "KHR_lights_punctual": lights });
        model.json["scenes"] = json!([{ "nodes": [0, camera, light] }]);
        model.load().scene
    };
    let matrix = [0, 2, 0, 0, -3, 0, 0, 0, 0, 0, 4, 0, 1, 2, -3, 1];
    let rows = "matrix = [[0, -3, 0, 1], [2, 0, 0, 2], [0, 0, 4, -3], [0, 0, 0, 1]]";
    for (nodes, keys) in [
        (&[json!({ "mesh": 0 })][..], ""),
        (
            &[json!({ "mesh": 0, "scale": [0.5, 2, 1], "translation": [0.1, 0, -3] })],
            "scale = [0.5, 2, 1]\ntranslate = [0.1, 0, -3]",
        ),
        // Mirrored, once by a parent and once by itself.
        (
            &[
                json!({ "scale": [-1, 1, 1], "children": [1] }),
                json!({ "mesh": 0, "scale": [2, 1, 1] }),
            ],
            "scale = [-2, 1, 1]",
        ),
        (&[json!({ "mesh": 0, "scale": [-1, 1, 1] })], "scale = [-1, 1, 1]"),
        (&[json!({ "mesh": 0, "rotation": [0, 1, 0, 0] })], "rotate_deg = [0, 180, 0]"),
        (&[json!({ "mesh": 0, "matrix": matrix })], rows),
        // A moved child of a turned parent.
        (
            &[
                json!({ "rotation": [0, 0, 1, 0], "children": [1], "scale": [1, 1, 1] }),
                json!({ "mesh": 0, "translation": [0.5, 0.25, -1] }),
            ],
            "rotate_deg = [0, 0, 180]\ntranslate = [-0.5, -0.25, -1]",
        ),
    ] {
        let scene = gltf(nodes);
        assert_same(&scene, &toml(keys));
        let turned = keys.contains("[0, 180, 0]");
        let front = if turned { -Vec3::Z } else { Vec3::Z };
        assert!(scene.triangles().iter().all(|t| t.normal == front), "{keys}");
    }
}

#[test]
fn meshes_are_placed_by_each_node_of_the_default_scene() {
    let mut model = square();
    model.json["nodes"] = json!([
        { "mesh": 0, "name": "left", "translation": [-5, 0, 0] },
        { "mesh": 0, "name": "right", "translation": [5, 0, 0], "children": [3] },
        { "mesh": 0, "name": "elsewhere" },
        { "mesh": 0, "name": "above", "translation": [0, 7, 0] },
    ]);
    model.json["scenes"] = json!([{ "nodes": [2] }, { "nodes": [1, 0] }]);
    model.json["scene"] = json!(1);
    let loaded = model.load();
    let names: Vec<_> = loaded.scene.meshes().iter().map(|mesh| &mesh.name[..]).collect();
    assert_eq!(names, ["right", "above", "left"]);
    assert_eq!(loaded.scene.bounds().min, Vec3::new(-6.0, -1.0, 0.0));
    assert_eq!(loaded.scene.bounds().max, Vec3::new(6.0, 8.0, 0.0));
    assert_eq!(loaded.scene.materials().len(), 1);
    model.json["scene"] = json!(0);
    assert_eq!(model.load().scene.meshes()[0].name, "elsewhere");
    model.json.as_object_mut().unwrap().remove("scene");
    assert_eq!(model.load().scene.meshes().len(), 1, "the first scene");
    model.json.as_object_mut().unwrap().remove("scenes");
    assert_eq!(model.load().scene.meshes().len(), 4, "all roots");
}

#[test]
fn deep_node_trees_load() {
    let mut model = square();
    let depth = 100_000;
    let chain = (1..=depth).map(|i| json!({ "children": [i], "translation": [0, 0, 0.5] }));
    let mut nodes: Vec<Value> = chain.collect();
    nodes.push(json!({ "mesh": 0 }));
    model.json["nodes"] = json!(nodes);
    let scene = model.load().scene;
    assert_eq!(scene.in_file(scene.bounds().min).z, 0.5 * f64::from(depth));
}

#[test]
fn skipped_contents_are_warnings_or_strictly_refused() {
    let mut model = square();
    let part = model.json["meshes"][0]["primitives"][0].clone();
    let with = |key: &str, value: Value| {
        let mut part = part.clone();
        part[key] = value;
        part
    };
    let mut colored = part.clone();
    colored["attributes"]["_TEMPERATURE"] = json!(99);
    model.push(
        "meshes",
        json!({
            "name": "mix", "primitives": [colored, with("mode", json!(1)), part]
        }),
    );
    model.node(json!({ "mesh": 1, "translation": [0, 0, -1] }));
    model.node(json!({ "mesh": 0, "scale": [1, 1, 0], "name": "pressed" }));
    model.json["extensionsUsed"] = json!(["KHR_materials_sheen", "KHR_lights_punctual"]);
    model.json["animations"] = json!([{ "channels": [], "samplers": [] }]);
    let files = model.files();
    let loaded = files.load();
    assert_eq!(loaded.scene.triangle_count(), 6);
    let kind_of = |part: &str| {
        let warning = loaded.warnings.iter().find(|warning| warning.text.contains(part));
        warning.unwrap_or_else(|| panic!("no {part:?} in {}", loaded.warnings_text())).kind
    };
    for part in [
        "a.gltf: ignored the extensions `KHR_materials_sheen`",
        "ignored the points or lines of `mix`",
    ] {
        assert_eq!(kind_of(part), WarningKind::Skipped, "{part}");
    }
    for part in ["animations are not played", "flattens: `pressed`", "no camera", "nothing emits"] {
        assert_eq!(kind_of(part), WarningKind::Chosen, "{part}");
    }
    let strict = LoadOptions { strict: true, ..LoadOptions::default() };
    let error = load_with(&files.1, &strict).unwrap_err().to_string();
    for part in
        ["a.gltf: not all of the scene can be rendered", "points or lines", "strict checking"]
    {
        assert!(error.contains(part), "{error}");
    }
    assert!(!error.contains("no camera"), "{error}");
    load_with(&square().files().1, &strict).unwrap_or_else(|e| panic!("{e}"));
}

#[test]
fn strictness_and_camera_names_apply_to_obj_files() {
    let strict = LoadOptions { strict: true, ..LoadOptions::default() };
    let good = files(&[("a.obj", SQUARE_OBJ.as_bytes())]);
    load_with(&good.1, &strict).unwrap_or_else(|e| panic!("{e}"));
    let lines = files(&[("a.obj", format!("{SQUARE_OBJ}l 1 2\n").as_bytes())]);
    let error = load_with(&lines.1, &strict).unwrap_err().to_string();
    assert!(error.contains("ignored 1 points, lines or curves"), "{error}");
    let camera = LoadOptions { camera: Some("Front"), ..LoadOptions::default() };
    let error = load_with(&good.1, &camera).unwrap_err().to_string();
    assert!(error.contains("only glTF and Mitsuba files have named cameras"), "{error}");
    assert!(load(&lines.1).is_ok());
}

#[test]
fn info_command_reports_cameras_lights_and_warnings() {
    let mut model = square();
    let lens = json!({ "type": "perspective", "perspective": { "yfov": 0.5 } });
    model.push("cameras", lens);
    for (name, z) in [("Near", 5), ("Far", 9)] {
        model.node(json!({ "name": name, "camera": 0, "translation": [0, 0, z] }));
    }
    model.json["extensionsUsed"] = json!(["KHR_audio"]);
    let files = model.files();
    let run = |arguments: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_bdpm"));
        command.arg(arguments[0]).arg(&files.1).args(&arguments[1..]).output().unwrap()
    };
    let info = run(&["info", "--json", "--camera", "Far"]);
    let report: Value = serde_json::from_slice(&info.stdout).unwrap();
    assert_eq!(report["camera"]["position"], json!([0.0, 0.0, 9.0]));
    assert_eq!(report["read"]["cameras"], json!(["Near", "Far"]));
    assert_eq!(
        (&report["read"]["camera"], &report["read"]["triangles"]),
        (&json!("Far"), &json!(2))
    );
    assert_eq!(report["notes"][0]["kind"], "skipped");
    let shown = String::from_utf8(run(&["info"]).stdout).unwrap();
    assert!(shown.contains("camera name       Near, of Near, Far\n"), "{shown}");
    let refused = run(&["info", "--strict"]);
    let shown = String::from_utf8(refused.stderr).unwrap();
    assert!(!refused.status.success() && shown.contains("ignored the extensions `KHR_audio`"));
    let output = files.0.path().join("a.exr");
    let output = output.to_str().unwrap();
    let image = ["--resolution", "8x8", "--iterations", "1", "--output", output];
    let rendered = run(&[&["render"][..], &image].concat());
    let shown = String::from_utf8(rendered.stderr).unwrap();
    let line = "read 1 mesh of 2 triangles, 1 material, 0 textures, 1 light, camera Near (of 2)\n";
    assert!(shown.contains(line), "{shown}");
}
