//! The image under way: sums of its pixels, paths to take for each, times of the phases.

pub mod beyond;
pub mod compare;
pub mod counts;
pub mod film;
pub mod layers;
mod phase_times;

pub use phase_times::PhaseTimes;
