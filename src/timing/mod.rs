//! How long an iteration takes: measured phase by phase, fitted, and kept in files.
//!
//! [`sample`] holds the times of single iterations, [`grid`] says at which counts they are taken,
//! [`fit`] turns them into a [`TimeModel`], [`criterion`] and [`file`](mod@file) read what others
//! have measured, [`setup`] keeps foreign times away.

pub mod criterion;
pub mod file;
pub mod fit;
pub mod grid;
mod model;
pub mod report;
pub mod sample;
pub mod setup;
mod solve;

pub use file::Timings;
pub use model::TimeModel;
