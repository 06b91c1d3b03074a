//! White sheets in a furnace by the techniques that
//! `tests/transport/diffuse_transmission.rs` leaves out.

use crate::common::several_ways::{WAYS, WEIGHTINGS, assert_white_sheets};

#[test]
fn white_sheets_in_a_furnace_have_its_radiance() {
    assert_white_sheets(false, &WAYS[..1], &WEIGHTINGS[4..]);
    assert_white_sheets(true, &WAYS[1..], &WEIGHTINGS[..2]);
}
