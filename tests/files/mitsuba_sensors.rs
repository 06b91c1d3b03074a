//! Sensors and films of Mitsuba's scene files.

use super::mitsuba::{CAMERA, LIGHT, SQUARE, folder, read, refused, scene, with};
use bdpm::load::{LoadOptions, load_with};
use bdpm::scene::{Extent, FieldOfView, Optics};
use glam::Vec3;

#[test]
fn mitsuba_camera_looks_along_z_with_x_to_the_left() {
    let camera = with(SQUARE).scene.camera;
    assert_eq!(camera.position(), Vec3::new(0.0, 0.0, 5.0));
    assert!((camera.direction() - Vec3::NEG_Z).length() < 1e-6);
    assert!((camera.up() - Vec3::Y).length() < 1e-6);
    assert_eq!(camera.optics(), Optics::Pinhole(FieldOfView::X(40.0)));
    for (axis, expected) in [
        ("y", FieldOfView::Y(50.0)),
        ("smaller", FieldOfView::Y(50.0)),
        ("larger", FieldOfView::X(50.0)),
    ] {
        let text = format!(
            "<sensor type='perspective'><float name='fov' value='50'/><string name='fov_axis' value='{axis}'/>\
             <film type='hdrfilm'><integer name='width' value='30'/><integer name='height' value='20'/></film>\
             </sensor>"
        );
        let loaded = read(&scene(&[&text, LIGHT, SQUARE].concat()));
        assert_eq!(loaded.scene.camera.optics(), Optics::Pinhole(expected), "{axis}");
        assert_eq!(loaded.defaults.resolution, Some([30, 20]));
    }
    // 50 mm of 36 mm times 24 mm film, across the diagonal.
    let text = scene(&["<sensor type='perspective'/>", LIGHT, SQUARE].concat());
    let Optics::Pinhole(FieldOfView::X(degrees)) = read(&text).scene.camera.optics() else {
        panic!()
    };
    assert!((degrees - 38.1848).abs() < 1e-3, "as mitsuba 3.9.1 says: {degrees}");
}

#[test]
fn orthographic_sensors_show_two_units_of_their_space() {
    let flat = |film: &str| {
        let text = format!(
            "<sensor type='orthographic'><transform name='to_world'><scale x='3' y='3'/>\
             <lookat origin='0, 0, 5' target='0, 0, 0' up='0, 1, 0'/></transform>\
             <film type='hdrfilm'><integer name='width' value='40'/><integer name='height' value='20'/>{film}\
             </film></sensor>"
        );
        read(&scene(&[&text, LIGHT, SQUARE].concat())).scene.camera
    };
    assert_eq!(flat("").optics(), Optics::Orthographic(Extent::X(6.0)));
    let part =
        flat("<integer name='crop_width' value='10'/><integer name='crop_offset_x' value='30'/>");
    assert_eq!(part.optics(), Optics::Orthographic(Extent::X(1.5)));
    assert_eq!(part.shift(), [1.5, 0.0]);
}

#[test]
fn cropped_and_shifted_films_match_the_whole_film() {
    let film = |what: &str, of: &str| {
        let text = format!(
            "<sensor type='perspective'><float name='fov' value='50'/>{what}<film type='hdrfilm'>\
             <integer name='width' value='30'/><integer name='height' value='20'/>{of}</film></sensor>"
        );
        scene(&[&text, LIGHT, SQUARE].concat())
    };
    let number = |name: &str, value: u32| format!("<integer name='crop_{name}' value='{value}'/>");
    let part = |x, y, width, height| {
        [("offset_x", x), ("offset_y", y), ("width", width), ("height", height)]
            .map(|(name, value)| number(name, value))
            .concat()
    };
    let seen = |text: &str, x: f32, y: f32| {
        let loaded = read(text);
        let [width, height] = loaded.defaults.resolution.unwrap();
        (loaded.scene.camera.view(width, height).ray(x, y, [0.5; 2]).0.direction, [width, height])
    };
    let (whole, _) = seen(&film("", ""), 12.5, 7.0);
    let (cropped, size) = seen(&film("", &part(10, 5, 12, 6)), 2.5, 2.0);
    assert!((whole - cropped).length() < 1e-5 && size == [12, 6], "{whole} {cropped} {size:?}");
    let moved = "<float name='principal_point_offset_x' value='0.1'/>\
                 <float name='principal_point_offset_y' value='-0.2'/>";
    for (of, x, y) in [(String::new(), 9.5, 11.0), (part(4, 5, 12, 6), 5.5, 6.0)] {
        let (moved, _) = seen(&film(moved, &of), x, y);
        assert!((whole - moved).length() < 1e-5, "{whole} {moved}");
    }
    refused(&film("", &part(25, 0, 10, 5)), &["a.xml:2", "not within the film of 30 x 20"]);
}

#[test]
fn sensors_are_chosen_by_their_id() {
    let two = CAMERA.replace("<sensor ", "<sensor id='one' ")
        + "<sensor type='perspective' id='two'><float name='fov' value='20'/></sensor>";
    let folder = folder(&scene(&[&two, LIGHT, SQUARE].concat()));
    let path = folder.path().join("a.xml");
    let chosen = |camera| load_with(&path, &LoadOptions { camera, ..LoadOptions::default() });
    assert_eq!(chosen(Some("two")).unwrap().scene.camera.position(), Vec3::ZERO);
    let first = chosen(None).unwrap();
    assert_eq!(first.summary.camera.as_deref(), Some("one"));
    assert!(first.warnings_text().contains("the first of several cameras"));
    let error = chosen(Some("three")).unwrap_err().to_string();
    assert!(error.contains("`three`") && error.contains("`one`, `two`"), "{error}");
}

#[test]
fn mirrored_cameras_mirror_the_scene() {
    let mirrored = CAMERA.replace("<lookat", "<scale x='-1'/><lookat");
    let square =
        "<shape type='rectangle'><transform name='to_world'><translate x='2'/></transform></shape>";
    let loaded = read(&scene(&[&mirrored, LIGHT, square].concat()));
    assert!((loaded.scene.bounds().center() - Vec3::new(-2.0, 0.0, 0.0)).length() < 1e-5);
    assert!(loaded.warnings_text().contains("mirrored"), "{}", loaded.warnings_text());
}
