//! Common ground of all stages: errors, vectors and sampling, random numbers, iteration sets,
//! memory and files.

pub mod atomic;
pub mod duration;
pub mod error;
pub mod file_id;
pub mod input;
pub mod math;
pub mod names;
pub mod memory;
pub mod iteration_set;
pub mod photometry;
pub mod pool;
pub mod quantiles;
pub mod rng;
pub mod spectrum;
