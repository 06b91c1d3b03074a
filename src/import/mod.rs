//! Scene files: reading TOML, OBJ, glTF and Mitsuba's XML, and writing a scene as a folder of TOML,
//! OBJ and PNG.
//!
//! [`load()`] reads scenes and [`export()`] writes them. No other module knows file formats of
//! scenes.

mod builder;
mod default_camera;
mod environment;
mod export;
mod fallback;
mod gltf;
mod instances;
mod instancing;
mod lines;
mod lit_check;
mod load;
mod mitsuba;
mod mtl;
mod obj;
mod ply;
mod scene_file;
mod sky;
mod srgb;
mod summary;
mod text;
mod texture_file;
mod warnings;

pub use environment::EnvironmentSource;
pub use export::{Exported, export};
pub use load::{LoadOptions, Loaded, NamedMesh, SCENE_EXTENSIONS, load, load_meshes, load_with};
pub use scene_file::render_settings;
pub use summary::{SceneSummary, counted};
pub use warnings::{Warning, WarningKind};
