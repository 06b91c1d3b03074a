//! Scene files: reading TOML, OBJ, glTF and Mitsuba's XML, and writing a scene as a folder of TOML, OBJ and PNG.
//!
//! [`load()`] is the way in and [`save()`] the way out; nothing else knows what a file looks like.

mod arrange;
mod builder;
mod environment;
mod fallback;
mod framing;
mod glance;
mod gltf;
mod lines;
mod load;
mod mitsuba;
mod mtl;
mod notes;
mod obj;
mod places;
mod ply;
mod save;
mod scene_file;
mod srgb;
mod summary;
mod text;
mod texture_file;

pub use environment::EnvironmentSource;
pub use load::{LoadOptions, Loaded, load, load_with};
pub use notes::{Note, NoteKind};
pub use save::{Saved, save};
pub use summary::{SceneSummary, counted};
