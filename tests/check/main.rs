//! Tests that are too long for `make test`: statistical tables, the paper's experiment, and pages.
//! `make check` runs the tables, `make check-long` the longest ones, `make check-report` the
//! others. The suite has a case or two of each table in a module of the same name.

#[path = "../common/mod.rs"]
mod common;

mod caustics;
mod choice;
mod counts;
mod denoise;
mod diffuse_transmission;
mod dispersion;
mod gather;
mod kernel;
mod light_groups;
mod materials_furnace;
mod materials_light;
mod measure_glass;
mod measure_page;
mod media_merges;
mod mis;
mod mix_page;
mod page;
mod predicts;
mod reference;
mod report;
mod scenes;
