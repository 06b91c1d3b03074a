//! The program as its users meet it.

#[path = "../common/program.rs"]
mod program;

mod automatic;
mod noise;
mod optimize;
mod render;
mod reproduce;
mod timings;
