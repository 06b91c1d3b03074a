//! Noise in media by the query that `tests/transport/media_merges.rs` leaves out.

use crate::common::fog::assert_noise_in_media;
use bdpm::settings::MediumQuery;

#[test]
fn noise_in_media_is_predicted() {
    assert_noise_in_media((2, MediumQuery::Points, 1.0));
}
