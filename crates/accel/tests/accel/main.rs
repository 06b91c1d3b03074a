//! Both backends of ray tracing. Apart from `tests/suite.rs` because `make check` runs these tests
//! without Embree and `scripts/valgrind.sh` runs them under valgrind, so the program stays small.

extern crate self as bdpm; // `shapes` names the types as the whole library does
pub use bdpm_accel as accel;

#[path = "../../../../tests/common/shapes.rs"]
mod shapes;

mod bvh;
#[cfg(feature = "embree")]
mod embree;
