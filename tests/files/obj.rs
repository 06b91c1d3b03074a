//! OBJ files as the world writes them: dialects, polygons of any shape, and what is missing or odd.

use crate::common::{area, settings};
use bdpm::accel::{Intersect, Ray};
use bdpm::load::{Loaded, load};
use bdpm::noise::Measure;
use bdpm::scene::backend::{Backend, build};
use bdpm::scene::{Mesh, Scene};
use bdpm::{Renderer, Settings};
use glam::{Vec2, Vec3};
use std::sync::Arc;
use tempfile::TempDir;

/// Loads the last of these files.
fn load_files(files: &[(&str, &[u8])]) -> bdpm::Result<Loaded> {
    let folder = TempDir::new().unwrap();
    for (name, content) in files {
        std::fs::write(folder.path().join(name), content).unwrap();
    }
    load(folder.path().join(files.last().unwrap().0))
}

#[track_caller]
fn obj(content: impl AsRef<[u8]>) -> Loaded {
    load_files(&[("a.obj", content.as_ref())]).unwrap_or_else(|e| panic!("{e}"))
}

#[track_caller]
fn refused(content: &str, part: &str) {
    let error = load_files(&[("a.obj", content.as_bytes())]).unwrap_err().to_string();
    assert!(error.contains(part) && error.contains("\nhelp: "), "{error}");
}

/// All corners of all triangles.
fn corners(scene: &Arc<Scene>) -> Vec<Vec3> {
    let of = |mesh: &Mesh| -> Vec<Vec3> {
        mesh.triangles.iter().flatten().map(|i| mesh.positions[*i as usize]).collect()
    };
    scene.meshes().iter().flat_map(of).collect()
}

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n";

#[test]
fn equivalent_spellings_of_a_square_load_alike() {
    let expected = corners(&obj(SQUARE).scene);
    assert_eq!(
        expected,
        [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]]
            .map(|[x, y]| { Vec3::new(x as f32, y as f32, 0.0) })
    );
    let vertices = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
    let rest = "vt 0 0\nvn 0 0 1\n";
    for content in [
        format!("{vertices}f 1 2 3\nf 1 3 4\n"),
        format!("{vertices}f -4 -3 -2 -1\n"),
        format!("{vertices}f -4 2 +3 -1 # all\n"),
        format!("{vertices}{rest}f 1 2/1 3//1 4/1/1\n"),
        format!("{vertices}{rest}f 1/1 2/-1/-1 3/1/1 4/1/1\n"),
        format!("{vertices}{rest}f 1/ 2// 3 4\n"),
        format!("{vertices}f\t1  2 \\\n3 \\  \n \\\r\n 4 \t \n"),
        format!("{vertices}# a comment \\\nf 1 2 3 4"),
        format!("\u{feff}{SQUARE}"),
        SQUARE.replace('\n', "\r\n"),
        SQUARE.replace('\n', "\r"),
        format!("\u{feff}{}", SQUARE.replace('\n', "\r")),
        SQUARE.replace('\n', " \t\n\n"),
        SQUARE.replace(' ', "\t"),
        SQUARE.replace("v ", "  v   "),
        SQUARE.replace('\n', " # why not\n"),
        SQUARE.replace("1 0\n", "1 0 1\n").replace("1 1 0 1", "2 2 0 2"),
        SQUARE.replace("0\n", "0 0.1 0.2 0.3\n"),
        SQUARE.replace("0\n", "0 0.1 0.2 0.3 1\n"),
        SQUARE.replace("0 ", "0.e5 ").replace("v 1 ", "v +10e-1 ").replace("1 0\n", "1. -.0\n"),
        SQUARE.replace("v 1", "v 1000e-3").replace("0 0\n", ".0 -0\n"),
        format!("s 1\ng\no\nvp 0 0\n{SQUARE}"),
    ] {
        let read = corners(&obj(&content).scene);
        assert_eq!(read, expected, "{content:?}");
    }
}

#[test]
fn texture_coordinates_of_one_to_three_numbers() {
    let content = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt .5\nvt 1e-1 2\nvt 3 4 5 # six\n";
    let mesh = obj(format!("{content}f 1/1 2/2 3/3\n")).scene.meshes()[0].clone();
    assert_eq!(mesh.uvs, [Vec2::new(0.5, 0.0), Vec2::new(0.1, 2.0), Vec2::new(3.0, 4.0)]);
    assert_eq!(mesh.normals, []);
}

#[test]
fn vertices_are_shared_by_faces_that_agree_on_all_of_them() {
    let head = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\nvn 0 0 1\nvn 0 1 1\n";
    // An object is left and taken up again; only one corner differs.
    let faces = "o a\nf 1/1/1 2/1/1 3/1/1\no b\nf 1 2 3\no a\nf 1/1/1 3/1/1 4/1/1\n\
                 f 1/2/1 3/1/1 4/1/1\n";
    let scene = obj(format!("{head}{faces}")).scene;
    let [a, b] = scene.meshes() else { panic!("{:?}", scene.meshes()) };
    assert_eq!(a.triangles, [[0, 1, 2], [0, 2, 3], [4, 2, 3]]);
    assert_eq!((a.positions.len(), a.uvs.len(), a.normals.len()), (5, 5, 5));
    assert_eq!(a.uvs[4], Vec2::ONE);
    assert_eq!((b.positions.len(), b.uvs.len(), b.normals.len()), (3, 0, 0));

    // Where only some faces have normals, the others are flat.
    let scene = obj(format!("{head}f 1//2 2//2 3//2\nf 1//2 3//2 4\n")).scene;
    let normals: Vec<_> = scene.meshes().iter().map(|mesh| mesh.normals.len()).collect();
    assert_eq!(normals, [3, 0]);
}

#[test]
fn polygons_that_are_not_convex_cover_what_they_enclose() {
    let l: &[[f32; 2]] = &[[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
    let arrow: &[[f32; 2]] = &[[0.0, 0.0], [2.0, -1.0], [0.0, 3.0], [-2.0, -1.0]];
    let inside_l = [[0.5, 0.5], [1.9, 0.9], [0.1, 1.9], [0.9, 1.1], [1.1, 0.9]];
    let outside_l = [[1.1, 1.1], [1.9, 1.9], [1.1, 1.9], [1.4, 1.2]];
    let inside_arrow = [[0.0, 0.1], [1.8, -0.85], [-1.8, -0.85], [0.0, 2.8]];
    let outside_arrow = [[0.0, -0.1], [0.5, -0.5], [-0.5, -0.5], [1.5, -0.9]];
    for (shape, whole, inside, outside) in
        [(l, 3.0, &inside_l[..], &outside_l[..]), (arrow, 6.0, &inside_arrow, &outside_arrow)]
    {
        for first in 0..shape.len() {
            let vertices: String = shape.iter().map(|[x, y]| format!("v {x} {y} 0\n")).collect();
            let order = (0..shape.len()).map(|i| (first + i) % shape.len() + 1);
            let face: String = order.map(|index| format!(" {index}")).collect();
            let scene = obj(format!("{vertices}f{face}\n")).scene;
            assert!((area(&scene.meshes()[0]) / whole - 1.0).abs() < 1e-6, "{face}");
            assert!(scene.triangles().iter().all(|triangle| triangle.normal == Vec3::Z), "{face}");
            for accel in backends(&scene) {
                let is_hit = |[x, y]: &[f32; 2]| {
                    let ray = Ray::new(Vec3::new(*x, *y, 1.0), -Vec3::Z);
                    !accel.closest_hit(&ray).is_miss()
                };
                assert!(inside.iter().all(is_hit), "{face}: a hole");
                assert!(!outside.iter().any(is_hit), "{face}: a bulge");
            }
        }
    }
}

fn backends(scene: &Arc<Scene>) -> Vec<Arc<dyn Intersect>> {
    Backend::ALL.into_iter().filter_map(|backend| build(backend, scene).ok()).collect()
}

/// The green image of a scene by each backend.
fn images(scene: &Arc<Scene>) -> Vec<Vec<f64>> {
    let settings = Settings { radius: 1e-3 * scene.size(), ..settings(16, 16) };
    let image = |accel: Arc<dyn Intersect>| {
        let mut renderer = Renderer::new(scene, &accel, settings.clone()).unwrap();
        for _ in 0..4 {
            assert!(renderer.iterate(Measure::Off).non_finite.is_empty());
        }
        renderer.film().mean().iter().map(|pixel| f64::from(pixel.y)).collect()
    };
    backends(scene).into_iter().map(image).collect()
}

#[test]
fn coordinates_may_be_huge_or_tiny() {
    // A model alone is framed and lit by its size, so it looks the same at any.
    let reference = images(&obj(SQUARE).scene);
    let lit = reference[0].iter().filter(|pixel| **pixel > 0.1).count();
    assert!(lit > 30, "{lit} of 256 pixels are lit");
    for scale in ["1e11", "1e9", "1e-9"] {
        let content = SQUARE.replace("v 1 ", &format!("v {scale} "));
        let content = content.replace(" 1 0\n", &format!(" {scale} 0\n"));
        let all = images(&obj(content).scene);
        assert_eq!(all.len(), reference.len(), "{scale}: a backend refuses it");
        for (image, reference) in all.iter().zip(&reference) {
            let close = |(a, b): &(&f64, &f64)| (*a - *b).abs() < 0.05 * b.abs().max(0.01);
            let agree = image.iter().zip(reference).filter(close).count();
            assert!(agree > 240, "{scale}: {agree} of 256 pixels agree");
        }
    }
    let far = SQUARE.replace("v 1 1 0", "v 1 1e12 0");
    assert_eq!(obj(far).scene.bounds().max.y, 1e12);
    refused(&SQUARE.replace("v 1 1 0", "v 1 1.1e12 0"), "a.obj:3: the vertex has a coordinate");
    refused(&SQUARE.replace("v 1 1 0", "v 1 1e999 0"), "a.obj:3: the vertex has a coordinate");
    refused(&SQUARE.replace("v 1 1 0", "v 1 nan 0"), "a.obj:3: the vertex has a coordinate");
    refused(&SQUARE.replace("v 1 1 0", "v 1 1 0 0"), "a.obj:3: the vertex has a coordinate");
}

#[test]
fn degenerate_faces_go_and_the_rest_stays() {
    let odd = "f 1 1 2\nf 1 2 2 3\nf 4 4 4 4 4\nf 2 3 4\nf 1 2\n";
    let loaded = obj(format!("{}{odd}", SQUARE.replace("f 1 2 3 4\n", "")));
    assert_eq!(corners(&loaded.scene).len(), 3 * 2);
    let notes = loaded.warnings_text();
    assert!(notes.contains("dropped 5 triangles without area"), "{notes}");
    assert!(notes.contains("a.obj: ignored 1 points, lines or curves"), "{notes}");
    for image in images(&loaded.scene) {
        assert!(image.iter().any(|pixel| *pixel > 0.1));
    }
}

#[test]
fn missing_items_are_noted_once_by_name() {
    let content =
        format!("usemtl early\nmtllib no.mtl\n{SQUARE}mtllib no.mtl\nusemtl m\nf 1 2 4\n");
    let loaded = obj(content);
    let notes = loaded.warnings_text();
    assert_eq!(notes.matches("a.obj:2: the material library `no.mtl` does not exist").count(), 1);
    assert_eq!(notes.matches("no.mtl").count(), 1, "{notes}");
    assert_eq!(notes.matches("`early`, `m` undefined; used gray of albedo 0.5").count(), 1);
    assert_eq!(loaded.scene.triangle_count(), 3);

    // A line may name several libraries; those that exist are read.
    let content = format!("mtllib no.mtl a.mtl gone.mtl\nusemtl m\n{SQUARE}");
    let loaded = load_files(&[("a.mtl", b"newmtl m\n"), ("a.obj", content.as_bytes())]).unwrap();
    let notes = loaded.warnings_text();
    assert!(notes.contains("a.obj:1: the material library `no.mtl` does not exist"), "{notes}");
    assert!(notes.contains("a.obj:1: the material library `gone.mtl` does not exist"), "{notes}");
    assert!(!notes.contains("undefined"), "{notes}");

    let mtl =
        "newmtl a\nmap_Kd gone.png\nmap_Ks other.png\nnewmtl b\nmap_Kd gone.png\nnorm my map.png\n";
    let content = format!("usemtl a\n{SQUARE}usemtl b\nf 1 2 4\nmtllib a.mtl\n");
    let loaded = load_files(&[("a.mtl", mtl.as_bytes()), ("a.obj", content.as_bytes())]).unwrap();
    let notes = loaded.warnings_text();
    let missing = "a.mtl: ignored some textures, for there are no files `gone.png`, `my map.png`";
    assert_eq!(notes.matches(missing).count(), 1, "{notes}");
    assert_eq!(notes.matches("gone.png").count(), 1, "{notes}");
    assert!(notes.contains("(of another use) of `a`"), "{notes}");
    // Defined, if only by a library that is named last.
    assert!(!notes.contains("undefined"), "{notes}");
}

#[test]
fn names_hold_spaces_and_stay_until_others_come() {
    let mtl = "newmtl my  red\nKd 0.5 0 0\n";
    let content =
        format!("g  left  leg \nusemtl my  red \nmtllib a lib.mtl\n{SQUARE}o right\nf 1 2 3\n");
    let loaded = load_files(&[("a lib.mtl", mtl.as_bytes()), ("a.obj", content.as_bytes())]);
    let scene = loaded.unwrap_or_else(|e| panic!("{e}")).scene;
    let names: Vec<_> = scene.meshes().iter().map(|mesh| &mesh.name[..]).collect();
    assert_eq!(names, ["left  leg", "right"]);
    assert_eq!(scene.materials().len(), 1);
    assert_eq!(scene.materials()[0].name, "my  red");
    assert_eq!(scene.materials()[0].bsdf.albedo().to_array(), [0.5, 0.0, 0.0]);
}

#[test]
fn the_line_of_an_error_is_right_in_any_dialect() {
    refused("v 0 0 0\r\n\r\nv 0 x 0\r\n", "a.obj:3: `x` is not a number\n  3 | v 0 x 0\n");
    refused("v 0 0 0\r\rv 0 x 0\r", "a.obj:3: `x` is not a number\n  3 | v 0 x 0\n");
    refused("v 0 0 0\n# \\\nf 1 \\\n1 \\\n2\n", "a.obj:3: the face refers to vertex 2");
    // Far into a file of many pieces, and the first of several.
    let many = SQUARE.repeat(20_000);
    let text = format!("{many}f -80001 1 1\nf 0 0 0\n{many}");
    refused(&text, "a.obj:100001: the face refers to vertex -80001, but 80000 are defined");
    assert_eq!(obj(format!("{many}f -80000 -1 2\n")).scene.triangle_count(), 40_001);
}

#[cfg(target_os = "linux")]
#[test]
fn files_larger_than_memory_are_refused_at_once() {
    let folder = TempDir::new().unwrap();
    let path = folder.path().join("a.obj");
    std::fs::File::create(&path).unwrap().set_len(1 << 43).unwrap();
    let error = load(&path).unwrap_err().to_string();
    assert!(
        error.contains("a.obj: reading the file takes about 49152.0 GiB of memory, but"),
        "{error}"
    );
}
