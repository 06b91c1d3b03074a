//! A short summary of a scene file.

use bdpm_core::scene::{Material, Scene};
use bdpm_import::FileNames;
use serde::Serialize;
use std::fmt;

/// Contents of a scene file.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SceneSummary {
    /// Number of meshes, one for each placement, material and part of a mesh in the file.
    pub meshes: usize,
    /// Number of triangles that have an area.
    pub triangles: usize,
    /// Names of the materials in use.
    pub materials: Vec<String>,
    /// Names of the dispersive materials.
    pub dispersive_materials: Vec<String>,
    /// Names of the media.
    pub media: Vec<String>,
    /// Number of pictures that they use, however they are sampled.
    pub textures: usize,
    /// Number of light sources. Each emissive triangle is one.
    pub lights: usize,
    /// Names of the lights, if the format has names for them.
    pub light_names: Vec<String>,
    /// Names of all cameras to choose from.
    pub cameras: Vec<String>,
    /// Name of the chosen camera.
    pub camera: Option<String>,
}

impl SceneSummary {
    pub(super) fn new(scene: &Scene, names: FileNames) -> Self {
        let materials = scene.materials().iter();
        let mut pictures: Vec<_> = materials
            .flat_map(Material::textures)
            .map(|texture| texture.texels().as_ptr())
            .collect();
        pictures.sort_unstable();
        pictures.dedup();
        let environment = usize::from(scene.lights().environment().is_some());
        Self {
            meshes: scene.placements().len(),
            triangles: scene.triangle_count(),
            materials: scene.materials().iter().map(|material| material.name.clone()).collect(),
            dispersive_materials: scene
                .materials()
                .iter()
                .filter(|material| material.dispersion.is_some())
                .map(|material| material.name.clone())
                .collect(),
            media: scene.media().map_or(Vec::new(), |media| {
                media.media().iter().map(|medium| medium.name.clone()).collect()
            }),
            textures: pictures.len(),
            lights: scene.lights().emitters().len() + environment,
            light_names: names.lights,
            cameras: names.cameras,
            camera: names.camera,
        }
    }
}

/// One line, such as `2 meshes of 24 triangles, 1 material, 0 textures, 1 light, camera Front (of
/// 3)`.
impl fmt::Display for SceneSummary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} of {}, {}, {}, {}",
            counted(self.meshes, "mesh"),
            counted(self.triangles, "triangle"),
            counted(self.materials.len(), "material"),
            counted(self.textures, "texture"),
            counted(self.lights, "light"),
        )?;
        match (&self.camera, self.cameras.len()) {
            (Some(name), 1) => write!(f, ", camera {name}"),
            (Some(name), count) => write!(f, ", camera {name} (of {count})"),
            (None, _) => Ok(()),
        }
    }
}

/// A number with its noun.
pub fn counted(count: usize, noun: &str) -> String {
    match (count, noun) {
        (1, noun) => format!("1 {noun}"),
        (count, "mesh") => format!("{count} meshes"),
        (count, noun) => format!("{count} {noun}s"),
    }
}
