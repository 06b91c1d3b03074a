//! Files of renders under way.

pub mod checkpoint;
pub mod denoise;
#[cfg(feature = "cli")]
#[doc(hidden)] // public for the program
pub mod false_color;
#[cfg(feature = "cli")]
#[doc(hidden)] // public for the program
pub mod glare;
#[cfg(feature = "cli")]
#[doc(hidden)] // public for the program
pub mod isolines;
pub mod layers;
#[cfg(feature = "cli")]
#[doc(hidden)] // public for the program
pub mod polar_plot;
pub mod merge;
#[cfg(feature = "cli")]
#[doc(hidden)] // public for the program
pub mod page;
pub mod recorded_camera;
