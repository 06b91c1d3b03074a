//! Shapes that several formats have, as triangle meshes, and their placement in the scene.

pub mod curves;
pub mod instancing;
pub mod polygon;
pub mod round;
