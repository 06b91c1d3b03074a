//! What all stages use: errors, vectors and sampling, random numbers, sets of numbers, memory, files: which one a path
//! stands for, those that are read, and those that appear whole.

pub mod atomic;
pub mod error;
pub mod file_id;
pub mod input;
pub mod math;
pub(crate) mod memory;
pub mod iteration_set;
pub(crate) mod pool;
pub mod rng;
