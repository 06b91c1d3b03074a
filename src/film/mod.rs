//! The image under way: sums of its pixels, paths to take for each, times of the phases.

pub mod annulus;
pub mod compare;
pub mod counts;
pub mod radiance;
pub mod aov;
mod phase_times;

pub use phase_times::PhaseTimes;
