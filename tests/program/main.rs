//! The program as its users meet it.

#[path = "../common/program.rs"]
mod program;

mod automatic;
mod denoise;
mod limits;
mod noise;
mod optimize;
mod outputs;
mod render;
mod reproduce;
mod timings;
