#![doc = include_str!("../README.md")]

// In the order of the stages: no module names one that comes after it (tests/stages.rs).
pub mod accel;
pub mod base;
pub mod bsdf;
pub mod files;
pub mod image;
pub mod import;
#[doc(hidden)] // what tests and benches measure
pub mod lanes;
pub mod noise;
pub mod optimize;
pub mod pictures;
pub mod render;
#[cfg(feature = "cli")]
#[doc(hidden)] // the program's own
pub mod reproduce;
pub mod scene;
pub mod settings;
pub mod steer;
pub mod timing;
#[doc(hidden)] // what tests and benches measure
pub mod transport;

pub use base::error::{Error, Result};
pub use render::Renderer;
pub use scene::Scene;
pub use settings::Settings;
