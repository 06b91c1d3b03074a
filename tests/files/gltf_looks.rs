//! glTF: what materials, lights and cameras become.

use crate::common::gltf::*;
use bdpm::import::WarningKind;
use bdpm::load::{LoadOptions, load_with};
use bdpm::scene::bsdf::{Bsdf, Dielectric, Glossy, RoughDielectric, ThinDielectric};
use bdpm::scene::{
    Emitter, Extent, FieldOfView, Material, Optics, RefractiveIndex, Sampling, Wrap,
};
use glam::{Vec2, Vec3};
use serde_json::{Value, json};
use std::f32::consts::{FRAC_PI_2, FRAC_PI_4};

/// A picture of 2 by 1 texels.
fn picture(texels: [[u8; 4]; 2]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 2, 1);
    encoder.set_color(png::ColorType::Rgba);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(texels.as_flattened()).unwrap();
    writer.finish().unwrap();
    bytes
}

/// The square with this material, and texture 0 of the picture.
fn with_material(material: Value, texels: [[u8; 4]; 2]) -> Model {
    let mut model = square();
    let uvs = model.uvs(&[[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]]);
    model.json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = json!(uvs);
    model.json["materials"][0] = material;
    let view = model.view(&picture(texels));
    model.push("images", json!({ "bufferView": view }));
    model.push("textures", json!({ "source": 0 }));
    model
}

/// The converted material, and the warnings about omissions.
#[track_caller]
fn looks(material: Value, texels: [[u8; 4]; 2]) -> (Material, String) {
    let loaded = with_material(material, texels).load();
    let skipped = loaded.warnings.iter().filter(|warning| warning.kind == WarningKind::Skipped);
    let skipped: Vec<_> = skipped.map(|warning| &warning.text[..]).collect();
    (loaded.scene.materials()[0].clone(), skipped.join("\n"))
}

const WHITE: [[u8; 4]; 2] = [[255; 4]; 2];

fn pbr(metallic: f32, roughness: f32) -> Value {
    json!({
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.8, 0.4, 0.2, 1],
            "metallicFactor": metallic,
            "roughnessFactor": roughness,
        },
        "doubleSided": true,
    })
}

fn with(mut material: Value, key: &str, value: Value) -> Value {
    match key.starts_with("KHR_") {
        true => material["extensions"][key] = value,
        false => material[key] = value,
    }
    material
}

#[test]
fn materials_convert_as_documented() {
    let color = Vec3::new(0.8, 0.4, 0.2);
    let glossy = |metallic, ior, alpha| Bsdf::Glossy(Glossy::new(color, metallic, ior, alpha));
    let coat = |material, factor: f32| {
        with(material, "KHR_materials_clearcoat", json!({ "clearcoatFactor": factor }))
    };
    let rough_coat = json!({ "clearcoatFactor": 1, "clearcoatRoughnessFactor": 0.5 });
    let rough_coat = with(pbr(0.0, 1.0), "KHR_materials_clearcoat", rough_coat);
    let index = |material, ior: f32| with(material, "KHR_materials_ior", json!({ "ior": ior }));
    let glass = |roughness: f32| {
        let white = json!({ "metallicFactor": 0, "roughnessFactor": roughness });
        let material = json!({ "pbrMetallicRoughness": white });
        let material =
            with(material, "KHR_materials_transmission", json!({ "transmissionFactor": 1 }));
        with(material, "KHR_materials_ior", json!({ "ior": 1.25 }))
    };
    let thick = |roughness: f32| {
        with(glass(roughness), "KHR_materials_volume", json!({ "thicknessFactor": 0.5 }))
    };
    for (material, expected, warning) in [
        (pbr(0.0, 0.5), glossy(0.0, 1.5, 0.25), ""),
        (with(pbr(0.0, 1.0), "doubleSided", json!(false)), glossy(0.0, 1.5, 1.0), ""),
        (index(pbr(0.0, 0.0), 1.75), glossy(0.0, 1.75, 0.0), ""),
        (pbr(0.75, 0.5), glossy(0.75, 1.5, 0.25), ""),
        (pbr(1.0, 0.5), glossy(1.0, 1.5, 0.25), ""),
        (index(pbr(0.0, 0.5), 1.0), Bsdf::diffuse(color), ""),
        (index(pbr(0.5, 0.5), 1.0), glossy(0.5, 1.0, 0.25), ""),
        (coat(pbr(0.0, 0.5), 1.0), glossy(0.0, 1.5, 0.0), ""),
        (coat(pbr(0.25, 0.5), 1.0), glossy(0.0, 1.5, 0.0), "ignored the metal in"),
        (rough_coat, glossy(0.0, 1.5, 0.25), ""),
        (coat(pbr(0.0, 0.5), 0.25), glossy(0.0, 1.5, 0.25), "ignored the clear coat of"),
        (coat(pbr(1.0, 0.5), 1.0), glossy(1.0, 1.5, 0.25), "ignored the clear coat of"),
        (thick(0.0), Bsdf::Dielectric(Dielectric::new(1.25)), ""),
        (thick(0.5), Bsdf::RoughDielectric(RoughDielectric::new(1.25, 0.25)), ""),
        (glass(0.0), Bsdf::ThinDielectric(ThinDielectric::new(1.25)), ""),
        (glass(0.5), Bsdf::ThinDielectric(ThinDielectric::new(1.25)), "of the thin glass"),
        (
            with(
                thick(0.0),
                "KHR_materials_volume",
                json!({
                    "thicknessFactor": 1, "attenuationDistance": 1, "attenuationColor": [1, 0, 0]
                }),
            ),
            Bsdf::Dielectric(Dielectric::new(1.25)),
            "",
        ),
        (
            with(pbr(1.0, 0.0), "KHR_materials_unlit", json!({})),
            Bsdf::diffuse(color),
            "unlit material",
        ),
        (
            with(pbr(0.0, 0.5), "occlusionTexture", json!({ "index": 0 })),
            glossy(0.0, 1.5, 0.25),
            "",
        ),
    ] {
        let (read, warnings) = looks(material.clone(), WHITE);
        assert_eq!(read.bsdf, expected, "{material}");
        assert!(
            if warning.is_empty() { warnings.is_empty() } else { warnings.contains(warning) },
            "{warnings}"
        );
    }
    let dispersive = |dispersion: f32| {
        let key = "KHR_materials_dispersion";
        let (read, warnings) =
            looks(with(thick(0.0), key, json!({ "dispersion": dispersion })), WHITE);
        assert_eq!(warnings, "");
        read.dispersion.map(|dispersion| dispersion.inside().clone())
    };
    assert_eq!(dispersive(0.0), None);
    assert_eq!(dispersive(0.5), Some(RefractiveIndex::Abbe { index: 1.25, abbe: 40.0 }));
    // The standard's default is a rough white metal.
    let mut model = square();
    model.json["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("material");
    let white = Bsdf::Glossy(Glossy::new(Vec3::ONE, 1.0, 1.5, 1.0));
    assert_eq!(model.load().scene.materials()[0].bsdf, white);
}

/// The material `m` of these keys in a scene file, with the picture as `p.png`.
fn of_scene_file(keys: &str, texels: [[u8; 4]; 2]) -> Material {
    let scene = format!(
        "camera = {{ position = [0, 0, 5], target = [0, 0, 0], fov_x_deg = 40 }}\n\
         environment = {{ radiance = 1 }}\nmesh = [{{ file = 'a.obj', material = 'm' }}]\n\
         [materials.m]\n{keys}"
    );
    let png = picture(texels);
    let list: [(&str, &[u8]); 3] =
        [("p.png", &png), ("a.obj", SQUARE_OBJ.as_bytes()), ("a.toml", scene.as_bytes())];
    files(&list).load().scene.materials()[0].clone()
}

#[test]
fn textures_equal_those_of_scene_files() {
    let texels = [[255, 200, 128, 255], [10, 60, 250, 255]];
    let info = json!({ "index": 0 });
    let textured = |key: &str, mut material: Value| {
        material["pbrMetallicRoughness"][key] = info.clone();
        material
    };
    let both = textured("metallicRoughnessTexture", textured("baseColorTexture", pbr(1.0, 0.5)));
    let glossy = "type = 'glossy'\nalbedo = [0.8, 0.4, 0.2]\n";
    let all = "albedo_texture = 'p.png'\nmetallic_roughness_texture = 'p.png'\n\
               metallic = 1\nroughness = 0.5\n";
    let lamp = with(both.clone(), "emissiveFactor", json!([1, 0.5, 0]));
    let lamp = with(lamp, "emissiveTexture", info.clone());
    let lamp = with(lamp, "KHR_materials_emissive_strength", json!({ "emissiveStrength": 10 }));
    let lamp = with(lamp, "doubleSided", json!(false));
    let bent = json!({ "index": 0, "scale": 0.5 });
    let coat = with(pbr(0.0, 0.5), "KHR_materials_clearcoat", json!({ "clearcoatFactor": 1 }));
    for (material, keys) in [
        (both.clone(), format!("{glossy}{all}")),
        (
            textured("baseColorTexture", pbr(0.0, 0.0)),
            format!("{glossy}albedo_texture = 'p.png'\n"),
        ),
        (lamp, format!("{glossy}{all}emission = [10, 5, 0]\nemission_texture = 'p.png'\n")),
        (
            with(pbr(1.0, 0.5), "normalTexture", bent.clone()),
            format!(
                "{glossy}metallic = 1\nroughness = 0.5\nnormal_texture = 'p.png'\n\
                 normal_scale = 0.5"
            ),
        ),
        (
            with(textured("baseColorTexture", coat), "normalTexture", bent),
            "type = 'glossy'\nalbedo = [0.8, 0.4, 0.2]\nalbedo_texture = 'p.png'\nroughness = 0\n\
             metallic = 0\nnormal_texture = 'p.png'\nnormal_scale = 0.5"
                .into(),
        ),
    ] {
        let (read, warnings) = looks(with(material, "name", json!("m")), texels);
        assert_eq!((&read, &warnings[..]), (&of_scene_file(&keys, texels), ""), "{keys}");
    }
}

#[test]
fn samplers_select_wrap_and_filter() {
    let mut material = pbr(0.0, 0.5);
    material["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
    let sampled = |sampler: Value| {
        let mut model = with_material(material.clone(), WHITE);
        model.json["samplers"] = json!([sampler]);
        model.json["textures"][0]["sampler"] = json!(0);
        model
    };
    for (sampler, wrap, nearest) in [
        (json!({}), [Wrap::Repeat; 2], false),
        (json!({ "magFilter": 9729, "wrapS": 10497 }), [Wrap::Repeat; 2], false),
        (json!({ "wrapS": 33071, "wrapT": 33648 }), [Wrap::Clamp, Wrap::Mirror], false),
        (json!({ "magFilter": 9728, "minFilter": 9729 }), [Wrap::Repeat; 2], true),
    ] {
        let loaded = sampled(sampler).load();
        let picture = loaded.scene.materials()[0].albedo_texture.clone().unwrap();
        assert_eq!(picture.sampling(), Sampling { wrap, nearest });
    }
    sampled(json!({ "wrapT": 5 })).files().refused(&["samplers[0].wrapT: unknown 5"]);
}

#[test]
fn tangents_are_read_only_for_normal_maps() {
    let bent = json!({ "index": 0, "texCoord": 0 });
    let tangent = |material: Value| {
        let mut model = with_material(material, WHITE);
        let tangents = bytes([[0.0, 2.0, 0.0, 1.0]; 4].as_flattened());
        let accessor = model.accessor(&tangents, F32, "VEC4", 4);
        model.json["meshes"][0]["primitives"][0]["attributes"]["TANGENT"] = json!(accessor);
        model.json["nodes"][0]["rotation"] = json!([0, 1, 0, 0]);
        model.load().scene.meshes()[0].tangents.clone()
    };
    assert!(tangent(pbr(0.0, 0.5)).is_empty());
    assert_eq!(tangent(with(pbr(0.0, 0.5), "normalTexture", bent.clone())), [Vec3::Y; 4]);
    let mut turned = bent;
    turned["extensions"] = json!({ "KHR_texture_transform": { "rotation": 1 } });
    assert!(tangent(with(pbr(0.0, 0.5), "normalTexture", turned)).is_empty());
}

#[test]
fn all_textures_use_the_coordinates_of_the_first() {
    let mut material = with(pbr(0.0, 0.5), "normalTexture", json!({ "index": 0 }));
    let moved = json!({ "KHR_texture_transform": { "offset": [0.5, 0] } });
    material["pbrMetallicRoughness"]["baseColorTexture"] =
        json!({ "index": 0, "extensions": moved });
    let (_, warnings) = looks(material, WHITE);
    assert!(warnings.contains("used the texture coordinates of the first texture"), "{warnings}");
}

#[test]
fn emission_is_the_factor_times_strength() {
    let lamp = with(pbr(0.0, 1.0), "emissiveFactor", json!([1, 0.5, 0]));
    let strong = with(lamp, "KHR_materials_emissive_strength", json!({ "emissiveStrength": 10 }));
    let (read, warnings) = looks(with(strong.clone(), "doubleSided", json!(false)), WHITE);
    assert_eq!((read.emission, &warnings[..]), (Vec3::new(10.0, 5.0, 0.0), ""));
    assert!(!read.two_sided_emission);
    let (read, warnings) = looks(strong, WHITE);
    assert_eq!((read.two_sided_emission, &warnings[..]), (true, ""));
}

#[test]
fn alpha_masks_cut_at_the_cutoff() {
    let texels = [[255, 255, 255, 60], [255, 255, 255, 200]];
    let material = |mode: &str, cutoff: Option<f32>| {
        let mut material = with(pbr(0.0, 1.0), "alphaMode", json!(mode));
        material["pbrMetallicRoughness"]["baseColorTexture"] = json!({ "index": 0 });
        if let Some(cutoff) = cutoff {
            material["alphaCutoff"] = json!(cutoff);
        }
        material
    };
    let holes = |mode: &str, cutoff: Option<f32>| {
        let (material, warnings) = looks(material(mode, cutoff), texels);
        let at = |u: f32| {
            let picture = material.opacity_texture.as_ref();
            picture.is_none_or(|picture| picture.opacity(Vec2::new(u, 0.5)) >= 0.5)
        };
        ([at(0.25), at(0.75)], warnings)
    };
    assert_eq!(holes("OPAQUE", None), ([true, true], String::new()));
    assert_eq!(holes("MASK", None), ([false, true], String::new()));
    assert_eq!(holes("MASK", Some(0.2)), ([true, true], String::new()));
    assert_eq!(holes("MASK", Some(0.24)), ([false, true], String::new()));
    assert_eq!(holes("MASK", Some(0.78)), ([false, true], String::new()));
    let (blended, warnings) = looks(material("BLEND", None), texels);
    assert_eq!((blended.opacity, &warnings[..]), (Some(1.0), ""));
    let shares =
        [0.25, 0.75].map(|u| blended.opacity_texture.as_ref().unwrap().opacity(Vec2::new(u, 0.5)));
    assert_eq!(shares, [60.0, 200.0].map(|alpha| alpha / 255.0));
    let mut half = material("BLEND", None);
    half["pbrMetallicRoughness"]["baseColorFactor"] = json!([1, 1, 1, 0.5]);
    let (half, _) = looks(half, WHITE);
    assert!(half.opacity == Some(0.5) && half.opacity_texture.is_none());
    let (whole, _) = looks(material("BLEND", None), WHITE);
    assert!(whole.opacity.is_none() && whole.opacity_texture.is_none());
    // Surfaces that are cut away as a whole are omitted.
    for cutoff in [0.9, 1.5] {
        let model = with_material(material("MASK", Some(cutoff)), texels);
        model
            .files()
            .refused(&["the opacity is below the cutoff all over", "lower their alphaCutoff"]);
    }
}

/// A square behind this node, with this light.
fn lit(light: Value, node: Value) -> Model {
    let mut model = square();
    model.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [light] } });
    model.json["nodes"][0]["translation"] = json!([0, 0, -5]);
    let mut node = node;
    node["extensions"] = json!({ "KHR_lights_punctual": { "light": 0 } });
    model.node(node);
    model
}

#[test]
fn lights_are_divided_by_the_efficacy_and_turned_by_their_node() {
    let color = Vec3::new(1.0, 0.5, 0.25);
    let intensity = 2.0 * color;
    let light = |kind: &str, more: Value| {
        let mut light = json!({ "type": kind, "intensity": 1366, "color": [1, 0.5, 0.25] });
        if !more.is_null() {
            light["spot"] = more;
        }
        light
    };
    let close = |a: Vec3, b: Vec3| (a - b).length() < 1e-6 * b.length();
    let node = json!({ "name": "Lamp", "translation": [1, 2, 3], "scale": [2, 2, 2] });
    let loaded = lit(light("point", Value::Null), node.clone()).load();
    let [Emitter::Point { position, intensity: read }] = loaded.scene.lights().emitters() else {
        panic!("no point")
    };
    assert!(*position == Vec3::new(1.0, 2.0, 3.0) && close(*read, intensity), "{read}");
    assert_eq!(loaded.summary.light_names, ["Lamp"]);
    assert!(!loaded.warnings_text().contains("nothing emits"));
    // A quarter about x turns -z down.
    let (sin, cos) = FRAC_PI_4.sin_cos();
    let down =
        json!({ "rotation": [-sin, 0, 0, cos], "scale": [3, 1, 2], "translation": [0, 4, 0] });
    let sun = lit(light("directional", Value::Null), down.clone()).load().scene;
    let [Emitter::Directional(sun)] = sun.lights().emitters() else { panic!("no sun") };
    assert!(close(sun.direction, -Vec3::Y) && close(sun.irradiance, intensity), "{sun:?}");
    let cones = json!({ "innerConeAngle": 0.2, "outerConeAngle": 0.5 });
    let spot = lit(light("spot", cones), down.clone()).load().scene;
    let [Emitter::Spot(spot)] = spot.lights().emitters() else { panic!("no spot") };
    assert!(close(spot.direction, -Vec3::Y) && close(spot.intensity, intensity), "{spot:?}");
    assert_eq!(
        (spot.cos_inner, spot.cos_outer),
        (f64::from(0.2_f32).cos(), f64::from(0.5_f32).cos())
    );
    assert_eq!(spot.position, Vec3::new(0.0, 4.0, 0.0));
    // Edges may be sharp, and cones as wide as a half space.
    for (inner, outer) in [(0.5, 0.5), (0.0, FRAC_PI_2)] {
        let cones = json!({ "innerConeAngle": inner, "outerConeAngle": outer });
        let scene = lit(light("spot", cones), down.clone()).load().scene;
        let [Emitter::Spot(spot)] = scene.lights().emitters() else { panic!("no spot") };
        assert!(spot.cos_inner > spot.cos_outer && spot.solid_angle() > 0.0);
    }
    let default = lit(light("spot", json!({})), down).load().scene;
    let [Emitter::Spot(spot)] = default.lights().emitters() else { panic!("no spot") };
    assert_eq!((spot.cos_inner, spot.cos_outer), (1.0, f64::from(FRAC_PI_4).cos()));
    let dark = lit(json!({ "type": "point", "intensity": 0 }), json!({})).load();
    assert!(dark.warnings_text().contains("nothing emits"));
}

#[test]
fn cameras_are_chosen_by_name() {
    let mut model = square();
    let perspective = |yfov: f32, more: Value| {
        let mut own = json!({ "yfov": yfov, "znear": 0.1 });
        if !more.is_null() {
            own["aspectRatio"] = more;
        }
        json!({ "type": "perspective", "perspective": own })
    };
    let flat = json!({ "xmag": 2, "ymag": 1, "zfar": 10, "znear": 0 });
    model.push("cameras", json!({ "type": "orthographic", "orthographic": flat }));
    model.push("cameras", perspective(0.5, json!(2)));
    model.push("cameras", perspective(1.0, Value::Null));
    model.json["cameras"][1]["name"] = json!("lens");
    model.node(json!({ "name": "Plan", "camera": 0 }));
    model.node(json!({ "name": "Front", "camera": 1, "translation": [0, 0, 9] }));
    let (sin, cos) = FRAC_PI_4.sin_cos();
    model.node(json!({ "camera": 2, "translation": [9, 0, 0], "rotation": [0, sin, 0, cos] }));
    let files = model.files();
    let choose = |camera| load_with(&files.1, &LoadOptions { camera, ..LoadOptions::default() });
    let plan = choose(None).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(plan.scene.camera.optics(), Optics::Orthographic(Extent::Y(2.0)));
    assert_eq!(plan.defaults.resolution, Some([512, 256]));
    assert_eq!(plan.summary.camera.as_deref(), Some("Plan"));
    let first = choose(Some("Front")).unwrap_or_else(|e| panic!("{e}"));
    let camera = &first.scene.camera;
    assert_eq!((camera.position(), camera.direction()), (Vec3::new(0.0, 0.0, 9.0), -Vec3::Z));
    assert_eq!(camera.optics(), Optics::Pinhole(FieldOfView::Y(0.5_f32.to_degrees())));
    assert_eq!((camera.up(), first.defaults.resolution), (Vec3::Y, Some([512, 256])));
    assert_eq!(first.summary.cameras, ["Plan", "Front", "nodes[3]"]);
    assert_eq!(first.summary.camera.as_deref(), Some("Front"));
    assert!(first.summary.to_string().ends_with(", camera Front (of 3)"), "{}", first.summary);
    let third = choose(Some("nodes[3]"));
    // By the camera's own name, which nodes may share, the first of them is meant.
    let lens = choose(Some("lens")).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(lens.summary.camera.as_deref(), Some("Front"));
    let third = third.unwrap_or_else(|e| panic!("{e}"));
    assert!((third.scene.camera.direction() + Vec3::X).length() < 1e-6);
    assert_eq!(third.defaults.resolution, None);
    let error = choose(Some("Back")).unwrap_err().to_string();
    for part in ["there is no camera `Back`", "`Plan`, `Front`, `nodes[3]`"] {
        assert!(error.contains(part), "{error}");
    }
}

#[test]
fn lamps_holes_and_mirrors_render_like_those_of_mtl() {
    let texels = [[255, 128, 0, 255], [0, 0, 0, 0]];
    let material = json!({
        "pbrMetallicRoughness": {
            "baseColorTexture": { "index": 0 }, "baseColorFactor": [0.5, 0.5, 0.5, 1], "metallicFactor": 0,
        },
        "alphaMode": "MASK", "doubleSided": true, "extensions": diffuse(),
    });
    let mut model = with_material(material, texels);
    let metal = json!({ "metallicFactor": 0.9, "roughnessFactor": 0.6, "baseColorFactor": [0.9, 0.6, 0.3, 1] });
    model.push("materials", json!({ "pbrMetallicRoughness": metal }));
    let black = json!({ "baseColorFactor": [0, 0, 0, 1], "metallicFactor": 0 });
    model.push(
        "materials",
        json!({
            "pbrMetallicRoughness": black, "emissiveFactor": [1, 1, 0.5],
            "extensions": {
                "KHR_materials_emissive_strength": { "emissiveStrength": 4 },
                "KHR_materials_ior": { "ior": 1 },
            },
        }),
    );
    let part = model.json["meshes"][0]["primitives"][0].clone();
    for (mesh, (z, turned)) in [(-1.0, false), (3.0, true)].into_iter().enumerate() {
        let mut part = part.clone();
        part["attributes"].as_object_mut().unwrap().remove("TEXCOORD_0");
        part["material"] = json!(mesh + 1);
        model.push("meshes", json!({ "primitives": [part] }));
        let rotation = if turned { [0, 1, 0, 0] } else { [0, 0, 0, 1] };
        model.node(json!({ "mesh": mesh + 1, "translation": [0, 0, z], "rotation": rotation }));
    }
    let mtl = "newmtl cut\nKd .5\nmap_Kd p.png\nmap_d p.png\nnewmtl metal\nKd .9 .6 .3\nPm .9\nPr .6\n\
               newmtl lamp\nKd 0\nKe 4 4 2\n";
    let square =
        |z: i32, x: i32| format!("v {} -1 {z}\nv {x} -1 {z}\nv {x} 1 {z}\nv {} 1 {z}\n", -x, -x);
    let obj = format!(
        "mtllib a.mtl\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n{}usemtl cut\nf 1/1 2/2 3/3 4/4\n\
         {}usemtl metal\nf 5 6 7 8\n{}usemtl lamp\nf 9 10 11 12\n",
        square(0, 1),
        square(-1, 1),
        square(3, -1)
    );
    let png = picture(texels);
    let obj = files(&[("p.png", &png), ("a.mtl", mtl.as_bytes()), ("a.obj", obj.as_bytes())]);
    assert_same(&model.load().scene, &obj.load().scene);
}
