#![doc = include_str!("../README.md")]

// In the order of the stages: no module names one that comes after it (tests/stages.rs).
pub mod base;
#[doc(hidden)] // what tests and benches measure
pub mod lanes;
pub mod accel;
pub mod bsdf;
pub mod pictures;
pub mod settings;
pub mod scene;
pub mod import;
pub mod image;
#[doc(hidden)] // what tests and benches measure
pub mod transport;
pub mod noise;
pub mod render;
pub mod timing;
pub mod optimize;
pub mod steer;
pub mod denoise;
pub mod files;
#[doc(hidden)] // the program's own
pub mod ranks;
#[cfg(feature = "cli")]
#[doc(hidden)] // the program's own
pub mod page;
#[cfg(feature = "cli")]
#[doc(hidden)] // the program's own
pub mod reproduce;

pub use base::error::{Error, Result};
pub use render::Renderer;
pub use scene::Scene;
pub use settings::Settings;
