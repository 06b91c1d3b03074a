//! Scene files: readers of TOML, OBJ, glTF, Mitsuba's XML, pbrt-v4 and Radiance, and a writer of a
//! scene as a folder of TOML, OBJ and PNG.
//!
//! A reader (`read`) fills a `builder` with meshes, materials and lights. What several formats have
//! is written once: `look` (materials), `spectrum`, `shape`, `light`, `sensor`, `sky` and
//! `warnings`. Readers do not know each other, except for mesh files, which several formats refer
//! to. No reader traces rays: the crate above, `load`, adds what rays decide. No other crate knows
//! file formats of scenes.

mod builder;
mod environment;
mod excerpts;
mod far;
mod file_names;
mod growth;
mod gzip;
mod hdr;
mod light;
mod lines;
mod look;
mod luminaires;
mod read;
mod sensor;
mod shape;
mod spectrum;
mod srgb;
mod text;
mod warnings;
mod whole_view;
mod write;

pub use builder::{FileNames, Imported};
pub use environment::{EnvironmentSource, RadianceImage, read_radiance};
pub use luminaires::frame as luminaire_frame;
pub use read::{
    ImportOptions, NamedMesh, SCENE_EXTENSIONS, camera_of, parse_meters, read, read_meshes,
    read_meters, render_settings,
};
pub use text::problems;
pub use warnings::{Warning, WarningKind};
pub use whole_view::WHOLE_VIEW_DEGREES;
pub use write::{Exported, export_scene};
