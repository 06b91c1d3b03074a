//! The noise of the materials that `tests/transport/materials_light.rs` leaves out.

use crate::common::material_noise::{assert_predicted, materials};

#[test]
#[ignore = "takes minutes: make check-long"]
fn the_noise_of_each_material_is_predicted() {
    for (name, _) in materials() {
        if !["glass", "gloss"].contains(&name) {
            assert_predicted(name);
        }
    }
}
