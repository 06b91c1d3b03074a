//! Files that were tampered with: random changes of bytes, and what must hold after loading.

use bdpm::load::{Loaded, load};
use bdpm::scene::Mesh;
use bdpm::settings::{PartialSettings, Settings};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use std::hash::{BuildHasher, RandomState};
use std::path::Path;

/// Text that is likely to matter where it does not belong.
pub const TOKENS: &[&str] = &[
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
    "1e12",
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

/// The settings of a fuzz test of so many cases, or `PROPTEST_CASES`. Prints the seed, which a
/// failure shows.
pub fn fuzz_config(cases: u32) -> ProptestConfig {
    let given = |name: &str| std::env::var(name).ok().and_then(|text| text.parse::<u64>().ok());
    let random = || RandomState::new().hash_one(0);
    let seed = given("PROPTEST_RNG_SEED").unwrap_or_else(random);
    let cases = given("PROPTEST_CASES").map_or(cases, |cases| cases as u32);
    println!("PROPTEST_RNG_SEED={seed} PROPTEST_CASES={cases} repeats this test");
    seeded_config(cases, seed)
}

/// The settings of a fuzz test with this seed.
pub fn seeded_config(cases: u32, seed: u64) -> ProptestConfig {
    let rng_seed = RngSeed::Fixed(seed);
    ProptestConfig { cases, rng_seed, failure_persistence: None, ..ProptestConfig::default() }
}

#[derive(Clone, Debug)]
pub enum Change {
    Delete { at: f64, length: usize },
    Double { at: f64, length: usize },
    Byte { at: f64, byte: u8 },
    Insert { at: f64, token: usize },
    ReplaceWord { at: f64, token: usize },
    SwapLines { a: f64, b: f64 },
}

pub fn change() -> impl Strategy<Value = Change> {
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

pub fn apply(text: &mut Vec<u8>, change: &Change) {
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

/// Most vertices and triangles that a scene may hold for each byte of its files: far more than any
/// of these has, and far fewer than a number in a file can name.
const MOST_PER_BYTE: usize = 4;

/// Bytes of all files beside this one, or in this folder.
fn size_of_files(path: &Path) -> usize {
    let folder = if path.is_dir() { path } else { path.parent().unwrap() };
    let files = std::fs::read_dir(folder).unwrap();
    files.map(|file| file.unwrap().metadata().unwrap().len() as usize).sum()
}

/// Loads a file. A scene must have triangles, light and possible materials, an error must name its
/// cause and a remedy.
pub fn load_soundly(path: &Path) -> Option<Loaded> {
    match load(path) {
        Ok(loaded) => {
            let scene = &loaded.scene;
            assert!(scene.triangle_count() > 0 && scene.lights().power().is_finite());
            for triangle in scene.triangles() {
                assert!((triangle.normal.length() - 1.0).abs() < 1e-5, "{triangle:?}");
            }
            for material in scene.materials() {
                let albedo = material.bsdf.albedo();
                assert!(albedo.min_element() >= 0.0 && albedo.max_element() <= 1.0, "{material:?}");
            }
            Some(loaded)
        }
        Err(error) => {
            let text = error.to_string();
            assert!(text.contains("\nhelp: ") && text.len() < 5000, "{text}");
            None
        }
    }
}

/// Loads a file soundly. A scene must also be fit for rendering and as small as its files.
pub fn load_and_check(path: &Path) {
    let Some(loaded) = load_soundly(path) else { return };
    let scene = &loaded.scene;
    assert!(!scene.lights().is_empty());
    for triangle in scene.triangles() {
        assert!(triangle.area() > 0.0 && triangle.area().is_finite(), "{triangle:?}");
    }
    let held = |mesh: &Mesh| mesh.positions.len() + mesh.triangles.len();
    let held: usize = scene.meshes().iter().map(held).sum();
    let bytes = size_of_files(path);
    assert!(held <= MOST_PER_BYTE * bytes, "{held} vertices and triangles of {bytes} bytes");
    for mesh in scene.meshes() {
        let count = mesh.positions.len();
        assert!(mesh.triangles.iter().flatten().all(|i| (*i as usize) < count));
        assert!((mesh.material as usize) < scene.materials().len());
    }
    // A radius may still be unfit for the scene's size, but must say so.
    if let Err(e) = Settings::resolve(&PartialSettings::default(), &loaded.defaults, scene.size()) {
        assert!(e.to_string().contains("radius"), "{e}");
    }
}
