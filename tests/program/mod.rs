//! The program as its users meet it.

mod audit;
mod automatic;
mod combinations;
mod denoise;
mod glare;
mod goniometer;
mod image_info;
mod interrupts;
mod limits;
mod measure;
mod measure_dark;
mod measure_glass;
mod merge;
mod noise;
mod optimize;
mod options;
mod outputs;
mod page;
mod photometric;
mod render;
mod render_text;
mod reproduce;
mod room_glare;
mod timings;
mod tone;
mod view;
