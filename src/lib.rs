//! Bidirectional photon mapping that knows its own noise.

pub mod accel;
