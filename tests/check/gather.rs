//! Camera paths that end at a cache, at surfaces that `tests/transport/gather.rs` leaves out.

use crate::common::cached_light::{SHORT, assert_cached_light, assert_suffix_paths, scenes};

#[test]
fn cached_light_is_that_of_full_paths() {
    assert_cached_light(&scenes()[SHORT..]);
}

#[test]
fn suffix_paths_tell_what_a_bad_cache_adds() {
    assert_suffix_paths(&scenes()[SHORT..]);
}
