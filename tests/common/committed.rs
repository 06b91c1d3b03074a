//! The scenes of this project, small.

use bdpm::load::load;
use bdpm::scene::Arrangement;
use bdpm::settings::PartialSettings;
use bdpm::{Scene, Settings};
use std::path::Path;
use std::sync::Arc;

/// Pixels across.
const WIDTH: u32 = 16;

/// Scenes whose image a path tracer can make, if necessary without the lights that no ray can hit:
/// it misses their caustics.
pub const TRACED: [&str; 6] =
    ["cornell-box", "keyhole", "materials", "caustic-sphere", "objective", "hall"];

/// Traced scenes that are compared without the lights that no ray can hit.
const LAMPS_ALONE: [&str; 3] = ["materials", "objective", "hall"];

/// A scene with its own settings, but small.
pub fn small(name: &str) -> (Arc<Scene>, Settings) {
    across(name, WIDTH)
}

/// The scene `name` with settings for an image of `pixels` across.
pub fn across(name: &str, pixels: u32) -> (Arc<Scene>, Settings) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    let loaded = load(&path).unwrap();
    let [width, height] = loaded.defaults.resolution.unwrap_or([1, 1]);
    let resolution = Some([pixels, (pixels * height / width).max(1)]);
    let wishes = PartialSettings { resolution, ..PartialSettings::default() };
    let settings = Settings::resolve(&wishes, &loaded.defaults, loaded.scene.size()).unwrap();
    (loaded.scene, settings)
}

/// The scene whose images are compared in place of `scene`, if another one is. It has the same
/// geometry.
pub fn compared(name: &str, scene: &Arc<Scene>) -> Option<Arc<Scene>> {
    LAMPS_ALONE.contains(&name).then(|| {
        let (meshes, placements) = (scene.meshes().to_vec(), scene.placements().to_vec());
        let arrangement = Arrangement { meshes, placements };
        let (name, materials) = (scene.name.clone(), scene.materials().to_vec());
        let (camera, regions) = (scene.camera, scene.regions.clone());
        Scene::new(name, arrangement, materials, Vec::new(), camera, regions).unwrap().into()
    })
}
