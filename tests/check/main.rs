//! What `make test` has no time for: the long statistical tables, of which it has a case or two in a
//! module of the same name, the paper's experiment, and a page of a render. `make check` runs the tables,
//! `make check-report` the others.

#[path = "../common/mod.rs"]
mod common;

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
