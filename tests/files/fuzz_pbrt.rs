//! No file of pbrt's, and no mesh that it names, makes the loader panic: good ones with pieces
//! deleted, doubled or replaced. `PROPTEST_CASES=100000` tries far more.

use crate::common::mutate::{apply, change, fuzz_config, load_soundly};
use proptest::collection::vec;
use proptest::prelude::*;

const SCENE: &[u8] = include_bytes!("../data/pbrt/box.pbrt");
const SHAPES: &[u8] = include_bytes!("../data/pbrt/shapes.pbrt");
const PLY: &[u8] = include_bytes!("../data/pbrt/hill.ply.gz");
const COLORS: &[u8] = include_bytes!("../data/pbrt/colors.png");

/// Loads a scene of these files: it must be fit for rendering, or refused with advice.
fn check(scene: &[u8], shapes: &[u8], ply: &[u8]) {
    let folder = tempfile::tempdir().unwrap();
    let files =
        [("a.pbrt", scene), ("shapes.pbrt", shapes), ("hill.ply.gz", ply), ("colors.png", COLORS)];
    for (name, content) in files {
        std::fs::write(folder.path().join(name), content).unwrap();
    }
    load_soundly(&folder.path().join("a.pbrt"));
}

proptest! {
    #![proptest_config(fuzz_config(400))]

    #[test]
    fn changed_scenes_load_or_are_refused(changes in vec(change(), 1..6)) {
        let mut scene = SCENE.to_vec();
        changes.iter().for_each(|change| apply(&mut scene, change));
        check(&scene, SHAPES, PLY);
    }

    #[test]
    fn changed_included_files_load_or_are_refused(changes in vec(change(), 1..6)) {
        let mut shapes = SHAPES.to_vec();
        changes.iter().for_each(|change| apply(&mut shapes, change));
        check(SCENE, &shapes, PLY);
    }

    #[test]
    fn changed_meshes_load_or_are_refused(changes in vec(change(), 1..6)) {
        let mut ply = PLY.to_vec();
        changes.iter().for_each(|change| apply(&mut ply, change));
        check(SCENE, SHAPES, &ply);
    }
}
