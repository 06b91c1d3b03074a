//! Sheets in a furnace by the techniques that `tests/transport/materials_furnace.rs` leaves out.

use crate::common::white_furnace::{EVERY_WAY, assert_sheets_are_invisible};

#[test]
fn sheets_in_a_furnace_keep_its_radiance() {
    assert_sheets_are_invisible(&EVERY_WAY[2..]);
}
