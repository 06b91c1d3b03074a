//! Decisions while an image is rendered: technique, radii, counts, and when to stop.

pub mod autopilot;
mod count_choice;
pub mod count_policy;
pub mod denoised_noise;
pub mod error_interval;
mod neighbor_counts;
pub mod optimize;
pub mod plan;
pub mod stopping;
pub mod technique;
pub mod time_probe;
