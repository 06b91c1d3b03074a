//! What all stages use: errors, vectors and sampling, random numbers, memory, files that appear whole.

pub mod atomic;
pub mod error;
pub mod math;
pub(crate) mod memory;
pub(crate) mod pool;
pub mod rng;
