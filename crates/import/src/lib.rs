//! Scene files: reading TOML, OBJ, glTF, Mitsuba's XML and pbrt-v4, and writing a scene as a folder
//! of TOML, OBJ and PNG.
//!
//! [`load()`] reads scenes and [`export()`] writes them. No other module knows file formats of
//! scenes.

mod builder;
mod camera_change;
mod curves;
mod default_camera;
mod environment;
mod export;
mod fallback;
mod file_names;
mod gltf;
mod growth;
mod gzip;
mod instances;
mod instancing;
mod lines;
mod lit_check;
mod load;
mod meters;
mod luminaires;
mod mitsuba;
mod mtl;
mod obj;
mod paint;
mod pbrt;
mod ply;
mod scene_file;
mod srgb;
mod summary;
mod text;
mod texture_file;
mod warnings;

pub use camera_change::{CameraChange, LookAt};
pub use environment::{EnvironmentSource, RadianceImage, read_radiance};
pub use export::{Exported, export};
pub use load::{LoadOptions, Loaded, NamedMesh, SCENE_EXTENSIONS, load, load_meshes, load_with};
pub use luminaires::frame as luminaire_frame;
pub use meters::read_meters;
pub use scene_file::render_settings;
pub use summary::{SceneSummary, counted};
pub use warnings::{Warning, WarningKind};
