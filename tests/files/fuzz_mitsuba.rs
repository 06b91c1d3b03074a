//! No file of Mitsuba's, and no mesh that it names, makes the loader panic: good ones with pieces
//! deleted, doubled or replaced. `PROPTEST_CASES=100000` tries far more.

use crate::common::mutate::{apply, change, fuzz_config, load_soundly};
use bdpm::load::load;
use proptest::collection::vec;
use proptest::prelude::*;
use std::path::Path;

const MESHES: &[u8] = include_bytes!("../data/mitsuba/meshes.xml");
const TEXTURES: &[u8] = include_bytes!("../data/mitsuba/textures.xml");
const MASK: &[u8] = include_bytes!("../data/mitsuba/mask.xml");
const SPECTRA: &[u8] = include_bytes!("../data/mitsuba/spectra.xml");
const TRANSFORMS: &[u8] = include_bytes!("../data/mitsuba/transforms.xml");
const LIGHTS: &[u8] = include_bytes!("../data/mitsuba/area.xml");
const INSTANCES: &[u8] = include_bytes!("../data/mitsuba/instances.xml");
const METALS: &[u8] = include_bytes!("../data/mitsuba/roughconductor-ggx.xml");
const OLD: &[u8] = include_bytes!("../data/mitsuba/old.xml");
const SCENES: [&[u8]; 9] =
    [MESHES, TEXTURES, MASK, SPECTRA, TRANSFORMS, LIGHTS, INSTANCES, METALS, OLD];
const PLY: &[u8] = include_bytes!("../data/mitsuba/hill.ply");
const SERIALIZED: &[u8] = include_bytes!("../data/mitsuba/two.serialized");
const BASE: &[u8] = include_bytes!("../data/mitsuba/base.xml");

/// Loads a scene beside these meshes: it must be fit for rendering, or refused with advice.
fn check(scene: &[u8], base: &[u8], ply: &[u8], serialized: &[u8]) {
    let folder = tempfile::tempdir().unwrap();
    let obj = include_bytes!("../data/mitsuba/pyramid.obj");
    let colors = include_bytes!("../data/mitsuba/colors.png");
    let opacity = include_bytes!("../data/mitsuba/opacity.png");
    let files: [(&str, &[u8]); 7] = [
        ("a.xml", scene),
        ("base.xml", base),
        ("hill.ply", ply),
        ("two.serialized", serialized),
        ("pyramid.obj", obj),
        ("colors.png", colors),
        ("opacity.png", opacity),
    ];
    for (name, content) in files {
        std::fs::write(folder.path().join(name), content).unwrap();
    }
    load_soundly(&folder.path().join("a.xml"));
}

proptest! {
    #![proptest_config(fuzz_config(400))]

    #[test]
    fn changed_scenes_load_or_are_refused(which in 0..SCENES.len(), changes in vec(change(), 1..6)) {
        let mut scene = SCENES[which].to_vec();
        changes.iter().for_each(|change| apply(&mut scene, change));
        check(&scene, BASE, PLY, SERIALIZED);
    }

    #[test]
    fn changed_included_files_load_or_are_refused(changes in vec(change(), 1..6)) {
        let mut base = BASE.to_vec();
        changes.iter().for_each(|change| apply(&mut base, change));
        check(LIGHTS, &base, PLY, SERIALIZED);
    }

    #[test]
    fn changed_meshes_load_or_are_refused(changes in vec(change(), 1..6)) {
        let (mut ply, mut serialized) = (PLY.to_vec(), SERIALIZED.to_vec());
        changes.iter().for_each(|change| apply(&mut ply, change));
        changes.iter().for_each(|change| apply(&mut serialized, change));
        check(MESHES, BASE, &ply, SERIALIZED);
        check(MESHES, BASE, PLY, &serialized);
    }
}

/// The mutations above start from files that load; otherwise they would test nothing but refusal.
#[test]
fn unmodified_files_load() {
    for scene in SCENES {
        let folder = tempfile::tempdir().unwrap();
        let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/mitsuba");
        for entry in std::fs::read_dir(data).unwrap() {
            let path = entry.unwrap().path();
            std::fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
        }
        let path = folder.path().join("a.xml");
        std::fs::write(&path, scene).unwrap();
        load(&path).unwrap_or_else(|e| panic!("{e}"));
    }
}
