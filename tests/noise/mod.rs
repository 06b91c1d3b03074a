//! Measured coefficients, what follows from them, and what they rest on.

mod audit;
mod audit_image;
mod camera_points;
mod counts;
mod estimators;
mod failures;
mod files;
mod interval;
mod large;
mod merge;
mod optimize;
mod predicts;
mod ranks;
mod reproduce;
mod scene;
mod technique;
mod timing_fit;
