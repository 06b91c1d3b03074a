//! Photons of caustics alone with the balls and the strategy that `tests/transport/caustics.rs`
//! leaves out.

use crate::common::caustics::{
    assert_far_counts, assert_light_of_panels, assert_light_of_points, balls,
};
use bdpm::settings::Strategy;

#[test]
fn light_of_panels_is_that_of_path_tracing() {
    assert_light_of_panels(&balls()[1..]);
}

#[test]
fn light_of_points_is_that_of_photons_of_all_kinds() {
    assert_light_of_points(&balls()[1..]);
}

#[test]
fn noise_is_predicted_at_far_counts() {
    assert_far_counts(Strategy::GatherCaustics);
}
