//! Each number of a file in turn becomes an extreme one: a count, an index, a size or a factor that
//! no file of this size can mean. Each file still loads or is refused, in bounded time and memory.

use crate::common::mutate::load_soundly;
use bdpm::light::photometry::LuminaireFile;
use std::fs;
use std::ops::Range;

/// Numbers in the place of others.
const EXTREME: [&str; 9] =
    ["0", "-1", "65535", "4294967296", "1e18", "1e308", "-1e38", "1e-300", "1e39"];

/// Places of numbers: not parts of names.
fn numbers(text: &str) -> Vec<Range<usize>> {
    let bytes = text.as_bytes();
    let is_number = |byte: u8| byte.is_ascii_digit() || b"+-.".contains(&byte);
    let mut found = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let begins = at == 0 || b" \t\n\r[](){},:='\"".contains(&bytes[at - 1]);
        if !(begins && is_number(bytes[at])) {
            at += 1;
            continue;
        }
        let more = |byte: &&u8| is_number(**byte) || **byte == b'e' || **byte == b'E';
        let end = at + bytes[at..].iter().take_while(more).count();
        if text[at..end].parse::<f64>().is_ok() {
            found.push(at..end);
        }
        at = end;
    }
    found
}

/// Loads the first of these files with each number of the file `changed` replaced. Of long files
/// each `step`-th number is.
fn check(files: &[(&str, &[u8])], changed: &str, step: usize) {
    let folder = tempfile::tempdir().unwrap();
    for (name, content) in files {
        fs::write(folder.path().join(name), content).unwrap();
    }
    let (_, content) = files.iter().find(|(name, _)| *name == changed).unwrap();
    let text = String::from_utf8_lossy(content);
    for (index, range) in numbers(&text).into_iter().step_by(step).enumerate() {
        // Each place gets three of them, and its neighbors others.
        for extreme in EXTREME.iter().skip(index % 3).step_by(3) {
            let other = [&text[..range.start], extreme, &text[range.end..]].concat();
            fs::write(folder.path().join(changed), other).unwrap();
            load_soundly(&folder.path().join(files[0].0));
        }
    }
}

const OBJ: &[u8] = b"v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 1 0\n\
    usemtl m\nf 1/1/1 2/2/1 3/3/1\nf -4 -3 -2 -1\n";

#[test]
fn scene_files_with_extreme_numbers_load_or_are_refused() {
    let scene = "medium = 'fog'
ray_offset = 1e-4
[camera]
position = [0, 2, 3]
target = [0, 0, 0]
fov_x_deg = 40
lens_radius = 0.1
focus_distance = 2
[render]
resolution = [16, 16]
light_paths = 100
radius = 0.1
[[mesh]]
file = 'a.obj'
translate = [0, 0, 1]
rotate_deg = [0, 90, 0]
scale = 2
material = 'm'
[materials.m]
type = 'dielectric'
ior = { nanometers = [400, 700], values = [1.5, 1.4] }
[materials.n]
type = 'glossy'
albedo = [0.5, 0.4, 0.3]
roughness = 0.3
emission = [1, 2, 3]
[[mesh]]
file = 'a.obj'
material = 'n'
[media.fog]
absorption = 0.1
scattering = [0.1, 0.2, 0.3]
asymmetry = 0.5
[[light]]
type = 'point'
position = [0, 1, 0]
intensity = 3
[[light]]
type = 'spot'
position = [0, 1, 0]
direction = [0, -1, 0]
inner_deg = 20
outer_deg = 30
intensity = 3
[[meter]]
corner = [0, 0, 0]
edges = [[1, 0, 0], [0, 0, 1]]
columns = 3
rows = 2
[[meter]]
position = [0, 1, 0]
direction = [0, -1, 0]
opening_deg = 10
";
    check(&[("a.toml", scene.as_bytes()), ("a.obj", OBJ)], "a.toml", 1);
}

#[test]
fn skies_with_extreme_numbers_load_or_are_refused() {
    let scene = "[camera]
position = [0, 2, 3]
target = [0, 0, 0]
fov_x_deg = 40
[[mesh]]
file = 'a.obj'
[sky]
latitude = 48
longitude = 11
timezone = 1
date = [2024, 6, 21]
hour = 12.5
turbidity = 3
sun_angle_deg = 0.5
sky_scale = 1
sun_scale = 1
turn_deg = 30
";
    check(&[("a.toml", scene.as_bytes()), ("a.obj", OBJ)], "a.toml", 1);
}

#[test]
fn meshes_with_extreme_numbers_load_or_are_refused() {
    let scene = b"[camera]\nposition = [0, 2, 3]\ntarget = [0, 0, 0]\nfov_x_deg = 40\n\
        [environment]\nradiance = 1\n[materials.m]\nalbedo = 0.5\n[[mesh]]\nfile = 'a.ply'\n\
        material = 'm'\n[[mesh]]\nfile = 'a.obj'\n";
    let ply = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty double y\n\
        property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n\
        element face 1\nproperty list uchar int vertex_indices\n\
        property list uchar float texcoord\nelement tristrips 1\n\
        property list int int vertex_indices\nend_header\n0 0 0 1 2 3\n1 0 0 1 2 3\n0 1 0 1 2 3\n\
        3 0 1 2 6 0 0 1 0 1 1\n3 0 1 2\n";
    let mtl = b"newmtl m\nKd 1 0.5 0.3\nKs 0.1 0.1 0.1\nNs 10\nNi 1.5\nd 0.5\nillum 7\nPr 0.1\n\
        Pm 0.2\nTf 0.5 0.5 0.5\nKe 1 1 1\nmap_Kd -s 2 2 1 -o 1 0 0 a.png\n";
    let obj = [b"mtllib a.mtl\n", OBJ].concat();
    let files: [(&str, &[u8]); 4] =
        [("a.toml", scene), ("a.ply", ply), ("a.obj", &obj), ("a.mtl", mtl)];
    for changed in ["a.ply", "a.obj", "a.mtl"] {
        check(&files, changed, 1);
    }
}

#[test]
fn scenes_of_mitsuba_with_extreme_numbers_load_or_are_refused() {
    let obj = include_bytes!("../data/mitsuba/pyramid.obj");
    let scenes: [&[u8]; 5] = [
        include_bytes!("../data/mitsuba/transforms.xml"),
        include_bytes!("../data/mitsuba/instances.xml"),
        include_bytes!("../data/mitsuba/media.xml"),
        include_bytes!("../data/mitsuba/spectra.xml"),
        include_bytes!("../data/mitsuba/thinlens.xml"),
    ];
    for scene in scenes {
        let files: [(&str, &[u8]); 5] = [
            ("a.xml", scene),
            ("base.xml", include_bytes!("../data/mitsuba/base.xml")),
            ("pyramid.obj", obj),
            ("colors.png", include_bytes!("../data/mitsuba/colors.png")),
            ("hill.ply", include_bytes!("../data/mitsuba/hill.ply")),
        ];
        check(&files, "a.xml", 2);
    }
}

#[test]
fn scenes_of_pbrt_with_extreme_numbers_load_or_are_refused() {
    let files: [(&str, &[u8]); 4] = [
        ("a.pbrt", include_bytes!("../data/pbrt/box.pbrt")),
        ("shapes.pbrt", include_bytes!("../data/pbrt/shapes.pbrt")),
        ("hill.ply.gz", include_bytes!("../data/pbrt/hill.ply.gz")),
        ("colors.png", include_bytes!("../data/pbrt/colors.png")),
    ];
    check(&files, "a.pbrt", 2);
    check(&files, "shapes.pbrt", 2);
}

#[test]
fn gltf_files_with_extreme_numbers_load_or_are_refused() {
    let mut model = crate::common::gltf::square();
    let places = model.points(&[[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]]);
    model.json["nodes"][0]["extensions"] = serde_json::json!({
        "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": places } }
    });
    let text = model.text();
    check(&[("a.gltf", text.as_bytes())], "a.gltf", 1);
}

#[test]
fn photometric_files_with_extreme_numbers_are_read_or_refused() {
    let files: [(&str, &str); 4] = [
        ("a.ies", include_str!("../data/photometry/quarter.ies")),
        ("a.ies", include_str!("../data/photometry/flood.ies")),
        ("a.ies", include_str!("../data/photometry/tilted.ies")),
        ("a.ldt", include_str!("../data/photometry/quadrants.ldt")),
    ];
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let path = folder.path().join(name);
        for (index, range) in numbers(text).into_iter().enumerate() {
            for extreme in EXTREME.iter().skip(index % 3).step_by(3) {
                let other = [&text[..range.start], extreme, &text[range.end..]].concat();
                fs::write(&path, other).unwrap();
                if let Err(error) = LuminaireFile::read(&path) {
                    assert!(error.to_string().contains("\nhelp: "), "{error}");
                }
            }
        }
    }
}
