//! What bdpm decides by itself: technique, radii, counts, and when to stop.
//!
//! [`timing`] measures and models the time of an iteration, and [`adaptive`] weighs it against the
//! measured noise. Both render with [`bdpm_core`], a few iterations at a time. Nothing here reads
//! scene files, keeps an image, or prints.

mod bisect;
pub mod timing;
pub mod adaptive;
#[cfg(test)]
mod test_scene;

pub use adaptive::stopping::Stop;
