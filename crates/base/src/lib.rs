//! The common ground of all stages of bdpm.
//!
//! Here live errors, vectors and sampling, random numbers, wavelengths and refractive indices,
//! iteration sets, memory and files, and numbers of many paths side by side. Nothing here knows
//! scenes, images, or how light is transported.

// In the order of the stages: no module names one that comes after it.
pub mod names;
pub mod error;
pub mod memory;
pub mod file_id;
pub mod input;
pub mod atomic;
pub mod duration;
pub mod iteration_set;
pub mod rng;
pub mod math;
pub mod angles;
pub mod photometry;
pub mod pool;
pub mod quantiles;
pub mod spectrum;
mod glasses;
pub mod dispersion;
#[doc(hidden)] // public for the renderer, tests and benches
pub mod simd;

pub use error::{Error, Result};
