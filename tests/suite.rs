//! The tests of `make test` in one program, so that the library is linked and the helpers are
//! compiled once. Run one family or one file by its path:
//! `cargo test --test suite noise::optimize`.

#[allow(dead_code)] // the tests use its parts, not its `main`
#[path = "../examples/make_scenes/main.rs"]
mod make_scenes;

mod common;
mod docs;
mod files;
mod noise;
mod optics;
mod program;
mod stages;
mod transport;
