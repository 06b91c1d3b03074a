//! A ball of strong dispersion by weights that `tests/transport/dispersion.rs` leaves out.

use crate::common::dispersive_box::assert_means_of_the_path_tracer;
use crate::common::several_ways::WEIGHTINGS;

#[test]
fn all_strategies_and_the_path_tracer_have_one_mean_of_each_channel() {
    assert_means_of_the_path_tracer(false, &WEIGHTINGS[1..]);
}
