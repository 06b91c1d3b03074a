//! Colors of vertices, instances, morph targets and skins.

use crate::common::gltf::*;
use bdpm::load::{export, load};
use bdpm::scene::Mesh;
use bdpm::scene::bsdf::{Bsdf, Glossy};
use glam::Vec3;
use serde_json::json;

/// The square with colors at its corners.
fn colored(kind: &str, codes: &[f32]) -> Model {
    let mut model = square();
    let colors = model.accessor(&bytes(codes), F32, kind, 4);
    model.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
    model
}

#[test]
fn colors_of_vertices_are_read_and_survive_conversion() {
    let rgb = [1.0, 0.0, 0.0, 0.0, 0.25, 0.0, 0.1, 0.2, 0.3, 1.0, 1.0, 2.0];
    let rgba: Vec<f32> =
        rgb.chunks(3).flat_map(|color| [color[0], color[1], color[2], 0.5]).collect();
    let expected = [Vec3::X, 0.25 * Vec3::Y, Vec3::new(0.1, 0.2, 0.3), Vec3::ONE];
    for model in [colored("VEC3", &rgb), colored("VEC4", &rgba)] {
        let loaded = model.load();
        let mesh = &loaded.scene.meshes()[0];
        let mut found = mesh.colors.clone();
        // In the order of their first use.
        let order: Vec<usize> = mesh
            .positions
            .iter()
            .map(|p| SQUARE.iter().position(|s| p.to_array() == *s).unwrap())
            .collect();
        order.iter().enumerate().for_each(|(new, old)| found[*old] = mesh.colors[new]);
        assert_eq!(found, expected);
        let folder = tempfile::TempDir::new().unwrap();
        let copy = folder.path().join("copy");
        export(&loaded, "a.gltf", &copy, false).unwrap();
        assert_eq!(load(&copy).unwrap().scene.fingerprint(), loaded.scene.fingerprint());
    }
    // A warning reports that their opacity is ignored where it would have an effect.
    for (mode, is_reported) in [("OPAQUE", false), ("BLEND", true), ("MASK", true)] {
        let mut model = colored("VEC4", &rgba);
        model.json["materials"][0]["alphaMode"] = json!(mode);
        let warnings = model.load().warnings_text();
        assert_eq!(
            warnings.contains("ignored the opacity of the vertex colors"),
            is_reported,
            "{warnings}"
        );
    }
    let mut opaque = colored("VEC4", &[1.0; 16]);
    opaque.json["materials"][0]["alphaMode"] = json!("BLEND");
    assert!(!opaque.load().warnings_text().contains("vertex colors"));
    // White ones take no room, and bytes are shares.
    assert!(colored("VEC3", &[1.0; 12]).load().scene.meshes()[0].colors.is_empty());
    let mut model = square();
    let colors = model.accessor(&[51; 16], U8, "VEC4", 4);
    model.json["accessors"][colors]["normalized"] = json!(true);
    model.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
    assert_eq!(model.load().scene.meshes()[0].colors, [Vec3::splat(0.2); 4]);
    model.json["accessors"][colors]["count"] = json!(3);
    model.files().refused(&["attributes.COLOR_0: 3 elements for 4 vertices"]);
}

#[test]
fn specular_scales_the_reflectance() {
    let with = |specular: serde_json::Value| {
        let mut model = square();
        model.json["materials"][0] = json!({
            "pbrMetallicRoughness": { "metallicFactor": 0, "roughnessFactor": 0.5 },
            "extensions": { "KHR_materials_specular": specular },
        });
        model.json["extensionsRequired"] = json!(["KHR_materials_specular"]);
        let loaded = model.load();
        (loaded.scene.materials()[0].bsdf, loaded.warnings_text())
    };
    let glossy = Glossy::new(Vec3::ONE, 0.0, 1.5, 0.25);
    assert_eq!(with(json!({})).0, Bsdf::Glossy(glossy));
    assert_eq!(with(json!({ "specularFactor": 0 })).0, Bsdf::diffuse(Vec3::ONE));
    assert_eq!(with(json!({ "specularFactor": 0.5 })).0, Bsdf::Glossy(glossy.reflecting(0.5)));
    let (doubled, warnings) = with(json!({ "specularColorFactor": [2, 2, 2] }));
    let Bsdf::Glossy(doubled) = doubled else { panic!("{doubled:?}") };
    assert!(
        (doubled.normal_reflectance() - 0.08).abs() < 1e-6 && !warnings.contains("specular"),
        "{warnings}"
    );
    let (_, warnings) = with(json!({ "specularColorFactor": [1, 0, 0] }));
    assert!(warnings.contains("used the luminance of the specular color of"), "{warnings}");
}

/// Heights of the first vertices of all meshes.
fn heights(model: &Model) -> Vec<f32> {
    let scene = model.load().scene;
    let height = |mesh: &Mesh| scene.in_file(mesh.positions[0]).z as f32;
    scene.copies().iter().map(height).collect()
}

#[test]
fn gpu_instances_are_placed_by_their_attributes() {
    let mut model = square();
    let places = model.points(&[[0.0, 0.0, 1.0], [0.0, 0.0, 2.0], [0.0, 0.0, 3.0]]);
    let turns = model.accessor(&bytes(&[0.0, 0.0, 0.0, 1.0].repeat(3)), F32, "VEC4", 3);
    let sizes = model.points(&[[1.0; 3], [2.0; 3], [3.0; 3]]);
    let attributes =
        json!({ "TRANSLATION": places, "ROTATION": turns, "SCALE": sizes, "_ID": places });
    model.json["nodes"][0]["extensions"] =
        json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
    model.json["nodes"][0]["translation"] = json!([0, 0, 10]);
    model.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    assert_eq!(heights(&model), [11.0, 12.0, 13.0]);
    let scene = model.load().scene;
    assert_eq!((scene.triangle_count(), scene.bounds().max.x), (6, 3.0));
    model.json["accessors"][sizes]["count"] = json!(2);
    model.files().refused(&["attributes.SCALE: its count differs from that of the other"]);
    model.json["accessors"][sizes]["count"] = json!(3);
    let none = model.accessor(&bytes(&[0.0; 12]), F32, "VEC4", 3);
    model.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["ROTATION"] =
        json!(none);
    model.files().refused(&["instance 0 is not finite"]);
}

#[test]
fn morph_target_weights_of_the_node_precede_those_of_the_mesh() {
    let mut model = square();
    let [up, over] = [[0.0, 0.0, 1.0], [0.0, 0.0, 10.0]].map(|move_by| model.points(&[move_by; 4]));
    model.json["meshes"][0]["primitives"][0]["targets"] =
        json!([{ "POSITION": up }, { "POSITION": over }]);
    assert_eq!(heights(&model), [0.0]);
    model.json["meshes"][0]["weights"] = json!([0.5, 0]);
    model.node(json!({ "mesh": 0, "weights": [0, 1] }));
    model.node(json!({ "mesh": 0, "weights": [1, 1], "translation": [0, 0, 100] }));
    assert_eq!(heights(&model), [0.5, 10.0, 111.0]);
    model.json["accessors"][over]["count"] = json!(3);
    model.files().refused(&["targets[1].POSITION: 3 elements, but vertex 3 is used"]);
}

#[test]
fn skinned_meshes_follow_their_joints() {
    let mut model = square();
    let normals = model.points(&[[0.0, 0.0, 1.0]; 4]);
    let joints = model.accessor(&[0, 1, 0, 0].repeat(4), U8, "VEC4", 4);
    let weights = model.accessor(&bytes(&[0.25, 0.75, 0.0, 0.0].repeat(4)), F32, "VEC4", 4);
    let attributes = &mut model.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["NORMAL"] = json!(normals);
    attributes["JOINTS_0"] = json!(joints);
    attributes["WEIGHTS_0"] = json!(weights);
    // The first is bound at a height of 1.
    let mut bound = [glam::Mat4::IDENTITY; 2];
    bound[0].w_axis.z = -1.0;
    let numbers: Vec<f32> = bound.iter().flat_map(|matrix| matrix.to_cols_array()).collect();
    let unbound = model.accessor(&bytes(&numbers), F32, "MAT4", 2);
    model.json["skins"] = json!([{ "joints": [1, 2], "inverseBindMatrices": unbound }]);
    // Where its own node is does not count.
    model.json["nodes"] = json!([
        { "mesh": 0, "skin": 0, "translation": [0, 0, 1000] },
        { "translation": [0, 0, 5] },
        { "translation": [0, 0, 40] },
    ]);
    assert_eq!(heights(&model), [0.25 * 4.0 + 0.75 * 40.0]);
    // Turned by a quarter about x, what faced +z faces -y.
    let half = std::f32::consts::FRAC_1_SQRT_2;
    for joint in [1, 2] {
        model.json["nodes"][joint]["rotation"] = json!([half, 0, 0, half]);
    }
    let scene = model.load().scene;
    let mesh = &scene.meshes()[0];
    assert!(
        mesh.normals.iter().all(|normal| (*normal + Vec3::Y).length() < 1e-5),
        "{:?}",
        mesh.normals
    );
    assert!(mesh.positions.iter().all(|p| p.y.abs() < 2.0), "{:?}", mesh.positions);
    let refused = |change: &dyn Fn(&mut Model), part: &str| {
        let mut model = model.clone();
        change(&mut model);
        model.files().refused(&[part]);
    };
    refused(&|m| m.json["skins"][0]["joints"] = json!([1]), "has joint 1 of 1");
    refused(&|m| m.json["skins"][0]["joints"] = json!([1, 9]), "nodes[9] is not in the scene");
    refused(
        &|m| m.json["skins"][0]["joints"] = json!([1, 2, 2]),
        "there are fewer than the 3 joints",
    );
    refused(&|m| m.json["nodes"][0]["skin"] = json!(3), "nodes[0].skin: there is no skins[3]");
}
