//! No scene, OBJ or MTL file makes the loader panic or take long: random bytes, and good files with
//! pieces deleted, doubled or replaced. `PROPTEST_CASES=100000` tries far more.

use bdpm::scene::load;
use bdpm::settings::{RenderDefaults, Settings};
use proptest::collection::vec;
use proptest::prelude::*;
use std::time::{Duration, Instant};

const TOML: &str = include_str!("../docs/scene-format.md");
const OBJ: &str = "mtllib a.mtl\no a b\nv -1 0 -1\nv -1 0 1 1\nv 1 0 1 .1 .2 .3\nv 1 0 -1\n\
    vt 0 0\nvn 0 1 0\ng g\nusemtl lamp\nf 1 2 3\nf 1/1/1 \\\n3//1 4/1\nf -4 -3 -2 -1\ns off\nl 1 2\n";
const MTL: &str =
    "newmtl lamp\nKd 0.5 0.5 0.5\nKe 1 1 1\nd 0.5\nmap_Kd -s 1 1 1 x.png\nnewmtl b\nKd 1\n";

/// Text that is likely to matter where it does not belong.
const TOKENS: &[&str] = &[
    "nan",
    "-inf",
    "1e39",
    "1e400",
    "1e-400",
    "-1",
    "0",
    "4294967295",
    "4294967296",
    "-0.0",
    "9223372036854775807",
    "-9223372036854775808",
    "99999999999999999999",
    "1e15",
    "1e-45",
    "/",
    "//",
    "\\\n",
    "\n",
    "\r",
    "\r\n",
    "\0",
    "\u{feff}",
    "é",
    "\u{2028}",
    "#",
    "f",
    "v",
    "o",
    "g",
    "usemtl",
    "mtllib",
    "newmtl",
    "Kd",
    "Ke",
    "[",
    "]",
    "[[",
    "]]",
    "{",
    "}",
    "\"",
    "'''",
    "=",
    ".",
    ",",
    "true",
    "1979-05-27",
    "0x10",
    "camera",
    "mesh",
    "a.obj",
    "a.mtl",
    ".",
    "..",
    "%",
];

#[derive(Clone, Debug)]
enum Change {
    Delete { at: f64, length: usize },
    Double { at: f64, length: usize },
    Byte { at: f64, byte: u8 },
    Insert { at: f64, token: usize },
    ReplaceWord { at: f64, token: usize },
    SwapLines { a: f64, b: f64 },
}

fn change() -> impl Strategy<Value = Change> {
    let at = 0.0..1.0;
    let token = 0..TOKENS.len();
    prop_oneof![
        (at.clone(), 1..40_usize).prop_map(|(at, length)| Change::Delete { at, length }),
        (at.clone(), 1..80_usize).prop_map(|(at, length)| Change::Double { at, length }),
        (at.clone(), any::<u8>()).prop_map(|(at, byte)| Change::Byte { at, byte }),
        (at.clone(), token.clone()).prop_map(|(at, token)| Change::Insert { at, token }),
        (at.clone(), token).prop_map(|(at, token)| Change::ReplaceWord { at, token }),
        (at.clone(), at).prop_map(|(a, b)| Change::SwapLines { a, b }),
    ]
}

fn apply(text: &mut Vec<u8>, change: &Change) {
    let place = |at: f64, count: usize| ((at * count as f64) as usize).min(count.saturating_sub(1));
    if text.is_empty() {
        return;
    }
    let size = text.len();
    match *change {
        Change::Delete { at, length } => {
            let begin = place(at, size);
            text.drain(begin..(begin + length).min(size));
        }
        Change::Double { at, length } => {
            let begin = place(at, size);
            let piece = text[begin..(begin + length).min(size)].to_vec();
            text.splice(begin..begin, piece);
        }
        Change::Byte { at, byte } => text[place(at, size)] = byte,
        Change::Insert { at, token } => {
            let begin = place(at, size);
            text.splice(begin..begin, TOKENS[token].bytes());
        }
        Change::ReplaceWord { at, token } => {
            let middle = place(at, size);
            let is_space = |byte: &u8| byte.is_ascii_whitespace() || b",[]".contains(byte);
            let begin = text[..middle].iter().rposition(is_space).map_or(0, |i| i + 1);
            let end = text[middle..].iter().position(is_space).map_or(size, |i| i + middle);
            text.splice(begin..end.max(begin), TOKENS[token].bytes());
        }
        Change::SwapLines { a, b } => {
            let mut lines: Vec<Vec<u8>> =
                text.split(|byte| *byte == b'\n').map(<[u8]>::to_vec).collect();
            let (a, b) = (place(a, lines.len()), place(b, lines.len()));
            lines.swap(a, b);
            *text = lines.join(&b'\n');
        }
    }
}

fn example() -> &'static str {
    TOML.split("```toml\n").nth(1).unwrap().split("```").next().unwrap()
}

/// Loads `name` from a folder of the four files, of which some were tampered with. What loads must
/// be fit for rendering; what does not must say why.
fn check(scene: &[u8], obj: &[u8], mtl: &[u8], name: &str) {
    let folder = tempfile::tempdir().unwrap();
    let files = [("scene.toml", scene), ("a.obj", obj), ("floor.obj", obj), ("block.obj", obj)];
    for (file, content) in files.into_iter().chain([("a.mtl", mtl)]) {
        std::fs::write(folder.path().join(file), content).unwrap();
    }
    let start = Instant::now();
    match load(&folder.path().join(name)) {
        Ok(loaded) => {
            let scene = &loaded.scene;
            assert!(scene.triangle_count() > 0 && scene.lights.power().is_finite());
            assert!(!scene.lights.is_empty());
            for triangle in scene.triangles() {
                assert!((triangle.normal.length() - 1.0).abs() < 1e-5, "{triangle:?}");
                assert!(triangle.area() > 0.0 && triangle.area().is_finite(), "{triangle:?}");
            }
            for mesh in &scene.meshes {
                let count = mesh.positions.len();
                assert!(mesh.triangles.iter().flatten().all(|i| (*i as usize) < count));
                assert!((mesh.material as usize) < scene.materials.len());
            }
            for material in &scene.materials {
                let albedo = material.bsdf.albedo();
                assert!(albedo.min_element() >= 0.0 && albedo.max_element() <= 1.0);
            }
            // A radius may still be unfit for the scene's size, but must say so.
            if let Err(e) =
                Settings::resolve(&RenderDefaults::default(), &loaded.defaults, scene.size())
            {
                assert!(e.to_string().contains("radius"), "{e}");
            }
        }
        Err(error) => {
            let text = error.to_string();
            assert!(text.contains("\nhelp: ") && text.len() < 5000, "{text}");
        }
    }
    assert!(start.elapsed() < Duration::from_secs(5), "took {:?}", start.elapsed());
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: std::env::var("PROPTEST_CASES").ok().and_then(|n| n.parse().ok()).unwrap_or(1500),
        failure_persistence: None,
        ..ProptestConfig::default()
    })]

    #[test]
    fn random_bytes(bytes in vec(any::<u8>(), 0..300)) {
        check(&bytes, OBJ.as_bytes(), MTL.as_bytes(), "scene.toml");
        check(b"", &bytes, &bytes, "a.obj");
        check(b"", OBJ.as_bytes(), &bytes, "a.obj");
    }

    #[test]
    fn random_tokens(tokens in vec(0..TOKENS.len(), 0..60)) {
        let text = tokens.iter().map(|i| TOKENS[*i]).collect::<Vec<_>>().join(" ");
        check(text.as_bytes(), OBJ.as_bytes(), MTL.as_bytes(), "scene.toml");
        check(b"", text.as_bytes(), MTL.as_bytes(), "a.obj");
        check(b"", OBJ.as_bytes(), text.as_bytes(), "a.obj");
    }

    #[test]
    fn changed_scene_files(changes in vec(change(), 1..6)) {
        let mut scene = example().as_bytes().to_vec();
        changes.iter().for_each(|change| apply(&mut scene, change));
        check(&scene, OBJ.as_bytes(), MTL.as_bytes(), "scene.toml");
    }

    #[test]
    fn changed_models(changes in vec(change(), 1..6)) {
        let mut obj = OBJ.as_bytes().to_vec();
        changes.iter().for_each(|change| apply(&mut obj, change));
        check(b"", &obj, MTL.as_bytes(), "a.obj");
    }

    #[test]
    fn changed_material_libraries(changes in vec(change(), 1..6)) {
        let mut mtl = MTL.as_bytes().to_vec();
        changes.iter().for_each(|change| apply(&mut mtl, change));
        check(b"", OBJ.as_bytes(), &mtl, "a.obj");
    }
}

/// The mutations above start from files that load; otherwise they would test nothing but refusal.
#[test]
fn the_untouched_files_load() {
    let folder = tempfile::tempdir().unwrap();
    for (file, content) in [
        ("scene.toml", example()),
        ("a.obj", OBJ),
        ("floor.obj", OBJ),
        ("block.obj", OBJ),
        ("a.mtl", MTL),
    ] {
        std::fs::write(folder.path().join(file), content).unwrap();
    }
    load(folder.path()).unwrap_or_else(|e| panic!("{e}"));
    let loaded = load(&folder.path().join("a.obj")).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(loaded.scene.triangle_count(), 4);
}
