//! No scene, OBJ or MTL file makes the loader panic or hold more than its size warrants: random
//! bytes, and good files with pieces deleted, doubled or replaced. `PROPTEST_CASES=100000` tries
//! far more.

use crate::common::mutate::{TOKENS, apply, change, fuzz_config, load_and_check, seeded_config};
use bdpm::load::load;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;

const TOML: &str = include_str!("../../docs/reference/scene-format.md");
const OBJ: &str = "mtllib a.mtl\no a b\nv -1 0 -1\nv -1 0 1 1\nv 1 0 1 .1 .2 .3\nv 1 0 -1\n\
    vt 0 0\nvn 0 1 0\ng g\nusemtl lamp\nf 1 2 3\nf 1/1/1 \\\n3//1 4/1\nf -4 -3 -2 -1\ns off\nl 1 2\n";
const MTL: &str =
    "newmtl lamp\nKd 0.5 0.5 0.5\nKe 1 1 1\nd 0.5\nmap_Kd -s 1 1 1 x.png\nnewmtl b\nKd 1\n";

fn example() -> &'static str {
    TOML.split("```toml\n").nth(1).unwrap().split("```").next().unwrap()
}

/// Loads `name` from a folder of the four files after some were tampered with.
fn check(scene: &[u8], obj: &[u8], mtl: &[u8], name: &str) {
    let folder = tempfile::tempdir().unwrap();
    let files = [("scene.toml", scene), ("a.obj", obj), ("floor.obj", obj), ("block.obj", obj)];
    for (file, content) in files.into_iter().chain([("a.mtl", mtl)]) {
        std::fs::write(folder.path().join(file), content).unwrap();
    }
    load_and_check(&folder.path().join(name));
}

proptest! {
    #![proptest_config(fuzz_config(1500))]

    #[test]
    fn files_of_random_bytes_load_or_are_refused(bytes in vec(any::<u8>(), 0..300)) {
        check(&bytes, OBJ.as_bytes(), MTL.as_bytes(), "scene.toml");
        check(b"", &bytes, &bytes, "a.obj");
        check(b"", OBJ.as_bytes(), &bytes, "a.obj");
    }

    #[test]
    fn files_of_random_tokens_load_or_are_refused(tokens in vec(0..TOKENS.len(), 0..60)) {
        let text = tokens.iter().map(|i| TOKENS[*i]).collect::<Vec<_>>().join(" ");
        check(text.as_bytes(), OBJ.as_bytes(), MTL.as_bytes(), "scene.toml");
        check(b"", text.as_bytes(), MTL.as_bytes(), "a.obj");
        check(b"", OBJ.as_bytes(), text.as_bytes(), "a.obj");
    }

    #[test]
    fn changed_scene_files_load_or_are_refused(changes in vec(change(), 1..6)) {
        let mut scene = example().as_bytes().to_vec();
        changes.iter().for_each(|change| apply(&mut scene, change));
        check(&scene, OBJ.as_bytes(), MTL.as_bytes(), "scene.toml");
    }

    #[test]
    fn changed_models_load_or_are_refused(changes in vec(change(), 1..6)) {
        let mut obj = OBJ.as_bytes().to_vec();
        changes.iter().for_each(|change| apply(&mut obj, change));
        check(b"", &obj, MTL.as_bytes(), "a.obj");
    }

    #[test]
    fn changed_material_libraries_load_or_are_refused(changes in vec(change(), 1..6)) {
        let mut mtl = MTL.as_bytes().to_vec();
        changes.iter().for_each(|change| apply(&mut mtl, change));
        check(b"", OBJ.as_bytes(), &mtl, "a.obj");
    }
}

/// The mutations above start from files that load; otherwise they would test nothing but refusal.
#[test]
fn unmodified_files_load() {
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
    let loaded = load(folder.path().join("a.obj")).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(loaded.scene.triangle_count(), 4);
}

#[test]
fn a_seed_repeats_the_cases() {
    let cases = |seed| {
        let mut runner = TestRunner::new(seeded_config(1, seed));
        let change = |_| format!("{:?}", change().new_tree(&mut runner).unwrap().current());
        (0..5).map(change).collect::<Vec<_>>()
    };
    assert_eq!(cases(3), cases(3));
    assert_ne!(cases(3), cases(4));
}
