//! Scene files: reading TOML, OBJ, glTF and Mitsuba's XML, and writing a scene as a folder of TOML, OBJ and PNG.
//!
//! [`load()`] is the way in and [`save()`] the way out; nothing else knows what a file looks like.

mod instancing;
mod builder;
mod environment;
mod fallback;
mod default_camera;
mod lit_check;
mod gltf;
mod lines;
mod load;
mod mitsuba;
mod mtl;
mod warnings;
mod obj;
mod instances;
mod ply;
mod export;
mod scene_file;
mod srgb;
mod summary;
mod text;
mod texture_file;

pub use environment::EnvironmentSource;
pub use export::{Saved, save};
pub use load::{LoadOptions, Loaded, load, load_with};
pub use summary::{SceneSummary, counted};
pub use warnings::{Warning, WarningKind};
