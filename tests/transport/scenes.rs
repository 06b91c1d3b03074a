//! The scenes of this project, small: images and noise. The others are in `tests/check/scenes.rs`.

use crate::common::scene_case::Case;

#[test]
fn cornell_box() {
    let (light_paths, iterations, measured) = (40_000, 30, 600);
    Case { name: "cornell-box", light_paths, iterations, measured, ..Case::default() }.check();
}
