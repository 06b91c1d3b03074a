//! Changes of the camera that the command line requests, for all kinds of scenes.

use bdpm::load::{CameraChange, LoadOptions, Loaded, load_with};
use bdpm::scene::{FieldOfView, Optics};
use glam::Vec3;
use std::path::{Path, PathBuf};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

fn changed(scene: &str, camera_change: CameraChange) -> bdpm::base::error::Result<Loaded> {
    load_with(&data(scene), &LoadOptions { camera_change, ..LoadOptions::default() })
}

#[test]
fn look_at_and_fov_change_the_camera_of_any_scene() {
    let look_at = Some("1,2,30,1,2,0".parse().unwrap());
    let scenes =
        ["scenes/cornell-box", "tests/data/mitsuba/shapes.xml", "tests/data/mitsuba/pyramid.obj"];
    for scene in scenes {
        let change = CameraChange { look_at, fov: Some(12.5), ..CameraChange::default() };
        let loaded = changed(scene, change).unwrap_or_else(|e| panic!("{e}"));
        let camera = &loaded.scene.camera;
        assert_eq!((camera.position(), camera.direction()), (Vec3::new(1.0, 2.0, 30.0), -Vec3::Z));
        assert_eq!(camera.up(), Vec3::Y, "{scene}");
        let Optics::Pinhole(FieldOfView::X(degrees) | FieldOfView::Y(degrees)) = camera.optics()
        else {
            panic!("{:?}", camera.optics())
        };
        assert_eq!(degrees, 12.5, "{scene}");
    }
}

#[test]
fn cameras_of_other_scenes_come_with_their_resolution() {
    let folder = tempfile::tempdir().unwrap();
    let alone = folder.path().join("camera.toml");
    let text = "[camera]\ntype = \"fisheye\"\nposition = [1, 2, 3]\ntarget = [0, 0, 0]\n\
                [render]\nresolution = [33, 44]\n";
    std::fs::write(&alone, text).unwrap();
    let mitsuba = data("tests/data/mitsuba/crop.xml");
    for from in [&alone, &mitsuba] {
        let change = CameraChange { from: Some(from), ..CameraChange::default() };
        let loaded = changed("scenes/cornell-box", change).unwrap();
        if from == &alone {
            assert_eq!(loaded.defaults.resolution, Some([33, 44]));
            assert_eq!(loaded.scene.camera.position(), Vec3::new(1.0, 2.0, 3.0));
        } else {
            let own = load_with(from, &LoadOptions::default()).unwrap();
            assert_eq!(loaded.scene.camera, own.scene.camera);
            assert_eq!(loaded.defaults.resolution, own.defaults.resolution);
        }
    }
}

#[test]
fn missing_camera_is_noted_unless_the_request_replaces_its_position() {
    let obj = "tests/data/mitsuba/pyramid.obj";
    let notes = |change: CameraChange| {
        changed(obj, change).unwrap_or_else(|e| panic!("{e}")).warnings_text()
    };
    let none = CameraChange::default();
    let shown = notes(none);
    assert!(shown.contains("no camera") && shown.contains("40 degrees high"), "{shown}");
    let shown = notes(CameraChange { fov: Some(12.5), ..none });
    assert!(shown.contains("no camera") && shown.contains("12.5 degrees high"), "{shown}");
    let shown = notes(CameraChange { look_at: Some("1,2,30,1,2,0".parse().unwrap()), ..none });
    assert!(!shown.contains("no camera"), "{shown}");
    let other = data("scenes/cornell-box");
    let shown = notes(CameraChange { from: Some(&other), ..none });
    assert!(!shown.contains("no camera"), "{shown}");
}

#[test]
fn impossible_changes_name_the_problem() {
    let fov = |degrees| CameraChange { fov: Some(degrees), ..CameraChange::default() };
    let shown = changed("scenes/cornell-box", fov(200.0)).unwrap_err().to_string();
    assert!(shown.contains("field of view is 200 degrees"), "{shown}");
    let folder = tempfile::tempdir().unwrap();
    let bad = folder.path().join("camera.toml");
    std::fs::write(&bad, "[camera]\nposition = [0, 0, 0]\nfov_x_deg = 40\n").unwrap();
    let change = CameraChange { from: Some(&bad), ..CameraChange::default() };
    let shown = changed("scenes/cornell-box", change).unwrap_err().to_string();
    assert!(shown.contains("camera.toml:1: the camera needs exactly one of `target`"), "{shown}");
}
