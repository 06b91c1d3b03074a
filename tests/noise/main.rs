//! Measured coefficients, what follows from them, and what they rest on.

#[path = "../common/mod.rs"]
mod common;

mod counts;
mod estimators;
mod files;
mod optimize;
mod predicts;
mod reproduce;
mod scene;
mod timing_fit;
