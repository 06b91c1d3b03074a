//! Measured coefficients, what follows from them, and what they rest on.

#[path = "../common/automatic.rs"]
mod automatic;
#[path = "../common/mod.rs"]
mod common;
#[path = "../common/far_counts.rs"]
mod far_counts;

mod counts;
mod estimators;
mod files;
mod merge;
mod optimize;
mod predicts;
mod reproduce;
mod scene;
mod technique;
mod timing_fit;
