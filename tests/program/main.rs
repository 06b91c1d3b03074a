//! The program as its users meet it.

#[path = "../common/desk.rs"]
mod desk;
#[path = "../common/html.rs"]
mod html;
#[path = "../common/program.rs"]
mod program;

mod automatic;
mod denoise;
mod interrupts;
mod limits;
mod merge;
mod noise;
mod optimize;
mod outputs;
mod page;
mod render;
mod reproduce;
mod timings;
mod view;
