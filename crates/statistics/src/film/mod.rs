//! Per-pixel sums of the image and of everything that is kept beside it, and path counts.

pub mod annulus;
pub mod aov;
pub mod cells;
pub mod compare;
pub mod counts;
pub mod features;
pub mod folds;
pub mod halves;
pub mod light_components;
mod phase_times;
pub mod radiance;
pub mod seen_lights;
pub mod smoothing;
pub mod statistic;
pub mod tiled_buffer;
pub mod windows;

pub use phase_times::PhaseTimes;
