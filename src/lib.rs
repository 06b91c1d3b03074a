//! Bidirectional photon mapping that knows its own noise.

pub mod accel;
pub mod error;
pub mod math;
pub mod rng;
pub mod scene;
pub mod settings;

pub use error::{Error, Result};
pub use scene::Scene;
pub use settings::Settings;
