//! Files of renders under way.

pub mod checkpoint;
pub mod merge;
