//! Meters around a globe in all directions, of which `tests/program/measure_glass.rs` has some.

use crate::common::glass_globe::{DIRECTIONS, assert_globe_shows_its_lamp_once};

#[test]
fn meters_on_axis_and_seams_of_a_globe_see_its_lamp_once() {
    assert_globe_shows_its_lamp_once(&(0..DIRECTIONS).collect::<Vec<_>>());
}
