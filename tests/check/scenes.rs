//! The scenes of this project, small: images and noise. One more is in `tests/transport/scenes.rs`.

use crate::common::scene_case::Case;

#[test]
fn keyhole() {
    Case { name: "keyhole", light_paths: 300_000, error: 0.07, ..Case::default() }.check();
}

#[test]
fn caustic_sphere() {
    // Edges of the lamp, seen twice.
    Case { name: "caustic-sphere", quiet: 0.8, ..Case::default() }.check();
}

#[test]
fn point_caustic() {
    Case { name: "point-caustic", ..Case::default() }.check();
}

#[test]
fn daylight() {
    Case { name: "daylight", guide: 24, ..Case::default() }.check();
}

#[test]
fn materials() {
    Case { name: "materials", ..Case::default() }.check();
}

#[test]
fn objective() {
    Case { name: "objective", ..Case::default() }.check();
}

#[test]
fn hall() {
    // Flames are smaller than pixels, and a pixel sees few of the light paths.
    let (radius, quiet, error) = (0.005, 0.5, 0.12);
    Case { name: "hall", radius, quiet, error, ..Case::default() }.check();
}
