//! The core of bdpm: from a scene in memory to an image that knows its own error.
//!
//! Here live scenes, light transport, photon maps, and [`Renderer`], which renders iterations. All
//! of it is in one crate, since the hot path spans its modules. Vectors, image files, settings and
//! the statistics of an image are in crates below this one, which it shows as its own modules.
//! Nothing here knows formats of scene files, decides how long to render, or prints.

// In the order of the stages: no module names one that comes after it.
pub mod scene;
#[doc(hidden)] // public for tests and benches
pub mod transport;
pub mod render;

#[doc(inline)]
pub use bdpm_accel as accel;
#[doc(inline)]
pub use bdpm_base as base;
#[doc(hidden)] // public for tests and benches
pub use bdpm_base::simd;
pub use bdpm_base::{Error, Result};
#[doc(inline)]
pub use bdpm_image as image_io;
#[doc(inline)]
pub use bdpm_statistics::{film, noise, settings};
/// Vectors and transforms of the interface, in the version that this crate uses.
pub use glam;
pub use render::Renderer;
pub use scene::Scene;
pub use settings::Settings;
