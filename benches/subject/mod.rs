//! What the benches of single phases work on.
#![allow(dead_code)] // each bench takes its part

use bdpm::camera_paths::{CameraPass, CameraPathId, CameraPaths};
use bdpm::math::Rgb;
use bdpm::merge::PairVisitor;
use bdpm::scene::load;
use bdpm::{Scene, Settings};
use std::path::Path;

/// Camera paths per batch, as the renderer takes them.
pub const BATCH: u32 = 2048;

/// The scene that `BDPM_SCENE` names, `scenes/cornell-box` without it, and settings for a small
/// image of it.
pub fn scene() -> (Scene, Settings) {
    let path = std::env::var("BDPM_SCENE").unwrap_or_else(|_| "scenes/cornell-box".into());
    let loaded = load(Path::new(&path)).unwrap();
    let mut settings =
        Settings::resolve(&Default::default(), &loaded.defaults, loaded.scene.size()).unwrap();
    (settings.width, settings.height, settings.camera_paths) = (64, 64, 25);
    (loaded.scene, settings)
}

/// The camera paths of the image, batch after batch.
pub fn camera_phase(
    pass: &CameraPass,
    paths: &mut CameraPaths,
    mut each: impl FnMut(&CameraPaths),
) {
    let Settings { width, height, camera_paths, .. } = *pass.settings;
    let all = width * height * camera_paths;
    for first in (0..all).step_by(BATCH as usize) {
        let ids = (first..all.min(first + BATCH)).map(|path| {
            let pixel = path / camera_paths;
            CameraPathId { x: pixel % width, y: pixel / width, index: path % camera_paths }
        });
        paths.trace(pass, ids);
        each(paths);
    }
}

/// Adds up all pairs.
#[derive(Default)]
pub struct Sum {
    pub light: Rgb,
    pub pairs: u64,
}

impl PairVisitor for Sum {
    #[inline]
    fn pair(&mut self, _: u32, contribution: Rgb, _: bool) {
        self.light += contribution;
        self.pairs += 1;
    }

    #[inline]
    fn end_path(&mut self, _: Rgb) {}
}
