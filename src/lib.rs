#![doc = include_str!("../README.md")]

// In the order of the stages: no module names one that comes after it (tests/stages).
pub mod base;
#[doc(hidden)] // public for tests and benches
pub mod simd;
pub mod accel;
pub mod image_io;
pub mod settings;
pub mod scene;
pub mod import;
pub mod film;
#[doc(hidden)] // public for tests and benches
pub mod transport;
pub mod noise;
pub mod render;
pub mod timing;
pub mod adaptive;
pub mod output;
#[doc(hidden)] // public for the program
pub mod mpi;
pub mod job;
pub mod measurement;
pub mod judge;
#[cfg(feature = "cli")]
#[doc(hidden)] // public for the program
pub mod paper;

pub use adaptive::stopping::Stop;
pub use base::error::{Error, Result};
pub use import::load;
pub use job::{Event, RenderJob, RenderResult};
pub use measurement::{MeasureJob, Measurement};
pub use render::Renderer;
pub use scene::Scene;
pub use settings::Settings;
