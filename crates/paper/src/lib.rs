//! The paper's experiment repeated: measurements, and comparisons with the published values.
//!
//! [`measurement`] lists the measurements, [`run`] takes them and can be stopped at any time, and
//! [`folder`] keeps their results. [`results`] derives the figures and tables of the paper from
//! them. [`comparisons`] judge which values agree with the paper, and [`report`] writes one HTML
//! file. [`implied`] derives values from the published numbers alone.

pub mod comparisons;
pub mod estimators;
pub mod findings;
pub mod folder;
pub mod implied;
pub mod optimum;
pub mod measurement;
pub mod published;
pub mod report;
pub mod results;
pub mod run;
pub mod tables;
pub mod terms;
