//! The scene and data that benches of single phases work on.
#![allow(dead_code)] // each bench takes its part

#[path = "../../tests/common/shapes.rs"]
mod shapes;

use bdpm::base::math::Rgb;
use bdpm::load::load;
use bdpm::scene::bsdf::Bsdf;
use bdpm::scene::{Camera, Emitter, FieldOfView, Material, Mesh};
use bdpm::settings::{Length, PartialSettings};
use bdpm::transport::camera_paths::{CameraPass, CameraPathId, CameraPaths};
use bdpm::{Scene, Settings};
use glam::Vec3;
use std::path::Path;
use std::sync::Arc;

/// The scene that `BDPM_SCENE` names, `scenes/cornell-box` without it, and settings for a small
/// image of it. `ball` is a bumpy ball of 717,600 triangles in a room.
pub fn scene() -> (Arc<Scene>, Settings) {
    let path = std::env::var("BDPM_SCENE").unwrap_or_else(|_| "scenes/cornell-box".into());
    let (scene, defaults) = if path == "ball" {
        (
            ball(),
            PartialSettings { radius: Some(Length::Units(0.02)), ..PartialSettings::default() },
        )
    } else {
        let loaded = load(Path::new(&path)).unwrap();
        (loaded.scene, loaded.defaults)
    };
    let mut settings = Settings::resolve(&Default::default(), &defaults, scene.size()).unwrap();
    (settings.width, settings.height, settings.camera_paths) = (64, 64, 25);
    (scene, settings)
}

/// A ball in a room with a point light, all of them white.
fn ball() -> Arc<Scene> {
    let mesh = |name: &str, shapes::Mesh { positions, triangles }| {
        let name = name.to_owned();
        Mesh { name, positions, triangles, ..Mesh::default() }
    };
    let walls = mesh("room", shapes::Mesh::cuboid(Vec3::ZERO, Vec3::splat(1.5), 0.0));
    let ball = mesh("ball", shapes::Mesh::bumpy_ball(600));
    let white = Material::new("white", Bsdf::diffuse(Rgb::splat(0.7)));
    let light = Emitter::Point { position: Vec3::new(-1.0, -1.2, 1.3), intensity: Rgb::splat(1.0) };
    let eye = Vec3::new(-1.4, -1.4, 0.3);
    let camera = Camera::look(eye, -eye, Vec3::Z, FieldOfView::X(70.0)).unwrap();
    Scene::new("ball".into(), vec![walls, ball], vec![white], vec![light], camera, vec![])
        .unwrap()
        .into()
}

/// The camera paths of the image, batch after batch.
pub fn camera_phase(
    pass: &CameraPass,
    paths: &mut CameraPaths,
    mut each: impl FnMut(&CameraPaths),
) {
    let mut ids = ids(pass.settings);
    while ids.next.y < pass.settings.height {
        paths.clear();
        paths.trace(pass, ids.by_ref().take(CameraPaths::BATCH));
        each(paths);
    }
}

/// The camera paths of an image.
pub fn ids(settings: &Settings) -> Ids<'_> {
    Ids { settings, next: CameraPathId { x: 0, y: 0, index: 0 } }
}

/// The camera paths of an image, pixel after pixel.
pub struct Ids<'a> {
    settings: &'a Settings,
    next: CameraPathId,
}

impl Iterator for Ids<'_> {
    type Item = CameraPathId;

    #[inline]
    fn next(&mut self) -> Option<CameraPathId> {
        let Settings { width, height, camera_paths, .. } = *self.settings;
        let Self { next: CameraPathId { x, y, index }, .. } = self;
        let id = CameraPathId { x: *x, y: *y, index: *index };
        *index += 1;
        if *index == camera_paths {
            (*index, *x) = (0, *x + 1);
        }
        if *x == width {
            (*x, *y) = (0, *y + 1);
        }
        (id.y < height).then_some(id)
    }
}
