//! PLY files as programs write them: colors, numbers, line ends, and attributes of faces.

use bdpm::load::{LoadOptions, Loaded, load_with};
use glam::{Vec2, Vec3};
use std::fs;

const SCENE: &str = "[camera]
position = [0, 0, 3]
target = [0, 0, 0]
fov_x_deg = 40
[environment]
radiance = 1
[materials.white]
albedo = 1
[[mesh]]
file = 'a.ply'
material = 'white'
";

/// Loads a scene of this PLY file, or returns the error.
fn loaded(ply: &[u8]) -> Result<Loaded, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.toml");
    fs::write(&path, SCENE).unwrap();
    fs::write(folder.path().join("a.ply"), ply).unwrap();
    load_with(&path, &LoadOptions::default()).map_err(|error| error.to_string())
}

/// Loads a PLY file of which nothing is skipped.
#[track_caller]
fn complete(ply: &[u8]) -> bdpm::scene::Mesh {
    let loaded = loaded(ply).unwrap();
    assert_eq!(loaded.warnings_text(), "");
    loaded.scene.meshes()[0].clone()
}

/// A triangle whose vertices have further properties.
fn triangle(properties: &[&str], values: &str) -> String {
    let properties: String = properties.iter().map(|own| format!("property {own}\n")).collect();
    format!(
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
         property float z\n{properties}element face 1\nproperty list uchar int vertex_indices\n\
         end_header\n-2 -2 0 {values}\n2 -2 0 {values}\n0 4 0 {values}\n3 0 1 2\n"
    )
}

/// Linear values of the sRGB codes 128, 64 and 32 of 255.
const DECODED: Vec3 = Vec3::new(0.215_861, 0.051_269_46, 0.014_443_844);

#[test]
fn integer_colors_are_srgb_codes_of_their_full_range() {
    for (kind, values) in [
        ("uchar", "128 64 32"),
        ("uint8", "128 64 32"),
        ("int", "128 64 32"),
        ("ushort", "32896 16448 8224"),
    ] {
        for names in ["red green blue", "r g b", "diffuse_red diffuse_green diffuse_blue"] {
            let properties: Vec<String> =
                names.split(' ').map(|name| format!("{kind} {name}")).collect();
            let properties: Vec<&str> = properties.iter().map(String::as_str).collect();
            let mesh = complete(triangle(&properties, values).as_bytes());
            for color in &mesh.colors {
                assert!(color.abs_diff_eq(DECODED, 1e-6), "{kind} {names}: {color}");
            }
            assert_eq!(mesh.colors.len(), 3, "{kind} {names}");
        }
    }
}

#[test]
fn float_colors_are_linear() {
    for kind in ["float", "double", "float64"] {
        let properties = ["red", "green", "blue"].map(|name| format!("{kind} {name}"));
        let properties: Vec<&str> = properties.iter().map(String::as_str).collect();
        let mesh = complete(triangle(&properties, "0.5 0.25 0.125").as_bytes());
        assert_eq!(mesh.colors, [Vec3::new(0.5, 0.25, 0.125); 3], "{kind}");
        let beyond = loaded(triangle(&properties, "2 -1 0.5").as_bytes()).unwrap();
        assert_eq!(beyond.scene.meshes()[0].colors, [Vec3::new(1.0, 0.0, 0.5); 3]);
        let text = beyond.warnings_text();
        assert!(text.contains("clamped colors of vertices or faces to [0, 1]"), "{text}");
    }
}

#[test]
fn opaque_alpha_is_complete_and_translucent_alpha_is_reported() {
    let properties = ["uchar red", "uchar green", "uchar blue", "uchar alpha"];
    let mesh = complete(triangle(&properties, "128 64 32 255").as_bytes());
    assert!(mesh.colors[0].abs_diff_eq(DECODED, 1e-6));
    let loaded = loaded(triangle(&properties, "128 64 32 254").as_bytes()).unwrap();
    let text = loaded.warnings_text();
    assert!(text.contains("a.ply: ignored the opacity of vertices"), "{text}");
}

#[test]
fn binary_colors_are_read_in_both_byte_orders() {
    let points = [[-2.0_f32, -2.0, 0.0], [2.0, -2.0, 0.0], [0.0, 4.0, 0.0]];
    for is_big in [false, true] {
        let order = if is_big { "big" } else { "little" };
        let mut ply = format!(
            "ply\nformat binary_{order}_endian 1.0\nelement vertex 3\nproperty float x\n\
             property float y\nproperty float z\nproperty uchar red\nproperty uchar green\n\
             property uchar blue\nelement face 1\nproperty list uchar int vertex_indices\n\
             end_header\n"
        )
        .into_bytes();
        for point in points {
            ply.extend(
                point.iter().flat_map(|x| if is_big { x.to_be_bytes() } else { x.to_le_bytes() }),
            );
            ply.extend([128, 64, 32]);
        }
        ply.push(3);
        let corners = [0_i32, 1, 2].into_iter();
        ply.extend(corners.flat_map(|i| if is_big { i.to_be_bytes() } else { i.to_le_bytes() }));
        let mesh = complete(&ply);
        assert_eq!(mesh.positions, points.map(Vec3::from_array), "{order}");
        assert!(mesh.colors[2].abs_diff_eq(DECODED, 1e-6), "{order}");
        let short = loaded(&ply[..ply.len() - 1]).unwrap_err();
        assert!(short.contains("the file ends before item 0 of the element `face`"), "{short}");
    }
}

#[test]
fn numbers_and_line_ends_of_all_programs_are_read() {
    let plain = triangle(&[], "");
    let expected = complete(plain.as_bytes()).positions;
    for (what, text) in [
        ("a point without digits after", plain.replace("-2 -2 0", "-2. -2. 0.")),
        ("a point without digits before", plain.replace("-2 -2 0", "-2 -2 .0")),
        ("signs and exponents", plain.replace("-2 -2 0", "-2E0 -20e-1 +0.0")),
        ("a byte order mark", format!("\u{feff}{plain}")),
        ("line ends of old Macs", plain.replace('\n', "\r")),
        ("line ends of Windows", plain.replace('\n', "\r\n")),
        ("empty lines", plain.replace('\n', "\n\n")),
        ("tabs and spaces", plain.replace(' ', " \t ").replace('\n', " \n  ")),
        ("no line end at the end", plain.trim_end().to_owned()),
    ] {
        let read = loaded(text.as_bytes());
        let read = read.unwrap_or_else(|error| panic!("{what}: {error}"));
        assert_eq!(read.scene.meshes()[0].positions, expected, "{what}");
    }
}

#[test]
fn malformed_texts_name_their_line() {
    let plain = triangle(&[], "");
    for (text, part) in [
        (plain.replace("2 -2 0", "2 x 0"), ":10: cannot read it as a PLY file: `x` is not"),
        (plain.replace("0 4 0", "0 4"), ":12: cannot read it as a PLY file: the line has too few"),
        (plain.replace("3 0 1 2", "3 0 1 -2"), ":13: cannot read it as a PLY file: face 0 has"),
        (plain.replace("3 0 1 2", "3 0 1 7"), "a face uses vertex 7 of 3"),
        (plain.replace("3 0 1 2", "4 0 1 2 7"), ":13: cannot read it as a PLY file: face 0 uses"),
        (plain.replace("3 0 1 2", "-3 0 1 2"), "a list of item 0 has the length -3"),
        (plain.replace("float y", "flat y"), ":5: cannot read it as a PLY file: Line 5"),
        (plain.replace("property float z", ""), "its vertices have no `z`"),
        (plain.replace("end_header", ""), "cannot read it as a PLY file"),
        (plain.replace("vertex 3", "vertex 5000000000"), "it has more than"),
        (String::new(), "the file ends within its header"),
    ] {
        let error = loaded(text.as_bytes()).unwrap_err();
        assert!(error.contains(part) && error.contains("a.ply"), "{part}: {error}");
    }
}

/// A square whose face has further properties.
fn square(properties: &str, values: &str) -> String {
    format!(
        "ply\nformat ascii 1.0\ncomment TextureFile wood.png\nelement vertex 4\nproperty float x\n\
         property float y\nproperty float z\nelement face 1\n\
         property list uchar int vertex_indices\n{properties}end_header\n-1 -1 0\n1 -1 0\n1 1 0\n\
         -1 1 0\n4 0 1 2 3 {values}\n"
    )
}

#[test]
fn texture_coordinates_of_faces_are_read() {
    let text = square("property list uchar float texcoord\n", "8 0 0 .5 0 .5 1 0 1");
    let loaded = loaded(text.as_bytes()).unwrap();
    let mesh = &loaded.scene.meshes()[0];
    for (position, uv) in mesh.positions.iter().zip(&mesh.uvs) {
        let expected = Vec2::new(0.25 * (position.x + 1.0), 0.5 * (position.y + 1.0));
        assert_eq!(*uv, expected, "{position}");
    }
    assert_eq!(mesh.uvs.len(), 4);
    let text = loaded.warnings_text();
    assert!(text.contains("`TextureFile`, which materials have to name: `wood.png`"), "{text}");
    let odd = square("property list uchar float texcoord\n", "7 0 0 .5 0 .5 1 0");
    let error = self::loaded(odd.as_bytes()).unwrap_err();
    assert!(error.contains("face 0 has 7 of 8 texture coordinates"), "{error}");
}

#[test]
fn vertices_are_split_where_faces_have_other_attributes() {
    let text = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
                property float z\nproperty float nx\nproperty float ny\nproperty float nz\n\
                element face 2\nproperty list uchar int vertex_index\n\
                property list uchar float texcoord\nproperty uchar red\nproperty uchar green\n\
                property uchar blue\nend_header\n-1 -1 0 0 0 1\n1 -1 0 0 0 1\n1 1 0 0 0 1\n\
                -1 1 0 0 0 1\n3 0 1 2 6 0 0 1 0 1 1 255 0 0\n3 0 2 3 6 0 0 .5 1 0 1 0 0 255\n";
    let mesh = complete(text.as_bytes());
    assert_eq!((mesh.positions.len(), mesh.uvs.len(), mesh.normals.len()), (6, 6, 6));
    let colors: Vec<Vec3> =
        mesh.triangles.as_flattened().iter().map(|i| mesh.colors[*i as usize]).collect();
    assert_eq!(colors, [Vec3::X, Vec3::X, Vec3::X, Vec3::Z, Vec3::Z, Vec3::Z]);
}

#[test]
fn polygons_that_are_not_convex_are_cut_and_strips_become_triangles() {
    let dent = square("", "").replace("\n1 1 0", "\n-.5 -.5 0").replace("4 0 1 2 3", "4 1 2 3 0");
    let mesh = loaded(dent.as_bytes()).unwrap().scene.meshes()[0].clone();
    assert!((crate::common::area(&mesh) - 1.0).abs() < 1e-6, "{:?}", mesh.triangles);
    let strip = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n\
                 property float z\nelement tristrips 1\nproperty list int int vertex_indices\n\
                 end_header\n-1 -1 0\n1 -1 0\n-1 1 0\n1 1 0\n8 0 1 2 3 -1 0 1 2\n";
    let mesh = complete(strip.as_bytes());
    assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 3], [0, 1, 2]]);
}

#[test]
fn skipped_properties_and_elements_are_reported() {
    let text = triangle(&["float confidence", "uchar specular_red"], "1 255");
    let shown = loaded(text.as_bytes()).unwrap().warnings_text();
    assert!(shown.contains("the properties of the element `vertex`: `specular_red`"), "{shown}");
    assert!(!shown.contains("confidence"), "{shown}");
    let edges = "element edge 2\nproperty int vertex1\nproperty int vertex2\nend_header";
    let text = triangle(&[], "").replace("end_header", edges) + "0 1\n1 2\n";
    let shown = loaded(text.as_bytes()).unwrap().warnings_text();
    assert!(shown.contains("a.ply: ignored 2 elements `edge`"), "{shown}");
}

#[test]
fn compressed_files_without_end_are_refused() {
    use flate2::Compression;
    use flate2::write::GzEncoder;
    use std::io::Write;
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    let header = "ply\nformat binary_little_endian 1.0\nelement point 4000000000\n\
                  property list uchar float numbers\nend_header\n";
    encoder.write_all(header.as_bytes()).unwrap();
    (0..300).for_each(|_| encoder.write_all(&[0; 1 << 20]).unwrap());
    let error = loaded(&encoder.finish().unwrap()).unwrap_err();
    assert!(error.contains("it holds over 100 times the bytes of the file"), "{error}");
    let mut spaces = GzEncoder::new(Vec::new(), Compression::fast());
    (0..8).for_each(|_| spaces.write_all(&[b' '; 1 << 20]).unwrap());
    let error = loaded(&spaces.finish().unwrap()).unwrap_err();
    assert!(error.contains("the first line is not `ply`"), "{error}");
}
