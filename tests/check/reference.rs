//! The renderer against the path tracer: the materials that `tests/transport/reference.rs` leaves
//! out.

use crate::common::MIS;
use crate::common::boxes;
use crate::common::strategies::assert_same;
use bdpm::settings::Direct::{Connect, PhotonMap};

#[test]
#[ignore = "takes minutes: make check-long"]
fn a_ball_of_each_material_under_a_panel() {
    for (name, _) in boxes::balls() {
        if !["glass-ball", "rough-metal-ball"].contains(&name) {
            assert_same(name, &[(Connect, 2), (PhotonMap, 1), (Connect, MIS)]);
        }
    }
}

#[test]
fn pictures_of_everything_in_a_box() {
    assert_same("pictures", &[(Connect, MIS), (Connect, 2), (Connect, 1), (PhotonMap, 1)]);
}
