//! The settings of an image, and its statistics.
//!
//! Here live the settings that determine an image beside its scene, sums per pixel, and the noise
//! model with the estimators of its coefficients. Nothing here knows scenes or how paths are
//! sampled.

// In the order of the stages: no module names one that comes after it.
pub mod settings;
pub mod film;
pub mod noise;
