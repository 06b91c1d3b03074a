//! Errors of mixtures of light sources in scenes that `tests/program/light_groups.rs` leaves out.

// Not a module of `common`, which an example includes as well: it starts the program.
#[path = "../common/light_mixtures.rs"]
mod light_mixtures;

use light_mixtures::assert_mixtures_state_their_error;

#[test]
fn random_mixtures_have_the_error_that_they_state() {
    for (name, environment, lights) in [("cornell-box-classic", "0.1", 2), ("materials", "0.3", 4)]
    {
        assert_mixtures_state_their_error(name, &["--environment", environment], lights);
    }
}
