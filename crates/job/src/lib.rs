//! Jobs of bdpm: one call renders an image ([`RenderJob`]), measures light ([`MeasureJob`]), or the
//! daylight of a year ([`DaylightJob`](daylight::DaylightJob)).
//!
//! Here live the loop over iterations, what a job leaves behind (checkpoints, layers, the denoised
//! image), and the exchange between processes. Nothing here knows formats of scene files, chooses
//! settings, or prints.

pub mod output;
#[doc(hidden)] // public for the program
pub mod mpi;
pub mod job;
pub mod measurement;
pub mod daylight;
pub mod judge;

pub use job::{Event, RenderJob, RenderResult};
pub use measurement::{MeasureJob, Measurement};
