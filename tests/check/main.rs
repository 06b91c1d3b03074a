//! What `make test` has no time for: the long statistical tables, of which it has a case or two in a
//! module of the same name, the paper's experiment, and a page of a render. `make check` runs the tables,
//! `make check-report` the others.

#[path = "../common/automatic.rs"]
mod automatic;
#[path = "../common/boxes.rs"]
mod boxes;
#[path = "../common/committed.rs"]
mod committed;
#[path = "../common/mod.rs"]
mod common;
#[path = "../common/denoised.rs"]
mod denoised;
#[path = "../common/far_counts.rs"]
mod far_counts;
#[path = "../common/material_noise.rs"]
mod material_noise;
#[path = "../common/program.rs"]
mod program;
#[path = "../common/scene_case.rs"]
mod scene_case;
#[path = "../common/several_ways.rs"]
mod several_ways;
#[path = "../common/strategies.rs"]
mod strategies;
#[path = "../common/true_bias.rs"]
mod true_bias;

mod choice;
mod counts;
mod denoise;
mod kernel;
mod materials_light;
mod mis;
mod page;
mod predicts;
mod reference;
mod report;
mod scenes;
