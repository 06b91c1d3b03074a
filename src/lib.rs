#![doc = include_str!("../README.md")]

#[doc(inline)]
pub use bdpm_auto::{Stop, adaptive, timing};
#[doc(inline)]
pub use bdpm_core::{
    Error, Renderer, Result, Scene, Settings, accel, base, film, glam, image_io, noise, render,
    scene, settings,
};
#[doc(hidden)] // public for tests and benches
pub use bdpm_core::{simd, transport};
#[doc(inline)]
pub use bdpm_import as import;
#[doc(hidden)] // public for the program
pub use bdpm_job::mpi;
#[doc(inline)]
pub use bdpm_job::{
    Event, MeasureJob, Measurement, RenderJob, RenderResult, daylight, job, judge, measurement,
    output,
};
#[doc(inline)]
pub use bdpm_light as light;
#[doc(inline)]
pub use bdpm_load as load;
#[doc(inline)]
pub use bdpm_load::load;
#[cfg(feature = "paper")]
#[doc(hidden)] // public for the program
pub use bdpm_paper as paper;
#[cfg(feature = "cli")]
#[doc(hidden)] // public for the program
pub use bdpm_report as report;
