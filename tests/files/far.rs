//! Scenes far from the origin are loaded with the lengths of near ones, from files of all formats.

use crate::common::gltf::Model;
use bdpm::import::read_meters;
use bdpm::load::{CameraChange, LoadOptions, Loaded, LookAt, export, load, load_with};
use bdpm::scene::Emitter;
use glam::{DVec3, Vec3};
use serde_json::json;
use std::fs::write;
use std::path::Path;
use tempfile::TempDir;

/// A floor of 4 by 4 with a lamp 2 above a meter, at a distance along x. `by_matrix` moves the mesh
/// by its table, else its file has the distance.
fn folder(distance: f64, by_matrix: bool) -> TempDir {
    let folder = TempDir::new().unwrap();
    let own = if by_matrix { 0.0 } else { distance };
    let corner = |x: f64, z: f64| format!("v {} 0 {z}\n", own + x);
    let obj = [corner(-2.0, -2.0), corner(2.0, -2.0), corner(2.0, 2.0), corner(-2.0, 2.0)].concat();
    let translate =
        if by_matrix { format!("translate = [{distance}, 0, 0]\n") } else { String::new() };
    let text = format!(
        "[camera]\nposition = [{distance}, 3, 5]\ntarget = [{distance}, 0, 0]\nfov_x_deg = 40\n\
         [[mesh]]\nfile = 'a.obj'\nmaterial = 'm'\n{translate}[materials.m]\nalbedo = 0.5\n\
         [[light]]\ntype = 'point'\nposition = [{0}, 2.125, 0.25]\ncandela = 1000\n\
         [[meter]]\nname = 'a'\nposition = [{0}, 0.125, 0.25]\nnormal = [0, 1, 0]\n",
        distance + 0.375
    );
    write(folder.path().join("a.obj"), obj + "f 4 3 2 1\n").unwrap();
    write(folder.path().join("scene.toml"), text).unwrap();
    folder
}

/// Position of the first light in the file.
fn lamp(loaded: &Loaded) -> DVec3 {
    let Emitter::Point { position, .. } = loaded.scene.lights().emitters()[0] else {
        panic!("not a point")
    };
    loaded.scene.in_file(position)
}

/// Size of the box of a scene, which is near its origin.
fn near_size(loaded: &Loaded) -> Vec3 {
    let bounds = loaded.scene.bounds();
    assert!(bounds.center().abs().max_element() < 8.0, "{bounds:?}");
    bounds.max - bounds.min
}

#[test]
fn far_scenes_have_the_lengths_of_near_ones() {
    for distance in [1e2, 1e3, 1e4, 1e5, 1e6] {
        for by_matrix in [false, true] {
            let own = folder(distance, by_matrix);
            let loaded = load(own.path()).unwrap();
            assert_eq!(lamp(&loaded), DVec3::new(distance + 0.375, 2.125, 0.25));
            assert_eq!(near_size(&loaded), Vec3::new(4.0, 0.0, 4.0));
            let meter = loaded.scene.in_file(loaded.meters[0].meters[0].position);
            assert_eq!(meter, DVec3::new(distance + 0.375, 0.125, 0.25));
            let camera = loaded.scene.in_file(loaded.scene.camera.position());
            assert_eq!(camera, DVec3::new(distance, 3.0, 5.0));
            assert!(loaded.warnings_text().contains("far from the origin"));
        }
    }
    for near in [0.0, 30.0] {
        let loaded = load(folder(near, false).path()).unwrap();
        assert_eq!(loaded.scene.file_origin(), DVec3::ZERO);
    }
}

#[test]
fn tables_of_meters_cameras_and_conversions_keep_the_coordinates_of_the_file() {
    let own = folder(1e6, false);
    let loaded = load(own.path()).unwrap();
    let table = own.path().join("m.csv");
    write(&table, "name,x,y,z,nx,ny,nz\na,1000000.375,0.125,0.25,0,1,0\n").unwrap();
    let meters = read_meters(&table, &loaded.scene).unwrap();
    assert_eq!(meters[0].meters, loaded.meters[0].meters);
    let out = TempDir::new().unwrap();
    export(&loaded, "scene.toml", out.path(), true).unwrap();
    let again = load(out.path()).unwrap();
    assert_eq!(lamp(&again), lamp(&loaded));
    assert_eq!(again.scene.file_origin(), loaded.scene.file_origin());
    assert_eq!(again.scene.fingerprint(), loaded.scene.fingerprint());
    let eye = DVec3::new(1e6 + 1.0, 2.0, 3.0);
    let look_at = Some(LookAt::new(eye, DVec3::new(1e6, 0.0, 0.0), None));
    let camera_change = CameraChange { look_at, ..CameraChange::default() };
    let options = LoadOptions { camera_change, ..LoadOptions::default() };
    let moved = load_with(own.path(), &options).unwrap().scene;
    assert_eq!(moved.in_file(moved.camera.position()), eye);
    let toml = own.path().join("scene.toml");
    let camera_change = CameraChange { from: Some(&toml), ..CameraChange::default() };
    let options = LoadOptions { camera_change, ..LoadOptions::default() };
    let same = load_with(own.path(), &options).unwrap().scene;
    assert_eq!(same.camera.position(), loaded.scene.camera.position());
}

/// Matrices and vertices of other formats keep their digits as well.
#[test]
fn far_scenes_of_mitsuba_and_pbrt_have_the_lengths_of_near_ones() {
    let folder = TempDir::new().unwrap();
    let xml = |shape: &str| {
        format!(
            "<scene version='3.0.0'><sensor type='perspective'><transform name='to_world'>\
             <lookat origin='1000000, 3, 5' target='1000000, 0, 0' up='0, 1, 0'/></transform></sensor>\
             <emitter type='point'><point name='position' x='1000000.375' y='2.125' z='0.25'/>\
             </emitter>{shape}</scene>"
        )
    };
    let moved = "<shape type='rectangle'><transform name='to_world'><rotate x='1' angle='-90'/>\
                 <translate x='1000000'/></transform></shape>";
    let ply = "ply\nformat ascii 1.0\nelement vertex 4\nproperty double x\nproperty double y\n\
               property double z\nelement face 1\nproperty list uchar int vertex_indices\n\
               end_header\n999999 0 1\n1000001 0 1\n1000001 0 -1\n999999 0 -1\n4 0 1 2 3\n";
    write(folder.path().join("far.ply"), ply).unwrap();
    let file = "<shape type='ply'><string name='filename' value='far.ply'/></shape>";
    let pbrt = |translate: &str, points: &str| {
        format!(
            "LookAt 1000000 3 5  1000000 0 0  0 1 0\nCamera \"perspective\"\nWorldBegin\n\
             LightSource \"point\" \"point3 from\" [1000000.375 2.125 0.25]\n{translate}\
             Shape \"trianglemesh\" \"integer indices\" [0 1 2 0 2 3]\n\"point3 P\" [{points}]\n"
        )
    };
    let by_matrix = pbrt("Translate 1000000 0 0\n", "-1 0 1  1 0 1  1 0 -1  -1 0 -1");
    let points = "999999 0 1  1000001 0 1  1000001 0 -1  999999 0 -1";
    for (name, text) in [
        ("matrix.xml", xml(moved)),
        ("file.xml", xml(file)),
        ("matrix.pbrt", by_matrix),
        ("points.pbrt", pbrt("", points)),
    ] {
        let path: &Path = &folder.path().join(name);
        write(path, text).unwrap();
        let loaded = load(path).unwrap();
        // Files of pbrt are left-handed: their scenes are mirrored.
        let lamp = lamp(&loaded);
        assert_eq!([lamp.x.abs(), lamp.y, lamp.z], [1_000_000.375, 2.125, 0.25], "{name}");
        assert!((near_size(&loaded) - Vec3::new(2.0, 0.0, 2.0)).abs().max_element() < 1e-5);
    }
}

#[test]
fn far_nodes_of_gltf_have_the_lengths_of_near_ones() {
    let placed = |x: f64| {
        let mut model = Model::new();
        let points = model.points(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        let primitive = json!({ "attributes": { "POSITION": points } });
        model.push("meshes", json!({ "primitives": [primitive] }));
        model.node(json!({ "mesh": 0, "translation": [x, 0.0, 0.0] }));
        model.load()
    };
    let (near, far) = (placed(0.0), placed(1e6 + 0.125));
    assert_eq!(near_size(&far), near_size(&near));
    let corner = |loaded: &Loaded| loaded.scene.in_file(loaded.scene.bounds().min);
    assert_eq!(corner(&far) - corner(&near), DVec3::new(1e6 + 0.125, 0.0, 0.0));
}

/// Positions in single precision have steps of 8 at this distance.
#[test]
fn far_cameras_spots_and_meters_look_at_their_near_targets() {
    let far = 1e8;
    let own = folder(far, false);
    let path = own.path().join("scene.toml");
    let text = std::fs::read_to_string(&path).unwrap();
    let camera = format!("position = [{far}, 3, 5]\ntarget = [{far}, 0, 0]");
    let aside = format!("position = [{}, 2, 0]\ntarget = [{far}, 2, 0]", far - 3.0);
    assert!(text.contains(&camera));
    let more = format!(
        "[[light]]\ntype = 'spot'\nposition = [{far}, 2, 0]\ntarget = [{}, 2, 0]\nouter_deg = 20\n\
         candela = 1000\n\
         [[meter]]\nname = 'b'\nposition = [{far}, 2, 0]\ntarget = [{}, 2, 0]\n",
        far + 1.0,
        far - 1.0
    );
    write(&path, text.replace(&camera, &aside) + &more).unwrap();
    let loaded = load(own.path()).unwrap();
    assert_eq!(loaded.scene.camera.direction(), Vec3::X);
    assert_eq!(loaded.scene.in_file(loaded.scene.camera.position()).x, far - 3.0);
    let spot = loaded.scene.lights().emitters().iter().find_map(|emitter| match emitter {
        Emitter::Spot(spot) => Some(spot.direction),
        _ => None,
    });
    assert_eq!(spot, Some(Vec3::X));
    assert_eq!(loaded.meters[1].meters[0].normal, Vec3::NEG_X);
    // The camera of the command line, which is far from a scene near the origin
    let near = folder(0.0, false);
    let look_at = LookAt::new(DVec3::new(far, 0.0, 0.0), DVec3::new(far - 1.0, 0.0, 0.0), None);
    let camera_change = CameraChange { look_at: Some(look_at), ..CameraChange::default() };
    let options = LoadOptions { camera_change, ..LoadOptions::default() };
    let loaded = load_with(near.path(), &options).unwrap();
    assert_eq!(loaded.scene.camera.direction(), Vec3::NEG_X);
}
