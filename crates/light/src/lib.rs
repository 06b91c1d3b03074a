//! Light as bdpm describes it and reads it, without rendering.
//!
//! Here live photometric files, models of the sky, the polar diagram of a luminaire, and what is
//! read from a picture: glare, false colors, isolines. Nothing here knows scene files, traces rays,
//! or prints.

#[cfg(feature = "pictures")]
#[doc(hidden)] // public for the program
pub mod false_color;
#[doc(hidden)] // public for the program
pub mod glare;
#[doc(hidden)] // public for the program
pub mod grouped_intensities;
#[cfg(feature = "pictures")]
#[doc(hidden)] // public for the program
pub mod isolines;
pub mod photometry;
#[doc(hidden)] // public for the program
pub mod polar_plot;
pub mod sky;
#[doc(hidden)] // public for the program
pub mod step_blur;
pub mod weather;
