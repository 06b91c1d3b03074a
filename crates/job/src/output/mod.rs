//! Files of renders under way.

pub mod checkpoint;
pub mod denoise;
mod enlarge;
pub mod layers;
pub mod light_layers;
pub mod light_mix;
pub mod light_sample;
pub mod merge;
pub mod recorded_camera;
pub mod recorded_gamut;
pub mod recorded_error;

pub use enlarge::enlarge;
