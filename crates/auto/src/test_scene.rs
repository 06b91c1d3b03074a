//! Scenes for the tests of this crate.

use bdpm_core::accel::Intersect;
use bdpm_core::render::Renderer;
use bdpm_core::scene::Scene;
use bdpm_core::scene::backend::{Backend, build};
use bdpm_core::settings::Settings;
use std::path::Path;
use std::sync::Arc;

/// A scene that is ready to render, with the settings of its file.
pub struct TestScene {
    scene: Arc<Scene>,
    accel: Arc<dyn Intersect>,
    pub settings: Settings,
}

impl TestScene {
    /// The scene of this name in `scenes/`, or of this path, in an image of so many pixels.
    pub fn new(name: impl AsRef<Path>, [width, height]: [u32; 2]) -> Self {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../scenes");
        let loaded = bdpm_load::load(Path::new(folder).join(name)).unwrap();
        let own = Settings::resolve(&Default::default(), &loaded.defaults, loaded.scene.size());
        let settings = Settings { width, height, ..own.unwrap() };
        let accel = build(Backend::Bvh, &loaded.scene).unwrap();
        Self { scene: loaded.scene, accel, settings }
    }

    /// A renderer of the scene with these settings.
    pub fn renderer(&self, settings: &Settings) -> Renderer {
        Renderer::new(&self.scene, &self.accel, settings.clone()).unwrap()
    }
}
