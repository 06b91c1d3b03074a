//! Files of renders under way.

pub mod checkpoint;
pub mod denoise;
pub mod layers;
pub mod merge;
#[cfg(feature = "cli")]
#[doc(hidden)] // public for the program
pub mod page;
